"""Laws of the manifest: what is written is read back from any format, and a damaged one is refused."""

import hashlib

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.exports.targets.manifest import Manifest, check_joints, read_manifest


@pytest.fixture(scope="module")
def model():
    session = ta.simulate("ur10", poses=40, strategy="box", seed=1).session
    return ta.fit("ur10", session, model="kinematic").model


@pytest.mark.parametrize("frame", ["// {}\n", "<!-- {} -->", "/* {} */ int x;", "# a\n# {}\n1,2\n", "\0\1meta{}\0"])
def test_a_manifest_is_read_back_from_any_comment(model, tmp_path, frame):
    manifest = Manifest.of(model, "csv", direction="command")
    (tmp_path / "x").write_bytes(frame.format(manifest.line()).encode())
    assert read_manifest(tmp_path / "x") == manifest


def test_a_manifest_is_one_line_that_ends_no_comment(model):
    arm = ta.Arm("a--b*/c", model.arm.chain)
    odd = type(model)(arm).fit(model.training_.angle_sample, model.predict(model.training_.angle_sample))
    line = Manifest.of(odd, "c").line()
    assert not [part for part in ("--", "*/", "\n") if part in line]
    assert line.isascii()


def test_its_hash_is_that_of_the_model_file(model, tmp_path):
    model.save(tmp_path / "m")
    loaded = ta.load_model(tmp_path / "m")
    digest = hashlib.sha256((tmp_path / "m").read_bytes()).hexdigest()
    assert Manifest.of(model, "c").provenance.model_sha256 == digest == Manifest.of(loaded, "c").provenance.model_sha256


def test_check_poses_are_trained_and_show_a_wrong_sign_unit_or_order(model):
    joints = check_joints(model)
    assert not model.outside_training(joints).any()
    tips = model.predict(joints)
    for joint in range(5):  # the tip is on the axis of the sixth
        wrong = joints.copy()
        wrong[:, joint] *= -1
        assert np.linalg.norm(model.predict(wrong) - tips, axis=1).max() > 1.0  # mm
    for i in range(5):
        wrong = joints.copy()
        wrong[:, [i, i + 1]] = wrong[:, [i + 1, i]]
        assert np.linalg.norm(model.predict(wrong) - tips, axis=1).max() > 1.0


@pytest.mark.parametrize("text", ["", "truearm-export: {", 'truearm-export: {"format": 1}', "truearm-export: {" * 9999])
def test_a_file_without_a_whole_manifest_is_refused(tmp_path, text):
    (tmp_path / "x").write_text(text)
    refuses(r"check poses|damaged", read_manifest, tmp_path / "x")


def test_a_name_with_the_marker_hides_no_manifest(model, tmp_path):
    manifest = Manifest.of(model, "urdf")
    (tmp_path / "x").write_text(f'<robot name="truearm-export: {{}}">\n<!-- {manifest.line()} -->\n</robot>')
    assert read_manifest(tmp_path / "x") == manifest
