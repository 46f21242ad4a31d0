"""Corners in rendered images: where they truly are, and what is said of images without a board."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from truearm.errors import InputError
from truearm.wings.camera.boards import Board, parse_board
from truearm.wings.camera.detection import Detector, blur_of

pytest.importorskip("cv2", reason="opencv-python-headless is not installed")

# Root mean square error of a coordinate [px]: tags have fewer pixels around a corner.
BOARDS = {
    "charuco:8x11,15mm,11mm": 0.05,
    "charuco:7x8,18mm,13mm,5x5_100,legacy": 0.05,
    "chessboard:9x6,18mm": 0.05,
    "aprilgrid:4x3,30mm,10mm": 0.15,
}


@pytest.mark.parametrize("text", BOARDS)
def test_corners_are_found_where_they_are(view, text):
    image, true = view(text)
    found = Detector(parse_board(text)).find(image)
    assert not found.problem
    assert len(found) == len(true)
    miss = found.pixels - true[found.corners]
    assert np.sqrt((miss**2).mean()) < BOARDS[text]
    assert np.abs(miss.mean(axis=0)).max() < 0.03  # px: no shift by half a pixel or the like


def test_a_chessboard_has_its_first_corner_also_half_turned(view):
    text = "chessboard:9x6,18mm"
    for turn in (0.0, np.pi / 2, np.pi, 3.5):
        image, true = view(text, tilt=(0.0, 0.1, turn), distance=400.0)
        found = Detector(parse_board(text)).find(image)
        np.testing.assert_allclose(found.pixels, true[found.corners], atol=0.5)


def test_tags_of_another_generator_and_with_two_border_cells_are_turned_as_the_grid_is(view):
    text = "aprilgrid:4x3,30mm,10mm"
    image, true = view(text, tilt=(0.1, 0.1, np.pi / 2))
    found = Detector(parse_board(text)).find(image)
    np.testing.assert_allclose(found.pixels, true[found.corners], atol=0.6)
    detector = Detector(parse_board(text))
    tags = detector._tag_detectors[0].detectMarkers(image)
    turned = [np.roll(tag, 1, axis=1) for tag in tags[0]], *tags[1:]

    class Turned:
        def detectMarkers(self, image):
            return turned

    detector.__dict__["_tag_detectors"] = [Turned()]
    np.testing.assert_array_equal(detector.find(image).corners, found.corners)
    np.testing.assert_allclose(detector.find(image).pixels, found.pixels, atol=1e-3)


def test_half_a_board_is_used(view):
    text = "charuco:8x11,15mm,11mm"
    image, true = view(text)
    image[:, :320] = 120
    found = Detector(parse_board(text)).find(image)
    assert 10 < len(found) < 60
    assert np.abs(found.pixels - true[found.corners]).max() < 0.3


def test_the_other_pattern_of_opencv_is_recognised(view):
    image, true = view("charuco:7x8,18mm,13mm,legacy")
    found = Detector(parse_board("charuco:7x8,18mm,13mm")).find(image)
    assert found.variant == "its pattern is that of OpenCV before 4.6"
    assert np.abs(found.pixels - true[found.corners]).max() < 0.3


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ("charuco:5x6,15mm,11mm", "board of another size"),
        ("charuco:11x8,15mm,11mm", "it may be 8x11"),
        ("charuco:8x11,15mm,11mm,6x6_100", r"markers of dictionary 4x4 \(50 to 1000\), the board those of 6x6_100"),
        ("aprilgrid:6x6,20mm,6mm", "markers of dictionary 4x4"),
        ("chessboard:5x7,15mm", "5 x 7 inner corners must all be in the image"),
    ],
)
def test_another_board_is_named(view, stated, problem):
    image, _ = view("charuco:8x11,15mm,11mm")
    found = Detector(parse_board(stated)).find(image)
    assert not len(found)
    with pytest.raises(ValueError, match=problem):
        raise ValueError(found.problem)


def test_a_grid_with_other_gaps_is_another_board(view):
    image, _ = view("aprilgrid:4x3,30mm,10mm")
    assert "another size" in Detector(parse_board("aprilgrid:3x3,30mm,10mm")).find(image).problem
    assert "it is another board" in Detector(parse_board("aprilgrid:3x4,30mm,10mm")).find(image).problem


def test_a_blurred_image_is_said_to_be_one(view):
    image, _ = view("charuco:8x11,15mm,11mm")
    blurred = gaussian_filter(image, 5.0)
    assert "the image is blurred" in Detector(parse_board("charuco:8x11,15mm,11mm")).find(blurred).problem
    assert blur_of(image) < 1.5 < blur_of(gaussian_filter(image, 2.0)) < blur_of(blurred)


def test_an_image_without_a_board_is_said_to_have_none():
    detector = Detector(parse_board("charuco:8x11,15mm,11mm"))
    rng = np.random.default_rng(0)
    assert "too dark or too bright" in detector.find(np.full((480, 640), 3, np.uint8)).problem
    assert detector.find(rng.integers(0, 256, (480, 640), dtype=np.uint8)).problem.startswith(
        "no board found: its markers"
    )
    assert detector.find(np.zeros((5, 5), np.uint8)).problem


def test_a_list_of_points_is_for_other_detectors():
    board = Board("points", "points", np.arange(4), np.zeros((4, 3)))
    with pytest.raises(InputError, match="program of your own"):
        Detector(board)
