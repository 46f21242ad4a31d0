"""The page about a hand-held arm, seats and a bar says what the program takes."""

import re
import shlex
from pathlib import Path

from page_transcripts import blocks
from truearm.readings import read_lengths, read_session

TEXT = (Path(__file__).parents[3] / "docs" / "seat-and-bar.md").read_text(encoding="utf-8")
COMMANDS = [shlex.split(line) for line in re.findall(r"^\$ (.+)$", TEXT.replace("\\\n", ""), flags=re.MULTILINE)]


def test_its_tables_are_a_session_and_its_lengths(tmp_path):
    for name, text in zip(("s.csv", "l.csv"), blocks("seat-and-bar.md", "csv"), strict=True):
        (tmp_path / name).write_text(text)
    readings = read_session(tmp_path / "s.csv", n_joints=7)
    assert readings.position.tolist() == ["B1"] * 3
    known = read_lengths(tmp_path / "l.csv", seats=[*readings.seat.tolist(), "B2a", "B2b"])
    assert known.artefact.tolist() == ["bar 500"] * 2


def test_its_first_measurements_come_out_as_it_says(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulate = next(command for command in COMMANDS if "session.csv" in command and command[1] == "simulate")
    assert truearm(*simulate[1:]).code == 0
    readings = read_session(tmp_path / "session.csv")
    assert {(readings.seat == name).sum() for name in set(readings.seat.tolist())} == {15}
    known = read_lengths(tmp_path / "bar.csv", seats=readings.seat.tolist())
    assert {f"{length:.4f}" for length in known.length_mm} == {"499.9959"}
