"""Tables of other programs: what ``truearm import`` makes of each kind of file, with what a person would type."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.commands import command_output
from benchmarks.rows import RowResult, Rows, Target, scratch
from benchmarks.table_kinds import Kind, all_kinds
from truearm.readings import read_session

ROWS = Rows()
OUTCOMES = (
    "right, nothing stated",
    "right, columns and units stated",
    "refused with a remedy that works",
    "refused without",
    "wrong content",
)
NEEDED = 80 / 91


@ROWS.row("kinds", "tables of other programs, by what becomes of them")
def kinds(every: bool = False) -> RowResult:
    """Import every kind of table: with nothing stated, and where that is refused, with the columns and units."""
    found = {name: outcome(kind, scratch()) for name, kind in all_kinds().items()}
    counts = Counter(what for what, _ in found.values())
    table = [
        {"kind": name, "": what, "message": said.partition("truearm: ")[2]}
        for name, (what, said) in found.items()
        if every or what not in OUTCOMES[:2]
    ]
    n, n_right = len(found), counts[OUTCOMES[0]] + counts[OUTCOMES[1]]
    return RowResult(
        table,
        [
            Target(f"of {n} kinds right", n_right, np.ceil(n * NEEDED), "above"),
            Target("accepted with wrong content", counts["wrong content"], 0),
            Target("refused without an option that mends it", counts["refused without"], 0),
        ],
        [", ".join(f"{counts[what]} {what}" for what in OUTCOMES)],
    )


def outcome(kind: Kind, folder: Path) -> tuple[str, str]:
    """What becomes of a kind of table, and what the command says."""
    table = folder / f"table{kind.suffix}"
    table.write_bytes(kind.write())
    for what, columns in zip(OUTCOMES, ([], stated_columns(kind)), strict=False):
        code, said = run(table, columns, kind.options)
        if code == 0:
            is_right = not kind.remedy and kind.is_right(session(table))
            return (what if is_right else "wrong content"), said
    if kind.remedy and all(f"--{name}" in said for name in kind.remedy):
        code, _ = run(table, columns, kind.options | kind.remedy)
        if code == 0 and kind.is_right(session(table)):
            return "refused with a remedy that works", said
    return "refused without", said


def stated_columns(kind: Kind) -> list[str]:
    """Options that state columns and units."""
    options = ["--angles", ",".join(kind.angles), "--angle-unit", kind.angle_unit]
    if kind.points:
        options += ["--point", ",".join(kind.points), "--point-unit", kind.point_unit]
    return options


def run(table: Path, columns: list[str], options: dict[str, str]) -> tuple[int, str]:
    """Run ``truearm import``: its exit code and all that it says."""
    arguments = ["import", str(table), "--out", str(table.with_name("session.csv")), *columns]
    for name, value in options.items():
        arguments += [f"--{name.replace('_', '-')}", value]
    table.with_name("session.csv").unlink(missing_ok=True)
    return command_output(*arguments)


def session(table: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Angles [deg] and points [mm] of the session file that was written."""
    written = read_session(table.with_name("session.csv"))
    return np.degrees(written.angles), written.points
