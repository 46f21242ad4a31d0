"""Share of small mutations of the source that the tests of the same room kill: a sample, of nightly size.

A mutant is a copy of `src` in which one operator, comparison, number, call or statement differs. The tests in the
directory of the mutated module run against it, those that name the module first and none of those that are marked
slow, until one fails. A mutant that survives shows a line that no law holds, or one that may be written either way (an
equivalent mutant): a person judges.
"""

from __future__ import annotations

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.rows import ROOT, RowResult, Rows, Target

ROWS = Rows()

ROOMS = (
    "solve",
    "files",
    "identification/estimation",
    "identification/judgement",
    "wings/laboratory/monitor",
    "wings/laboratory/standards",
)
WANTED = 85.0  # [%]
PACKAGE = Path("src", "truearm")

# What each operator becomes. A boundary that moves (`<` to `<=`) differs for whole numbers alone, so it is one of two.
OPERATORS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.Pow: (ast.Mult,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
# Functions whose first argument stands for the result: without them a value is not bounded, not positive, not a root.
DROPPED = {"abs", "clip", "exp", "expm1", "hypot", "log", "log1p", "max", "maximum", "min", "minimum", "sqrt", "unique"}


def mutations_of(node: ast.AST) -> Iterator[tuple[int, str, Callable[[], None]]]:
    """Line, description and act of each mutation below a node; the act changes the tree. None of types."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for place, one in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(one, ast.AST):
                for said, other in _others(one):
                    act = partial(_put, node, field, place if isinstance(value, list) else None, other)
                    yield getattr(one, "lineno", getattr(node, "lineno", 0)), said, act
                yield from mutations_of(one)


def _put(node: ast.AST, field: str, place: int | None, other: ast.AST) -> None:
    """Put another node into a field of a node, or into its place of a list."""
    if place is None:
        setattr(node, field, other)
    else:
        getattr(node, field)[place] = other


def _others(one: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What a node may become, with a description."""
    for kind in OPERATORS.get(type(one), ()):
        yield f"{type(one).__name__} -> {kind.__name__}", kind()
    match one:
        case ast.Constant(value=bool() as value):
            yield f"{value} -> {not value}", ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            changed = value + 1 if value < 10 else 2 * value
            yield f"{value:g} -> {changed:g}", ast.Constant(changed)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield f"{ast.unparse(one)} -> {ast.unparse(operand)}", operand
        case ast.Call(func=ast.Name(id="max" | "min"), args=[_]):  # of an iterable: not a number without it
            return
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[first, *_]) if name in DROPPED:
            yield f"{ast.unparse(one)} -> {ast.unparse(first)}", first
        case ast.Raise() | ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield f"without {ast.unparse(one)}", ast.copy_location(ast.Pass(), one)


def sampled(room: str, n: int, seed: int) -> list[tuple[Path, int]]:
    """Module and number of the mutation of n mutants of a room: every mutation is as probable as every other."""
    sites = [
        (file.relative_to(ROOT), number)
        for file in sorted((ROOT / PACKAGE / room).rglob("*.py"))
        for number, _ in enumerate(mutations_of(ast.parse(file.read_text(encoding="utf-8"))))
    ]
    return random.Random(f"{seed} {room}").sample(sites, min(n, len(sites)))


def tests_of(module: Path) -> list[str]:
    """Test files of a module's directory, or of the next one above that has some; those that name the module first."""
    folder = ROOT / "tests" / module.parent.relative_to(PACKAGE)
    while not (files := sorted(folder.glob("test_*.py"))):
        folder = folder.parent
    return [str(file) for file in sorted(files, key=lambda one: module.stem not in one.read_text(encoding="utf-8"))]


def mutant(module: Path, number: int, copy: Path, timeout_s: float) -> dict[str, Any]:
    """Make a mutant in a copy of the source, and run the tests."""
    source = (ROOT / module).read_text(encoding="utf-8")
    tree = ast.parse(source)
    line, said, act = list(mutations_of(tree))[number]
    act()
    (copy / module).write_text(ast.unparse(ast.fix_missing_locations(tree)), encoding="utf-8")
    pytest = [sys.executable, "-B", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n", "0", "-m", "not slow"]
    environment = os.environ | {"PYTHONPATH": str(copy / "src")}
    try:
        ran = subprocess.run(
            [*pytest, *tests_of(module)], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=timeout_s
        )
        failed = [row for row in ran.stdout.splitlines() if row.startswith(("FAILED", "ERROR"))] or ["at once"]
        found = failed[0].partition(" - ")[0].rpartition("/")[2] if ran.returncode else ""
    except subprocess.TimeoutExpired:
        found = "never ends"
    finally:
        (copy / module).write_text(source, encoding="utf-8")
    short = said if len(said) < 80 else said[:77] + "..."
    return {"place": f"{module.relative_to(PACKAGE)}:{line}", "mutation": short, "killed by": found}


@ROWS.row("sample", quick={"rooms": ("solve",), "mutants": 1}, is_long=True)
def sample(rooms: tuple[str, ...] = ROOMS, mutants: int = 8, seed: int = 1, timeout_s: float = 600.0) -> RowResult:
    """Some mutants of each room; those that survive have an empty last column."""
    table, targets = [], []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        shutil.copytree(ROOT / "src", copy / "src", ignore=shutil.ignore_patterns("__pycache__"))
        for room in rooms:
            found = []
            for module, number in sampled(room, mutants, seed):
                found.append(mutant(module, number, copy, timeout_s))
                print(*found[-1].values(), sep="  ", file=sys.stderr, flush=True)
            table += found
            killed = sum(bool(one["killed by"]) for one in found)
            what = f"{room}: killed, of {len(found)} mutants [%]"
            targets.append(Target(what, 100 * killed / len(found), WANTED, good="above"))
    return RowResult(table, targets)
