"""The page about a hand-held arm, seats and a bar says what the program takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from truearm.readings import read_lengths, read_session

TEXT = (Path(__file__).parents[3] / "docs" / "seat-and-bar.md").read_text(encoding="utf-8")
COMMANDS = [shlex.split(line) for line in re.findall(r"^\$ (.+)$", TEXT.replace("\\\n", ""), flags=re.MULTILINE)]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_its_commands_have_such_options(truearm, command):
    name, verb, *arguments = command
    assert name == "truearm"
    options = [argument for argument in arguments if argument.startswith("--")]
    told = truearm(verb, "--help").out
    assert all(re.search(rf"{option}\b", told) for option in options)


def test_its_tables_are_a_session_and_its_lengths(tmp_path):
    session, lengths = (block.split("```")[0] for block in TEXT.split("```csv\n")[1:3])
    (tmp_path / "s.csv").write_text(session)
    (tmp_path / "l.csv").write_text(lengths)
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
