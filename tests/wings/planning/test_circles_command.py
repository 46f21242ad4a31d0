"""``truearm arms --circles-plan`` and ``--from-circles``: the file to fill in, the arm that comes of it."""

import json

import numpy as np
import pandas as pd
import pytest

from page_transcripts import block, walk
from truearm.arm import load_arm

circles = pytest.importorskip("benchmarks.circles", reason="benchmarks are not beside the tests")


@pytest.fixture(scope="module")
def filled(truearm, tmp_path_factory):
    """A plan for six joints, filled in with an arm of the catalogue whose target is off its flange."""
    path = tmp_path_factory.mktemp("circles") / "circles.csv"
    made = truearm("arms", "--circles-plan", 6, "--points", 8, "--span", 50, "--out", path).done()
    assert "48 readings" in made.out
    assert f"truearm arms --from-circles {path} --out my-arm.toml" in made.out
    form, arm = pd.read_csv(path), load_arm("ur10")
    angles = form.filter(regex="^note_q").to_numpy(float) + [0, -90, 60, 10, 20, 0]
    pose = arm.forward(np.radians(angles))
    points = pose.tip_in_base + pose.R_base_tip @ [90.0, 0.0, 40.0] + np.random.default_rng(1).normal(0, 0.02, (48, 3))
    table = pd.DataFrame(
        {
            **{f"q{i + 1}_deg": angles[:, i] for i in range(6)},
            **dict(zip(("x_mm", "y_mm", "z_mm"), points.T, strict=True)),
        }
    )
    table.to_csv(path, index=False)
    return path


def test_an_arm_without_a_drawing(truearm, filled, tmp_path):
    done = truearm("arms", "--from-circles", filled, "--out", tmp_path / "mine.toml").done()
    assert done.out.startswith("An arm of 6 joints from 48 points on 6 circles")
    assert "base frame is that of joint 1" in done.out
    assert load_arm(tmp_path / "mine.toml").name == "mine"
    found = json.loads(truearm("arms", "--from-circles", filled, "--json").out)
    assert found["a_mm"][1] == pytest.approx(-612, abs=6 * found["u_a_mm"][1])
    assert truearm("arms", tmp_path / "mine.toml").code == 0
    assert truearm("arms", "--from-circles", filled, "--out", tmp_path / "mine.urdf").code == 0


def test_an_arm_of_which_a_joint_is_missing_is_written_with_exit_code_1(truearm, filled, tmp_path):
    table = pd.read_csv(filled)
    table[table.index // 8 != 5].to_csv(tmp_path / "five.csv", index=False)
    done = truearm("arms", "--from-circles", tmp_path / "five.csv", "--out", tmp_path / "mine.toml")
    assert done.code == 1
    assert done.out.startswith("J6 not measured: an arm of 5 of 6 joints")
    assert load_arm(tmp_path / "mine.toml").n_joints == 6
    machine = truearm("arms", "--from-circles", tmp_path / "five.csv", "--json")
    assert machine.code == 1
    assert json.loads(machine.out)["tip_mm"] == [None] * 3


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        (["ur10", "--from-circles", "c.csv"], "does not apply to --from-circles"),
        (["--points", "9"], "--points applies to --circles-plan only"),
        (["--noise", "1"], "--noise applies to --circles-plan only"),
        (["--accept", "a reason"], "--accept applies to --from-circles only"),
        (["--circles-plan", "6"], "--circles-plan needs --out"),
        (["--circles-plan", "6", "--points", "3", "--out", "plan.csv"], "5 to 1000 points"),
        (["--circles-plan", "6", "--from-circles", "c.csv"], "one of them at a time"),
        (["--from-circles", "missing.csv"], "missing.csv"),
    ],
)
def test_options_that_do_not_fit(refused, arguments, phrase):
    refused(["arms", *arguments], phrase)


def test_the_transcript_of_the_page_is_true(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chain, stand = circles.planted("ur10", 1)
    circles.swept(chain, stand, 1, points=12, arc_deg=60).to_frame().to_csv("circles.csv", index=False)
    walk(truearm, block("describe-your-arm.md", "console circles"))
