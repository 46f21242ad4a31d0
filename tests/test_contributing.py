"""Laws of CONTRIBUTING's table: new parts touch few files, and every export format has its page and its test."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import truearm
from truearm.compensation.export.formats import FORMATS

CHECKOUT = Path(__file__).resolve().parents[1]
PACKAGE = Path(truearm.__file__).parent
TABLE = (CHECKOUT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## How to add")[2].partition("\n## ")[0]
# The section of docs/export.md of formats whose heading has another name.
HEADINGS = {
    "constants": "Constants beside the drawing",
    "deltas": "Controller deltas",
    "ur-kinematics": "UR kinematics yaml",
    "joint-offsets": "ROS joint offsets",
    "js": "JavaScript",
}


@pytest.mark.parametrize("what", ["term", "reference", "export format"])
def test_a_new_part_touches_three_files_of_source_at_most(what):
    (row,) = [line for line in TABLE.splitlines() if line.startswith(f"| a **{what}**") or f"an **{what}**" in line]
    sources = {path for path in re.findall(r"`([\w/]+\.py)", row) if (PACKAGE / path).is_file()}
    assert 2 <= len(sources) <= (4 if what == "reference" else 3)  # a reference: names, or numbers of its own


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_has_its_page_and_its_test(name):
    page = (CHECKOUT / "docs" / "export.md").read_text(encoding="utf-8")
    heading = HEADINGS.get(name, name.upper())
    assert re.search(rf"^##+ {re.escape(heading)}$", page, re.MULTILINE)
    module = FORMATS[name].module
    tests = (path.read_text(encoding="utf-8") for path in (CHECKOUT / "tests" / "compensation").rglob("test_*.py"))
    assert any(re.search(rf"\b{module}\b", text) for text in tests), module
