"""References: what is known of the tip at a reading, as residuals between tips and artefacts with derivatives.

An artefact may have unknowns (the position of a seat, the centre of a sphere), which are identified with the arm.
Arrays have the readings as their last axis, as those of the chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol, Self

import numpy as np

from truearm.arm.chain import MAX_LENGTH_MM
from truearm.errors import InputError
from truearm.typing import FloatArray, IntArray, NameArray


class LinearisedResiduals(NamedTuple):
    """Residuals of m readings and their derivatives.

    Attributes
    ----------
    residuals : (k, m) array
        [mm], or [rad] times a lever [mm].
    by_tip : (k, 3, m) array
        By the tip.
    unknown : (a, m) int array
        The reference's unknowns that each reading depends on.
    by_unknown : (k, a, m) array
        By these unknowns.
    by_turn : (k, 3, m) array, optional
        By a small rotation of the flange about the axes of the tips' frame [1/rad]; None without orientations.
    """

    residuals: FloatArray
    by_tip: FloatArray
    unknown: IntArray
    by_unknown: FloatArray
    by_turn: FloatArray | None = None

    def weighted(self, weights: FloatArray) -> LinearisedResiduals:
        """The same for residuals multiplied by weights (k, m)."""
        each = weights[:, None]
        by_turn = None if self.by_turn is None else each * self.by_turn
        return LinearisedResiduals(
            weights * self.residuals, each * self.by_tip, self.unknown, each * self.by_unknown, by_turn
        )


class Constraints(NamedTuple):
    """Residuals that depend on the unknowns only: lengths between seats.

    Attributes
    ----------
    residuals : (l,) array
        [mm].
    by_unknown : (l, n_unknowns) array
    std : (l,) array
        Standard uncertainties of the stated values [mm].
    names : tuple of str
        What each constrains.
    values : (l, 2) array
        The value by the unknowns, and the stated one [mm].
    """

    residuals: FloatArray
    by_unknown: FloatArray
    std: FloatArray
    names: tuple[str, ...]
    values: FloatArray


class Reference(Protocol):
    """One kind of reference: its readings, and residuals of their tips."""

    @property
    def kind(self) -> str:
        """The name of the kind; the noise is estimated for each kind."""
        ...

    @property
    def rows(self) -> IntArray:
        """(m,) rows of the readings."""
        ...

    @property
    def n_residuals(self) -> int:
        """Number k of residuals of a reading."""
        ...

    @property
    def uses_orientation(self) -> bool:
        """Whether the residuals depend on the orientation of the flange."""
        ...

    @property
    def std(self) -> FloatArray:
        """(k, m) stated standard uncertainties; 0 where only the noise counts [mm]."""
        ...

    @property
    def repeat_variance(self) -> FloatArray | None:
        """(m,) variance by which errors common to repeats lower the weight of each [mm^2]; None without any."""
        ...

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns, with units."""
        ...

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """The reference initialised at the tips (3, m) [mm] of the nominal arm, and start values of its unknowns."""
        ...

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """Residuals and derivatives of the readings `rows[which]`, from their tips (3, m) [mm].

        `axes` (3, 3, m) are the flange's axes as columns in the tips' frame.
        """
        ...

    def constraints(self, unknowns: FloatArray) -> Constraints | None:
        """Constraints among the unknowns; None without any."""
        ...


@dataclass(frozen=True, eq=False)
class Points:
    """Tips whose positions a reference instrument measured.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    points : (m, 3) array
        [mm].
    point_std : (m, 3) array, optional
        Standard uncertainties [mm].
    repeat_variance : (m,) array, optional
        ``(r - 1) u^2`` for r points with a common error of standard uncertainty u, which their mean has too [mm^2].

    Raises
    ------
    InputError
        If shapes do not match, or points are not finite or beyond the reach of any arm.
    """

    rows: IntArray
    points: FloatArray
    point_std: FloatArray | None = None
    repeat_variance: FloatArray | None = None
    kind = "point"
    n_residuals = 3
    uses_orientation = False
    unknowns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what, values in (("points", self.points), ("their standard uncertainties", self.point_std)):
            if values is not None and np.shape(values) != (len(self.rows), 3):
                raise InputError(f"expected {what} of shape {(len(self.rows), 3)}, got {np.shape(values)}")
        bad = ~(np.abs(self.points) <= MAX_LENGTH_MM).all(axis=1)
        if bad.any():
            at = int(np.argmax(bad))
            raise InputError(
                f"expected points within {MAX_LENGTH_MM:g} mm, got {self.points[at].tolist()} "
                f"at reading {self.rows[at] + 1}"
            )

    @property
    def std(self) -> FloatArray:
        """(3, m) standard uncertainties [mm]."""
        return np.zeros((3, len(self.rows))) if self.point_std is None else self.point_std.T

    def select(self, which: IntArray) -> Self:
        """Some of them, in that order."""
        return replace(
            self,
            rows=self.rows[which],
            points=self.points[which],
            point_std=None if self.point_std is None else self.point_std[which],
            repeat_variance=None if self.repeat_variance is None else self.repeat_variance[which],
        )

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """See `Reference`."""
        del tips
        return self, np.zeros(0)

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del unknowns, axes
        m = tips.shape[1]
        return LinearisedResiduals(
            tips - self.points[which].T, _identity(m), np.zeros((0, m), np.intp), np.zeros((3, 0, m))
        )

    def constraints(self, unknowns: FloatArray) -> None:
        """See `Reference`."""
        del unknowns


# The error of an expansion is an unknown in mm/m, about as large as the other unknowns.
MM_PER_M = 1e-3


class Length(NamedTuple):
    """A known length between seats a and b.

    Attributes
    ----------
    a, b : int
        The seats.
    length_mm, std_mm : float
        Its value and standard uncertainty [mm].
    artefact : str
        Name of the artefact; its lengths are the same length, with a common error. Empty: an error of its own.
    place_std_mm : float
        Additional standard uncertainty from place to place [mm]; positive for a length of an artefact.
    growth : float
        Factor of the length by thermal expansion in this place.
    material : str
        Material; the expansions of a material have a common error. Empty: no expansion.
    growth_std : float
        Standard uncertainty of the factor; positive and equal for all lengths of a material.
    """

    a: int
    b: int
    length_mm: float
    std_mm: float
    artefact: str = ""
    place_std_mm: float = 0.0
    growth: float = 1.0
    material: str = ""
    growth_std: float = 0.0


@dataclass(frozen=True, eq=False)
class Seats:
    """Tips in seats: the same unknown point in many poses, some seats a known length apart.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    seat : (m,) int array
        The seat of each, an index of `names`.
    names : tuple of str
    lengths : tuple of Length
        Between pairs of seats.

    Raises
    ------
    InputError
        If a seat is not among the names, a length is from a seat to itself or not positive, or an artefact has several
        lengths.
    """

    rows: IntArray
    seat: IntArray
    names: tuple[str, ...]
    lengths: tuple[Length, ...] = ()
    kind = "seat"
    repeat_variance: ClassVar[None] = None
    n_residuals = 3
    uses_orientation = False

    def __post_init__(self) -> None:
        _check_members(self.kind, self.rows, self.seat, self.names)
        certificates: dict[str, tuple[float, float]] = {}
        growths: dict[str, float] = {}
        for a, b, length, std, artefact, place_std, growth, material, growth_std in self.lengths:
            if a == b:
                raise InputError(f"a length from seat {self.names[a]!r} to itself is not possible")
            if not (np.isfinite(length) and length > 0 and np.isfinite(std) and std > 0):
                raise InputError(
                    f"expected a positive length and uncertainty between seats {self.names[a]!r} and "
                    f"{self.names[b]!r}, got {length} mm and {std} mm"
                )
            if not (np.isfinite(growth) and growth > 0):
                raise InputError(f"expected a positive expansion factor of the length of {length} mm, got {growth}")
            if not (np.isfinite(growth_std) and (growth_std > 0) == bool(material) and growth_std >= 0):
                raise InputError(f"expected a positive uncertainty of the expansion of {material!r}, got {growth_std}")
            if material and growths.setdefault(material, growth_std) != growth_std:
                raise InputError(f"expected one uncertainty of the expansion of {material!r}, got several")
            if not (np.isfinite(place_std) and (place_std > 0 or (place_std == 0 and not artefact))):
                raise InputError(
                    f"expected a positive uncertainty of artefact {artefact!r} from place to place, got {place_std} mm"
                )
            if artefact and certificates.setdefault(artefact, (length, std)) != (length, std):
                raise InputError(f"expected one length and one uncertainty of artefact {artefact!r}, got several")

    @property
    def std(self) -> FloatArray:
        """(3, m) zeros: only the noise counts [mm]."""
        return np.zeros((3, len(self.rows)))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Coordinates of the seats, lengths of the artefacts, errors of expansions."""
        seats = [f"{axis} of seat {name} [mm]" for name in self.names for axis in "xyz"]
        lengths = (f"length of artefact {name} [mm]" for name in self._artefacts)
        return (*seats, *lengths, *(f"error of the expansion of {name} [mm/m]" for name in self._materials))

    @property
    def _artefacts(self) -> dict[str, Length]:
        """One length of each artefact."""
        return {length.artefact: length for length in self.lengths if length.artefact}

    @property
    def _materials(self) -> dict[str, float]:
        """Standard uncertainty of the expansion of each material."""
        return {length.material: length.growth_std for length in self.lengths if length.material}

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """The mean tip in each seat, and the stated lengths of artefacts."""
        count = np.bincount(self.seat, minlength=len(self.names))
        if not count.all():
            raise InputError(f"seat {self.names[int(np.argmin(count))]!r} has no readings")
        centres = np.stack([np.bincount(self.seat, tip, minlength=len(self.names)) for tip in tips], axis=1)
        stated = [length.length_mm for length in self._artefacts.values()]
        return self, np.concatenate([(centres / count[:, None]).ravel(), stated, np.zeros(len(self._materials))])

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del axes
        m, seat = tips.shape[1], self.seat[which]
        return LinearisedResiduals(
            tips - self._centres(unknowns)[seat].T, _identity(m), 3 * seat + np.arange(3)[:, None], -_identity(m)
        )

    def constraints(self, unknowns: FloatArray) -> Constraints | None:
        """Lengths between seats, as (d^2 - L^2) / 2 L, and the stated lengths of artefacts and errors of expansions.

        The length of an artefact is an unknown that all its places share, so that many places do not make it more
        certain than its certificate; the same holds for the expansion error of a material. L is the length in its
        place: the certificate value times the expansion factor. Values are at 20 degC.
        """
        if not self.lengths:
            return None
        centres, first = self._centres(unknowns), 3 * len(self.names)
        shared = [*self._artefacts, *self._materials]
        artefacts = {name: first + i for i, name in enumerate(self._artefacts)}
        materials = {name: first + len(artefacts) + i for i, name in enumerate(self._materials)}
        n = len(self.lengths)
        residuals, std = np.empty(n + len(shared)), np.empty(n + len(shared))
        by, values = np.zeros((n + len(shared), len(unknowns))), np.empty((n + len(shared), 2))
        for i, length in enumerate(self.lengths):
            apart = centres[length.b] - centres[length.a]
            certified, growth = length.length_mm, length.growth
            if length.artefact:
                certified = unknowns[artefacts[length.artefact]]
            if length.material:
                growth += MM_PER_M * unknowns[materials[length.material]]
            true = certified * growth
            if length.artefact:
                by[i, artefacts[length.artefact]] = -true * growth / length.length_mm
            if length.material:
                by[i, materials[length.material]] = -true * certified * MM_PER_M / length.length_mm
            # (d^2 - L^2) / 2 L is d - L near its zero, and smooth where the seats coincide.
            residuals[i] = (apart @ apart - true**2) / (2 * length.length_mm)
            by[i, 3 * length.a :][:3] = -apart / length.length_mm
            by[i, 3 * length.b :][:3] = apart / length.length_mm
            std[i] = length.place_std_mm if length.artefact else np.hypot(length.std_mm, length.place_std_mm)
            values[i] = np.linalg.norm(apart) / growth, length.length_mm
        stated = [(length.length_mm, length.std_mm) for length in self._artefacts.values()]
        stated += [(0.0, growth_std / MM_PER_M) for growth_std in self._materials.values()]
        for i, (value, u) in enumerate(stated):
            residuals[n + i], std[n + i] = unknowns[first + i] - value, u
            by[n + i, first + i] = 1.0
            values[n + i] = unknowns[first + i], value
        names = [f"length between seats {self.names[one.a]} and {self.names[one.b]}" for one in self.lengths]
        names += [f"length of artefact {name}" for name in artefacts]
        names += [f"expansion of {name} per metre" for name in materials]
        return Constraints(residuals, by, std, tuple(names), values)

    def _centres(self, unknowns: FloatArray) -> FloatArray:
        """(n_seats, 3) [mm]."""
        return unknowns[: 3 * len(self.names)].reshape(-1, 3)


def _identity(m: int) -> FloatArray:
    return np.broadcast_to(np.eye(3)[:, :, None], (3, 3, m))


StatedLength = tuple[str, str, float, float] | tuple[str, str, float, float, str, float, float, str, float]
"""``(seat_a, seat_b, length_mm, u_mm)``, optionally with the other fields of a `Length`."""


def seats_of(rows: IntArray, names: NameArray, lengths: Sequence[StatedLength] = ()) -> Seats:
    """Create seats from the seat name of each reading (m,), with lengths between them.

    Raises
    ------
    InputError
        If no reading is in a seat that a length names.
    """
    unique, seat = number_names(names)
    known = {name: i for i, name in enumerate(unique)}
    for seat_a, seat_b, *_ in lengths:
        for name in (seat_a, seat_b):
            if name not in known:
                raise InputError(
                    f"a length refers to seat {name!r}, but no reading is in it",
                    hint=f"seats of the session: {', '.join(list(known)[:8])}",
                )
    return Seats(rows, seat, unique, tuple(Length(known[a], known[b], *rest) for a, b, *rest in lengths))


def number_names(names: NameArray) -> tuple[tuple[str, ...], IntArray]:
    """The distinct names, and for each reading (m,) the index of its name."""
    unique, index = np.unique(names, return_inverse=True)
    return tuple(str(name) for name in unique), index.astype(np.intp)


def _check_members(kind: str, rows: IntArray, which: IntArray, names: tuple[str, ...]) -> None:
    if np.shape(which) != (len(rows),) or not np.isin(which, np.arange(len(names))).all():
        raise InputError(f"expected one of {len(names)} {kind}s at each of {len(rows)} readings, got {which!r:.60}")
