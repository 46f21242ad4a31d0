"""Sizes of the source, and how far a reading walks through it.

The sizes are counted from the syntax trees. A walk is one call of a verb on a small session: of every call of a
function of truearm those count of which an argument is what is followed or a record that holds it, each pair of caller
and function once; what it is asked without an argument is no step. A *stay* is an unbroken stretch in one file; a
*climb* is a call into a file that stands higher by the imports; a *return* is a stay in a file that was left before;
*names* are the parameters that had it. The last columns count the calls that check or convert readings.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import truearm as ta
from benchmarks.rows import ROOT, RowResult, Rows, Target
from truearm.models.compensator import Compensator
from truearm.readings.readings import Readings

HOUSE = Path(ta.__file__).parent
ROWS = Rows()
GUARDS = ("_check_session", "check_angles", "skip_beyond_limits", "state_of", "references_of", "Readings.__post_init__")
MOST_IMPORTS, LONG_FUNCTION = 18, 60


@dataclass
class Source:
    """A file of source: its tree and all nodes of it, its lines of code and what it imports of truearm."""

    path: Path
    tree: ast.Module = field(init=False)
    nodes: list[ast.AST] = field(init=False)
    code: int = field(init=False)
    lines: int = field(init=False)

    def __post_init__(self) -> None:
        text = self.path.read_text(encoding="utf-8")
        self.tree, self.lines = ast.parse(text), text.count("\n")
        self.nodes, said = list(ast.walk(self.tree)), set[int]()
        for node in self.nodes:
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
                said |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
        kept = (i for i, line in enumerate(text.splitlines(), 1) if re.match(r"\s*[^\s#]", line) and i not in said)
        self.code = sum(1 for _ in kept)


def sources(folder: Path) -> dict[str, Source]:
    """The Python files of a folder by module name.

    Raises
    ------
    FileNotFoundError
        If there are none: of nothing no size is small.
    """
    names = {path: ".".join(path.relative_to(folder.parent).with_suffix("").parts) for path in folder.rglob("*.py")}
    if not names:
        raise FileNotFoundError(f"expected Python files in {folder}, there are none: run this in a checkout")
    return {name.removesuffix(".__init__"): Source(path) for path, name in sorted(names.items())}


def imports(files: dict[str, Source]) -> dict[str, set[str]]:
    """Which files a file imports."""
    found: dict[str, set[str]] = {}
    for name, source in files.items():
        used = set()
        for node in source.nodes:
            if isinstance(node, ast.ImportFrom) and node.module:
                # A name of a package is the file of that name, or what its __init__ lists.
                whole = {f"{node.module}.{alias.name}" for alias in node.names}
                used |= {one if one in files else node.module for one in whole}
            elif isinstance(node, ast.Import):
                used |= {alias.name for alias in node.names}
        found[name] = (used & files.keys()) - {name}
    return found


def floors(arrows: dict[str, set[str]]) -> dict[str, int]:
    """Floor of each file: one above the highest that it imports; files without imports stand on floor 1."""
    floor: dict[str, int] = {}

    def of(name: str) -> int:
        if name not in floor:
            floor[name] = 1 + max((of(one) for one in arrows[name]), default=0)
        return floor[name]

    for name in arrows:
        of(name)
    return floor


def plan() -> dict[str, Any]:
    """The budgets of `house.toml`, and the places of each wing: its folder, or what is listed as beside the wings."""
    read = tomllib.loads((ROOT / "house.toml").read_text(encoding="utf-8"))
    folders = sorted(path.name for path in (HOUSE / "wings").iterdir() if (path / "__init__.py").is_file())
    return read | {"wings": read["beside"] | {name: [f"wings.{name}"] for name in folders}}


def wing_of(module: str, wings: dict[str, list[str]]) -> str | None:
    """The wing that a module belongs to; None for one of the core."""
    inner = module.removeprefix("truearm.")
    found = [wing for wing, places in wings.items() for one in places if f"{inner}.".startswith(f"{one}.")]
    return found[0] if found else None


def room_of(module: str, wings: dict[str, list[str]]) -> str:
    """Where the lines of a module count: its wing, or its folder in the core."""
    inner = module.removeprefix("truearm").strip(".").split(".")
    return wing_of(module, wings) or ".".join(inner[:-1][:2]) or "doors"


def names_across(files: dict[str, Source], wings: dict[str, list[str]], *, back: bool = False) -> dict[str, set[str]]:
    """Names of the core that wings import, by module; with `back` names of wings that the core imports, by importer."""
    found: dict[str, set[str]] = defaultdict(set)
    for name, source in files.items():
        here = wing_of(name, wings)
        for node in source.nodes:
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("truearm"):
                continue
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                there = wing_of(whole if whole in files else str(node.module), wings)
                if back and here is None and there is not None:
                    found[name].add(whole)
                if not back and here is not None and there is None:
                    found[str(node.module)].add(alias.name)
    return found


def doors(files: dict[str, Source]) -> dict[str, Source]:
    """Files but those that list everything: the package itself and the table of commands."""
    return {
        name: source
        for name, source in files.items()
        if name not in ("truearm", "truearm.wings", "truearm.command_line")
    }


@ROWS.row("wall")
def wall() -> RowResult:
    """The core and the wings: lines of code and files, and what crosses the wall."""
    files, wings = sources(HOUSE), plan()["wings"]
    rooms: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for name, source in files.items():
        folder = source.path.parent.relative_to(HOUSE).as_posix()
        wing = wing_of(name, wings)
        for room in (folder if folder != "." else "doors", f"wing: {wing}" if wing else "core", "together"):
            rooms[room][0] += source.code
            rooms[room][1] += 1
    across = names_across(doors(files), wings)
    back = names_across(doors(files), wings, back=True)
    order = sorted(rooms, key=lambda room: (room in ("core", "together"), room.startswith("wing: "), room))
    table = [{"part": room, "code lines": rooms[room][0], "files": rooms[room][1]} for room in order]
    return RowResult(
        table,
        [
            Target("code lines of the core", rooms["core"][0], 19000),
            Target("files of the core", rooms["core"][1], 130),
            Target("code lines in all", rooms["together"][0], 57000),
            Target("files in all", rooms["together"][1], 400),
            Target("names of the core that wings import", sum(map(len, across.values())), 150),
            Target("names of wings that the core imports", sum(map(len, back.values())), 0),
        ],
    )


@ROWS.row("across")
def across() -> RowResult:
    """Names of the core that wings import, and names of wings that the core imports, by module."""
    files, wings = doors(sources(HOUSE)), plan()["wings"]
    rows = [
        {
            "module": module.removeprefix("truearm."),
            "names": ", ".join(sorted(name.removeprefix("truearm.") for name in names)),
            "": way,
        }
        for way, back in (("the core imports", True), ("wings import", False))
        for module, names in sorted(names_across(files, wings, back=back).items())
    ]
    return RowResult(rows)


@ROWS.row("sizes")
def sizes() -> RowResult:
    """Sizes of the source, of its rooms and of what stands beside it."""
    files = sources(HOUSE)
    arrows = imports(files)
    words = {name: Counter(re.findall(r"\w+", ast.unparse(source.tree))) for name, source in files.items()}
    nodes = [(name, node) for name, source in files.items() for node in source.nodes]
    functions = [node for _, node in nodes if isinstance(node, ast.FunctionDef)]
    records = [
        node.name
        for _, node in nodes
        if isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(one) for one in node.decorator_list)
    ]
    questions = [
        node
        for _, node in nodes
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) == "isinstance"
        and re.search(r"\b(\w+Model|Compensator)\b", ast.unparse(node.args[1]))
    ]
    users = defaultdict(set)
    for name, used in arrows.items():
        for one in used:
            users[one].add(name)
    rooms = Counter(name.rpartition(".")[0] for name in files)
    into_estimation = [
        one for name in files if ".models." in name for one in arrows[name] if ".identification.estimation." in one
    ]
    tests, benchmarks = sources(ROOT / "tests"), sources(ROOT / "benchmarks")
    counts = {
        "code lines": (sum(s.code for s in files.values()), 40000),
        "all lines": (sum(s.lines for s in files.values()), 63000),
        "files in the largest room": (max(rooms.values()), 25),
        "imports from models into estimation": (len(into_estimation), 20),
        "questions for the type of a model": (len(questions), 10),
        f"files that import more than {MOST_IMPORTS} of ours": (sum(len(a) > MOST_IMPORTS for a in arrows.values()), 2),
        "records used in one file only": (sum(sum(name in w for w in words.values()) == 1 for name in records), 25),
        f"functions of more than {LONG_FUNCTION} lines": (
            sum((f.end_lineno or 0) - f.lineno > LONG_FUNCTION for f in functions),
            30,
        ),
        "files under 120 lines with one user": (
            sum(len(u) == 1 and files[name].lines < 120 for name, u in users.items()),
            12,
        ),
        "code lines of tests": (sum(s.code for s in tests.values()), 37000),
        "code lines of benchmarks": (sum(s.code for s in benchmarks.values()), 5000),
        "files of benchmarks": (len(benchmarks), 25),
    }
    return RowResult(targets=[Target(what, count, limit) for what, (count, limit) in counts.items()])


class Walk:
    """Follows objects of a kind through the calls of truearm."""

    def __init__(self, kind: type, floor: dict[str, int]) -> None:
        self.kind, self.floor = kind, floor
        self.stack: list[tuple[str, str] | None] = []
        self.seen: set[tuple[Any, ...]] = set()
        self.route: list[str] = []
        self.climbs = 0
        self.names: set[str] = set()
        self.guards: Counter[str] = Counter()

    def holds(self, value: object, depth: int = 2) -> bool:
        """Whether a value is of the kind, or a record of truearm that holds one."""
        if isinstance(value, self.kind):
            return True
        if depth == 0 or not type(value).__module__.startswith("truearm."):
            return False
        if isinstance(value, tuple):
            parts: list[object] = list(value)
        elif is_dataclass(value):
            parts = list(getattr(value, "__dict__", {}).values())
        else:
            return False
        return any(self.holds(part, depth - 1) for part in parts)

    def __call__(self, frame: FrameType, event: str, _arg: object) -> None:
        """Take part in every call and return, as `sys.setprofile` wants it."""
        if event == "return" and self.stack:
            self.stack.pop()
        if event != "call":
            return
        module, code = frame.f_globals.get("__name__", ""), frame.f_code
        entered = None
        if module.startswith("truearm.") and not code.co_name.startswith("<"):
            self.guards[code.co_qualname.removeprefix("Compensator.")] += 1
            given = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            names = {name for name in given if self.holds(frame.f_locals.get(name))}
            # What it says of itself without an argument, as its length, is no step of a walk.
            if names and (given != ("self",) or not isinstance(frame.f_locals["self"], self.kind)):
                self.names |= names
                entered = (module, code.co_qualname)
                self._enter(entered)
        self.stack.append(entered)

    def _enter(self, entered: tuple[str, str]) -> None:
        caller = next((one for one in reversed(self.stack) if one is not None), None)
        if (caller, entered) in self.seen:
            return
        self.seen.add((caller, entered))
        for module in ([caller[0]] if caller else []) + [entered[0]]:
            if not self.route or self.route[-1] != module:
                self.route.append(module)
        if caller and self.floor[entered[0]] > self.floor[caller[0]]:
            self.climbs += 1

    @property
    def figures(self) -> list[int]:
        """Stays, files, climbs, returns, names."""
        files = set(self.route)
        return [len(self.route), len(files), self.climbs, len(self.route) - len(files), len(self.names)]


def walk(work: Callable[[], object], kind: type, floor: dict[str, int]) -> Walk:
    """Follow a kind of object through one call."""
    followed = Walk(kind, floor)
    sys.setprofile(followed)
    try:
        work()
    finally:
        sys.setprofile(None)
    return followed


# What makes a refusal: errors that a user can mend, and the methods that make one with its file and line.
REFUSALS = ("InputError", "MissingTool", "TruearmError", "ValueError", "error", "contradict")


@ROWS.row("refusals")
def refusals() -> RowResult:
    """Places that refuse, by the room they are in, and those of them that a person may override with a reason."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    wings = plan()["wings"]
    for name, source in sources(HOUSE).items():
        if name in ("truearm.acceptance", "truearm.errors"):
            continue
        calls = [node for node in source.nodes if isinstance(node, ast.Call) and node.args]
        # `Readings.contradict` itself is no place that refuses, nor is the error within a contradiction a second one.
        inner = {id(node.args[0]) for node in calls if ast.unparse(node.func) == "contradict"}
        calls = [node for node in calls if not ast.unparse(node.args[0]).startswith("self.error(problem, row")]
        for node in calls:
            called = ast.unparse(node.func).rpartition(".")[2]
            if called in REFUSALS and id(node) not in inner:
                found[room_of(name, wings)][called] += 1
    whole = sum(found.values(), Counter[str]())
    rows = [*sorted(found.items()), ("together", whole)]
    table = [{"room": room, "refuse": of.total(), "may be overridden": of["contradict"]} for room, of in rows]
    return RowResult(table)


@ROWS.row("walks")
def walks() -> RowResult:
    """Walks of the readings and of the model through fit, evaluate and correct, and what checks them on the way."""
    floor = floors(imports(sources(HOUSE)))
    session = ta.simulate("ur10", poses=80, seed=1).session
    train, test = session.split(by="row", hold_out=0.3, seed=1)
    model = ta.fit("ur10", train, model="kinematic").model
    walks = {
        "fit, the readings": walk(lambda: ta.fit("ur10", train, model="physical"), Readings, floor),
        "evaluate, the readings": walk(lambda: ta.evaluate(model, test), Readings, floor),
        "evaluate, the model": walk(lambda: ta.evaluate(model, test), Compensator, floor),
        "correct, the model": walk(lambda: ta.correct(model, test.angles), Compensator, floor),
    }
    figures = ("stays", "files", "climbs", "returns", "names")
    return RowResult(
        [
            {
                "walk": what,
                **dict(zip(figures, one.figures, strict=True)),
                **{name: one.guards[name] for name in GUARDS},
            }
            for what, one in walks.items()
        ]
    )
