"""`truearm record --headless`: JSON lines out, commands in, and a kill at any moment."""

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

import truearm as ta

CHECKOUT = Path(__file__).resolve().parents[3]


@pytest.fixture
def standard_input(monkeypatch):
    """What a program wrote to standard input before it closed it."""

    with contextlib.ExitStack() as opened:

        def given(text: str = "") -> None:
            reading, writing = os.pipe()
            os.write(writing, text.encode())
            os.close(writing)
            monkeypatch.setattr("sys.stdin", opened.enter_context(os.fdopen(reading)))

        given()
        yield given


@pytest.fixture
def simulated(tmp_path):
    path = tmp_path / "simulated.csv"
    ta.simulate("ur10", poses=3, seed=1).session.save(path)
    return path


def test_events_are_json_lines(truearm, tmp_path, simulated, standard_input):
    out = tmp_path / "session.csv"
    ran = truearm("record", "--source", f"replay:{simulated}@max", "--out", out, "--arm", "ur10", "--headless").done()
    events = [json.loads(line) for line in ran.out.splitlines()]
    assert [event["event"] for event in events] == ["ready", "reading", *["reading", "learned"] * 2, "notice", "end"]
    assert events[1]["reading"] == 1
    assert events[-1]["readings"] == len(ta.read_session(out)) == 3


def test_every_verb_reads_the_file(truearm, tmp_path, simulated, standard_input):
    out = tmp_path / "session.csv"
    ta.simulate("ur10", poses=40, seed=2).session.save(simulated)
    assert truearm("record", "--source", f"replay:{simulated}@max", "--out", out, "--headless").code == 0
    model = tmp_path / "model.truearm"
    truearm("fit", out, "--arm", "ur10", "--model", "kinematic", "--out", model).done()
    truearm("evaluate", model, out).done()


def test_commands_are_lines_on_standard_input(truearm, tmp_path, simulated, standard_input):
    standard_input("seat cone A\nundo\nend\n")
    ran = truearm("record", "--source", f"replay:{simulated}", "--out", tmp_path / "session.csv", "--headless")
    events = [json.loads(line) for line in ran.out.splitlines()]
    assert [event["event"] for event in events if event["text"] != "ready"][-3:] == ["notice", "refused", "end"]


def test_without_a_terminal_it_says_what_to_do(truearm, tmp_path, simulated):
    ran = truearm("record", "--source", f"replay:{simulated}", "--out", tmp_path / "session.csv")
    assert (ran.code, ran.err) == (
        2,
        "truearm: taking readings needs a terminal. Try: --headless prints JSON lines and reads commands\n",
    )


def test_a_wrong_source_is_one_line(refused, tmp_path):
    refused(
        ["record", "--source", "teapot:1", "--out", tmp_path / "a.csv", "--headless"],
        "truearm: expected a source, got 'teapot:1'",
    )


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


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo terminals")
def test_in_a_terminal_keys_take_readings_and_name_the_seat(tmp_path, simulated):
    out, (terminal, inner) = tmp_path / "session.csv", os.openpty()
    command = [
        sys.executable,
        "-m",
        "truearm",
        "record",
        "--source",
        f"replay:{simulated}",
        "--out",
        out,
        "--on",
        "key",
    ]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    shown = ""

    def wait_for(text: str) -> None:
        nonlocal shown
        deadline = time.monotonic() + 60
        while text not in shown:
            assert time.monotonic() < deadline, shown[-2000:]
            if select.select([terminal], [], [], 1.0)[0]:
                shown += os.read(terminal, 65536).decode("utf-8", "replace")

    with subprocess.Popen(command, stdin=inner, stdout=inner, stderr=inner, env=environment) as running:
        os.close(inner)
        wait_for("space take")
        os.write(terminal, b"scone A\r")
        wait_for("seat cone A")
        os.write(terminal, b" ")
        wait_for("reading 1, seat cone A: mean of ")
        os.write(terminal, b"mu")
        wait_for("reading 2 removed")
        os.write(terminal, b"q")
        wait_for(f"1 reading in {out}"[:60])
    os.close(terminal)
    assert running.returncode == 0
    assert ta.read_session(out).seat.tolist() == ["cone A"]
