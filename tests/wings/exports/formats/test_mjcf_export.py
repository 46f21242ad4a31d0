"""MJCF written: MuJoCo gets the arm that was built, and nothing else changes."""

import re
from functools import cache

import numpy as np
import pytest

import truearm as ta
from made_up_mjcf import MODEL
from refusals import refuses
from truearm.wings.exports.formats import mjcf


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "robot.xml"
    path.write_bytes(MODEL.replace("\n", "\r\n").encode())
    return path


def poses(arm) -> np.ndarray:
    q = np.random.default_rng(0).uniform(-1, 1, (60, arm.n_joints))
    return np.where(arm.chain.is_prismatic, 200 * q, q)


@cache
def built(source) -> ta.KinematicModel:
    arm = ta.load_arm(source)
    motions = np.random.default_rng(4).normal(size=(arm.chain.n_places, 6)) * ([1e-3] * 3 + [0.5] * 3)
    q = poses(arm)
    return ta.KinematicModel(arm).fit(q, arm.chain.with_tip(np.array([5.0, 6, 7])).with_motions(motions).tip_in_base(q))


@pytest.mark.parametrize("links", ["", ":base:hand"])
def test_the_model_has_the_arm_that_was_built(source, tmp_path, links):
    model = built(f"{source}{links}")
    out = tmp_path / "built.xml"
    rigid = mjcf.write(model, out, source=f"{source}{links}").rigid
    q = poses(rigid.arm)
    again = ta.load_arm(out)
    np.testing.assert_allclose(again.chain.tip_in_base(q), rigid.arm.chain.tip_in_base(q), rtol=0, atol=1e-9)  # mm
    np.testing.assert_allclose(mjcf.tips(out, q), rigid.arm.chain.tip_in_base(q), rtol=0, atol=1e-9)
    assert ta.check_export(model, out).agrees
    twice = tmp_path / "twice.xml"
    ta.export(model, twice, source=out)
    assert twice.read_text().count("truearm-export") == 1
    assert twice.read_text().count('name="truearm"') == 1


def test_only_poses_of_bodies_change(source, tmp_path):
    out = tmp_path / "built.xml"
    ta.export(built(f"{source}"), out, source=source)
    lines = out.read_bytes().decode().splitlines()
    kept = [line for line in lines if not re.search(r"truearm-export|name=\"tip\"|name=\"truearm\"", line)]
    before = MODEL.splitlines()
    changed = [(one, other) for one, other in zip(before, kept, strict=True) if one != other]
    assert len(lines) == len(kept) + 3
    assert [re.search(r'name="(\w+)"', one)[1] for one, _ in changed] == ["l2", "l3", "l4", "l5"]
    for one, other in changed:
        assert re.sub(r' (pos|quat|xyaxes|zaxis)="[^"]*"', "", one) == re.sub(r' (pos|quat)="[^"]*"', "", other)


def test_a_model_that_is_the_nominal_arm_moves_no_body(source, tmp_path):
    arm = ta.load_arm(source)
    q = poses(arm)
    ta.export(ta.NominalModel(arm).fit(q, arm.chain.tip_in_base(q)), tmp_path / "same.xml", source=source)
    lines = (tmp_path / "same.xml").read_bytes().splitlines(keepends=True)
    kept = [line for line in lines if b"truearm" not in line and b'name="tip"' not in line]
    assert b"".join(kept).replace(b"\r", b"") == source.read_bytes().replace(b"\r", b"")


def test_what_cannot_be_exported_is_refused(source, tmp_path):
    model = built(f"{source}")
    refuses("own model is not stated", ta.export, model, tmp_path / "out.xml")
    refuses("frame does not apply", ta.export, model, tmp_path / "out.xml", source=source, frame="reference")
    joints = '<joint name="a"/><joint name="b" axis="1 0 0"/>'
    body = f'<body>{joints}<body pos="0 0 1"><joint name="c"/><site name="tip" pos="0 1 0"/></body></body>'
    (tmp_path / "two.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    refuses("joint 'a' has several joints", ta.export, built(f"{tmp_path / 'two.xml'}"), tmp_path / "out.xml",
            source=tmp_path / "two.xml")  # fmt: skip
    assert not (tmp_path / "out.xml").exists()
