"""Fair splits: readings that are neighbours stay together."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeVar, get_args

import numpy as np

from truearm.errors import InputError
from truearm.readings.anchors import rows_with_distance
from truearm.readings.readings import Readings
from truearm.readings.repeats import readings_of_one_pose
from truearm.typing import BoolArray, IntArray, NameArray

Kept = TypeVar("Kept", bound=Readings)
SplitBy = Literal["position", "seat", "session", "row"]

# Readings in a seat that determine the place of the seat and something of the arm as well.
READINGS_A_SEAT = 5


def hold_out(readings: Kept, *, by: SplitBy = "position", fraction: float, seed: int) -> tuple[Kept, Kept]:
    """Split readings into training and test, whole groups at a time.

    Readings of one goal position differ only in orientation. A split by row favours a model that merely remembers
    positions; a split by position tests it at places it has not seen.

    Parameters
    ----------
    readings : Readings
        In the order that both parts keep.
    by : {"position", "seat", "session", "row"}
        What names the groups; ``row``: every reading is its own group, but those of one pose are together.
    fraction : float
        Share of the groups to hold out, between 0 and 1; at least one group goes to either part.
    seed : int
        The same seed gives the same split.

    Returns
    -------
    train, test : Readings

    Raises
    ------
    InputError
        If the readings do not name their groups, a name is empty, or there are fewer than two groups.
    """
    groups = _groups(readings, by)
    held = chosen_groups(int(groups.max()) + 1, fraction=fraction, seed=seed, by=by, file=readings.file)[groups]
    return readings.rows(~held), readings.rows(held)


def chosen_groups(n_groups: int, *, fraction: float, seed: int, by: str, file: Path | None) -> BoolArray:
    """(n_groups,) which groups are held out; see `hold_out`.

    Raises
    ------
    InputError
        If the share is not between 0 and 1, or there are fewer than two groups.
    """
    if not 0 < fraction < 1:
        raise InputError(f"the share to hold out must lie between 0 and 1, got {fraction}", hint="0.3")
    if n_groups < 2:
        raise InputError(f"a split needs readings of at least two {by}s, got one", file=file)
    n_test = min(max(round(fraction * n_groups), 1), n_groups - 1)
    chosen = np.zeros(n_groups, bool)
    chosen[np.random.default_rng(seed).permutation(n_groups)[:n_test]] = True
    return chosen


def stratified_rows(readings: Readings, n: int, *, seed: int) -> IntArray:
    """Choose a few readings, spread over the positions that they aimed at.

    With reference points: one reading of each position in turn, the positions in random order; readings at random if
    positions are not named. Without: readings in a few seats, five or more in each, as a single one has no information.
    Without seats: distances, as many to each anchor.

    Parameters
    ----------
    readings : Readings
    n : int
        Number of readings; as distances and tips of one pose stay together, there may be some more.
    seed : int
        The same seed gives the same rows.

    Returns
    -------
    (n,) int array, or more
        Rows, rising.

    Raises
    ------
    InputError
        If there are fewer readings with a reference point, or in seats.
    """
    rng = np.random.default_rng(seed)
    rows = np.flatnonzero(readings.has_point)
    group = rows if readings.position is None else np.unique(readings.position[rows], return_inverse=True)[1]
    if not len(rows) and readings.seat is not None:
        rows = np.flatnonzero(readings.seat != "")
        seats, group = np.unique(readings.seat[rows], return_inverse=True)
        shuffled = rng.permutation(len(seats))
        needed = int(np.searchsorted(np.cumsum(np.bincount(group)[shuffled]), n)) + 1
        few = np.isin(group, shuffled[: max(n // READINGS_A_SEAT, needed)])
        rows, group = (rows[few], group[few]) if n <= len(rows) else (rows, group)
    if not len(rows):
        rows = np.flatnonzero(rows_with_distance(readings))
        # Wires in turn.
        group = rows if readings.anchor is None else np.unique(readings.anchor[rows], return_inverse=True)[1]
    if not 1 <= n <= len(rows):
        what = "reference points" if readings.points is not None else "a seat or a distance"
        raise readings.error(f"expected a number of rows from 1 to the {len(rows)} readings with {what}, got {n}")
    order = rng.permutation(len(rows))
    turn = np.empty(len(rows))  # within its group
    for g in np.unique(group):
        turn[group == g] = rng.permutation(int((group == g).sum()))
    rows = rows[np.lexsort((order, turn))]
    _, first, pose, count = np.unique(
        readings_of_one_pose(readings, exactly=True)[rows], return_index=True, return_inverse=True, return_counts=True
    )
    by_turn = np.argsort(first)
    n_poses = int(np.searchsorted(np.cumsum(count[by_turn]), n)) + 1
    return np.sort(rows[np.isin(pose, by_turn[:n_poses])])


def _groups(readings: Readings, by: SplitBy) -> IntArray:
    """Give each reading the number of its group."""
    if by == "row":
        return np.unique(readings_of_one_pose(readings), return_inverse=True)[1]
    return np.unique(group_names(readings, by), return_inverse=True)[1]


def group_names(readings: Readings, by: str) -> NameArray:
    """(n,) names of the groups of readings.

    Raises
    ------
    InputError
        If the readings do not name their groups, or a name is empty.
    """
    kinds = get_args(SplitBy)
    if by not in kinds[:-1]:
        raise InputError(f"expected a split by {', '.join(kinds)}, got {by!r}")
    names: NameArray | None = getattr(readings, by)
    if names is None:
        present = [name for name in kinds[:-1] if getattr(readings, name) is not None]
        raise readings.error(
            f"the readings have no column {by!r} to split by",
            hint=f"by {' or '.join([*present, 'row'])}, or name a {by} for every reading",
        )
    if (names == "").any():
        row = int(np.argmax(names == ""))
        raise readings.error(f"the reading names no {by}, so it belongs to no group", row, column=by)
    return names
