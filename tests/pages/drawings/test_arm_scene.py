"""The arm of an interactive scene: the script's forward kinematics are the chain's, its links meet its joints."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import truearm as ta
import truearm.pages
from truearm.arm import Arm, Chain, list_arms
from truearm.arm.rigid_motions import frame_from_xyz_rpy, xyz_rpy_from_frame
from truearm.command_line import make_app
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_frames
from truearm.pages.html import render
from truearm.wings.reports.arm_page import arm_page
from truearm.wings.reports.arms import describe_arm

SPACE = Path(truearm.pages.__file__).parent / "scene_space.mjs"
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no node here (on Debian: apt-get install nodejs)")


def rail_arm():
    """An arm that slides and turns, with no axis parallel to another by chance."""
    random = np.random.default_rng(3)
    fixed = [frame_from_xyz_rpy(random.uniform(-300, 300, 3), random.uniform(-2, 2, 3)) for _ in range(4)]
    lower, upper = np.array([-500.0, -1.0, -np.inf]), np.array([700.0, 2.0, np.inf])
    return Arm(
        "rail", Chain(np.array(fixed), np.array([1.0, 2.0, 90.0]), [True, False, False]), lower=lower, upper=upper
    )


def by_script(cases):
    """Tips [mm] and roll, pitch, yaw [deg] of every case by the scripts of the page."""
    code = f"""
import {{ framesOf, rollPitchYaw }} from {json.dumps(SPACE.as_uri())};
let text = "";
for await (const part of process.stdin) text += part;
const out = JSON.parse(text).map(({{ mechanism, values }}) => values.map((row) => {{
  const frames = framesOf(mechanism, row);
  return [...frames.end, ...rollPitchYaw(frames.last)];
}}));
console.log(JSON.stringify(out));
"""
    asked = [NODE, "--input-type=module", "-e", code]
    done = subprocess.run(asked, input=json.dumps(cases), capture_output=True, text=True, timeout=60, check=True)
    return [np.array(one) for one in json.loads(done.stdout)]


@needs_node
def test_the_script_finds_the_tips_that_the_chain_finds():
    arms = [*map(ta.load_arm, list_arms()), rail_arm()]
    random = np.random.default_rng(0)
    values, cases = [], []
    for arm in arms:
        scale = np.where(arm.chain.is_prismatic, 300.0, 3.0)
        values.append(random.uniform(-1, 1, (20, arm.n_joints)) * scale)
        shown = np.where(arm.chain.is_prismatic, values[-1], np.degrees(values[-1]))
        cases.append({"mechanism": arm_mechanism(arm).to_json("mm"), "values": shown.tolist()})
    for arm, q, found in zip(arms, values, by_script(cases), strict=True):
        pose = arm.chain.pose(q)
        np.testing.assert_allclose(found[:, :3], pose.tip_in_base, atol=1e-9, err_msg=arm.name)  # mm
        for angles, turn in zip(found[:, 3:], pose.R_base_tip, strict=True):
            again = frame_from_xyz_rpy(np.zeros(3), np.radians(angles))[:3, :3]
            np.testing.assert_allclose(again, turn, atol=1e-9, err_msg=arm.name)


@pytest.mark.parametrize("arm", [*map(ta.load_arm, list_arms()), rail_arm()], ids=lambda arm: arm.name)
def test_every_link_leads_from_joint_to_joint(arm):
    links = arm_mechanism(arm).links
    ends = [
        *arm.chain.fixed[:-1, :3, 3],
        arm.chain.fixed[-1, :3, :3] @ arm.chain.tip_in_flange + arm.chain.fixed[-1, :3, 3],
    ]
    for link, end in zip(links, ends, strict=True):
        np.testing.assert_allclose(link[0], 0, atol=1e-12)
        np.testing.assert_allclose(link[-1], end, atol=1e-9)
    # A link is drawn along axes and common normals, which are not much longer than the way.
    for link in links[1:-1]:
        along = np.linalg.norm(np.diff(link, axis=0), axis=1).sum()
        assert along < 6 * np.linalg.norm(link[-1]) + 1e-9


def test_frames_before_joints_are_those_of_the_chain():
    arm = rail_arm()
    frames = joint_frames(arm.chain, [120.0, 0.3, -0.7])
    pose = arm.chain.pose([[120.0, 0.3, -0.7]])
    np.testing.assert_allclose(frames[-1, :3, :3], pose.R_base_tip[0], atol=1e-12)
    np.testing.assert_allclose(frames[-1, :3, :3] @ arm.chain.tip_in_flange + frames[-1, :3, 3], pose.tip_in_base[0])


def test_sliders_span_the_limits_or_a_full_turn():
    arm = rail_arm()
    shown = arm_mechanism(arm, controls=True)
    assert shown.units == ["mm", "deg", "deg"]
    np.testing.assert_allclose(shown.lower, [-500, np.degrees(-1), -360])
    np.testing.assert_allclose(shown.upper, [700, np.degrees(2), 360])
    assert shown.limited.tolist() == [True, True, False]
    assert shown.value_name == "joint position"


def test_the_page_of_an_arm_states_its_constants(tmp_path):
    html = render(arm_page(ta.load_arm("gao2017"), describe_arm("gao2017").table))
    assert "In its working pose the tip is at x 758, y 15, z 237 mm" in html
    assert '<span class="n">376<' in html
    assert "script-src 'sha256-" in html
    assert 'class="still' in html


def test_an_identified_arm_is_drawn_from_its_first_joint():
    arm = ta.load_arm("gao2017")
    q = np.random.default_rng(1).uniform(-1, 1, (30, 6))
    placed = arm.chain.with_reference_frame(frame_from_xyz_rpy([5000, -3000, 200], [0.1, 0, 2]))
    page = describe_arm(ta.NominalModel(arm).fit(q, placed.tip_in_base(q))).page()
    (scene,) = page.sections[0].scenes
    np.testing.assert_allclose(scene.mechanism.links[0][0], xyz_rpy_from_frame(placed.fixed[0])[0], atol=1e-6)  # mm
    assert "identified" in page.title


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["arms", "--page", "arm.html"], "--page needs the name of an arm"),
        (["arms", "ur5", "--page", "arm.toml"], "ends in .html"),
        (["arms", "nix", "--page", "arm.html"], "no arm 'nix'"),
    ],
)
def test_pages_that_cannot_be_written_are_refused(words, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = CliRunner().invoke(make_app(words[0]), words)
    assert problem in str(ran.exception)
    assert list(tmp_path.iterdir()) == []


def test_a_page_shows_the_arm(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = CliRunner().invoke(make_app("arms"), ["arms", "ur5", "--page", "ur5.html"])
    assert ran.exit_code == 0, ran.output
    assert "page written to ur5.html" in ran.output
    assert "Move it" in (tmp_path / "ur5.html").read_text(encoding="utf-8")
