"""What a release consists of says the same everywhere; wheel and sdist hold what they must."""

import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import truearm

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA_NAMES = {"matplotlib": "matplotlib-base"}


def test_the_version_is_one():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    recipe = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
    assert citation["version"] == recipe["context"]["version"] == truearm.__version__
    assert f"## {truearm.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_build_backend_answers_before_hatchling_is_installed():
    """pip asks for the hook of an editable install first, and fetches hatchling only then."""
    asked = (
        "import sys; sys.path.insert(0, 'packaging'); sys.modules['hatchling'] = None; import build_backend as backend;"
        "assert callable(backend.build_editable); print(backend.get_requires_for_build_editable())"
    )
    done = subprocess.run([sys.executable, "-c", asked], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "['hatchling>=1.24', 'editables>=0.3']"


def test_the_conda_recipe_has_the_dependencies_of_the_project():
    recipe = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
    named = [re.fullmatch(r"([\w-]+)(>=[\d.]+)(?:;.*)?", dependency).groups() for dependency in PROJECT["dependencies"]]
    assert recipe["requirements"]["run"][1:] == [f"{CONDA_NAMES.get(name, name)} {least}" for name, least in named]
    assert PROJECT["requires-python"] == f">={recipe['context']['python_min']}"
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert entry == "truearm = " + PROJECT["scripts"]["truearm"]


def test_the_pythons_that_are_declared_are_those_that_are_tested():
    checks = yaml.safe_load((ROOT / ".github/workflows/checks.yml").read_text(encoding="utf-8"))
    tested = checks["jobs"]["suite"]["strategy"]["matrix"]
    prefix = "Programming Language :: Python :: "  # the first is 3
    assert (
        tested["python"]
        == [text.removeprefix(prefix) for text in PROJECT["classifiers"] if text.startswith(prefix)][1:]
    )
    assert {name.partition("-")[0] for name in tested["os"]} == {"ubuntu", "macos", "windows"}


def test_the_paper_cites_what_its_bibliography_has_and_is_short():
    paper = (ROOT / "paper/paper.md").read_text(encoding="utf-8")
    _, _, text = paper.split("---\n", 2)
    keys = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper/paper.bib").read_text(encoding="utf-8"), flags=re.M)
    assert set(re.findall(r"@(\w+)", text)) == set(keys)
    assert len(text.split()) < 1000  # what the journal asks for, two pages
    methods = json.loads((ROOT / "docs/figures/methods.json").read_text(encoding="utf-8"))
    for ours, theirs in {
        "**physical": "physical",
        "kinematic calibration": "kinematic",
        "network from": "network",
    }.items():
        stated = next(line for line in text.splitlines() if line.startswith(f"| {ours}"))
        kept = [line for row in methods.values() for line in row["table"] if line["method"] == theirs]
        measured = " ".join(str(line.get("mean / largest error [mm]")) for line in kept)
        means = re.findall(r"\d+\.\d+", stated)
        assert len(means) == 4
        assert all(f"{mean} / " in measured for mean in means), ours


@pytest.mark.weekly
def test_wheel_and_sdist_hold_what_they_must_and_nothing_else(tmp_path):
    pytest.importorskip("build", reason="pip install build makes wheel and sdist")
    done = subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(tmp_path), str(ROOT)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (wheel,), (sdist,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    held = zipfile.ZipFile(wheel).namelist()
    for name in (
        "truearm/py.typed",
        "truearm/guide/index.md",
        "truearm/pages/page.html.j2",
        "truearm/arm/arms/ur5.toml",
    ):
        assert name in held
    roots = {name.partition("/")[0] for name in held}
    assert roots == {"truearm", f"truearm-{truearm.__version__}.dist-info"}
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    assert {"README.md", "LICENSE", "CHANGELOG.md", "pyproject.toml", "packaging/build_backend.py"} <= inside
    assert not [name for name in inside if name.startswith((".venv", "build/", "dist/", "docs/_build"))]
    pytest.importorskip("twine", reason="pip install twine checks them")
    checked = subprocess.run(
        [sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout
