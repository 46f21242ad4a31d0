"""Predict at the readings of a large session: part by part, into one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from truearm.choices import Conditions
from truearm.files.table_writer import Columns, table_writer
from truearm.models import Compensator
from truearm.readings import Session
from truearm.readings.large_sessions import LargeSession, Part
from truearm.solve.executors import Executor
from truearm.solve.quantile_sketch import QuantileSketch
from truearm.solve.sums import Sums, joined
from truearm.solve.threads import one_blas_thread
from truearm.typing import IntArray
from truearm.verbs.inputs import ModelLike, to_model
from truearm.verbs.outputs import check_output
from truearm.verbs.pass_over_parts import PartTask, joined_remarks, pass_over_parts
from truearm.verbs.predict import DECIMALS, Prediction, predict
from truearm.verbs.record import Record, format_fixed
from truearm.verbs.sentences import SAME_DAY

ENDINGS = (".csv", ".parquet")


@dataclass(frozen=True, eq=False)
class PredictionSums(Sums):
    """Figures of predictions that are added over parts.

    Attributes
    ----------
    n_points : int
    u : QuantileSketch
        Standard uncertainties of the coordinates [mm].
    u_outside : QuantileSketch
        Of those outside the trained range.
    n_outside : int
        Points outside it.
    outside : dict of str to int
        The same by input.
    unstated : dict of str to float
        By input that is not stated the sum of its variances over the points [mm^2].
    remarks : tuple of str
    """

    n_points: int = 0
    u: QuantileSketch = field(default_factory=QuantileSketch)
    u_outside: QuantileSketch = field(default_factory=QuantileSketch)
    n_outside: int = 0
    outside: Mapping[str, int] = field(default_factory=dict)
    unstated: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = field(default=(), metadata=joined(joined_remarks))

    @classmethod
    def of(cls, one: Prediction) -> PredictionSums:
        """Figures of a prediction."""
        n, is_outside = len(one.points), one.outside_training
        return cls(
            n,
            QuantileSketch.of(one.u_mm.ravel()),
            QuantileSketch.of(one.u_mm[is_outside].ravel()),
            int(is_outside.sum()),
            {name: int(rows.sum()) for name, rows in one.inputs_outside.items()},
            {name: n * u**2 for name, u in one.unstated_u_mm.items()},
            one.remarks,
        )


@dataclass(frozen=True, eq=False)
class PartOfTable(Sums):
    """Columns of the table, and figures, of some consecutive readings."""

    tables: tuple[Columns, ...]
    sums: PredictionSums


@dataclass(frozen=True)
class PredictTask(PartTask[PartOfTable]):
    """What is predicted of each part."""

    model: Compensator
    conditions: Conditions
    accept: str | None

    def sums(self, readings: Session, part: Part) -> PartOfTable:
        """See `PartTask.sums`."""
        one = predict(self.model, readings, conditions=self.conditions, accept=self.accept)
        names = np.full(len(one.points), part.file.name)
        table = {**one.columns(), "note_file": names, "note_line": cast(IntArray, one.session.numbers)}
        return PartOfTable((table,), PredictionSums.of(one))


@one_blas_thread()
def predict_large(
    model: ModelLike,
    session: str | Path,
    out: str | Path,
    *,
    conditions: Conditions = "reproducibility",
    accept: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> LargePrediction:
    """Compensate the readings of a large session: write the table of `Prediction.save`, part by part.

    Its further columns ``note_file`` and ``note_line`` say which reading each point is of: a line of a CSV file, or its
    place in a Parquet file.

    Parameters
    ----------
    model, conditions, accept
        As of `predict`.
    session : str or Path
        One file, or a folder of files (`LargeSession`).
    out : str or Path
        Table to write, ``.csv`` or ``.parquet``: whole, or not at all.
    executor : Executor, optional
        Who computes the parts; this process by default. The table does not depend on it.
    progress : callable, optional
        Called with the number of readings done and a note.

    Returns
    -------
    LargePrediction

    Raises
    ------
    InputError
        As `predict`; more than half of the readings beyond a joint limit are refused of every part.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> Path("line").mkdir()
    >>> session.save("line/1.csv")
    >>> model = ta.fit("ur10", session, model="nominal").model
    >>> ta.predict_large(model, "line", "points.csv").sums.n_points
    40
    """
    check_output(out, session, endings=ENDINGS)
    known = to_model(model)
    large = LargeSession.open(session, n_joints=known.arm.n_joints)
    tasks = [PredictTask(known, conditions, accept)] * len(large.parts)
    sums = PredictionSums()
    with table_writer(out, decimals=DECIMALS) as append:
        for of_part in pass_over_parts(large, tasks, executor, progress):
            for table in of_part.tables:
                append(table)
            sums = sums + of_part.sums
    return LargePrediction(conditions, len(large.parts), sums)


@dataclass(frozen=True, eq=False, repr=False)
class LargePrediction(Record):
    """Predicted points of a large session, which are in the table that was written.

    Attributes
    ----------
    conditions : {"reproducibility", "repeatability"}
    n_parts : int
    sums : PredictionSums
    """

    conditions: Conditions
    n_parts: int
    sums: PredictionSums

    def summary(self) -> str:
        """The answer in one sentence: the number of points and their uncertainty."""
        of = "" if self.conditions == "reproducibility" else f", {SAME_DAY}"
        return (
            f"{self.sums.n_points} points in {self.n_parts} parts, standard uncertainty of a coordinate "
            f"{format_fixed(self.sums.u.quantile(0.5))} mm (median{of})."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        most_outside = 2 * self.sums.n_outside > self.sums.n_points
        if most_outside:
            yield from self.sums.remarks
        yield self.summary()
        if self.sums.unstated:
            sizes = ", ".join(f"{name} ({format_fixed(u)} mm)" for name, u in self._unstated_u_mm.items())
            yield f"Not stated, or rounded, in some readings, and in the uncertainty: {sizes}."
        if n := self.sums.n_outside:
            inputs = ", ".join(f"{name} {count}" for name, count in self.sums.outside.items())
            u = format_fixed(self.sums.u_outside.quantile(0.5))
            yield f"{n} of {self.sums.n_points} points are outside the trained range ({inputs}): u there {u} mm."
        if not most_outside:
            yield from self.sums.remarks

    @property
    def _unstated_u_mm(self) -> dict[str, float]:
        return {name: float(np.sqrt(total / self.sums.n_points)) for name, total in self.sums.unstated.items()}

    def _json(self) -> object:
        n = self.sums.n_outside
        return {
            "summary": self.summary(),
            "n_readings": self.sums.n_points,
            "n_parts": self.n_parts,
            "conditions": self.conditions,
            "median_u_mm": self.sums.u.quantile(0.5),
            "unstated_u_mm": self._unstated_u_mm,
            "n_outside_training": n,
            "inputs_outside_training": self.sums.outside,
            "median_u_outside_training_mm": self.sums.u_outside.quantile(0.5) if n else None,
            "remarks": self.sums.remarks,
        }
