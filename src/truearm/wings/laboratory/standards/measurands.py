"""The measurands that tests compare with a certificate: the size of a sphere, and a length.

The uncertainty budgets contain artefact and set-up but not the errors of the arm, which are tested (ISO 23165,
recalled). Of a length ``u^2 = u_cal^2 + (L alpha u_T)^2 + (L (T - 20) u_alpha)^2 + u_fixture^2 + u_form^2``; of what
follows from many readings see `decision`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.laboratory.shapes.least_squares_shapes import Sphere, fit_plane, fit_sphere
from truearm.wings.laboratory.standards.artefacts import CalibratedBar, CalibratedLength, CalibratedSphere
from truearm.wings.laboratory.standards.decision import (
    Budget,
    ConformityResult,
    DecisionRule,
    assess_conformity,
    worst_result,
)
from truearm.wings.laboratory.standards.positions import frame_about, hemisphere
from truearm.wings.laboratory.standards.propagation import (
    ErrorSource,
    drawn_budget,
    in_each,
    linear_budget,
    value_range,
)
from truearm.wings.laboratory.standards.specification import Specification

# Fewer points on a ball leave no degree of freedom.
LEAST_ON_BALL = 5
# Chosen here: points that determine a ball this many times less accurately than points all over its half are refused,
# such as points evenly over a cap that ends nearer to its pole than 55 to 60 deg.
LOOSEST = 3.0
# Chosen here: so many times farther from the nearest point than in the planned pattern lies the half of the ball where
# points leave holes. Points anywhere on it: 1.2; to 60 deg from the pole only: 1.1; in three patches of 10 deg: 2.
SPARSEST = 1.5
# Chosen here: so many of the planned points lie apart from each other, by this share of the distance that they have if
# they lie evenly. Points anywhere on the half: 94 %; half of them within 2 deg of the pole: half.
LEAST_APART, APART = 0.7, 0.2
# Of the angle between the normal of a face and a length, 20 deg: a larger one belongs to another face.
LEAST_COSINE = 0.94


def check_spread(points: FloatArray, planned: int) -> None:
    """Check that points are spread over a ball so far that they determine its centre and size.

    The largest standard uncertainty of any combination of centre and radius, for points with equal errors (root of the
    largest eigenvalue of the fit's covariance), is compared with that of the planned number of points evenly over half
    of the ball.

    Parameters
    ----------
    points : (n, 3) array
        [mm]
    planned : int
        The planned number of points.

    Raises
    ------
    InputError
        If two points are the same, they determine no sphere, or determine it `LOOSEST` times less accurately.
    """
    if len(np.unique(points, axis=0)) < len(points):
        raise InputError(
            "two points on the ball have the same coordinates", hint="measure each point; copies are refused"
        )
    loose = _largest_u(points) / _largest_u_of_planned(planned)
    if loose > LOOSEST:
        raise InputError(
            f"the points lie so close together on the ball that its centre and size are {loose:.2g} times more "
            f"uncertain than from points all over its half",
            hint="measure points all over the accessible half of the ball, from the pole to the equator",
        )


def check_pattern(points: FloatArray, centre: FloatArray, planned: int) -> None:
    """Check that points lie as evenly over half of a ball as the planned pattern.

    The angle from a direction to the nearest point, in the mean over the half about the mean point, is compared with
    that of the planned number of points evenly over half of the ball; and points beside each other count as one.

    Parameters
    ----------
    points : (n, 3) array
        [mm]
    centre : (3,) array
        Of the ball [mm].
    planned : int
        The planned number of points.

    Raises
    ------
    InputError
        If it is `SPARSEST` times as large, or larger; or fewer than `LEAST_APART` of the points lie apart.
    """
    away, even = _mean_hole_deg(points - centre), _mean_hole_deg(hemisphere(planned))
    if away > SPARSEST * even:
        raise InputError(
            f"the points leave most of the ball untouched: half of it is {away:.2g} deg from the nearest point in the "
            f"mean, {even:.2g} deg in the pattern of the plan",
            hint="measure points evenly over half of the ball, or change pattern in the plan if your contract says so",
        )
    apart_deg = APART * float(np.degrees(np.sqrt(2 * np.pi / planned)))
    if (n := _count_apart(points - centre, apart_deg)) < LEAST_APART * planned:
        raise InputError(
            f"{n} of {planned} points are apart from each other, by {apart_deg:.2g} deg or more: points beside each "
            "other show one place of the ball",
            hint="measure points evenly over half of the ball, or change pattern in the plan if your contract says so",
        )


def _count_apart(points: FloatArray, apart_deg: float) -> int:
    """Number of points about the origin that are so far apart, each taken if none of those before is nearer."""
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    cosines, most = normals @ normals.T, np.cos(np.radians(apart_deg))
    taken: list[int] = []
    for i in range(len(normals)):
        if not taken or cosines[i, taken].max() <= most:
            taken.append(i)
    return len(taken)


def _mean_hole_deg(points: FloatArray) -> float:
    """The angle to the nearest of some points about the origin, in the mean over the half about their mean [deg]."""
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    middle = normals.mean(axis=0)
    half = hemisphere(400) @ frame_about(middle / max(float(np.linalg.norm(middle)), 1e-9)).T
    return float(np.degrees(np.arccos(np.clip((half @ normals.T).max(axis=1), -1.0, 1.0)).mean()))


def _end_point(points: FloatArray) -> FloatArray:
    """The end of a length: a single point, or the centre of a ball."""
    if len(points) == 1:
        alone: FloatArray = points[0]
        return alone
    if len(points) < LEAST_ON_BALL:
        raise InputError(
            f"expected one point, or {LEAST_ON_BALL} and more all over the ball, got {len(points)}",
            hint="measure more points on the ball",
        )
    check_spread(points, len(points))
    return fit_sphere(points, std_mm=1.0).centre


def _largest_u(points: FloatArray) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(fit_sphere(points, std_mm=1.0).covariance)[-1]))


@cache
def _largest_u_of_planned(n: int) -> float:
    return _largest_u(hemisphere(n))


@dataclass(frozen=True, eq=False)
class SphereMeasurement:
    """A calibrated sphere, touched from outside.

    Attributes
    ----------
    sphere : CalibratedSphere
    points : (n, 3) array
        Compensated points, or centres of the stylus tip [mm].
    degC : float
        Temperature of the sphere.
    tip_mm : float
        Diameter of the stylus tip where points are its centres, 0 where they are compensated.
    where : str
        The position or run, as text.
    """

    sphere: CalibratedSphere
    points: FloatArray
    degC: float = 20.0
    tip_mm: float = 0.0
    where: str = ""

    @cached_property
    def fit(self) -> Sphere:
        """The least-squares sphere through the points."""
        return fit_sphere(self.points)

    @property
    def diameter_mm(self) -> float:
        """The measured diameter at the sphere's temperature [mm]."""
        return 2 * self.fit.radius_mm - self.tip_mm

    def size_error(self, *, corrected: bool) -> float:
        """Return measured less calibrated diameter [mm]; `corrected` to 20 degC or at its temperature."""
        measured = self.sphere.at_reference(self.diameter_mm, self.degC) if corrected else self.diameter_mm
        return measured - self.sphere.diameter_mm

    @cached_property
    def _to_parameters(self) -> FloatArray:
        """What touches that lie off by a little change in the centre and the radius of the fit, (4, n)."""
        normals = (self.points - self.fit.centre) / self.fit.radius_mm
        return np.asarray(np.linalg.pinv(np.column_stack([normals, np.ones(len(normals))])))

    @property
    def _touch_sources(self) -> tuple[ErrorSource, ...]:
        """What form and fixture of the ball do to each touch, along its normal."""
        shape = (len(self.points),)
        return (*self.sphere.form_sources(shape), self.sphere.fixture_source(shape))

    def size_budget(self, *, corrected: bool) -> Budget:
        """Return the uncertainty budget of `size_error`."""
        sphere, one = self.sphere, np.ones(1)
        calibration = ErrorSource(
            "calibration of the diameter", np.array([[sphere.u_diameter_mm]]), sphere.calibration_dof
        )
        thermal = sphere.thermal_sources(sphere.diameter_mm * one, self.degC * one) if corrected else ()
        of_ball = linear_budget(one, [calibration, *thermal])
        of_touches = linear_budget(2 * self._to_parameters[3], self._touch_sources)
        return Budget((*of_ball.contributions, *of_touches.contributions))

    @property
    def form_budget(self) -> Budget:
        """The uncertainty budget of the form."""
        normals = np.linalg.pinv(self._to_parameters)
        to_residuals = np.eye(len(normals)) - normals @ self._to_parameters
        sources = [replace(one, effects=one.effects @ to_residuals) for one in self._touch_sources]
        return drawn_budget(self.fit.residuals, value_range, sources)

    def centre_sources(self) -> list[ErrorSource]:
        """What the form of the ball does to the fitted centre, effects (k, 3)."""
        sources = self.sphere.form_sources((len(self.points),))
        return [replace(one, effects=one.effects @ self._to_parameters[:3].T) for one in sources]


@dataclass(frozen=True, eq=False)
class LengthMeasurement:
    """A calibrated length, measured once.

    Attributes
    ----------
    bar : CalibratedBar
    length : CalibratedLength
    start, end : (n, 3), (m, 3) array
        Points at its two ends: one each, in a seat or on a face; or five and more on a ball; or, of a length between
        faces touched from opposite sides, three and more on a face [mm].
    degC : float
        Temperature of the bar.
    tip_mm : float
        As for `SphereMeasurement`; it matters between opposite faces only.
    position, repeat : str
        The position of the bar and the run.
    symbol : str
        Of the limit of its error. E_Bi is that of faces touched from opposite sides; the others are of balls, seats,
        or faces touched from the same side.
    """

    bar: CalibratedBar
    length: CalibratedLength
    start: FloatArray
    end: FloatArray
    degC: float = 20.0
    tip_mm: float = 0.0
    position: str = ""
    repeat: str = ""
    symbol: str = "E_Uni"

    @property
    def where(self) -> str:
        """The position and the run, as text."""
        return f"position {self.position}" + (f", repeat {self.repeat}" if self.repeat else "")

    @property
    def opposite(self) -> bool:
        """Whether the ends are faces touched from opposite sides."""
        return self.symbol == "E_Bi"

    @cached_property
    def distance_mm(self) -> float:
        """The distance between the ends at the bar's temperature [mm].

        Raises
        ------
        InputError
            If the number of points of an end does not determine it, or they lie too close together on the ball, or not
            across the length.
        """
        if self.opposite:
            return self._between_faces() - self.tip_mm
        centres = []
        for points, name in ((self.start, "A"), (self.end, "B")):
            try:
                centres.append(_end_point(points))
            except InputError as error:
                where = f"length {self.length.name!r}, {self.where}, end {name}"
                raise InputError(f"{where}: {error.problem}", hint=error.hint) from None
        return float(np.linalg.norm(centres[1] - centres[0]))

    def _between_faces(self) -> float:
        """The distance of opposite faces along their normal.

        With three points or more on a face: along the normal of its plane, or the mean of both. With one point on each,
        the direction is unknown by the angle of two points that do not lie opposite: with the standard uncertainty s of
        their distance across the length L in each direction, the distance is too large by ``s^2 / L`` on average, with
        that standard deviation (GUM F.2.4.4, recalled). The average is subtracted.
        """
        where = f"length {self.length.name!r}, {self.where}"
        between = self.end.mean(axis=0) - self.start.mean(axis=0)
        measured = float(np.linalg.norm(between))
        if len(self.start) == len(self.end) == 1:
            if self.bar.u_alignment_mm is None:
                raise InputError(
                    f"{where}: one point on each face does not show how far beside each other they lie: 2 mm beside "
                    "make 100 mm longer by 0.02 mm",
                    hint="measure three points or more on each face, spread over it; or state u_alignment_mm of "
                    f"{self.bar.name!r}, the standard uncertainty of that distance in each direction",
                )
            return measured - self.alignment_mm
        normals = [fit_plane(points, std_mm=1.0).normal for points in (self.start, self.end) if len(points) >= 3]
        if not normals:
            raise InputError(
                f"{where}: expected one point on either face, or three and more on a face, got {len(self.start)} and "
                f"{len(self.end)}",
                hint="measure the missing points",
            )
        normal = np.sum([one * np.sign(one @ between) for one in normals], axis=0)
        size = float(np.linalg.norm(normal))  # 0 where every face lies along the length
        along = float(normal @ between) / size if size else 0.0
        if not along >= LEAST_COSINE * measured or measured == 0:
            raise InputError(
                f"{where}: the points of a face lie in a plane that is not across the length",
                hint="spread the points over the face, and check that they belong to it",
            )
        return along

    @property
    def alignment_mm(self) -> float:
        """By how much single points on opposite faces lie too far apart on average, and its uncertainty [mm]."""
        return (self.bar.u_alignment_mm or 0.0) ** 2 / self.length.length_mm

    def error(self, *, corrected: bool) -> float:
        """Return measured less calibrated length [mm]; `corrected` to 20 degC or at its temperature."""
        measured = self.bar.at_reference(self.distance_mm, self.degC) if corrected else self.distance_mm
        return measured - self.length.length_mm

    def budget(self, *, corrected: bool) -> Budget:
        """Return the uncertainty budget of `error`."""
        return linear_budget(np.ones(1), length_sources([self], corrected=corrected))


def length_sources(lengths: Sequence[LengthMeasurement], *, corrected: bool) -> list[ErrorSource]:
    """Return what artefacts and set-up do to the errors of n measured lengths.

    The calibration of a length is common to all its readings; temperature and expansion to all readings of a bar.
    Form, fixture and the alignment of opposite points are new in each reading.
    """
    bars = {one.bar.name: one.bar for one in lengths}
    of_bar = {name: np.array([one.bar.name == name for one in lengths]) for name in bars}
    sizes = np.array([one.length.length_mm for one in lengths])
    degC = np.array([one.degC for one in lengths])
    calibrated = dict.fromkeys((one.bar.name, one.length.name) for one in lengths)
    calibration = [
        [one.length.u_mm if (one.bar.name, one.length.name) == key else 0.0 for one in lengths] for key in calibrated
    ]
    dof = min(bar.calibration_dof for bar in bars.values())
    sources = [[ErrorSource("calibration of the length", np.array(calibration), dof)]]
    if corrected:
        sources += [list(bar.thermal_sources(sizes * of_bar[name], degC)) for name, bar in bars.items()]
    for name, bar in bars.items():
        each = [*bar.form_sources(sizes.shape, ends=2), bar.fixture_source(sizes.shape)]
        sources.append([replace(one, effects=one.effects * of_bar[name]) for one in each])
    single = np.array([one.opposite and len(one.start) == len(one.end) == 1 for one in lengths])
    if single.any():
        beside = np.array([one.alignment_mm for one in lengths]) * single
        sources.append([in_each("alignment of opposite points", beside, sizes.shape)])
    by_label: dict[str, list[ErrorSource]] = {}
    for one in chain.from_iterable(sources):
        by_label.setdefault(one.label, []).append(one)
    return [
        ErrorSource(label, np.concatenate([one.effects for one in same]), same[0].dof)
        for label, same in by_label.items()
    ]


def worst_size_error(
    symbol: str, spheres: Sequence[SphereMeasurement], specification: Specification, *, rule: DecisionRule
) -> ConformityResult:
    """Return the decisive one of the errors of size of some spheres."""
    corrected, limit = specification.corrected_to_20_degC, specification.limit(symbol)
    return worst_result(
        [
            assess_conformity(
                symbol,
                one.size_error(corrected=corrected),
                one.size_budget(corrected=corrected),
                limit,
                rule=rule,
                where=one.where,
            )
            for one in spheres
        ]
    )
