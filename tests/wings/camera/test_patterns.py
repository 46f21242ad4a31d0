"""What is printed on a board: against OpenCV's own pictures."""

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.wings.camera.boards import Board, parse_board
from truearm.wings.camera.patterns import Pattern, opencv, opencv_dictionary, pattern_of

PICTURES = {  # pixels a mm that put all edges between pixels
    "charuco:8x11,15mm,11mm": 6,
    "charuco:5x6,15mm,10.5mm,5x5_100": 4,
    "charuco:5x6,15mm,11mm,legacy": 6,
    "charuco:6x5,15mm,11mm,legacy": 6,
}


@pytest.mark.parametrize("text", PICTURES)
def test_a_charuco_pattern_is_that_of_opencv_to_the_pixel(text):
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    board, k = parse_board(text), PICTURES[text]
    dictionary = opencv_dictionary(board.dictionary)
    theirs = cv2.aruco.CharucoBoard((board.across, board.down), board.side_mm, board.marker_mm, dictionary)
    theirs.setLegacyPattern(board.is_legacy)
    picture = theirs.generateImage((15 * k * board.across, 15 * k * board.down), marginSize=0)
    y, x = (np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5) / k
    np.testing.assert_array_equal(pattern_of(board).is_black(x, y), picture == 0)


def test_corners_lie_where_colours_change():
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    for text in ("charuco:8x11,15mm,11mm", "chessboard:9x6,25mm", "aprilgrid:4x3,24mm,7.2mm"):
        board = parse_board(text)
        pattern = pattern_of(board)
        x, y = pattern.on_sheet(board.points[:, :2].T)
        around = np.stack([pattern.is_black(x + dx, y + dy) for dx in (-0.1, 0.1) for dy in (-0.1, 0.1)])
        # Four squares meet in a corner; of a marker one quarter is black.
        assert (around.sum(axis=0) == (1 if board.kind == "aprilgrid" else 2)).all(), text
        assert board.size_mm == pytest.approx(pattern.size_mm, abs=1e-9)


def test_outside_the_pattern_all_is_white():
    pattern = pattern_of(parse_board("chessboard:3x3,10mm"))
    assert pattern.size_mm == (40.0, 40.0)
    x = np.array([-1.0, 5.0, 41.0, np.nan])
    assert pattern.is_black(x, np.full(4, 5.0)).tolist() == [False, True, False, False]


def test_rectangles_that_touch_leave_no_gap():
    pattern = Pattern(np.array([[0.1 + 0.2, 0.0, 1.0, 1.0], [0.0, 0.0, 0.3, 1.0]]), np.zeros(2))
    assert pattern.is_black(np.linspace(0.001, 0.999, 200), np.full(200, 0.5)).all()


def test_what_is_printed_around_a_list_of_points_is_not_known():
    board = Board("points", "points", np.arange(4), np.zeros((4, 3)))
    with pytest.raises(InputError, match="list of points"):
        pattern_of(board)


def test_without_opencv_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    with pytest.raises(InputError, match=r"OpenCV 4.10 or later.*pip install 'truearm\[camera\]'"):
        opencv()
