"""Tables of other programs: what ``truearm import`` makes of each kind of file, with what a person would type."""

from __future__ import annotations

import contextlib
import io
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.rows import RowResult, Rows, Target, scratch
from benchmarks.table_kinds import Kind, all_kinds
from truearm.cli import main
from truearm.readings import read_session

ROWS = Rows()
OUTCOMES = ("right", "refused with a remedy that works", "refused without", "wrong content")
NEEDED = 80  # of 91


@ROWS.row("kinds", "tables of other programs, by what becomes of them")
def kinds(all: bool = False) -> RowResult:
    """Import every kind of table."""
    found = {name: outcome(kind, scratch()) for name, kind in all_kinds().items()}
    counts = Counter(what for what, _ in found.values())
    table = [{"kind": n, "": what, "message": said} for n, (what, said) in found.items() if all or what != "right"]
    share = counts["right"] / len(found)
    return RowResult(
        table,
        [
            Target(f"of {len(found)} kinds right", counts["right"], np.ceil(len(found) * NEEDED / 91), "above"),
            Target("accepted with wrong content", counts["wrong content"], 0),
            Target("refused without an option that mends it", counts["refused without"], 0),
        ],
        [f"{share:.0%} right: " + ", ".join(f"{counts[what]} {what}" for what in OUTCOMES)],
    )


def outcome(kind: Kind, folder: Path) -> tuple[str, str]:
    """What becomes of a kind of table, and what the command says."""
    table = folder / f"table{kind.suffix}"
    table.write_bytes(kind.write())
    code, said = run(kind, table, kind.options)
    if code == 0:
        return ("wrong content" if kind.remedy or not kind.is_right(session(table)) else "right"), ""
    if kind.remedy and all(f"--{name}" in said for name in kind.remedy):
        code, _ = run(kind, table, kind.options | kind.remedy)
        if code == 0 and kind.is_right(session(table)):
            return OUTCOMES[1], said
    return "refused without", said


def run(kind: Kind, table: Path, options: dict[str, str]) -> tuple[int, str]:
    """Run ``truearm import``."""
    arguments = ["import", str(table), "--out", str(table.with_name("session.csv"))]
    if not kind.columns_known:
        arguments += ["--angles", ",".join(kind.angles), "--angle-unit", kind.angle_unit]
        if kind.points:
            arguments += ["--points", ",".join(kind.points), "--point-unit", kind.point_unit]
    for name, value in options.items():
        arguments += [f"--{name.replace('_', '-')}", value]
    table.with_name("session.csv").unlink(missing_ok=True)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main.run(arguments)
        except SystemExit as ended:
            return int(ended.code or 0), " ".join(said.getvalue().split())


def session(table: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Angles [deg] and points [mm] of the session file that was written."""
    written = read_session(table.with_name("session.csv"))
    return np.degrees(written.angles), written.points
