"""Laws of CONTRIBUTING's table: new parts touch few files, and every export format has its page and its test."""

import re
from pathlib import Path

import pytest

import truearm
from truearm.wings.exports.formats.formats import FORMATS

CHECKOUT = Path(__file__).resolve().parents[1]
PACKAGE = Path(truearm.__file__).parent
TABLE = (CHECKOUT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## How to add")[2].partition("\n## ")[0]
# The section of docs/export.md of formats whose heading has another name.
HEADINGS = {
    "constants": "Constants beside the drawing",
    "ur-kinematics": "UR kinematics yaml",
    "kinematics-yaml": "Kinematics yaml of Franka and UFACTORY",
    "joint-offsets": "ROS joint offsets",
    "lerobot": "LeRobot calibration",
    "js": "JavaScript",
}


@pytest.mark.parametrize("what", ["term", "reference", "export format"])
def test_a_new_part_touches_as_many_files_of_source_as_the_page_says(what):
    assert "at most three files of source (four for a reference with numbers of its own)" in TABLE
    (row,) = [line for line in TABLE.splitlines() if line.startswith(f"| a **{what}**") or f"an **{what}**" in line]
    always = re.sub(r"\(numbers of its own: [^)]*\)", "", row)
    in_row, in_always = (
        {path for path in re.findall(r"`([\w/]+\.py)", text) if (PACKAGE / path).is_file()} for text in (row, always)
    )
    assert 2 <= len(in_always) <= 3
    assert len(in_row - in_always) == (what == "reference")  # the fourth file, of numbers of its own


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_has_its_page_and_its_test(name):
    page = (CHECKOUT / "docs" / "export.md").read_text(encoding="utf-8")
    heading = HEADINGS.get(name, name.upper())
    assert re.search(rf"^##+ {re.escape(heading)}$", page, re.MULTILINE)
    module = FORMATS[name].module
    tests = (path.read_text(encoding="utf-8") for path in (CHECKOUT / "tests" / "wings" / "exports").rglob("test_*.py"))
    assert any(re.search(rf"\b{module}\b", text) for text in tests), module
