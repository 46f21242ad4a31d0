"""The README and the start pages: every block runs, without a network, and prints what the page shows."""

import contextlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from page_transcripts import BLOCK, check_printed, commands
from truearm.files.toml_documents import parse_toml
from truearm.readings import read_session
from truearm.wings.bench.live_server.live import serve
from truearm.wings.bench.sources.servo_bus import ServoDocument

CHECKOUT = Path(__file__).parents[2]
README, START = CHECKOUT / "README.md", CHECKOUT / "docs" / "start"
# Run by tests of their own: tests/verbs/test_robot_page.py, tests/verbs/test_regressors.py,
# tests/wings/camera/test_camera_start_page.py.
ELSEWHERE = {"camera", "robot", "researcher"}


def test_every_start_page_is_run():
    """Its blocks are of a kind that is run here, or it is one of those that have a test of their own."""
    for page in [README, *START.glob("*.md")]:
        kinds = {kind for kind, _, _ in BLOCK.findall(page.read_text(encoding="utf-8"))}
        assert page.stem in ELSEWHERE or kinds <= {"python", "console", "sh", "toml", "csv"}, page


@pytest.fixture(scope="module")
def run_page(truearm, tmp_path_factory):
    """Run a page in a folder of its own."""

    def run(page):
        folder, names = tmp_path_factory.mktemp(page.stem), {}
        with contextlib.chdir(folder):
            for kind, name, text in BLOCK.findall(page.read_text(encoding="utf-8")):
                if kind == "python":
                    exec(text, names)
                elif name:
                    Path(name).write_text(text, encoding="utf-8")
                elif kind == "console":
                    for (program, *arguments), shown in commands(text):
                        assert program == "truearm"
                        ran = truearm(*arguments).done()
                        check_printed(shown, ran.out.splitlines())
        return folder

    return run


def test_the_ten_lines_of_the_readme(run_page, capsys):
    folder = run_page(README)
    assert {path.name for path in folder.iterdir()} == {"ur10.truearm", "ur10.urdf"}
    said = capsys.readouterr().out
    (picture,) = re.findall(r'alt="(An arm and its errors [^"]*)"', README.read_text(encoding="utf-8"))
    nominal, identified = map(float, re.findall(r"mean_mm +([\d.]+) +([\d.]+)", said)[0])
    assert [float(number) for number in re.findall(r"([\d.]+) mm", picture)] == pytest.approx(
        [nominal, identified], abs=0.002
    )


def test_the_commands_of_the_readme(truearm, tmp_path, monkeypatch, quick_plans):
    """Those with a mark `.ci/run` runs word for word; the one without opens a page until it is interrupted."""
    text = README.read_text(encoding="utf-8")
    marked = dict(re.findall(r"<!-- ci: (\w+) -->\n```sh\n(.*?)\n```", text, flags=re.DOTALL))
    assert set(marked) == set(re.findall(r"run_readme (\w+)", (CHECKOUT / ".ci" / "run").read_text(encoding="utf-8")))
    (live,) = {block.strip() for kind, _, block in BLOCK.findall(text) if kind == "sh"} - set(marked.values())
    program, *arguments = shlex.split(live)
    assert program == ".venv/bin/truearm"

    def interrupted(*given):
        with contextlib.closing(serve(*given)) as events:
            yield next(events)
            raise KeyboardInterrupt

    monkeypatch.setattr("truearm.wings.bench.live_server.live.serve", interrupted)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ran = truearm(*arguments, "--port", 0)
    assert (ran.code, ran.err) == (130, "truearm: interrupted\n")
    assert "Open http://127.0.0.1:" in ran.out


def test_the_lines_of_python(run_page):
    assert (run_page(START / "python.md") / "errors.pdf").exists()


def test_the_printed_arm(run_page):
    folder = run_page(START / "printed-arm.md")
    assert read_session(folder / "by-hand.csv").points.shape == (1, 3)
    assert read_session(folder / "with-a-ruler.csv").anchor.tolist() == ["left", "right", "back"]
    servos = parse_toml((folder / "servos.toml").read_bytes(), ServoDocument)
    page = (START / "printed-arm.md").read_text(encoding="utf-8")
    (zeros,) = re.findall(r"`zero = (\[.*?\])`", page)
    shift = dict(re.findall(r"^(J\d) +([+-][\d.]+) ", page, flags=re.MULTILINE))  # theta that is missing
    put_right = servos.model_copy(update={"zero": tuple(map(float, zeros.strip("[]").split(",")))})
    counts = [1500, 1900, 2100, 2500, 3000]
    before, after = (np.degrees(document.decoder(5)(counts)) for document in (servos, put_right))
    expected = [float(shift.get(f"J{i}", 0)) for i in range(1, 6)]
    np.testing.assert_allclose(after - before, expected, atol=0.005)  # deg: a tenth of a count in the page's numbers


def test_what_others_call_calibration_is_named(refused):
    refused(["calibrate", "readings.csv"], "calibrate is called fit here. Try: truearm fit --help")
