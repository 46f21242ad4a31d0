"""`truearm live`: a page until Ctrl-C, and a whole file after it."""

import re
import signal
import subprocess
import sys

import pytest

import truearm as ta


@pytest.mark.skipif(sys.platform == "win32", reason="no signal of Ctrl-C to one program")
def test_ctrl_c_ends_it_the_page_says_so_and_the_file_is_whole(tmp_path):
    client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
    ta.simulate("ur10", poses=30, seed=1).session.save(tmp_path / "simulated.csv")
    out = tmp_path / "session.csv"
    command = [sys.executable, "-m", "truearm", "live", "--source", f"replay:{tmp_path / 'simulated.csv'}"]
    command += ["--arm", "ur10", "--out", out, "--port", "0"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell starts programs behind it without
    ) as running:
        address = re.fullmatch(r"Open http(://127\.0\.0\.1:\d+/) in .*\n", running.stdout.readline())[1]
        with client.connect(f"ws{address}live", proxy=None) as page:
            assert '"may_command":true' in page.recv(timeout=60)
            assert next(line for line in running.stdout if line.startswith("reading 1"))
            running.send_signal(signal.SIGINT)
            assert next(text for text in page if '"event":"end"' in text)
            said, fault = running.communicate(timeout=60)
    assert running.returncode == 130
    assert fault == "truearm: interrupted\n"
    n = len(ta.read_session(out))
    assert said.splitlines()[-1] in (f"{n} reading in {out}", f"{n} readings in {out}")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--source", "virtual:ur10"], "the page needs the arm. Try: --arm ARM, or --model-file MODEL"),
        (["--source", "virtual:ur10", "--arm", "ur10", "--host", "0.0.0.0"], "give a --token, too"),
        (["--source", "teapot:1", "--arm", "ur10"], "expected a source, got 'teapot:1'"),
        (["--arm", "ur10"], "expected --source and --out. Try: truearm live --demo"),
        (["--demo"], "--out does not apply to --demo"),
    ],
)
def test_what_is_missing_is_one_line(refused, tmp_path, options, said):
    refused(["live", *options, "--out", tmp_path / "session.csv"], said)
    assert list(tmp_path.iterdir()) == []
