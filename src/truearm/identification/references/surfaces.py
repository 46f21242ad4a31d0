"""References to touched surfaces and lines: spheres, planes and lines at unknown positions.

A ball tip touches with its surface, while the chain describes its centre. The centre moves on a sphere larger by the
radius of the ball (smaller, if touched from inside), on a plane parallel to the touched one, on a line along a groove.
The radius of a sphere here is this *effective* radius of sphere and ball together.

Residuals are distances [mm] from the nearest point, as in orthogonal regression: A. B. Forbes, "Least-squares best-fit
geometric elements", NPL Report DITC 140/89, National Physical Laboratory 1989.
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
from truearm.typing import FloatArray, IntArray, NameArray

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
