"""The page for a robot and a camera: its commands lead from images to corrected programs."""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest

import truearm as ta
from page_transcripts import BLOCK, DOCS, check_printed, commands
from truearm.wings.camera.boards import parse_board
from truearm.wings.camera.lenses import read_camera
from truearm.wings.camera.virtual_cell import VirtualCell, working_lens

pytestmark = pytest.mark.usefixtures("undrawn")

PAGE = (DOCS / "start" / "camera.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, truearm):
    """Where the page's commands were run."""
    pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'truearm[camera]'")
    folder = tmp_path_factory.mktemp("camera")
    with contextlib.chdir(folder):
        for kind, name, text in BLOCK.findall(PAGE):
            if name:
                Path(name).write_text(text, encoding="utf-8")
            elif kind == "console":
                for (_, *arguments), shown in commands(text):
                    ran = truearm(*arguments)
                    assert ran.code == 0, ran.err
                    check_printed(shown, ran.out.splitlines())
    return folder


def test_no_command_of_the_page_writes_a_file_that_an_earlier_one_wrote():
    """Someone who copies them all into one folder is not stopped by a file that exists."""
    written = re.findall(r"--(?:camera-)?out (\S+)", PAGE)
    assert len(set(written)) == len(written) > 8


def test_the_camera_that_is_written_is_the_true_one(folder):
    found, true = read_camera(folder / "camera.yaml"), working_lens()
    assert (found.width, found.height) == (true.width, true.height)
    # Of focal lengths and centre some hundredths of a pixel, of which four and more are rare.
    np.testing.assert_allclose(found.intrinsics[:4], true.intrinsics[:4], atol=0.6)  # px


def test_the_model_knows_the_arm_better_than_its_drawing(folder):
    """Up to the place of the camera, at poses that were not in an image."""
    virtual = ta.VirtualArm.draw(ta.load_arm("irb2600-12-165"), "research", seed=0)
    cell = VirtualCell.around(virtual, working_lens(), parse_board("charuco:12x9,30mm,22mm"), in_hand=False, seed=1)
    angles = ta.read_session(folder / "joints.csv").angles
    middle, spread = angles.mean(axis=0), np.ptp(angles, axis=0) / 4
    fresh = middle + np.random.default_rng(0).uniform(-1, 1, (60, 6)) * spread
    model = ta.load_model(folder / "irb.truearm")
    tip = cell.T_flange_mounted[:3, 3]
    motions = virtual.motions(fresh)
    true = virtual.nominal.chain.with_tip(tip).tip_in_base(fresh, motions)
    nominal = virtual.nominal.chain.with_tip(tip).tip_in_base(fresh)
    left, drawn = (_apart(points, true) for points in (model.predict(fresh), nominal))
    assert left < 0.5 * drawn


@pytest.mark.parametrize(
    ("before", "after"), [("pick.mod", "corrected.mod"), ("part.src", "kuka.src"), ("part.ls", "fanuc.ls")]
)
def test_only_the_numbers_of_targets_change(folder, before, after):
    lines = [(folder / name).read_bytes().splitlines() for name in (before, after)]
    kept = [line for line in lines[1] if b"truearm" not in line]
    assert len(kept) == len(lines[0])
    changed = [old for old, new in zip(lines[0], kept, strict=True) if old != new]
    assert changed
    assert all(any(mark in line for mark in (b"robtarget", b"PTP", b"LIN", b"X =", b"W =")) for line in changed)


def _apart(points: np.ndarray, true: np.ndarray) -> float:
    """Root mean square distance after the best rigid motion [mm]."""
    a, b = points - points.mean(axis=0), true - true.mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return float(np.sqrt(((a @ R - b) ** 2).sum(axis=1).mean()))
