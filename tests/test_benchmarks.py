"""Laws of the benchmarks: every command that is named somewhere exists, and a run states machine, rows and targets."""

import ast
import importlib
import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
PAGES = [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", CHECKOUT / "CHANGELOG.md"]
PAGES += [page for page in (CHECKOUT / "docs").rglob("*.md") if "_build" not in page.parts]
PAGES += [file for folder in ("src", "tests", "benchmarks") for file in (CHECKOUT / folder).rglob("*.py")]
PAGES += list((CHECKOUT / "src").rglob("*.json"))
COMMON = {"--list", "--json", "--quick"}
# Rows that no test runs.
NOT_RUN = {
    ("figures", "pages"): "writes the pages of the checkout",
    ("figures", "again"): "measures all other rows",
    ("speed", "fit-physical-100000"): "has no smaller form but fit-physical-1000",
    ("speed", "fit-physical-1000000"): "has no smaller form but fit-physical-1000",
}


@pytest.fixture
def command(monkeypatch):
    """The module of the command."""
    if not (CHECKOUT / "benchmarks").is_dir():
        pytest.skip("benchmarks are not beside the tests")
    monkeypatch.syspath_prepend(CHECKOUT)
    return importlib.import_module("benchmarks.__main__")


def named_commands(known):
    """Where, the name of a benchmark, rows and options of all commands that pages name."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        texts = re.findall(r"python -m benchmarks ([a-z][^`,\n\"]*)", text)
        if page.name == "benchmarks.md":  # the last column of its tables
            cells = re.findall(r"\| `([a-z_0-9]+(?: [a-z_0-9-]+)*)` \|$", text, re.MULTILINE)
            texts += [cell for cell in cells if cell.split()[0] in known]
        for one in texts:
            name, *words = re.sub(r"[\[\].]", " ", one).split()
            rows = itertools.takewhile(lambda word: not word.startswith("--"), words)
            yield page.name, name, [row for row in rows if not row.isupper()], re.findall(r"--[a-z-]+", one)


def test_every_named_command_exists(command):
    """Benchmark, rows and options."""
    known, n = command.benchmarks(), 0
    for page, name, chosen, options in named_commands(known):
        assert name in known, f"{page}: {name}"
        rows = importlib.import_module(f"benchmarks.{name}").ROWS
        assert set(chosen) <= set(rows), f"{page}: {name} {chosen}"
        taken = {f"--{option.replace('_', '-')}" for row in chosen or rows for option in rows[row].options}
        assert set(options) <= taken | COMMON, f"{page}: {name} {options}"
        n += 1
    assert n > 50


def test_no_page_names_a_file_of_the_benchmarks_that_is_not_there(command):
    """By its path."""
    for page in PAGES:
        for file in re.findall(r"\bbenchmarks/[a-z_0-9]+\.(?:py|txt)", page.read_text(encoding="utf-8")):
            assert (CHECKOUT / file).is_file(), f"{page.name}: {file}"


def test_quick_sizes_are_options_of_their_rows(command):
    """Sizes of `--quick`."""
    for name in command.benchmarks():
        for row_name, row in importlib.import_module(f"benchmarks.{name}").ROWS.items():
            assert set(row.quick) <= set(row.options), f"{name} {row_name}"
            assert not {f"--{option}" for option in row.options} & COMMON, f"{name} {row_name}"
            assert row.what, f"{name} {row_name}"


def test_one_option_name_has_one_type_within_a_benchmark(command):
    """The rows of a benchmark share one command line: of two types, one row would lose its own."""
    for name in command.benchmarks():
        types = {}
        for row_name, row in importlib.import_module(f"benchmarks.{name}").ROWS.items():
            for option, default in row.options.items():
                kind = command.option_type(default)
                assert types.setdefault(option, kind) == kind, f"{name} {row_name}: {option}"


@pytest.mark.parametrize(
    ("name", "row", "option"),
    [
        ("cost", "epoch", "units"),
        ("imperfect_readings", "far-out", "readings"),
        ("imperfect_readings", "far-out", "arms"),
        ("imperfect_readings", "wrong-arms", "arm_names"),
    ],
)
def test_a_row_accepts_its_own_defaults_as_typed(command, name, row, option):
    """Such as `--readings 50 100`."""
    rows = importlib.import_module(f"benchmarks.{name}").ROWS
    default = rows[row].options[option]
    typed = command.format_options({option: default}).split()
    read = vars(command.parser_of(name, rows).parse_args([row, *typed]))[option]
    assert read == (list(default) if isinstance(default, tuple) else default)


def test_every_mutation_is_another_program(command):
    """Each changes what a small module says, and leaves what Python reads."""
    mutations = importlib.import_module("benchmarks.mutations").mutations_of
    text = (CHECKOUT / "src/truearm/solve/least_squares_problem.py").read_text(encoding="utf-8")
    as_it_is, n = ast.unparse(ast.parse(text)), len(list(mutations(ast.parse(text))))
    assert n > 20
    for number in range(0, n, 3):
        tree = ast.parse(text)
        _, said, act = list(mutations(tree))[number]
        act()
        changed = ast.unparse(ast.fix_missing_locations(tree))
        assert changed != as_it_is, said
        compile(changed, "mutant", "exec")


def test_sizes_of_no_source_are_an_error(command, tmp_path, monkeypatch):
    """Nothing counted is no small size."""
    house = importlib.import_module("benchmarks.house")
    few = CHECKOUT / "src" / "truearm" / "solve"
    assert house.sources(few)
    with pytest.raises(FileNotFoundError, match="expected Python files in"):
        house.sources(tmp_path)
    monkeypatch.setattr(house, "ROOT", tmp_path)
    monkeypatch.setattr(house, "HOUSE", few)
    with pytest.raises(FileNotFoundError, match="tests"):
        house.sizes()


def test_a_run_states_the_machine_rows_and_targets(command, capsys):
    """As one JSON object."""
    command.main(["arm_files", "ur-angles", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["machine"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert len(found["rows"]["ur-angles"]["table"]) == 12
    assert [target["met"] for target in found["targets"]] == [True] * 3


def test_an_option_that_no_chosen_row_has_is_refused(command, capsys):
    """With its name."""
    with pytest.raises(SystemExit):
        command.main(["arm_files", "ur-angles", "--arms", "3"])
    assert "none of the rows ur-angles has the option --arms" in capsys.readouterr().err


def pytest_generate_tests(metafunc):
    """All rows of all benchmarks, where the weekly tests are asked for: to import them all takes seconds."""
    if "every_row" not in metafunc.fixturenames:
        return
    is_asked = "weekly" in metafunc.config.option.markexpr and "not weekly" not in metafunc.config.option.markexpr
    rows = []
    if is_asked and (CHECKOUT / "benchmarks").is_dir():
        sys.path.insert(0, str(CHECKOUT))
        known = importlib.import_module("benchmarks.__main__").benchmarks()
        rows = [(name, row) for name in known for row in importlib.import_module(f"benchmarks.{name}").ROWS]
    metafunc.parametrize("every_row", rows, ids=" ".join)


@pytest.mark.weekly
def test_every_row_runs_in_its_smallest_form(every_row, tmp_path):
    """In a process of its own, as the command is typed; without a peer library or a data set it is skipped."""
    name, row = every_row
    if every_row in NOT_RUN:
        pytest.skip(NOT_RUN[every_row])
    paths = [str(CHECKOUT), str(CHECKOUT / "src"), os.environ.get("PYTHONPATH", "")]
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks", name, row, "--quick", "--json"],
        capture_output=True,
        text=True,
        cwd=tmp_path,  # some write files
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    )
    missing = re.search(r"No module named '(?!truearm|benchmarks)([\w.]+)'", ran.stderr)
    if ran.returncode and missing:
        pytest.skip(f"needs {missing[1]}, which is not installed")
    if ran.returncode and "playwright install" in ran.stderr:
        pytest.skip("needs Chromium, which is not installed")
    if ran.returncode and (unavailable := re.search(r".*cannot be downloaded.*", ran.stderr)):
        pytest.skip(unavailable[0])
    assert ran.returncode == 0, ran.stderr[-2000:]
    found = json.loads(ran.stdout)
    done = found["rows"][row]
    assert done["table"] or done["notes"] or found["targets"]
