"""Groups of readings in batches, for cross-validation: many small groups at once, without a loop over them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification_result import ReferenceFit
from truearm.typing import IntArray

# The readings of a group: for each of its references the rows.
Members = list[tuple[int, IntArray]]


class GroupBatch(NamedTuple):
    """Groups of readings: of each reading its group, counted from 0, reference and row there, in this order."""

    group: IntArray
    which: IntArray
    row: IntArray

    @property
    def n_groups(self) -> int:
        """Number of groups."""
        return int(self.group[-1]) + 1

    def members(self) -> list[Members]:
        """The members of every group."""
        found: list[Members] = []
        for start, stop in pairwise(np.searchsorted(self.group, np.arange(self.n_groups + 1)).tolist()):
            which, row = self.which[start:stop], self.row[start:stop]
            parts = np.split(row, np.flatnonzero(np.diff(which)) + 1)
            found.append(list(zip(which[np.r_[True, np.diff(which) > 0]].tolist(), parts, strict=True)))
        return found

    def of(self, which: int) -> tuple[IntArray, IntArray, IntArray]:
        """Rows (m,) of a reference, their groups, and their places in these."""
        mine = self.which == which
        group = self.group[mine]
        first = np.searchsorted(group, np.arange(self.n_groups))
        return self.row[mine], group, np.arange(len(group)) - first[group]

    def largest(self, which: int) -> int:
        """Largest number of readings of a reference in a group."""
        return int(np.bincount(self.group[self.which == which], minlength=1).max())


def group_batches(references: Sequence[ReferenceFit], group: IntArray, chunk: int) -> Iterator[GroupBatch]:
    """Groups, several small ones of about one size at once, so that one pass of the chain evaluates many readings.

    As many places as the largest group has are within `chunk` for all groups of a batch, unless it is one group.
    """
    key = np.concatenate([group[reference.rows] for reference in references])
    which = np.concatenate([np.full(len(reference.rows), i) for i, reference in enumerate(references)])
    row = np.concatenate([np.arange(len(reference.rows)) for reference in references])
    key = np.unique(key, return_inverse=True)[1]
    order = np.lexsort((row, which, key, np.bincount(key)[key]))
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    stops = np.r_[starts[1:], len(order)]
    sizes = stops - starts
    first = 0
    while first < len(starts):
        places = np.arange(1, len(sizes[first : first + chunk]) + 1) * sizes[first : first + chunk]  # sizes rise
        after = first + max(int(np.searchsorted(places, chunk, side="right")), 1)
        some = order[starts[first] : stops[after - 1]]
        yield GroupBatch(np.cumsum(np.diff(key[some], prepend=key[some[0]]) != 0), which[some], row[some])
        first = after
