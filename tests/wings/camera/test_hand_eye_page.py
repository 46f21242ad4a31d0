"""The page of hand-eye shows every image, what it leaves and how it turns, and the cell to scale."""

import numpy as np
import pytest
from hand_eye_cells import make_cell

from truearm.wings.camera.hand_eye_page import _arm, _in_base, _Left

NOISE = (0.02, 0.1)  # deg, mm


@pytest.fixture(scope="module", params=[False, True], ids=["beside the robot", "on the flange"])
def found(request):
    """Hand-eye with an image that was seen half turned, the fifth."""
    cell = make_cell(2, 24, eye_in_hand=request.param, errors=(5e-4, 0.3), noise=NOISE)
    seen = cell.seen.copy()
    seen[4, :3, :3] = seen[4, :3, :3] @ np.diag([-1.0, -1.0, 1.0])
    return cell.with_seen(seen).hand_eye(joints=True)


def test_an_ignored_image_is_the_first_of_the_table_and_a_cross_in_the_turns(found):
    page = found.page()
    (table,) = page.sections[-1].tables
    assert [row[0] for row in table.rows] == [5, *range(1, 5), *range(6, 25)]
    assert table.states == ("doubtful", *["none"] * 23)
    assert (table.rows[0][1], table.rows[0][-1]) == ("image 5", "turns differ")
    off, good = found.interpretation.test.off_deg, np.arange(24) != 4
    assert off[4, good].min() > found.interpretation.test.tolerance_deg > off[np.ix_(good, good)].max()


def test_its_means_are_those_of_the_text(found):
    left = _Left.of(found)
    means = [float(values.mean()) for values in reversed(left.mm.values())]
    assert means == pytest.approx(found.held_out_mm[::-1], rel=1e-9)
    assert left.deg["arm identified"].mean() < 4 * NOISE[0]  # deg; three axes of noise, and what the arm has left


def test_the_arm_of_the_drawing_carries_the_board_or_the_camera(found):
    standing, carried = _in_base(found)
    arm = _arm(found, standing)
    drawn = arm.chain.tip_in_base(found.readings.angles)
    off = np.linalg.norm(drawn - carried[:, :3, 3], axis=1)
    # Noise of positions, and of orientations over the half metre to the board.
    assert off.max() < 6 * (NOISE[1] + np.radians(NOISE[0]) * 550)  # mm


def test_poses_of_the_flange_have_a_page_too(tmp_path):
    found = make_cell(3, 15, noise=NOISE).hand_eye()
    found.save_page(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "image 15" in text
    assert "arm identified" not in text


def test_the_command_writes_it_and_keeps_its_input(tmp_path, truearm):
    cell, file = make_cell(1, 12, noise=NOISE), tmp_path / "cell.csv"
    rows = np.hstack([np.degrees(cell.joints), cell.seen[:, :3].reshape(12, 12)])
    names = [f"q{k}_deg" for k in range(1, 7)]
    names += [name for k in "123" for name in (f"r{k}1", f"r{k}2", f"r{k}3", f"{'xyz'[int(k) - 1]}_mm")]
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="")
    ran = truearm("hand-eye", file, "--arm", "ur10", "--page", tmp_path / "page.html").done()
    assert "page written to" in ran.out
    assert "line 13" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "ends in .html" in truearm("hand-eye", file, "--arm", "ur10", "--page", file).refused().err
