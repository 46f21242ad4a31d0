"""References to touched surfaces and lines: spheres, planes and lines at unknown positions.

A ball tip touches with its surface, while the chain describes its centre. The centre moves on a sphere larger by the
radius of the ball (smaller, if touched from inside), on a plane parallel to the touched one, on a line along a groove.
The radius of a sphere here is this *effective* radius of sphere and ball together.

Residuals are distances [mm] from the nearest point, as in orthogonal regression: A. B. Forbes, "Least-squares best-fit
geometric elements", NPL Report DITC 140/89, National Physical Laboratory 1989.

Distances of the tip to anchors: fixed points at unknown places, as of a draw-wire encoder or a ball bar.

The residual is ``|t - a| + o - d`` with the tip t, the anchor a, the offset o that all distances to the anchor share,
and the stated distance d. Distances are absolute: they determine the size of the arm, as far as they determine the
offset.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np

from truearm.arm.rigid_motions import rotations_and_jacobians
from truearm.errors import InputError
from truearm.identification.references.references import Constraints, LinearisedResiduals, number_names
from truearm.readings.anchors import LEAST_READINGS, locate_anchor, offset_std
from truearm.readings.session import Session
from truearm.typing import FloatArray, IntArray, NameArray

OF_ANCHOR = ("x of anchor {} [mm]", "y of anchor {} [mm]", "z of anchor {} [mm]", "offset of anchor {} [mm]")


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances of the tip to anchors.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    anchor : (m,) int array
        The anchor of each, an index of `names`.
    names : tuple of str
    distances : (m,) array
        As stated [mm].
    distance_std : (m,) array
        Their standard uncertainties; 0 where only the noise counts [mm].
    offset_stds : (n_anchors,) array
        Standard uncertainties of the offsets [mm].

    Raises
    ------
    InputError
        If an anchor has fewer than four readings, a distance is not positive, or an uncertainty is negative.

    Notes
    -----
    At the anchor the distance has no direction; the derivative is zero there. Tips are a wire away.
    """

    rows: IntArray
    anchor: IntArray
    names: tuple[str, ...]
    distances: FloatArray
    distance_std: FloatArray
    offset_stds: FloatArray
    kind = "distance"
    repeat_variance: ClassVar[None] = None
    n_residuals = 1
    uses_orientation = False
    least: ClassVar[int] = LEAST_READINGS

    def __post_init__(self) -> None:
        shape = (len(self.rows),)
        if {np.shape(self.anchor), np.shape(self.distances), np.shape(self.distance_std)} != {shape}:
            raise InputError(f"expected an anchor, a distance and its uncertainty at each of {len(self.rows)} readings")
        if len(self.offset_stds) != len(self.names) or not np.isin(self.anchor, np.arange(len(self.names))).all():
            raise InputError(f"expected one of {len(self.names)} anchors at every reading, each with its offset")
        if not (np.isfinite(self.distances) & (self.distances > 0) & (self.distance_std >= 0)).all():
            raise InputError("expected positive distances to anchors, and uncertainties of 0 or more")
        if not (np.isfinite(self.offset_stds) & (self.offset_stds > 0)).all():
            raise InputError("expected positive standard uncertainties of the offsets of anchors")
        count = np.bincount(self.anchor, minlength=len(self.names))
        if count.min(initial=self.least) < self.least:
            fewest = int(np.argmin(count))
            raise InputError(
                f"expected at least {self.least} distances to anchor {self.names[fewest]!r}, the minimum that "
                f"determines it, got {count[fewest]}"
            )

    @property
    def std(self) -> FloatArray:
        """(1, m) stated standard uncertainties [mm]."""
        return self.distance_std[None]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Coordinates and offset of every anchor."""
        return tuple(what.format(name) for name in self.names for what in OF_ANCHOR)

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """The anchors by multilateration from the tips."""
        found = [
            locate_anchor(tips[:, self.anchor == i].T, self.distances[self.anchor == i], offset_std=std)
            for i, std in enumerate(self.offset_stds.tolist())
        ]
        return self, np.concatenate([np.zeros(0), *(np.append(one.place, one.offset) for one in found)])

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del axes
        anchor = self.anchor[which]
        x, y, z, offset = unknowns.reshape(-1, 4)[anchor].T
        away = tips - np.stack([x, y, z])
        distance = np.sqrt((away**2).sum(axis=0))
        outward = away / np.where(distance > 0, distance, 1.0)
        by_unknown = np.concatenate([-outward, np.ones((1, len(anchor)))])
        residuals = distance + offset - self.distances[which]
        return LinearisedResiduals(residuals[None], outward[None], 4 * anchor + np.arange(4)[:, None], by_unknown[None])

    def constraints(self, unknowns: FloatArray) -> Constraints:
        """The priors of the offsets: zero, with their standard uncertainties."""
        n = len(self.names)
        by = np.zeros((n, 4 * n))
        by[np.arange(n), 4 * np.arange(n) + 3] = 1.0
        offsets = unknowns[3::4]
        names = tuple(f"offset of anchor {name}" for name in self.names)
        return Constraints(offsets, by, self.offset_stds, names, np.stack([offsets, np.zeros(n)], axis=1))


def distances_of(readings: Session, rows: IntArray) -> Distances:
    """Create distances from the readings `rows` of a session, which have them."""
    assert readings.anchor is not None  # checked by the session
    assert readings.distance_mm is not None
    names, anchor = number_names(readings.anchor[rows])
    std = np.zeros(len(rows)) if readings.u_distance_mm is None else readings.u_distance_mm[rows]
    offset_stds = np.array([offset_std(readings, name) for name in names])
    return Distances(rows, anchor, names, readings.distance_mm[rows], std, offset_stds)


def is_offset(name: str) -> bool:
    """Whether a constraint of this name is the prior of an offset."""
    return name.startswith("offset of anchor ")


# Spheres with the same radius and uncertainty are one ball at several places; their radii differ by no more than this
# share of the uncertainty. Differences between touches are in the noise.
EQUAL_SHARE = 0.1


class Radius(NamedTuple):
    """A known radius.

    Attributes
    ----------
    sphere : int
    radius_mm, std_mm : float
        The effective radius, including the ball of the tip, and its standard uncertainty [mm].
    """

    sphere: int
    radius_mm: float
    std_mm: float


@dataclass(frozen=True, eq=False)
class Spheres:
    """Spheres touched from many sides, with known or unknown radii.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    touched : (m,) int array
        The sphere of each, an index of `names`.
    names : tuple of str
    radii : tuple of Radius
        The known radii. Spheres of equal radius and uncertainty are one ball at several places, with one certificate.

    Raises
    ------
    InputError
        If a sphere has fewer than four readings, or a radius is not positive.

    Notes
    -----
    At the centre of a sphere the distance has no direction; the derivative is zero there. Tips are a radius away.
    """

    rows: IntArray
    touched: IntArray
    names: tuple[str, ...]
    radii: tuple[Radius, ...] = ()
    kind = "sphere"
    repeat_variance: ClassVar[None] = None
    n_residuals = 1
    uses_orientation = False
    least: ClassVar[int] = 4

    def __post_init__(self) -> None:
        _check_counts(self.kind, self.touched, self.names, least=self.least)
        for sphere, radius, std in self.radii:
            if not (np.isfinite(radius) and radius > 0 and np.isfinite(std) and std > 0):
                raise InputError(
                    f"expected a positive radius and uncertainty of sphere {self.names[sphere]!r}, "
                    f"got {radius} mm and {std} mm"
                )

    @property
    def std(self) -> FloatArray:
        """(1, m) zeros: only the noise counts [mm]."""
        return np.zeros((1, len(self.rows)))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Centres and radii, then radii that several spheres share."""
        spheres = [
            f"{what} of sphere {name} [mm]"
            for name in self.names
            for what in ("x of the centre", "y of the centre", "z of the centre", "effective radius")
        ]
        return (*spheres, *(f"effective radius of spheres of {r!r} mm, u {u!r} mm [mm]" for r, u in self._shared))

    @property
    def _shared(self) -> list[tuple[float, float]]:
        """Radii and uncertainties that several spheres share."""
        count = Counter((radius.radius_mm, radius.std_mm) for radius in self.radii)
        return [one for one, n in count.items() if n > 1]

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """The best-fit spheres of the tips."""
        known = {radius.sphere: radius.radius_mm for radius in self.radii}
        fits = [_sphere(tips[:, self.touched == i], known.get(i)) for i in range(len(self.names))]
        return self, np.concatenate([*fits, [radius for radius, _ in self._shared]])

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del axes
        touched = self.touched[which]
        x, y, z, radius = unknowns[: 4 * len(self.names)].reshape(-1, 4)[touched].T
        away = tips - np.stack([x, y, z])
        distance = np.sqrt((away**2).sum(axis=0))
        outward = away / np.where(distance > 0, distance, 1.0)
        by_unknown = -np.concatenate([outward, np.ones((1, len(touched)))])
        return LinearisedResiduals(
            (distance - radius)[None], outward[None], 4 * touched + np.arange(4)[:, None], by_unknown[None]
        )

    def constraints(self, unknowns: FloatArray) -> Constraints | None:
        """The known radii.

        A radius that several spheres share is an unknown, so that many spheres do not make it more certain than its
        certificate; as for lengths of an artefact (`truearm.identification.references.references.Seats`).
        """
        if not self.radii:
            return None
        first = 4 * len(self.names)
        number = {shared: first + i for i, shared in enumerate(self._shared)}
        n = len(self.radii)
        residuals, std = np.empty(n + len(number)), np.empty(n + len(number))
        by = np.zeros((n + len(number), len(unknowns)))
        for i, (sphere, radius, u) in enumerate(self.radii):
            at = 4 * sphere + 3
            by[i, at] = 1.0
            if (shared := number.get((radius, u))) is None:
                residuals[i], std[i] = unknowns[at] - radius, u
            else:
                residuals[i], std[i] = unknowns[at] - unknowns[shared], EQUAL_SHARE * u
                by[i, shared] = -1.0
        for i, ((radius, u), shared) in enumerate(number.items(), start=n):
            residuals[i], std[i] = unknowns[shared] - radius, u
            by[i, shared] = 1.0
        of_one = [f"distance of sphere {self.names[radius.sphere]}" for radius in self.radii]
        names = (*of_one, *(f"distance of spheres of {r!r} mm" for r, _ in number))
        stated = [radius.radius_mm for radius in self.radii]
        found = [unknowns[4 * radius.sphere + 3] for radius in self.radii]
        values = [(*found, *(unknowns[at] for at in number.values())), (*stated, *(r for r, _ in number))]
        return Constraints(residuals, by, std, names, np.array(values).T)


@dataclass(frozen=True, eq=False)
class _Straight:
    """Planes or lines: the z axis of a frame is the normal or the direction; residuals are across the plane or line.

    Unknown are the tilts of the frame about its first two axes, relative to its initial orientation, so that no
    direction is singular, and its offsets across.
    """

    rows: IntArray
    touched: IntArray
    names: tuple[str, ...]
    frames: FloatArray | None = None
    origins: FloatArray | None = None
    kind = ""
    uses_orientation = False
    # Axes of the frame along which residuals are counted.
    across: ClassVar[tuple[int, ...]] = ()
    least: ClassVar[int] = 0

    def __post_init__(self) -> None:
        _check_counts(self.kind, self.touched, self.names, least=self.least)

    @property
    def n_residuals(self) -> int:
        """See `Reference`."""
        return len(self.across)

    @property
    def std(self) -> FloatArray:
        """(k, m) zeros: only the noise counts [mm]."""
        return np.zeros((self.n_residuals, len(self.rows)))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Tilts and offsets relative to the initial frame."""
        offsets = ["offset"] if len(self.across) == 1 else ["first offset", "second offset"]
        what = ["first tilt [rad]", "second tilt [rad]", *(f"{offset} [mm]" for offset in offsets)]
        return tuple(f"{self.kind} {name}, {one}" for name in self.names for one in what)

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """The frames by orthogonal regression to the tips, at which all unknowns are zero."""
        members = [tips[:, self.touched == i] for i in range(len(self.names))]
        origins = np.stack([tip.mean(axis=1) for tip in members])
        frames = np.stack([self._frame(tip - tip.mean(axis=1, keepdims=True)) for tip in members])
        return replace(self, frames=frames, origins=origins), np.zeros(len(self.unknowns))

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del axes
        assert self.frames is not None, "created by initialise"
        assert self.origins is not None
        touched, across = self.touched[which], list(self.across)
        k, size = len(across), 2 + len(across)
        x = unknowns.reshape(-1, size)
        tilted, J = rotations_and_jacobians(np.pad(x[:, :2], ((0, 0), (0, 1))).T)
        along = np.einsum("nab,bcn->acn", self.frames, tilted[:, across])
        turning = np.cross(J[:, :2, None], tilted[:, None, across], axis=0)
        by_tilt = np.einsum("nab,bjcn->ajcn", self.frames, turning)[..., touched]
        away = tips - self.origins[touched].T
        by_tip = along[..., touched].transpose(1, 0, 2)
        residuals = (by_tip * away).sum(axis=1) - x[touched, 2:].T
        by_unknown = np.empty((k, size, len(touched)))
        by_unknown[:, :2] = (by_tilt * away[:, None, None]).sum(axis=0).transpose(1, 0, 2)
        by_unknown[:, 2:] = -np.eye(k)[:, :, None]
        return LinearisedResiduals(residuals, by_tip, size * touched + np.arange(size)[:, None], by_unknown)

    def constraints(self, unknowns: FloatArray) -> None:
        """See `Reference`."""
        del unknowns

    def _frame(self, centred: FloatArray) -> FloatArray:
        """(3, 3) axes as columns: across are those along which the tips spread least."""
        _, axes = np.linalg.eigh(centred @ centred.T)  # the spread grows from column to column
        order = [1, 2, 0] if len(self.across) == 1 else [0, 1, 2]
        frame: FloatArray = axes[:, order]
        frame[:, 0] *= np.sign(np.linalg.det(frame))
        return frame


@dataclass(frozen=True, eq=False)
class Planes(_Straight):
    """Planes touched at many places.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    touched : (m,) int array
        The plane of each, an index of `names`.
    names : tuple of str
    frames : (n_planes, 3, 3) array, optional
        Axes of each as columns, the third its normal, as `initialise` sets them.
    origins : (n_planes, 3) array, optional
        Their origins [mm].

    Raises
    ------
    InputError
        If a plane has fewer than three readings.
    """

    kind = "plane"
    repeat_variance: ClassVar[None] = None
    across = (2,)
    least = 3


@dataclass(frozen=True, eq=False)
class Lines(_Straight):
    """Straight lines along which the tip moves, for example a groove or the edge of a ruler.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    touched : (m,) int array
        The line of each, an index of `names`.
    names : tuple of str
    frames : (n_lines, 3, 3) array, optional
        Axes of each as columns, the third its direction, as `initialise` sets them.
    origins : (n_lines, 3) array, optional
        Their origins [mm].

    Raises
    ------
    InputError
        If a line has fewer than two readings.
    """

    kind = "line"
    repeat_variance: ClassVar[None] = None
    across = (0, 1)
    least = 2


def spheres_of(rows: IntArray, names: NameArray, radii: Sequence[tuple[str, float, float]] = ()) -> Spheres:
    """Create spheres from the sphere name of each reading (m,), with effective radii ``(sphere, radius_mm, u_mm)``.

    Raises
    ------
    InputError
        If no reading touches a sphere that a radius names.
    """
    unique, touched = number_names(names)
    for name, *_ in radii:
        if name not in unique:
            raise InputError(
                f"a radius refers to sphere {name!r}, but no reading touches it",
                hint=f"spheres of the session: {', '.join(unique[:8])}",
            )
    known = tuple(Radius(unique.index(name), float(radius), float(std)) for name, radius, std in radii)
    return Spheres(rows, touched, unique, known)


def planes_of(rows: IntArray, names: NameArray) -> Planes:
    """Create planes from the plane name of each reading (m,)."""
    unique, touched = number_names(names)
    return Planes(rows, touched, unique)


def lines_of(rows: IntArray, names: NameArray) -> Lines:
    """Create lines from the line name of each reading (m,)."""
    unique, touched = number_names(names)
    return Lines(rows, touched, unique)


def _check_counts(kind: str, touched: IntArray, names: tuple[str, ...], *, least: int) -> None:
    count = np.bincount(touched, minlength=len(names))
    if len(count) > len(names):
        raise InputError(f"expected one of {len(names)} {kind}s at every reading, got number {len(count) - 1}")
    if count.min(initial=least) < least:
        fewest = int(np.argmin(count))
        raise InputError(
            f"expected at least {least} readings on {kind} {names[fewest]!r}, the minimum that determines it, "
            f"got {count[fewest]}"
        )


def _sphere(tips: FloatArray, radius: float | None) -> FloatArray:
    """Centre and radius (4,) of the algebraic best-fit sphere of tips (3, m), or of one with a known radius.

    Linear in centre and ``r^2 - c^2``: I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8, of circles.
    """
    middle = tips.mean(axis=1)
    centred = tips - middle[:, None]
    square = float((centred**2).sum(axis=0).mean())
    spread = np.sqrt(square) or 1.0
    unit = centred / spread
    A = np.concatenate([2 * unit, np.ones((1, unit.shape[1]))])
    found, *_ = np.linalg.lstsq(A.T, (unit**2).sum(axis=0), rcond=1e-9)
    towards = found[:3] * spread
    if radius is None:
        return np.array([*(middle + towards), np.sqrt(max(square + towards @ towards, 0.0))])
    # In that direction, at the distance from the mean tip that the known radius leaves: square + distance^2 = radius^2.
    distance = np.sqrt(max(radius**2 - square, 0.0))
    length = float(np.linalg.norm(towards))
    return np.array([*(middle + towards * (distance / length if length else 0.0)), radius])
