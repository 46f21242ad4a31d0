"""Distances of the tip to anchors: fixed points at unknown places, as of a draw-wire encoder or a ball bar.

The residual is ``|t - a| + o - d`` with the tip t, the anchor a, the offset o that all distances to the anchor share,
and the stated distance d. Distances are absolute: they determine the size of the arm, as far as they determine the
offset.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from truearm.errors import InputError
from truearm.identification.references.references import Constraints, LinearisedResiduals, number_names
from truearm.readings.anchors import LEAST_READINGS, locate_anchor, offset_std
from truearm.readings.session import Session
from truearm.typing import FloatArray, IntArray

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
