"""Tables 2, 3 and 4 of Gao et al. (2017) beside what was found: accuracy, effort, verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from truearm.pages.number_format import capitalize, format_count, format_exact, format_in_text, format_number
from truearm.pages.page import Cell, Column, Section, Table
from truearm.pages.plotting import Style, join_phrases
from truearm.papers.gao2017.phrases import (
    TRAINING_SHARES_NOTE,
    USED_TO_FIX_BOX,
    MissingPart,
    format_row_numbers,
    range_cell,
)
from truearm.papers.gao2017.reproduction_file import TableRow, TrainerSummary
from truearm.papers.gao2017.table_figure import TableFigureRow, reaches_paper_error, table_figure

_SUBJECT = {
    2: "a simulation: one hidden layer, other numbers of poses, goals, learning rates and units",
    3: "a simulation: larger networks, and three training functions",
    4: "the experiment on a real arm, here on virtual arms",
}


def table_section(
    number: int, rows: Sequence[TableRow] | None, rule: str, *, styles: Mapping[str, Style]
) -> Section | MissingPart:
    """Set a table of the paper beside what was found: accuracy, effort, and a picture of both.

    Parameters
    ----------
    number : int
        Of the table: 2, 3 or 4.
    rows : sequence of TableRow, optional
        None or empty if the table was not run.
    rule : str
        Of the verdicts.
    styles : mapping of str to Style
        For ``faithful`` and ``lm``.
    """
    title = f"Table {number}"
    if not rows:
        return MissingPart(title, f"--table {number}")
    told = [
        f"Table {number} of the paper is {_SUBJECT[number]}. " + describe_accuracy(rows),
        f"Rule of the verdicts. {capitalize(rule.rstrip('.'))}.",
        _starts_told(rows),
        *_notes_told(rows),
    ]
    return Section(
        title,
        "\n\n".join(part for part in told if part),
        tables=(_accuracy(number, rows), _effort(number, rows)),
        figures=(table_figure([_beside(row) for row in rows], headings=("row", "poses", "units"), styles=styles),),
    )


def _accuracy(number: int, rows: Sequence[TableRow]) -> Table:
    columns = [
        Column("row"),
        Column("poses"),
        Column("units"),
        Column("paper", "mm", group="mean error"),
        Column("faithful", "mm", group="mean error"),
        Column("range", "mm", group="mean error"),
        Column("lm", "mm", group="mean error"),
        Column("range", "mm", group="mean error"),
        Column("paper", "mm", group="largest error"),
        Column("faithful", "mm", group="largest error"),
        Column("lm", "mm", group="largest error"),
        Column("faithful", group="mean / paper's", digits=2),
        Column("lm", group="mean / paper's", digits=2),
        Column("faithful", group="verdict"),
        Column("lm", group="verdict"),
    ]
    lines: list[tuple[Cell, ...]] = [
        (
            row.row,
            row.n_train,
            _units(row),
            row.paper.mean_mm,
            *_median_and_range(row, "faithful"),
            *_median_and_range(row, "lm"),
            row.paper.max_mm,
            *(_of(row, name, lambda trained: trained.median.max_mm) for name in ("faithful", "lm")),
            row.ratio["faithful"],
            row.ratio["ours"],
            row.verdict or f"as row {row.same_training_as}",
            row.verdict_ours,
        )
        for row in rows
    ]
    one_size = len({row.n_train for row in rows}) == 1
    keep = [k for k in range(len(columns)) if not (k == 1 and one_size) and (k < 3 or _filled(lines, k))]
    poses = f", {format_number(rows[0].n_train)} poses" if one_size else ""
    return Table(
        tuple(columns[k] for k in keep),
        tuple(tuple(line[k] for k in keep) for line in lines),
        f"Table {number}, accuracy{poses}. Error of a single coordinate. Mean error: on 2000 further poses, "
        "median and range of the starts. Largest error: on as many poses as the paper tested, median of the starts. "
        f"{TRAINING_SHARES_NOTE.rstrip('.')}",
    )


def _effort(number: int, rows: Sequence[TableRow]) -> Table:
    columns = [
        Column("row"),
        Column("units"),
        Column("learning rate"),
        Column("goal"),
        Column("paper", group="epochs"),
        Column("faithful", group="epochs"),
        Column("lm", group="epochs"),
        Column("paper", "s", group="training time"),
        Column("faithful", "s", group="training time"),
        Column("lm", "s", group="training time"),
        Column("faithful", "s", group="time to the paper's mean error"),
        Column("starts", "s", group="time to the paper's mean error"),
        Column("lm", "s", group="time to the paper's mean error"),
        Column("starts", "s", group="time to the paper's mean error"),
        Column("faithful stopped by"),
    ]
    lines: list[tuple[Cell, ...]] = [
        (
            row.row,
            _units(row),
            format_exact(row.learning_rate),
            _power(row.goal),
            row.paper.epochs,
            *(_of(row, name, lambda trained: round(trained.median.epochs)) for name in ("faithful", "lm")),
            row.paper.seconds,
            *(_of(row, name, lambda trained: trained.median.seconds) for name in ("faithful", "lm")),
            *_time_to_paper(row, "faithful"),
            *_time_to_paper(row, "lm"),
            _stops(row),
        )
        for row in rows
    ]
    # Settings that no row of the table varies are said in its caption.
    same = {k: {line[k] for line in lines} for k in (2, 3)}
    keep = [k for k in range(len(columns)) if (k not in same or len(same[k]) > 1) and (k < 2 or _filled(lines, k))]
    fixed = "".join(f", {columns[k].heading} {next(iter(values))}" for k, values in same.items() if len(values) == 1)
    return Table(
        tuple(columns[k] for k in keep),
        tuple(tuple(line[k] for k in keep) for line in lines),
        f"Table {number}, effort{fixed}. Medians of the starts. Time to the paper's mean error: until the error on "
        "2000 further poses first was at or below it, median of the starts that got there, and how many did. "
        f"{TRAINING_SHARES_NOTE.rstrip('.')}",
    )


def _filled(lines: Iterable[Sequence[Cell]], column: int) -> bool:
    return any(line[column] is not None for line in lines)


def _median_and_range(row: TableRow, name: str) -> tuple[Cell, Cell]:
    trained = row.by_trainer().get(name)
    if trained is None:
        return None, None
    return trained.median.mean_many_mm, range_cell(trained.range_mm if len(trained.runs) > 1 else (0.0,))


def _timed(row: TableRow) -> bool:
    """Whether a time to the paper's error says something: gradient descent gets nowhere."""
    return row.paper.trainer == "trainlm"


def _time_to_paper(row: TableRow, name: str) -> tuple[Cell, Cell]:
    trained = row.by_trainer().get(name)
    if trained is None or not _timed(row):
        return None, None
    times = [run.seconds_to_paper for run in trained.runs]
    reached = [time for time in times if time is not None]
    return (float(np.median(reached)) if reached else None), f"{len(reached)}/{len(times)}"


def _stops(row: TableRow) -> str | None:
    if row.faithful is None:
        return None
    stops = Counter(run.stop.strip().rstrip(".") for run in row.faithful.runs)
    # MATLAB's "Maximum epoch reached" and the like: the words a MATLAB user knows.
    return join_phrases((stop if len(stops) == 1 else f"{stop} ({n})" for stop, n in stops.most_common()), most=2)


def _of(row: TableRow, name: str, value: Callable[[TrainerSummary], Cell]) -> Cell:
    trained = row.by_trainer().get(name)
    return None if trained is None else value(trained)


def _units(row: TableRow) -> str:
    hidden = ", ".join(str(units) for units in row.hidden)
    activation = "" if row.activation == "tansig" else f" {row.activation}"
    trainer = "" if row.paper.trainer == "trainlm" else f" {row.paper.trainer}"
    return f"{hidden}{activation}{trainer}"


def _beside(row: TableRow) -> TableFigureRow:
    trained = row.by_trainer()
    return TableFigureRow(
        (str(row.row), str(row.n_train), _units(row)),
        row.paper.mean_mm,
        row.paper.seconds,
        {name: [run.mean_many_mm for run in t.runs] for name, t in trained.items()},
        {name: [run.seconds_to_paper for run in t.runs] for name, t in trained.items() if _timed(row)},
    )


def _starts_told(rows: Sequence[TableRow]) -> str:
    told = []
    for name in ("faithful", "lm"):
        by_starts: dict[int, list[int]] = {}
        by_limit: dict[float, list[int]] = {}
        for row in rows:
            trained = row.by_trainer().get(name)
            if trained is not None:
                by_starts.setdefault(len(trained.runs), []).append(row.row)
                if trained.time_limit_s is not None:
                    by_limit.setdefault(trained.time_limit_s, []).append(row.row)
        if not by_starts:
            continue
        most = max(by_starts, key=lambda n: len(by_starts[n]))
        others = [f"{n} in {format_row_numbers(numbers)}" for n, numbers in sorted(by_starts.items()) if n != most]
        text = f"{name}: {format_count(most, 'start')}" + (f" ({', '.join(others)})" if others else "")
        limits = [
            f"{format_in_text(limit, unit='s')} in {format_row_numbers(numbers)}"
            for limit, numbers in sorted(by_limit.items())
        ]
        told.append(text + (f", time limit {', '.join(limits)}" if limits else ""))
    return f"Random starts of each row. {'; '.join(told)}." if told else ""


def _notes_told(rows: Sequence[TableRow]) -> list[str]:
    notes: dict[str, list[int]] = {}
    for row in rows:
        if row.note:
            notes.setdefault(row.note.strip(), []).append(row.row)
    return [f"{capitalize(format_row_numbers(numbers))}: {note}" for note, numbers in notes.items()]


def _power(value: float) -> str:
    """Give 4e-05 as 4e-5: as MATLAB's users type it."""
    mantissa, _, exponent = f"{value:g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa


def as_accurate(rows: Iterable[TableRow], name: str) -> tuple[int, int]:
    """In how many rows at least half of the starts became as accurate as the paper, and how many rows were run.

    A training that several rows share counts once, a row that fixed the box or that has no time is not counted.
    """
    run = [
        [start.seconds_to_paper for start in row.by_trainer()[name].runs]
        for row in rows
        if _timed(row) and row.verdicts().get(name, USED_TO_FIX_BOX) != USED_TO_FIX_BOX
    ]
    return sum(map(reaches_paper_error, run)), len(run)


def speedups(rows: Iterable[TableRow]) -> list[float]:
    """For each row where both get there, how many times sooner lm has the paper's mean error than faithful.

    Only rows of trainlm whose two trainings no other row has.
    """
    ratios = []
    for row in rows:
        times = {}
        for name in row.verdicts() if _timed(row) else ():
            seconds = [run.seconds_to_paper for run in row.by_trainer()[name].runs]
            if reaches_paper_error(seconds):
                times[name] = float(np.median([s for s in seconds if s is not None]))
        if len(times) == 2 and times["lm"] > 0:
            ratios.append(times["faithful"] / times["lm"])
    return ratios


def count_verdicts(rows: Iterable[TableRow], name: str) -> Counter[str]:
    """Verdicts of the trainings that were run, each once."""
    return Counter(verdicts[name] for row in rows if name in (verdicts := row.verdicts()))


def describe_accuracy(rows: Sequence[TableRow]) -> str:
    """Tell in how many rows each trainer gets as accurate as the paper; empty if nothing was run."""
    counts = {name: as_accurate(rows, name) for name in ("faithful", "lm")}
    told = [f"in {good} of {format_count(run, 'row')} with {name}" for name, (good, run) in counts.items() if run]
    if not told:
        return ""
    return (
        f"Half of the starts or more reach the paper's mean error {' and '.join(told)}; rows that fixed the box, and "
        f"repeats, are not counted. {TRAINING_SHARES_NOTE}"
    )
