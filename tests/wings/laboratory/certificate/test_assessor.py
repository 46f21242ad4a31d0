"""The assessor's walk: every row of its table is whole, and what it names is there."""

import re
from pathlib import Path

import pytest
from made_up_outcome import ROWS, certificate, outcome
from typer.testing import CliRunner

from truearm.command_line import make_app
from truearm.wings.laboratory.certificate.administrative_data import template
from truearm.wings.laboratory.certificate.dcc import dcc
from truearm.wings.laboratory.pages.certificate_page import certificate_page
from truearm.wings.laboratory.standards.artefacts import template as artefacts_template
from truearm.wings.laboratory.standards.decision import worst_result
from truearm.wings.laboratory.standards.measured_points import REQUIRED_COLUMNS, SAID_COLUMNS

PAGE = Path(__file__).parents[4] / "docs" / "assessor.md"
ROWS_OF_PAGE = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| clause")
]


def keys_of(text):
    """The keys of a template with their tables, those that are optional and stand in comments too."""
    table, keys = "", set()
    for line in text.splitlines():
        if head := re.match(r"(?:# )?\[+(\w+)\]+", line):
            table = f"{head[1]}."
        elif key := re.match(r"(?:# )?(\w+) = ", line):
            keys.add(f"{table}{key[1]}")
    return keys


@pytest.fixture(scope="module")
def known():
    """Keys, parts of the XML file, and sections of the page that there are."""
    both = certificate(made=outcome([worst_result(ROWS[:2]), *ROWS[:1]]), as_found=outcome())
    text = dcc(both).decode()
    keys = keys_of(template()) | {key.partition(".")[2] for key in keys_of(artefacts_template("artefacts"))}
    keys |= {*SAID_COLUMNS, *REQUIRED_COLUMNS}
    keys |= set(re.findall(r"--[a-z-]+", CliRunner().invoke(make_app("certificate"), ["certificate", "--help"]).output))
    xml = set(re.findall(r"<((?:dcc|si):\w+)", text)) | set(re.findall(r'refType="(\w+)"', text))
    return keys, xml, {"title", *(section.title for section in certificate_page(both, outcome()).sections)}


def in_code(cell):
    return re.findall(r"`([^`]+)`", cell)


def test_the_walk_has_every_clause_and_no_empty_cell():
    clauses = " ".join(row[0] for row in ROWS_OF_PAGE)
    for letter in "abcdefghijklmnop":
        assert f"7.8.2.1 {letter}" in clauses
    for clause in (*(f"7.8.4.1 {letter}" for letter in "abcdef"), "7.8.2.2", "7.8.4.3", "7.8.5", "7.8.6.1", "7.8.6.2"):
        assert clause in clauses
    assert all(clause in clauses for clause in ("7.8.7", "7.8.8.1", "7.8.8.2", "7.8.8.3", "ILAC-P14"))
    for row in ROWS_OF_PAGE:
        assert len(row) == 7, row
        assert all(row), row
        assert all(in_code(row[i]) for i in (3, 4, 6)), row


@pytest.mark.parametrize("row", ROWS_OF_PAGE, ids=lambda row: row[0])
def test_what_a_row_names_is_there(row, known):
    keys, xml, sections = known
    assert {*in_code(row[3])} <= keys
    assert {*in_code(row[4])} <= xml
    assert row[5] in sections
    sources = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parents[1].rglob("test_*.py"))
    for name in in_code(row[6]):
        assert f"\ndef {name}(" in sources


def test_every_field_of_the_notes_has_a_row():
    named = {key for row in ROWS_OF_PAGE for key in in_code(row[3])}
    assert {key for key in keys_of(template()) if key.startswith(("notes.", "adjustment.", "replaces."))} <= named


def test_a_key_that_the_template_lacks_is_found_out():
    assert "item.condition" in keys_of(template())
    assert "item.colour" not in keys_of(template())
