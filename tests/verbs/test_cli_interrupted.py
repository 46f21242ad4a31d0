"""Interrupted runs, closed pipes and watched terminals: what a program of its own leaves behind."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import pytest

from truearm.readings.files import table_writer

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and terminals of POSIX")

PROGRAM = [sys.executable, "-m", "truearm"]
# Long enough for a loaded machine; reached only if a program hangs.
PATIENCE_S = 120


def _listens_to_ctrl_c() -> None:
    """What a shell starts in the background ignores Ctrl-C, and so would the programs that these tests start there."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Watched:
    """A program whose standard error is a terminal of 80 columns, its standard output a pipe."""

    def __init__(self, *arguments: object, folder: object) -> None:
        import pty

        self.terminal, end = pty.openpty()
        environment = os.environ | {"TERM": "xterm", "COLUMNS": "80"}
        self.program = subprocess.Popen(
            [*PROGRAM, *map(str, arguments)],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=end,
            env=environment,
            preexec_fn=_listens_to_ctrl_c,
        )
        os.close(end)
        self.err = b""
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        while True:
            try:
                found = os.read(self.terminal, 65536)
            except OSError:  # Linux says so when the other end is closed
                return
            if not found:
                return
            self.err += found

    def wait_for(self, word: bytes) -> None:
        until = time.monotonic() + PATIENCE_S
        while word not in self.err:
            assert self.program.poll() is None, self.err.decode()
            assert time.monotonic() < until, self.err.decode()
            time.sleep(0.01)

    def end(self) -> tuple[int, str, str]:
        try:
            out = self.program.communicate(timeout=PATIENCE_S)[0]
        except subprocess.TimeoutExpired:
            self.program.kill()
            self.program.communicate()
            raise
        self.reader.join(PATIENCE_S)
        os.close(self.terminal)
        return self.program.returncode, out.decode(), self.err.decode()


def seen_at_the_end(err: str) -> list[str]:
    """What is left on the terminal after carriage returns, erased lines and moves of the cursor."""
    lines, row = [""], 0
    for part in re.findall(r"\x1b\[[0-9;?]*[A-Za-z]|\r|\n|[^\x1b\r\n]+", err):
        if part == "\n":
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif part.endswith("A") and part.startswith("\x1b"):
            row -= int(part[2:-1] or 1)
        elif part == "\x1b[2K":
            lines[row] = ""
        elif part[0] not in "\x1b\r":
            lines[row] += part
    return [line for line in lines if line]


@pytest.fixture
def slow_fit(made, tmp_path):
    """A training that takes minutes, with what was there before."""
    shutil.copy(made / "network.truearm", tmp_path / "net.truearm")
    # 6-12-3 on 300 readings; the goal is out of reach and validation never stops it so early.
    return ["fit", made / "train.csv", "--arm", "gao2017", "--model", "network", "--hidden", "12,12,12"], tmp_path


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_fit_leaves_only_what_was_there(slow_fit, number):
    arguments, folder = slow_fit
    before = (folder / "net.truearm").read_bytes()
    # Bayesian regularisation: no validation stop ends it before the signal comes.
    run = Watched(*arguments, "--trainer", "trainbr", "--epochs", 1_000_000, "--out", "net.truearm", folder=folder)
    run.wait_for(b"epoch 2")
    run.program.send_signal(number)
    code, out, err = run.end()
    assert (code, out) == (128 + number, "")
    assert "Traceback" not in err
    assert seen_at_the_end(err) == (["truearm: interrupted"] if number == signal.SIGINT else [])
    assert err.rindex("\x1b[?25h") > err.rindex("\x1b[?25l")  # the cursor is seen again
    assert sorted(p.name for p in folder.iterdir()) == ["net.truearm"]
    assert (folder / "net.truearm").read_bytes() == before


@pytest.fixture
def stopped(truearm, tmp_path, monkeypatch):
    """Run a verb that is interrupted at its second step, standard error a terminal; what is left on that."""

    def run(function, *arguments):
        def interrupted(*_, progress, **__):
            progress(1, "one")
            progress(2, "two")
            raise KeyboardInterrupt

        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(function, interrupted)
        ran = truearm(*arguments, terminal=True)
        assert (ran.code, ran.out) == (130, "")
        assert not list(tmp_path.iterdir())
        return seen_at_the_end(ran.err)

    return run


def test_an_interrupted_demo_leaves_no_folder(stopped):
    arguments = ("demo", "--quick", "--out", "demo")
    assert stopped("truearm.wings.gao2017.demo.experiment", *arguments) == ["truearm: interrupted"]


def test_an_interrupted_test_of_virtual_arms_prints_nothing(stopped):
    simulation = "truearm.wings.laboratory.verbs.simulate_verification.simulate_verification"
    assert stopped(simulation, "verify", "simulate", "shop") == ["truearm: interrupted"]


def test_interrupted_in_the_middle_of_a_file(truearm, made, tmp_path, monkeypatch):
    @contextmanager
    def stopped(*arguments, **options):
        def write_and_stop(columns):
            append(columns)
            raise KeyboardInterrupt

        with table_writer(*arguments, **options) as append:
            yield write_and_stop

    predict = ("predict", made / "kinematic.truearm", made / "angles.csv", "--out", tmp_path / "p.csv")
    assert truearm(*predict).code == 0
    before = (tmp_path / "p.csv").read_bytes()
    monkeypatch.setattr("truearm.verbs.predict.table_writer", stopped)
    ran = truearm(*predict)
    assert ran.code == 130
    assert ran.err == "truearm: interrupted\n"
    assert [p.name for p in tmp_path.iterdir()] == ["p.csv"]
    assert (tmp_path / "p.csv").read_bytes() == before


@pytest.fixture
def shown(truearm, made, monkeypatch):
    """Run in the folder of made files, standard error a terminal of 80 columns, which is empty again at the end."""
    monkeypatch.chdir(made)
    for name, value in {"TERM": "xterm", "COLUMNS": "80"}.items():
        monkeypatch.setenv(name, value)

    def run(*arguments):
        ran = truearm(*arguments, terminal=True)
        assert ran.code == 0
        assert seen_at_the_end(ran.err) == []
        return ran

    return run


def test_a_bar_shows_on_a_terminal_and_is_gone_at_the_end(shown, tmp_path):
    arguments = ["fit", "train.csv", "--arm", "gao2017", "--model", "network", "--hidden", "12"]
    ran = shown(*arguments, "--epochs", 30, "--out", tmp_path / "net.truearm")
    for word in ("fitting network", "rms error", "validation", ", mu ", " left ", "\u2501"):
        assert word in ran.err
    assert "\x1b" not in ran.out
    assert len(ran.out.splitlines()) == 5
    assert re.search(r"^training: .+ after \d+ epochs, best epoch \d+$", ran.out, flags=re.MULTILINE)
    assert [p.name for p in tmp_path.iterdir()] == ["net.truearm"]


def test_other_verbs_show_that_they_work(shown, undrawn, tmp_path):
    out = tmp_path / "r.html"
    assert "drawing the report" in shown("report", "kinematic.truearm", "test.csv", "--page", out).err
    assert "evaluating test.csv" in shown("evaluate", "kinematic.truearm", "test.csv").err
    assert "measuring 10 poses" in shown("simulate", "gao2017", "--poses", 10, "--out", tmp_path / "s.csv").err


def test_a_result_that_can_be_printed_nowhere_is_no_success(tmp_path):
    """Standard output closed before the start: the file is written, the exit code is that of a closed pipe."""
    command = f"exec {sys.executable} -m truearm arms ur10 --out a.toml >&-"
    ran = subprocess.run(["sh", "-c", command], cwd=tmp_path, stderr=subprocess.PIPE)
    assert (ran.returncode, ran.stderr) == (128 + signal.SIGPIPE, b"")
    assert (tmp_path / "a.toml").exists()


def test_messages_that_can_be_printed_nowhere_are_no_fault(tmp_path):
    """Standard error closed before the start: the exit code is that of the verb, with a message or without."""
    command = f"exec {sys.executable} -m truearm arms ur10 --out a.toml 2>&-"
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, stdout=subprocess.DEVNULL).returncode == 0
    assert (tmp_path / "a.toml").exists()
    command = f"exec {sys.executable} -m truearm arms nothing 2>&-"
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, stdout=subprocess.DEVNULL).returncode == 2


@pytest.mark.parametrize("arguments", [["arms"], ["--help"]])
def test_a_closed_output_pipe_ends_the_program_quietly(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ran = subprocess.run([*PROGRAM, *arguments], stdout=writer, stderr=subprocess.PIPE)
    finally:
        os.close(writer)
    assert (ran.returncode, ran.stderr) == (128 + signal.SIGPIPE, b"")  # no verdict, as 1 would be
