"""Predict at the readings of a large session: part by part, into one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from truearm.choices import Conditions
from truearm.compensation.models import Compensator
from truearm.files.table_writer import Columns, table_writer
from truearm.readings.large_sessions import LargeSession, Part
from truearm.solve.executor import Executor, Serial, results_in_order
from truearm.solve.quantile_sketch import QuantileSketch
from truearm.solve.threads import one_blas_thread
from truearm.typing import IntArray
from truearm.workflows.inputs import ModelLike, to_model
from truearm.workflows.outputs import check_output
from truearm.workflows.predict import DECIMALS, Prediction, predict
from truearm.workflows.record import Record, format_fixed
from truearm.workflows.sentences import SAME_DAY

K = TypeVar("K")

ENDINGS = (".csv", ".parquet")
# Remarks of parts that are repeated.
MAX_REMARKS = 6


@dataclass(frozen=True)
class PredictTask:
    """What one part needs."""

    part: Part
    model: Compensator
    conditions: Conditions
    accept: str | None


@dataclass(frozen=True)
class PredictionSums:
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
    remarks: tuple[str, ...] = ()

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

    def __add__(self, other: PredictionSums) -> PredictionSums:
        """Figures of both."""
        return PredictionSums(
            self.n_points + other.n_points,
            self.u + other.u,
            self.u_outside + other.u_outside,
            self.n_outside + other.n_outside,
            added(self.outside, other.outside),
            added(self.unstated, other.unstated),
            joined_remarks(self.remarks, other.remarks),
        )


def added(a: Mapping[K, Any], b: Mapping[K, Any]) -> dict[K, Any]:
    """Sums by name."""
    return {name: a.get(name, 0) + b.get(name, 0) for name in (*a, *(name for name in b if name not in a))}


def joined_remarks(a: tuple[str, ...], b: tuple[str, ...]) -> tuple[str, ...]:
    """The first different remarks of parts."""
    return tuple(dict.fromkeys((*a, *b)))[:MAX_REMARKS]


def predict_part(task: PredictTask) -> tuple[list[Columns], PredictionSums]:
    """Columns of the table and figures of one part."""
    tables: list[Columns] = []
    sums = PredictionSums()
    for session in task.part.sessions():
        one = predict(task.model, session, conditions=task.conditions, accept=task.accept)
        names = np.full(len(one.points), task.part.file.name)
        tables.append({**one.columns(), "note_file": names, "note_line": cast(IntArray, one.session.numbers)})
        sums = sums + PredictionSums.of(one)
    return tables, sums


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
    tasks = [PredictTask(part, known, conditions, accept) for part in large.parts]
    sums = PredictionSums()
    with table_writer(out, decimals=DECIMALS) as append:
        for tables, of_part in results_in_order(executor or Serial(), predict_part, tasks):
            for table in tables:
                append(table)
            sums = sums + of_part
            if progress is not None:
                progress(sums.n_points, f"{sums.n_points} of {len(large)} readings")
    return LargePrediction(conditions, len(tasks), sums)


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
        yield self.summary()
        if self.sums.unstated:
            sizes = ", ".join(f"{name} ({format_fixed(u)} mm)" for name, u in self._unstated_u_mm.items())
            yield f"Not stated, or rounded, in some readings, and in the uncertainty: {sizes}."
        if n := self.sums.n_outside:
            inputs = ", ".join(f"{name} {count}" for name, count in self.sums.outside.items())
            u = format_fixed(self.sums.u_outside.quantile(0.5))
            yield f"{n} of {self.sums.n_points} points are outside the trained range ({inputs}): u there {u} mm."
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
