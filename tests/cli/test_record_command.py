"""`truearm record --headless`: JSON lines out, commands in, and a kill at any moment."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import truearm as ta

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.fixture
def simulated(tmp_path):
    path = tmp_path / "simulated.csv"
    ta.simulate("ur10", poses=3, seed=1).session.save(path)
    return path


def test_events_are_json_lines(truearm, tmp_path, simulated, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    out = tmp_path / "session.csv"
    ran = truearm("record", "--source", f"replay:{simulated}@max", "--out", out, "--arm", "ur10", "--headless")
    assert (ran.code, ran.err) == (0, "")
    events = [json.loads(line) for line in ran.out.splitlines()]
    assert [event["event"] for event in events] == ["ready", *["reading"] * 3, "notice", "end"]
    assert events[1]["reading"] == 1
    assert events[-1]["readings"] == len(ta.read_session(out)) == 3


def test_every_verb_reads_the_file(truearm, tmp_path, simulated, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    out = tmp_path / "session.csv"
    ta.simulate("ur10", poses=40, seed=2).session.save(simulated)
    assert truearm("record", "--source", f"replay:{simulated}@max", "--out", out, "--headless").code == 0
    model = tmp_path / "model.truearm"
    ran = truearm("fit", out, "--arm", "ur10", "--model", "kinematic", "--out", model)
    assert ran.code == 0, ran.err
    ran = truearm("evaluate", model, out)
    assert ran.code == 0, ran.err


def test_a_wrong_source_is_one_line(truearm, tmp_path):
    ran = truearm("record", "--source", "teapot:1", "--out", tmp_path / "a.csv", "--headless")
    assert ran.code == 2
    assert ran.err.startswith("truearm: expected a source, got 'teapot:1'")
    assert len(ran.err.splitlines()) == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_kill_at_any_moment_loses_no_acknowledged_reading():
    if not (CHECKOUT / "benchmarks" / "live.py").is_file():
        pytest.skip("benchmarks are not beside the tests")
    command = [sys.executable, "-m", "benchmarks", "live", "kills", "--n", "10", "--json"]
    ran = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    (counted,) = json.loads(ran.stdout)["rows"]["kills"]["table"]
    assert counted["lost"] == 0
    assert counted["acknowledged"] > 50
