"""Run a benchmark: ``python -m benchmarks [NAME [ROW ...]] [--list] [--json] [--quick] [--keep] [options]``.

Without a name it lists the benchmarks; ``python -m benchmarks NAME --list`` lists rows and options.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import sys
import tempfile
import time
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.figures import keep
from benchmarks.rows import SCRATCH, Row, RowResult, Rows, machine, run_row


def benchmarks() -> dict[str, str]:
    """Names of the benchmarks, with the first line of their text."""
    here = Path(__file__).parent
    files = {file.stem: file for file in here.glob("*.py")}
    files |= {file.parent.name: file for file in here.glob("*/__init__.py")}
    texts = {name: file.read_text(encoding="utf-8") for name, file in sorted(files.items())}
    return {
        name: (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
        for name, text in texts.items()
        if "\nROWS = Rows()" in text
    }


def parser_of(name: str, rows: Rows) -> argparse.ArgumentParser:
    """The command line of a benchmark: its rows, and all of their options."""
    module = import_module(f"benchmarks.{name}")
    parser = argparse.ArgumentParser(
        f"python -m benchmarks {name}", description=module.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"{', '.join(rows)}; all by default")
    parser.add_argument("--list", action="store_true", help="list the rows with their options")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="the smallest sizes, which show that it runs")
    parser.add_argument(
        "--keep", action="store_true", help="keep what is printed in docs/figures, for the guide's pages"
    )
    for option, default in {option: value for row in rows.values() for option, value in row.options.items()}.items():
        parser.add_argument(f"--{option.replace('_', '-')}", default=argparse.SUPPRESS, **option_type(default))
    return parser


def option_type(default: Any) -> dict[str, Any]:
    """The type of an option with this default, as arguments of `add_argument`."""
    if isinstance(default, tuple):
        return {"nargs": "+", "type": type(default[0]) if default else str}
    if isinstance(default, bool):
        return {"action": "store_true"}
    return {"type": str if default is None else type(default)}


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    name, *rest = (sys.argv[1:] if arguments is None else arguments) or [""]
    known = benchmarks()
    if name not in known:
        print_table([{"benchmark": one, "": what} for one, what in known.items()])
        sys.exit(f"there is no benchmark {name}" if name and not name.startswith("-") else f"\n{__doc__}")
    rows: Rows = import_module(f"benchmarks.{name}").ROWS
    parser = parser_of(name, rows)
    options = vars(parser.parse_args(rest))
    chosen, as_json, quick = options.pop("rows"), options.pop("json"), options.pop("quick")
    keeps = options.pop("keep")
    if keeps and quick:
        parser.error("figures of the smallest sizes are not kept: either --keep or --quick")
    if unknown := [one for one in chosen if one not in rows]:
        parser.error(f"expected rows among {', '.join(rows)}, got {', '.join(unknown)}")
    if options.pop("list"):
        print_table(
            [{"row": one, "what": row.what, "options": format_options(row.options)} for one, row in rows.items()]
        )
        return
    chosen = {one: rows[one] for one in chosen or [one for one, row in rows.items() if not row.is_long]}
    if unknown_option := [one for one in options if not any(one in row.options for row in chosen.values())]:
        parser.error(f"none of the rows {', '.join(chosen)} has the option --{unknown_option[0]}")
    about = machine()
    if not as_json:
        print(", ".join(f"{what} {value}" for what, value in about.items()), flush=True)
    done: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ[SCRATCH] = folder
        for one, row in chosen.items():
            given = row.options | (row.quick if quick else {}) | {k: v for k, v in options.items() if k in row.options}
            begun, cpu = time.perf_counter(), time.process_time()
            found = run_row(name, one, given)
            seconds = {"seconds": time.perf_counter() - begun, "cpu_seconds": time.process_time() - cpu}
            judged = [asdict(target) | {"met": target.met} for target in found.targets]
            done[one] = {"what": row.what, "command": command_of(name, one, row, given), "options": given, **seconds}
            done[one] |= {"table": found.table, "targets": judged, "notes": found.notes}
            if keeps:  # at once, since a later row may be stopped
                keep(name, {one: json.loads(json.dumps(done[one], default=plain))})
            if not as_json:
                print_row(one, row, given, found, seconds)
    judged = [target for found in done.values() for target in found["targets"]]
    if as_json:
        print(json.dumps({"machine": about, "rows": done, "targets": judged}, indent=2, default=plain, allow_nan=False))
    elif judged:
        signs = {"below": "<=", "above": ">="}
        print()
        print_table([
            {
                "target": t["what"],
                " ": f"{signs[t['good']]} {t['limit']:g}",
                "reached": t["reached"],
                "": "met" if t["met"] else "missed",
            }
            for t in judged
        ])  # fmt: skip


def print_row(name: str, row: Row, options: dict[str, Any], found: RowResult, seconds: dict[str, float]) -> None:
    """Print what a row gives."""
    print(f"\n{name}: {row.what}" + (f" ({format_options(options)})" if options else ""))
    print_table(found.table)
    for one in found.targets if not found.table else ():
        print(f"{one.what}: {text(one.reached)}")
    for note in found.notes:
        print(note)
    print(f"{seconds['seconds']:.1f} s, {seconds['cpu_seconds']:.1f} s of CPU time here", flush=True)


def command_of(name: str, one: str, row: Row, given: dict[str, Any]) -> str:
    """The command that measures a row with these options."""
    changed = {option: value for option, value in given.items() if value != row.options[option]}
    return f"python -m benchmarks {name} {one} {format_options(changed)}".rstrip()


def format_options(options: dict[str, Any]) -> str:
    """Options as they are typed."""
    values = {o: " ".join(map(str, v)) if isinstance(v, tuple | list) else v for o, v in options.items()}
    return " ".join(f"--{o.replace('_', '-')} {v}" for o, v in values.items() if v or type(v) is int)


def print_table(rows: Any) -> None:
    """Print dicts as a table: texts to the left, numbers to the right."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    sides = [">" if all(isinstance(row.get(c, 0), int | float | None) for row in rows) else "<" for c in columns]
    cells = [columns, *([text(row.get(name, "")) for name in columns] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells if rows else ():
        print("  ".join(f"{c:{side}{width}}" for c, side, width in zip(row, sides, widths, strict=True)).rstrip())


def text(value: Any) -> str:
    """A cell: numbers to four digits."""
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None else str(value)


def plain(value: Any) -> Any:
    """Arrays, NumPy's numbers and paths for JSON."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


if __name__ == "__main__":
    main()
