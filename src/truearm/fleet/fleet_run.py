"""The result of a run: the arms that were fitted, and those that failed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from truearm.fleet.fit_task import FitRow
from truearm.workflows.record import TableRecord, TextTable, columns_of
from truearm.workflows.sentences import agree, number_of

# Failures that are printed.
MAX_ROWS = 20


@dataclass(frozen=True, eq=False, repr=False)
class FleetRun(TableRecord):
    """What a run did.

    Attributes
    ----------
    rows : tuple of FitRow
        Of the arms that were fitted, by serial number; those that failed are among them.
    unchanged : tuple of FitRow
        Earlier results of arms with the same inputs.

    Examples
    --------
    >>> from truearm.fleet.fleet_run import FleetRun
    >>> print(FleetRun((), ()))
    Nothing to fit: 0 arms are unchanged.
    """

    rows: tuple[FitRow, ...]
    unchanged: tuple[FitRow, ...]

    @property
    def n_fitted(self) -> int:
        """Arms that got a model in force."""
        return sum(row.is_usable for row in self.rows)

    @property
    def failures(self) -> tuple[FitRow, ...]:
        """Fits without a model, or with one worse than the nominal arm; those of earlier runs are among them."""
        return tuple(row for row in (*self.rows, *self.unchanged) if not row.is_usable)

    def summary(self) -> str:
        """How many arms were fitted, and how many failed."""
        same = f"{number_of(len(self.unchanged), 'arm')} {agree(len(self.unchanged), 'are')} unchanged"
        if n_before := sum(not row.is_usable for row in self.unchanged):
            same += f", {n_before} of them failed"
        if not self.rows:
            return f"Nothing to fit: {same}."
        failed = len(self.rows) - self.n_fitted
        return f"{number_of(self.n_fitted, 'arm')} fitted, {failed} failed; {same}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        for row in self.failures[:MAX_ROWS]:
            yield f"{row.serial_number}: {row.outcome}"
        if (more := len(self.failures) - MAX_ROWS) > 0:
            yield f"{number_of(more, 'more failure')}: truearm fleet status"

    def columns(self) -> dict[str, list[Any]]:
        """A row for each fit of this run; ``seconds`` is its duration."""
        return columns_of(self.rows)

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "n_fitted": self.n_fitted,
            "n_unchanged": len(self.unchanged),
            "failures": {row.serial_number: row.outcome for row in self.failures},
            "rows": self.rows,
        }
