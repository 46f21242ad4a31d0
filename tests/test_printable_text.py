"""Names and titles of others act on no terminal, page, table or document."""

import datetime
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import truearm as ta
from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.arm_files import write_arm
from truearm.arm.urdf import write_urdf
from truearm.files.delimited import write_columns
from truearm.pages.html import render
from truearm.pages.page import Column, Page, Section, Table
from truearm.pages.pdf import Paper, pdf_bytes
from truearm.printable_text import printable, printable_name
from truearm.verbs.console import print_line
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.recording.session_log import Event
from truearm.wings.bench.recording_view import RecordingView
from truearm.wings.bench.sources import Source
from truearm.wings.laboratory.certificate.administrative_data import xml_text

# Clears the screen, names the window, turns the direction of writing, ends a string of C, is a command of one byte.
EVIL = "\x1b[2J\x1b]0;owned\x07 red\u202egnp.exe \0 \x9b31m \u2066x\ufeff\ud800"
ACTS = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufeff]")


@given(st.text())
def test_what_is_printable_is_kept_and_acts_on_nothing(text):
    shown = printable(text)
    assert not ACTS.search(shown)
    assert printable(shown) == shown
    assert set(printable_name(text)).isdisjoint("\n\t")


def test_letters_of_all_scripts_spaces_and_lines_are_kept():
    text = "\u03b1 \u00fc \u4e2d \u05d0 \u0645\n\t0.1\u202f\u2212\u00b5"
    assert printable(text) == text


@pytest.fixture(scope="module")
def fitted():
    arm = replace(ta.load_arm("ur10"), name=EVIL, title=f"{EVIL}\nverdict: conform", source=EVIL)
    frame = ta.simulate("ur10", poses=14, seed=1).session.to_frame()
    return ta.fit(
        arm, ta.Session.from_frame(frame.assign(session=EVIL.replace("\0", "").replace("\ud800", ""))), model="nominal"
    )


def test_an_arm_with_such_names_is_written_as_urdf_and_read_again(fitted, tmp_path):
    write_urdf(fitted.model.arm_, tmp_path / "arm.urdf")
    assert not ACTS.search((tmp_path / "arm.urdf").read_text(encoding="utf-8"))
    assert load_arm(str(tmp_path / "arm.urdf")).name == fitted.model.arm_.name


@pytest.mark.parametrize("old", ['serial_number = "', 'name = "J2'])
def test_names_that_join_tables_hold_no_control_characters(old, tmp_path):
    write_arm(load_arm("ur10"), tmp_path / "arm.toml")
    text = (
        (tmp_path / "arm.toml")
        .read_text(encoding="utf-8")
        .replace('name = "ur10"', 'name = "ur10"\nserial_number = "7"')
    )
    (tmp_path / "arm.toml").write_text(text.replace(old, f"{old}\\u001b[2J"), encoding="utf-8")
    refuses("control character", load_arm, str(tmp_path / "arm.toml"))


def test_on_a_terminal_and_in_a_notebook(fitted, capfd):
    assert "owned" in str(fitted)
    for shown in (str(fitted), repr(fitted), fitted._repr_html_()):
        assert not ACTS.search(shown)
    assert "\n" not in fitted.model.arm_.title
    print_line(EVIL)
    assert not ACTS.search(capfd.readouterr().out)


def test_in_the_view_of_a_recording(tmp_path):
    view = RecordingView(Recording(Source("test", lambda: iter(())), tmp_path / "out.csv"))
    for kind in ("next", "learned", "notice"):
        view.add(Event(kind, EVIL))
    shown = [str(one) for one in view.__rich__().renderables]
    assert sum("owned" in one for one in shown) == 3
    assert not ACTS.search("".join(shown))


def test_on_pages_in_tables_and_in_documents(tmp_path):
    table = Table((Column(EVIL),), ((EVIL,),), EVIL)
    page = Page(EVIL, EVIL, (), (Section(EVIL, EVIL, tables=(table,)),), ((EVIL, EVIL),))
    assert not ACTS.search(render(page))
    write_columns(tmp_path / "t.csv", {"seat": np.array([EVIL, "=1"])})
    assert not ACTS.search((tmp_path / "t.csv").read_text(encoding="utf-8"))
    assert not ACTS.search(xml_text(EVIL))
    pytest.importorskip("typst", reason="pip install truearm[pdf] writes PDF files")
    pikepdf = pytest.importorskip("pikepdf", reason="pip install pikepdf[pdfa] checks PDF files")
    (tmp_path / "p.pdf").write_bytes(pdf_bytes(page, Paper(EVIL, (EVIL, EVIL), datetime.date(2026, 1, 5))))
    with pikepdf.open(tmp_path / "p.pdf") as document:
        assert not ACTS.search(str(document.open_metadata()))
