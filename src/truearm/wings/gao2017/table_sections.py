"""Tables 2, 3 and 4 of the paper beside the reproduction: accuracy, effort, verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from truearm.number_format import capitalize, format_count, format_exact, format_in_text, format_number
from truearm.pages.page import Cell, Column, Section, Table
from truearm.pages.plotting import Figure, join_phrases
from truearm.wings.gao2017.phrases import SHARES_NOTE, MissingPart, format_row_numbers, mark_cut, range_cell
from truearm.wings.gao2017.results import CUT_SHORT, FITTED_BOX, METHODS, Method, RowResult, TrainerResult, trained
from truearm.wings.gao2017.table_figure import TableFigureRow, table_figure

_SUBJECT = {
    2: "a simulation with one hidden layer: numbers of poses, goals, learning rates and units vary",
    3: "a simulation with larger networks and three training functions",
    4: "the experiment on a real arm, here on virtual arms",
}


def table_section(number: int, rows: Sequence[RowResult] | None, rule: str) -> Section | MissingPart:
    """A table of the paper beside the reproduction: accuracy, effort, and a figure of both.

    Parameters
    ----------
    number : int
        Of the table: 2, 3 or 4.
    rows : sequence of RowResult, optional
        None if the table was not run.
    rule : str
        Of the verdicts.
    """
    title = f"Table {number}"
    if not rows:
        return MissingPart(title, f"--table {number}")
    parts = [
        describe_accuracy(rows),
        f"Table {number} of the paper is {_SUBJECT[number]}.",
        f"Rule of the verdicts. {capitalize(rule.rstrip('.'))}.",
        _describe_starts(rows),
        *_notes(rows),
    ]
    return Section(
        title,
        "\n\n".join(part for part in parts if part),
        tables=(_accuracy(number, rows), _effort(number, rows)),
        figures=(_figure(rows),),
    )


def _figure(rows: Sequence[RowResult]) -> Figure:
    figure = table_figure([_figure_row(row) for row in rows], headings=("row", "poses", "units"))
    if not any(count_cut(rows, name) for name in METHODS):
        return figure
    return replace(figure, caption=f"{figure.caption} * Our time limit ended a training of this row.")


def _accuracy(number: int, rows: Sequence[RowResult]) -> Table:
    columns: dict[Column, list[Cell]] = {
        Column("row"): [row.paper.row for row in rows],
        Column("poses"): [row.paper.n_train for row in rows],
        Column("units"): [_units(row) for row in rows],
        Column("paper", "mm", group="mean error"): [row.paper.mean_mm for row in rows],
    }
    for name in METHODS:
        columns[Column(name, "mm", group="mean error")] = _cells(rows, name, lambda one: one.median["mean_many_mm"])
        columns[Column(f"{name}, range", "mm", group="mean error")] = _cells(
            rows, name, lambda one: range_cell(one.range_mm if len(one.runs) > 1 else (0.0,))
        )
    columns[Column("paper", "mm", group="largest error")] = [row.paper.max_mm for row in rows]
    columns |= _by_method(rows, "mm", "largest error", lambda one: one.median["max_mm"])
    for name in METHODS:
        columns[Column(name, group="mean / paper's", digits=2)] = [row.ratio[name] for row in rows]
    for name in METHODS:
        columns[Column(name, group="verdict")] = [_verdict(row, name) for row in rows]
    one_size = len({row.paper.n_train for row in rows}) == 1
    if one_size:
        del columns[Column("poses")]
    poses = f", {format_number(rows[0].paper.n_train)} poses" if one_size else ""
    return _table(
        columns,
        f"Table {number}, accuracy{poses}. Error of a single coordinate. Mean error: on 2000 further poses, "
        "median and range of the starts. Largest error: on as many poses as the paper tested, median of the starts. "
        f"{SHARES_NOTE.rstrip('.')}",
    )


def _verdict(row: RowResult, name: Method) -> str | None:
    text = row.verdict[name] or (f"as row {row.same_training_as}" if name == "trainlm" else None)
    result = row.results[name]
    return mark_cut(text, result.n_cut) if text and result is not None and text != CUT_SHORT else text


def _effort(number: int, rows: Sequence[RowResult]) -> Table:
    columns: dict[Column, list[Cell]] = {
        Column("row"): [row.paper.row for row in rows],
        Column("units"): [_units(row) for row in rows],
    }
    # Settings that no row of the table varies are stated in its caption.
    settings: dict[str, list[Cell]] = {
        "learning rate": [format_exact(row.paper.learning_rate) for row in rows],
        "goal": [_power(row.paper.goal) for row in rows],
    }
    columns |= {Column(name): cells for name, cells in settings.items() if len(set(cells)) > 1}
    fixed = "".join(f", {name} {cells[0]}" for name, cells in settings.items() if len(set(cells)) == 1)
    columns[Column("paper", group="epochs")] = [row.paper.epochs for row in rows]
    columns |= _by_method(rows, "", "epochs", lambda one: round(one.median["epochs"]))
    columns[Column("paper", "s", group="training time")] = [row.paper.seconds for row in rows]
    columns |= _by_method(rows, "s", "training time", lambda one: one.median["seconds"])
    group = "time to the paper's mean error"
    timed = [row for row in rows if row.timed]
    for name in METHODS:
        columns[Column(name, "s", group=group)] = _cells(
            rows, name, lambda one: float(np.median(one.seconds_to_paper)) if one.seconds_to_paper else None, only=timed
        )
        columns[Column(f"{name}, starts", "s", group=group)] = _cells(
            rows, name, lambda one: f"{len(one.seconds_to_paper)}/{len(one.runs)}", only=timed
        )
    cut = "starts cut by our time limit"
    columns |= _by_method(rows, "", cut, lambda one: f"{one.n_cut}/{len(one.runs)}" if one.n_cut else None)
    columns[Column("trainlm stopped by")] = _cells(rows, "trainlm", _stops)
    return _table(
        columns,
        f"Table {number}, effort{fixed}. Medians of the starts. Time to the paper's mean error: until the error on "
        "2000 further poses first was at or below it, median of the starts that reached it, and their number. "
        f"{SHARES_NOTE.rstrip('.')}",
    )


def _table(columns: Mapping[Column, Sequence[Cell]], caption: str) -> Table:
    """A table without its empty columns."""
    filled = {column: cells for column, cells in columns.items() if any(cell is not None for cell in cells)}
    return Table(tuple(filled), tuple(zip(*filled.values(), strict=True)), caption, folded=True)


def _cells(
    rows: Sequence[RowResult],
    name: Method,
    value: Callable[[TrainerResult], Cell],
    *,
    only: Sequence[RowResult] | None = None,
) -> list[Cell]:
    """A value of each row's result by a trainer; None where it was not run or is not among `only`."""
    results = [row.results[name] if only is None or row in only else None for row in rows]
    return [None if result is None else value(result) for result in results]


def _by_method(
    rows: Sequence[RowResult], unit: str, group: str, value: Callable[[TrainerResult], Cell]
) -> dict[Column, list[Cell]]:
    """A column of `_cells` for each method."""
    return {Column(name, unit, group=group): _cells(rows, name, value) for name in METHODS}


def _stops(result: TrainerResult) -> str:
    stops = Counter(run.stop.strip().rstrip(".") for run in result.runs)
    # MATLAB's "Maximum epoch reached" and the like: the words that a MATLAB user knows.
    return join_phrases((stop if len(stops) == 1 else f"{stop} ({n})" for stop, n in stops.most_common()), most=2)


def _units(row: RowResult) -> str:
    hidden = ", ".join(str(units) for units in row.paper.hidden)
    activation = "" if row.activation == "tansig" else f" {row.activation}"
    trainer = "" if row.paper.trainer == "trainlm" else f" {row.paper.trainer}"
    return f"{hidden}{activation}{trainer}"


def _figure_row(row: RowResult) -> TableFigureRow:
    results = {name: result for name, result in row.results.items() if result is not None}
    return TableFigureRow(
        (f"{row.paper.row}{'*' * any(one.n_cut for one in results.values())}", str(row.paper.n_train), _units(row)),
        row.paper.mean_mm,
        row.paper.seconds,
        {name: [run.mean_many_mm for run in one.runs] for name, one in results.items()},
        {name: [run.seconds_to_paper for run in one.runs] for name, one in results.items() if row.timed},
    )


def _describe_starts(rows: Sequence[RowResult]) -> str:
    parts = []
    for name in METHODS:
        by_starts: dict[int, list[int]] = {}
        by_limit: dict[float, list[int]] = {}
        for row, result in trained(rows, name):
            by_starts.setdefault(len(result.runs), []).append(row.paper.row)
            if result.time_limit_s is not None:
                by_limit.setdefault(result.time_limit_s, []).append(row.paper.row)
        if not by_starts:
            continue
        most = max(by_starts, key=lambda n: len(by_starts[n]))
        others = [f"{n} in {format_row_numbers(numbers)}" for n, numbers in sorted(by_starts.items()) if n != most]
        text = f"{name}: {format_count(most, 'start')}" + (f" ({', '.join(others)})" if others else "")
        limits = [
            f"{format_in_text(limit, unit='s')} in {format_row_numbers(numbers)}"
            for limit, numbers in sorted(by_limit.items())
        ]
        parts.append(text + (f", time limit {', '.join(limits)}" if limits else ""))
    return f"Random starts of each row. {'; '.join(parts)}." if parts else ""


def _notes(rows: Sequence[RowResult]) -> list[str]:
    notes: dict[str, list[int]] = {}
    for row in rows:
        if row.note:
            notes.setdefault(row.note.strip(), []).append(row.paper.row)
    return [f"{capitalize(format_row_numbers(numbers))}: {note}" for note, numbers in notes.items()]


def _power(value: float) -> str:
    """4e-05 as 4e-5: as MATLAB's users write it."""
    mantissa, _, exponent = f"{value:g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa


# Comparison of the trainers over rows --------------------------------------------------------------------------------


def as_accurate(rows: Iterable[RowResult], name: Method) -> tuple[int, int]:
    """The number of rows in which at least half of the starts reach the paper's error, and the number of rows.

    A training that several rows share counts once; rows that were used to fit the box or have no time do not.
    """
    counted = [row for row in rows if row.timed and row.verdicts.get(name, FITTED_BOX) != FITTED_BOX]
    results = [result for _, result in trained(counted, name)]
    return sum(result.reaches_paper_error for result in results), len(results)


def speedups(rows: Iterable[RowResult]) -> list[float]:
    """For each row in which both reach the paper's mean error: trainlm's time to it by varpro's.

    Only rows of trainlm that share neither training with another row.
    """
    ratios = []
    for row in rows:
        results = [row.results[name] for name in row.verdicts] if row.timed else []
        times = [
            float(np.median(one.seconds_to_paper)) for one in results if one is not None and one.reaches_paper_error
        ]
        if len(times) == 2 and times[1] > 0:
            ratios.append(times[0] / times[1])
    return ratios


def count_verdicts(rows: Iterable[RowResult], name: Method) -> Counter[str]:
    """Verdicts of the trainings that were run, each once."""
    return Counter(row.verdicts[name] for row in rows if name in row.verdicts)


def describe_skipped_rows(tables: Mapping[int, Sequence[RowResult] | None]) -> str:
    """How many rows of the tables each trainer ran, and which were skipped; empty if all were run."""
    n_rows = sum(len(rows or ()) for rows in tables.values())
    sentences = []
    for name in METHODS:
        skipped = {number: [row for row in rows or () if row.results[name] is None] for number, rows in tables.items()}
        n_skipped = sum(map(len, skipped.values()))
        if not n_skipped:
            continue
        parts = [
            f"Table {number} {format_row_numbers(row.paper.row for row in rows)}"
            for number, rows in skipped.items()
            if rows
        ]
        run = f"{n_rows - n_skipped} of {format_count(n_rows, 'row')}"
        sentences.append(f"{name} ran {run}, without {', '.join(parts)}.")
    return " ".join(sentences)


def describe_accuracy(rows: Sequence[RowResult]) -> str:
    """In how many rows each trainer reaches the paper's accuracy; empty if none was run."""
    counts = {name: as_accurate(rows, name) for name in METHODS}
    parts = [f"in {good} of {format_count(run, 'row')} with {name}" for name, (good, run) in counts.items() if run]
    if not parts:
        return ""
    cut = {name: count_cut(rows, name) for name in METHODS}
    cuts = " and ".join(f"of {format_count(n, 'row')} with {name}" for name, n in cut.items() if n)
    return (
        f"Half of the starts or more reach the paper's mean error {' and '.join(parts)}; rows that were used to fit "
        f"the box, and repeated rows, are not counted. {f'Our time limit cut trainings {cuts}. ' if cuts else ''}"
        f"{SHARES_NOTE}"
    )


def count_cut(rows: Iterable[RowResult], name: Method) -> int:
    """The number of rows with a training that the time limit ended, each training once."""
    return sum(result.n_cut > 0 for row, result in trained(list(rows), name) if name in row.verdicts)
