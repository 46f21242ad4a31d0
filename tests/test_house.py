"""Laws of the house itself: imports, public names, the README's commands, what must never be in it."""

import ast
import graphlib
import importlib
import inspect
import os
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import truearm
from truearm.command_line import COMMANDS, make_app

HOUSE = Path(truearm.__file__).parent
CHECKOUT = Path(__file__).resolve().parents[1]
PAGES = ["README.md", *sorted(str(page.relative_to(CHECKOUT)) for page in (CHECKOUT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not page.startswith(("docs/_build", "docs/gallery", "docs/generated"))]
SOURCES = sorted(HOUSE.rglob("*.py"))
MODULES = sorted(
    info.name for info in pkgutil.walk_packages(truearm.__path__, "truearm.") if info.name != "truearm.__main__"
)


def readable(path: Path) -> str:
    if not path.is_file():
        pytest.skip(f"{path.name} is not beside the tests")
    return path.read_text(encoding="utf-8")


# Imports -------------------------------------------------------------------------------------------------------------


def test_contributing_names_files_that_are_there():
    text = readable(CHECKOUT / "CONTRIBUTING.md")
    named = re.findall(r"`([\w/.]+/[\w.*]+\.(?:py|toml|json|md))`", text)
    assert named
    for name in named:
        assert list(CHECKOUT.glob(name)) or list((CHECKOUT / "src" / "truearm").glob(name)), name


def test_no_files_import_each_other_in_a_circle(counts, files):
    """Late imports and those for type checkers count too: whoever reads one of the files must know the others."""
    graphlib.TopologicalSorter(counts.imports(files)).prepare()  # a CycleError names the circle


def test_imports_point_down():
    pytest.importorskip("importlinter", reason="import-linter is not installed")
    readable(CHECKOUT / "pyproject.toml")
    linter = "from importlinter.cli import lint_imports; import sys; sys.exit(lint_imports())"
    ran = subprocess.run([sys.executable, "-c", linter], cwd=CHECKOUT, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert " 0 broken" in ran.stdout


@pytest.fixture(scope="module")
def counts():
    """The counts of `python -m benchmarks house`, and the plan of the house."""
    readable(CHECKOUT / "house.toml")
    if not (CHECKOUT / "benchmarks").is_dir():
        pytest.skip("benchmarks are not beside the tests")
    return importlib.import_module("benchmarks.house")


def test_no_room_outgrows_its_budget(counts, files):
    """Lines of code and files; raising a budget is a line of the commit that needs it."""
    plan = counts.plan()
    held = {room: [0, 0] for room in plan["budgets"]}
    for name, source in files.items():
        room = counts.room_of(name, plan["wings"])
        assert room in held, f"{room} has no budget in house.toml"
        held[room][0] += source.code
        held[room][1] += 1
    for room, (lines, n) in held.items():
        assert n > 0, f"{room} holds nothing"
        most_lines, most_files = plan["budgets"][room]
        assert lines <= most_lines, f"{room}: {lines} lines of code"
        assert n <= most_files, f"{room}: {n} files"


def test_the_guide_stays_within_its_words(counts):
    """A page that grows takes words of another, or raises the number in `house.toml`."""
    held = importlib.import_module("benchmarks.pages").words().table[0]
    assert held["words"] <= counts.plan()["guide"]["words"], held


def without(wings: dict[str, list[str]], folder: Path) -> Path:
    """The package without the places of some wings: links to its files, as copies take longer."""
    shutil.copytree(HOUSE, folder / "truearm", copy_function=os.symlink)
    for place in (place for places in wings.values() for place in places):
        there = folder.joinpath("truearm", *place.split("."))
        shutil.rmtree(there) if there.is_dir() else there.with_suffix(".py").unlink()
    return folder


def in_python(folder: Path, *arguments: str) -> str:
    """What Python prints with the package of a folder."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    ran = subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


CORE_VERBS = {"split", "fit", "refit", "predict", "evaluate"}


def test_a_wing_that_is_taken_off_takes_its_commands_and_leaves_those_of_the_core(counts, tmp_path):
    wings, whole = counts.plan()["wings"], without({}, tmp_path)
    for name, places in wings.items():
        taken_off = [whole.joinpath("truearm", *place.split(".")) for place in places]
        taken_off = [there if there.is_dir() else there.with_suffix(".py") for there in taken_off]
        for i, there in enumerate(taken_off):
            there.rename(tmp_path / f"{i}")
        help_text = in_python(whole, "-m", "truearm", "--help")
        for i, there in enumerate(taken_off):
            (tmp_path / f"{i}").rename(there)
        listed = set(re.findall(r"^  ([a-z]+)  ", help_text, re.MULTILINE))
        own = {word for word, place in COMMANDS.items() if place.startswith(f"truearm.wings.{name}.")}
        assert listed >= CORE_VERBS, name
        assert not own & listed, name


def test_what_builds_on_a_wing_that_was_taken_off_says_so(counts, tmp_path):
    """`compare` and `report` build on the exports, within their functions."""
    folder = without({"exports": counts.plan()["wings"]["exports"]}, tmp_path)
    assert in_python(folder, "-c", "import truearm; print(hasattr(truearm, 'compare'))") == "False\n"
    there = {"cwd": folder, "env": os.environ | {"PYTHONPATH": str(folder)}, "capture_output": True, "text": True}
    ran = subprocess.run([sys.executable, "-m", "truearm", "compare", "a.truearm", "b.truearm"], **there)
    assert (ran.returncode, ran.stderr) == (2, "truearm: this needs the wing exports, which was taken off\n")


def test_without_any_wing_an_arm_is_identified_its_model_saved_and_points_are_predicted(counts, tmp_path):
    folder = without(counts.plan()["wings"], tmp_path)
    truearm.simulate("ur10", poses=40, seed=1).session.save(folder / "readings.csv")
    code = """
import truearm as ta
session = ta.read_session("readings.csv")
model = ta.fit("ur10", session, model="kinematic").model
model.save("arm.truearm")
print(ta.predict("arm.truearm", session), ta.evaluate(model, session))
"""
    there = {"cwd": folder, "env": os.environ | {"PYTHONPATH": str(folder)}, "capture_output": True, "text": True}
    ran = subprocess.run([sys.executable, "-m", "truearm", "plan"], **there)
    assert (ran.returncode, "No such command 'plan'" in ran.stderr) == (2, True), ran.stderr
    printed = in_python(folder, "-c", code)
    assert "40 points, standard uncertainty" in printed
    assert "Mean error" in printed
    assert set(re.findall(r"^  ([a-z]+)  ", in_python(folder, "-m", "truearm", "--help"), re.MULTILINE)) == CORE_VERBS


def test_the_core_imports_no_wing_and_few_of_its_names_cross_the_wall(counts, files):
    """But for what `house.toml` says is asked late."""
    plan, files = counts.plan(), counts.doors(files)
    for places in plan["wings"].values():
        for place in places:
            there = HOUSE.joinpath(*place.split("."))
            assert there.is_dir() or there.with_suffix(".py").is_file(), place
    back = {name.removeprefix("truearm.") for name in counts.names_across(files, plan["wings"], back=True)}
    assert back == set(plan["wall"]["late"])
    assert sum(map(len, counts.names_across(files, plan["wings"]).values())) <= plan["wall"]["names"]
    for late in plan["wall"]["late"]:
        tree = ast.parse((HOUSE.joinpath(*late.split(".")).with_suffix(".py")).read_text(encoding="utf-8"))
        early = {node.module or "" for node in tree.body if isinstance(node, ast.ImportFrom)}
        assert not {one for one in early if counts.wing_of(one, plan["wings"])}, late


def test_the_core_holds_nothing_that_only_wings_use(counts, files):
    """But for the verbs, which people call, and for the insides of the estimation, which stay together."""
    wings = counts.plan()["wings"]
    core = {name for name in files if counts.wing_of(name, wings) is None}
    used = {one for name, found in counts.imports(files).items() if name in core for one in found}
    verbs = {*truearm._HOMES, "truearm", "truearm.__main__", "truearm.command_line"}
    alone = {name for name in core - used - verbs if files[name].path.name != "__init__.py"}
    assert not {name for name in alone if not name.startswith(("truearm.verbs.", "truearm.identification.estimation."))}


def test_the_command_line_starts_without_the_heavy_packages():
    """Help and messages come at once: NumPy and its like are imported by the verb that needs them."""
    listed = "import truearm.command_line as m, sys; m.make_app(); print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True, check=True)
    heavy = {"numpy", "scipy", "pandas", "sklearn", "matplotlib", "jinja2", "pooch", "pyarrow"}
    assert not heavy & set(ran.stdout.split())


def test_nothing_in_the_house_runs_code_out_of_data(files):
    """No pickle, no eval: files come from others."""
    forbidden = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve", "cloudpickle"}
    for path, nodes in ((source.path, source.nodes) for source in files.values()):
        for node in nodes:
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name.partition(".")[0] for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module.partition(".")[0], *(alias.name for alias in node.names)]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec", "compile"), f"{path}:{node.lineno}"
            elif isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), f"{path}:{node.value.lineno}"
                assert node.value.value is False, f"{path}:{node.value.lineno}"
            assert not forbidden & set(names), f"{path}:{node.lineno}"  # type: ignore[attr-defined]


# Names ---------------------------------------------------------------------------------------------------------------


def test_public_names_exist_and_are_described():
    for name in MODULES:
        module = importlib.import_module(name)
        assert module.__doc__, f"{name} has no docstring"
        for public in getattr(module, "__all__", []):
            thing = getattr(module, public)
            if inspect.isclass(thing) or inspect.isroutine(thing):
                assert thing.__doc__, f"{name}.{public} has no docstring"


def test_a_room_lists_every_name_it_takes_in():
    """A room's __init__ that imports names lists them; nothing slips out by chance."""
    for path in HOUSE.glob("*/__init__.py"):
        module = importlib.import_module(f"truearm.{path.parent.name}")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imported = {
            alias.asname or alias.name
            for node in tree.body
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("truearm.")
            for alias in node.names
        }
        assert imported <= set(getattr(module, "__all__", [])), path.parent.name


def test_no_file_names_a_place_of_one_machine():
    """Paths that mean something on the author's machine only."""
    places = re.compile(r"(?<![\w.])/(?:work|tmp|home|root|Users|mnt)/\w|/shared/(?!datasets)")
    files = [*SOURCES, *HOUSE.rglob("*.j2"), *HOUSE.rglob("*.toml"), *HOUSE.rglob("*.urdf"), *HOUSE.rglob("*.css")]
    files += [CHECKOUT / "README.md", CHECKOUT / "pyproject.toml"]
    for folder in ("docs", "benchmarks", ".ci"):
        files += [p for p in (CHECKOUT / folder).rglob("*") if p.suffix in (".md", ".py", ".toml", ".sh", "")]
    for path in files:
        if path.is_file():
            found = places.search(path.read_text(encoding="utf-8", errors="replace"))
            assert found is None, f"{path}: {found[0]}"


def test_the_map_of_the_house_names_every_room_and_no_other():
    """docs/house.md lists the folders that hold modules, and those alone."""
    named = set(
        re.findall(r"`([a-z0-9_/]+)/`", readable(CHECKOUT / "docs" / "house.md").partition("## How a session")[0])
    )
    rooms = {str(path.parent.relative_to(HOUSE)) for path in SOURCES} - {".", "wings", "identification"}
    assert named - {"src/truearm", "wings"} == rooms


# Pages that the build of the site makes; CHANGELOG.md is shown beside house.md there.
BUILT = ("../gallery/index", "gallery/index", "../api.md", "house.md", "start/index")


@pytest.mark.parametrize("page", PAGES)
def test_every_link_of_a_page_leads_to_a_file(page):
    text = re.sub(r"```.*?```", "", readable(CHECKOUT / page), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)|^\[[^]]+\]: (\S+)$", text, flags=re.MULTILINE):
        link = "".join(target).partition("#")[0]
        if (
            link
            and "://" not in link
            and link not in BUILT
            and not link.startswith("_static/front/")  # pictures that the build draws
        ):
            assert ((CHECKOUT / page).parent / link).exists(), f"{page}: {link}"


# The README ----------------------------------------------------------------------------------------------------------


def commands_of(text: str) -> list[list[str]]:
    """The command lines of `truearm` in the console and sh blocks of a page, split as a shell splits them."""
    commands = []
    for block in re.findall(r"```(?:console|sh|bash)\n(.*?)```", text, flags=re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            for part in re.split(r"&&|\|", line.strip().removeprefix("$ ")):
                words = shlex.split(part, comments=True) if re.match(r"\s*(\S*/)?truearm(\s|$)", part) else []
                if words:
                    commands.append(words[1:])
    return commands


def inline_commands_of(text: str) -> list[list[str]]:
    """The command lines of `truearm` within the sentences of a page."""
    outside = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return [shlex.split(found) for found in re.findall(r"`truearm ([^`]+)`", " ".join(outside.split()))]


def options_of(truearm_run_help: str) -> set[str]:
    return set(re.findall(r"(?<![\w-])(--?[a-z][a-z-]*)", truearm_run_help.partition("Options:")[2]))


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """The options of every verb, as its help lists them."""
    from typer.testing import CliRunner

    found = {}
    for verb in COMMANDS:
        app = make_app(verb)
        ran = CliRunner().invoke(app, [verb, "--help"])
        assert ran.exit_code == 0, ran.output
        found[verb] = options_of(ran.output)
        for name in re.findall(r"^  ([a-z-]+) ", ran.output.partition("Commands:")[2], flags=re.MULTILINE):
            found[verb] |= options_of(CliRunner().invoke(app, [verb, name, "--help"]).output)
    return found


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_can_be_typed(page, options):
    text = readable(CHECKOUT / page)
    for words in [*commands_of(text), *inline_commands_of(text)]:
        if words[:1] in (["--version"], ["--help"]) or not words:
            continue
        verb = words[0]
        assert verb in options, f"{page}: truearm {' '.join(words)}"
        used = {w.partition("=")[0] for w in words[1:] if re.match(r"--[a-z]", w)}
        assert used <= options[verb], f"{page}: truearm {' '.join(words)}"


def test_the_guide_names_every_verb():
    text = readable(CHECKOUT / "docs/guide.md")
    named = {words[0] for words in [*commands_of(text), *inline_commands_of(text)] if words}
    assert COMMANDS.keys() <= named


def test_the_commands_of_a_page_are_found():
    page = """Type `truearm arms` or
    `truearm fetch ur5 --out a.csv`.
```sh
python -m venv v && v/bin/truearm demo --quick
```
```console
$ truearm fit a.csv --arm ur5 \\
    --out 'b c'
truearm-demo is not a command
```
"""
    assert commands_of(page) == [["demo", "--quick"], ["fit", "a.csv", "--arm", "ur5", "--out", "b c"]]
    assert inline_commands_of(page) == [["arms"], ["fetch", "ur5", "--out", "a.csv"]]


def test_a_heading_stands_once_in_a_page():
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", readable(CHECKOUT / page), flags=re.M | re.S)
        headings = re.findall(r"^#+ .*$", text, re.M)
        assert len(set(headings)) == len(headings), (page, headings)
