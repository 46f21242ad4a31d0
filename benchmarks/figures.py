"""Figures of the guide: benchmarks keep what they print in `docs/figures`, and the pages take it from there.

``python -m benchmarks NAME ROW --keep`` writes the rows into ``docs/figures/NAME.json``, with the command, the commit,
the day and the machine. Two marks in a page take from there, and `pages` fills them in::

    <!-- figures: exports urdf; columns: format, mean_mm -->    a table, up to <!-- end -->
    0.377<!-- exports urdf > exported URDF > mean_mm --> mm     a number: first cell of its row, column

A number keeps the decimals that it has in the page. Without a row a table has all rows of the benchmark; the name
`targets` gives the targets of all. Rows whose `code` is empty were typed before figures were kept.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.rows import ROOT, RowResult, Rows, Target, machine, run_row

ROWS = Rows()
PAGES, KEPT = ROOT / "docs", ROOT / "docs" / "figures"
SOURCE = ROOT / "src" / "truearm"
TABLE = re.compile(r"(<!-- figures: (\w+)(?: ([\w-]+))?(?:; columns: ([^>]+?))? -->\n).*?(<!-- end -->)", re.DOTALL)
NUMBER = re.compile(r"(-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?)(<!-- (\w+) ([\w-]+) > ([^>]+?) > ([^>]+?) -->)")
# Times and memory scatter with the machine's load; everything else is computed from fixed seeds.
SCATTERS = re.compile(r"\b(s|ms|us|min|MB|GB)\b|CPU|time|second|elapsed", re.IGNORECASE)
SCATTER_OF_TIMES, SCATTER_OF_VALUES = 0.5, 0.02


def keep(benchmark: str, done: dict[str, dict[str, Any]]) -> None:
    """Write what rows gave, beside what is kept of others, with the commit and the state of the code."""
    file = KEPT / f"{benchmark}.json"
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    about = {
        "commit": git("log", "-1", "--format=%h", "--", "src/truearm", "benchmarks"),
        "day": datetime.date.today().isoformat(),
        "machine": machine(),
        "code": code_of(benchmark),
    }
    kept |= {row: about | found for row, found in done.items()}
    KEPT.mkdir(exist_ok=True)
    file.write_text(
        json.dumps(rounded(dict(sorted(kept.items()))), indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def git(*arguments: str) -> str:
    """What git says; nothing outside a repository."""
    ran = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    return ran.stdout.strip()


def code_of(benchmark: str) -> dict[str, str]:
    """Hash of each room of the source that is loaded (of all, where rows have processes of their own), and its own.

    A wing is a room, and is loaded where more of it is than what says its names.
    """
    modules = [name.split(".")[1:] for name in sys.modules if name.startswith("truearm.")]
    loaded = {inner[0] for inner in modules} | {"/".join(inner[:2]) for inner in modules if len(inner) > 2}
    own_processes = {row.threads for row in import_module(f"benchmarks.{benchmark}").ROWS.values()} != {"as here"}
    places = sorted({*SOURCE.iterdir(), *(SOURCE / "wings").iterdir()} - {SOURCE / "wings"})
    named = {path.relative_to(SOURCE).as_posix(): path for path in places if path.stem[0] != "_"}
    rooms = {name: path for name, path in named.items() if own_processes or name.removesuffix(".py") in loaded}
    own = [file for file in (ROOT / "benchmarks" / f"{benchmark}.py", ROOT / "benchmarks" / benchmark) if file.exists()]
    return {name: hash_of(path) for name, path in (rooms | {path.name: path for path in own}).items()}


def hash_of(path: Path) -> str:
    """Of the Python source in a file or folder."""
    files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()[:12]


def changed(entry: dict[str, Any]) -> list[str]:
    """What has changed of the code since a row was measured."""
    if not entry["code"]:
        return ["not recorded"]
    places = {name: SOURCE / name if (SOURCE / name).exists() else ROOT / "benchmarks" / name for name in entry["code"]}
    return [name for name, place in places.items() if not place.exists() or hash_of(place) != entry["code"][name]]


def rounded(value: Any) -> Any:
    """Numbers to six digits."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def kept_rows() -> dict[tuple[str, str], dict[str, Any]]:
    """All rows that are kept, by benchmark and name."""
    files = sorted(KEPT.glob("*.json"))
    return {
        (file.stem, row): entry for file in files for row, entry in json.loads(file.read_text(encoding="utf-8")).items()
    }


def table_of(entry: dict[str, Any]) -> list[dict[str, Any]]:
    """The table of a row, or its targets where it has no other."""
    return entry["table"] or targets_of(entry)


def targets_of(entry: dict[str, Any]) -> list[dict[str, Any]]:
    """Targets as rows of a table, with the verdict."""
    signs = {"below": "<=", "above": ">="}
    return [
        {
            "number": one["what"],
            "target": one["limit"] if isinstance(one["limit"], str) else f"{signs[one['good']]} {one['limit']:g}",
            "reached": one["reached"],
            "": "met" if one["met"] else "missed",
        }
        for one in entry["targets"]
    ]


def labels_of(row: dict[str, Any]) -> set[str]:
    """Names of a line of a table: its first cell, and all texts before its first number."""
    cells = list(row.values())
    texts: list[str] = []
    for cell in cells:
        if not isinstance(cell, str):
            break
        texts.append(cell)
    return {str(cells[0]), " / ".join(texts)}


def number(benchmark: str, row: str, label: str, column: str) -> float:
    """A number that is kept; of a text the first one in it.

    Raises
    ------
    LookupError
        If there is none.
    """
    entry = kept_rows()[benchmark, row]
    lines = [line for line in [*entry["table"], *targets_of(entry)] if label in labels_of(line) and column in line]
    if len(lines) != 1:
        raise LookupError(f"{len(lines)} lines {label!r} with {column!r} in {benchmark} {row}")
    cell = lines[0][column]
    found = re.search(r"-?\d+(\.\d+)?(e-?\d+)?", str(cell))
    if found is None:
        raise LookupError(f"no number in {cell!r}, {label!r} of {benchmark} {row}")
    return float(found[0])


def markdown(benchmark: str, row: str | None, columns: str | None) -> str:
    """A row's table, with the command and when it was measured; of all rows of the benchmark without a row."""
    if benchmark == "targets":
        judged = [line | {"command": f"`{row['command']}`"} for row in kept_rows().values() for line in targets_of(row)]
        return table_text(judged)
    chosen = [entry for (name, one), entry in kept_rows().items() if name == benchmark and row in (None, one)]
    if not chosen:
        raise LookupError(f"no figures of {benchmark} {row or ''} are kept")
    parts = []
    for entry in chosen:
        heading = [] if row else [f"**{entry['what']}**"]
        judged = targets_of(entry) if entry["table"] else []
        verdicts = [f"{t['number']}: {shown(t['reached'])} ({t['target']}): {t['']}." for t in judged]
        source = f"`{entry['command']}`, commit {entry['commit']}, {entry['day']}, {where(entry)}."
        lines = table_text(table_of(entry), columns.split(", ") if columns else None)
        parts += [*heading, lines, *verdicts, *entry["notes"], source]
    return "\n\n".join(parts)


def table_text(lines: list[dict[str, Any]], columns: list[str] | None = None) -> str:
    """A table of a page, with all its columns by default."""
    columns = columns or list(dict.fromkeys(key for line in lines for key in line))
    cells = [columns, ["---"] * len(columns), *([shown(line.get(key, "")) for key in columns] for line in lines)]
    return "\n".join("| " + " | ".join(line) + " |" for line in cells)


def shown(value: Any) -> str:
    """A cell of a table in a page."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: ""}[value]
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", "\\|")


def where(entry: dict[str, Any]) -> str:
    """The machine of a row."""
    about = entry["machine"]
    cores = f", {about['cores']} cores, Python {about['python']}" if "cores" in about else ""
    load = f", load {about['busy cores before']}" if "busy cores before" in about else ""
    return f"{about['cpu']}{cores}{load}"


def filled(page: str) -> str:
    """A page with its tables and numbers as they are kept."""

    def table(found: re.Match[str]) -> str:
        return f"{found[1]}\n{markdown(found[2], found[3], found[4])}\n\n{found[5]}"

    def one(found: re.Match[str]) -> str:
        decimals = len(found[1].partition(".")[2])
        return f"{number(*found.group(3, 4, 5, 6)):,.{decimals}f}{found[2]}"

    return NUMBER.sub(one, TABLE.sub(table, page))


def guide() -> Iterator[Path]:
    """Pages of the guide, and the README."""
    yield ROOT / "README.md"
    yield from (page for page in sorted(PAGES.rglob("*.md")) if "_build" not in page.parts)


@ROWS.row("pages", "write the kept figures into the pages that quote them")
def pages() -> Iterator[dict[str, Any]]:
    """Write the kept figures into the pages that quote them."""
    for page in guide():
        text = page.read_text(encoding="utf-8")
        if (new := filled(text)) != text:
            page.write_text(new, encoding="utf-8")
            yield {
                "page": page.name,
                "lines": sum(a != b for a, b in zip(text.split("\n"), new.split("\n"), strict=False)),
            }


@ROWS.row("stale", "kept rows whose code has changed since they were measured")
def stale() -> Iterator[dict[str, Any]]:
    """Kept rows whose code has changed since they were measured."""
    for (benchmark, row), entry in kept_rows().items():
        if rooms := changed(entry):
            yield {"benchmark": benchmark, "row": row, "commit": entry["commit"], "changed since": ", ".join(rooms)}


@ROWS.row("again", "short rows measured again, against what is kept", is_long=True)
def again(seconds: float = 120.0) -> RowResult:
    """Measure rows again that took less than some seconds; numbers that differ by more than their scatter."""
    table, n = [], 0
    for (benchmark, row), entry in kept_rows().items():
        if entry["seconds"] is None or entry["seconds"] > seconds:
            continue
        found = run_row(benchmark, row, entry["options"])
        olds, news = (
            rounded(numbered(*one)) for one in ((entry["table"], entry["targets"]), (found.table, found.targets))
        )
        n += 1
        name = {"row": f"{benchmark} {row}"}
        if len(olds) != len(news):
            table.append(name | {"line": "all", "column": "lines", "kept": len(olds), "now": len(news)})
        for old, new in zip(olds, news, strict=False):
            line = name | {"line": str(next(iter(old.values())))}
            different = [column for column in old if differs(column, old[column], new.get(column))]
            table += [line | {"column": one, "kept": old[one], "now": new.get(one)} for one in different]
    return RowResult(
        table, [Target(f"numbers of {n} rows that differ by more than their scatter", len(table) if n else None, 0)]
    )


def numbered(table: Sequence[dict[str, Any]], targets: Sequence[dict[str, Any] | Target]) -> list[dict[str, Any]]:
    """The lines of a table, and what was reached of each target, by the name that says its unit."""
    plain = [asdict(one) if isinstance(one, Target) else one for one in targets]
    return [*table, *({"number": one["what"], one["what"]: one["reached"]} for one in plain)]


def differs(column: str, old: Any, new: Any) -> bool:
    """Whether a number is another one: by 2 %, or by half for times and memory."""
    if not isinstance(old, int | float) or not isinstance(new, int | float):
        return bool(old != new)
    scatter = SCATTER_OF_TIMES if SCATTERS.search(column) else SCATTER_OF_VALUES
    return abs(new - old) > scatter * max(abs(old), abs(new))
