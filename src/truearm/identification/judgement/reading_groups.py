"""Two groups of readings with a constant offset between them: a second probe, or another nest of the reflector.

A tip that is longer in some readings offsets these in the frame of the flange, a nest of another height in that of the
reference. Offset and groups are found in turn (two means, S. P. Lloyd, IEEE Trans. Inf. Theory 28 (1982) 129), beside a
constant offset of all and, of readings in seats, the place of each seat. Two means explain at most 0.64 of Gaussian
residuals, and 0.75 of uniform ones, even if they scatter along a line.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from truearm.findings import Finding, format_mm
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.typing import BoolArray, FloatArray, IntArray

# Share of the residuals' squares that two groups explain, from which they are named.
LEAST_EXPLAINED = 0.8
# And the share that the first split explains, without which none is searched: of good sessions 0.1 to 0.3, and 0.45 and
# more of two tips in seats, at a tracker 0.98.
LEAST_SPLIT = 0.35
# Readings of a group, at least: fewer are gross errors.
LEAST_READINGS, LEAST_SHARE = 5, 0.1
# An offset that is said [mm]: joints with play leave two groups too, some tenths apart.
LEAST_OFFSET_MM = 0.5
MAX_ROUNDS, N_LISTED = 30, 3


class _Groups(NamedTuple):
    """Readings of the smaller group, the offset of their points (3,) [mm], and the share of squares explained."""

    members: BoolArray
    offset: FloatArray
    explained: float


def reading_groups(fit: IdentificationResult, readings: PreparedReadings) -> Iterator[Finding]:
    """Name a second tip, or a second offset of the reference points, in some of the readings.

    Parameters
    ----------
    fit : IdentificationResult
        The arm with its constants.
    readings : PreparedReadings
    """
    for part in fit.references:
        if part.kind not in ("point", "seat") or len(part.rows) < 2 * LEAST_READINGS:
            continue
        R_base_tip = fit.chain.pose_jacobians(readings.state.angles[part.rows])[0].R_base_tip
        place = np.zeros(len(part.rows), dtype=np.intp) if part.kind == "point" else _seats(readings, part.rows)
        frames = {"tip": R_base_tip}
        if part.kind == "point":
            frames["reference"] = np.broadcast_to(np.eye(3), R_base_tip.shape)
        found = {name: _groups(part.residuals.T, R_frame, place) for name, R_frame in frames.items()}
        named = max(found, key=lambda name: found[name].explained)
        members, offset, explained = found[named]
        n, size = int(members.sum()), float(np.linalg.norm(offset))
        if explained < LEAST_EXPLAINED or n < max(LEAST_READINGS, LEAST_SHARE * len(members)) or size < LEAST_OFFSET_MM:
            continue
        first = ", ".join(readings.measured.called(int(row)) for row in part.rows[members][:N_LISTED])
        if named == "tip":
            what = f"a tip {format_mm(size)} from that of the others"
            advice = "Was another probe or ball in use? Name the tip of each reading in the column tip, and fit again."
        else:
            along = ", ".join(f"{by:+.2f}" for by in offset)
            what = f"reference points offset by ({along}) mm from the others"
            advice = "Was the reflector in another nest? Correct these points, and fit again."
        said = f"{n} of {len(members)} readings ({first} ...) have {what}. {advice}"
        yield Finding("tips", said, {"offset_mm": size, "explained": explained})


def _seats(readings: PreparedReadings, rows: IntArray) -> IntArray:
    assert readings.measured.seat is not None
    return np.asarray(np.unique(readings.measured.seat[rows], return_inverse=True)[1]).reshape(-1)


def _groups(residuals: FloatArray, R_frame: FloatArray, place: IntArray) -> _Groups:
    """Two groups of readings by their residuals (n, 3), predicted less measured, in frames R_frame (n, 3, 3)."""
    count = np.bincount(place)[:, None]

    def of_places(values: FloatArray) -> FloatArray:
        """(n, k) means of values (n, k) at each place."""
        total = np.zeros((len(count), values.shape[1]))
        np.add.at(total, place, values)
        return np.asarray((total / count)[place])

    def centred(values: FloatArray) -> FloatArray:
        flat = values.reshape(len(values), -1)
        return (flat - of_places(flat)).reshape(values.shape)

    values = np.einsum("nji,nj->ni", R_frame, residuals)
    values -= values.mean(axis=0)
    members = _split(values)
    between = sum(float((values[part].sum(axis=0) ** 2).sum()) / max(part.sum(), 1) for part in (members, ~members))
    if between < LEAST_SPLIT * float((values**2).sum()):
        return _Groups(members, np.zeros(3), 0.0)
    n, wanted = len(residuals), centred(residuals).ravel()
    constant = centred(R_frame).reshape(3 * n, 3)
    alone = wanted - constant @ np.linalg.lstsq(constant, wanted, rcond=1e-9)[0]
    squares, offset = np.full((2, n), np.inf), np.zeros(3)
    for _ in range(MAX_ROUNDS):
        columns = np.concatenate([R_frame, R_frame * members[:, None, None]], axis=2)
        found: FloatArray = np.asarray(
            np.linalg.lstsq(centred(columns).reshape(3 * n, 6), wanted, rcond=1e-9)[0], float
        )
        offset, of_members = found[3:], R_frame @ found[3:]
        rest = residuals - R_frame @ found[:3]
        rest -= of_places(rest - of_members * members[:, None])
        squares = np.stack([(rest**2).sum(axis=1), ((rest - of_members) ** 2).sum(axis=1)])
        before, members = members, squares.argmin(axis=0) == 1
        if (members == before).all():
            break
    explained = 1 - squares.min(axis=0).sum() / max(float(alone @ alone), np.finfo(float).tiny)
    is_smaller = 2 * members.sum() <= n
    return _Groups(members if is_smaller else ~members, -offset if is_smaller else offset, float(explained))


def _split(values: FloatArray) -> BoolArray:
    """The half of values (n, 3) along their longest axis whose means differ most, for their numbers."""
    away = values - values.mean(axis=0)
    along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
    rising, n = np.sort(along), len(along)
    below = np.arange(1, n)
    between = np.cumsum(rising)[:-1] ** 2 / (below * (n - below))
    least = max(1, int(LEAST_SHARE * n))
    at = least + int(between[least - 1 : n - least].argmax())
    return np.asarray(along >= rising[at])
