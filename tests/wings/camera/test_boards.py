"""Boards: their corners against OpenCV's, and their texts."""

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.wings.camera.boards import aprilgrid, charuco, chessboard, named_board, parse_board, read_points


@pytest.mark.parametrize(("across", "down", "is_legacy"), [(8, 11, False), (5, 7, False), (6, 4, True)])
def test_corners_of_a_charuco_board_are_those_of_opencv(across, down, is_legacy):
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
    theirs = cv2.aruco.CharucoBoard((across, down), 15.0, 11.0, dictionary)
    theirs.setLegacyPattern(is_legacy)
    ours = charuco(across, down, 15.0, 11.0, is_legacy=is_legacy)
    np.testing.assert_allclose(ours.points, theirs.getChessboardCorners(), atol=1e-4)  # theirs are float32


def test_corner_k_of_a_charuco_board_is_where_the_formula_says():
    board = parse_board("charuco:8x11,15mm,11mm")
    k = board.corners
    expected = 15.0 * np.column_stack([1 + k % 7, 1 + k // 7])
    np.testing.assert_array_equal(board.points[:, :2], expected)
    assert (len(board), board.dictionary, board.size_mm) == (70, "4x4_50", (120.0, 165.0))


def test_a_chessboard_counts_inner_corners_from_the_first_one():
    board = parse_board("chessboard:9x6, 2.5cm")
    assert len(board) == 54
    np.testing.assert_array_equal(board.points[[0, 8, 9]], [[0, 0, 0], [200, 0, 0], [0, 25, 0]])


def test_a_length_may_have_all_digits_of_a_calculation():
    assert parse_board("chessboard:9x6,24.999999999999996mm").side_mm == pytest.approx(25.0)  # mm


def test_only_a_chessboard_of_like_parity_looks_the_same_half_turned():
    assert chessboard(8, 6, 25.0).has_two_readings
    assert not chessboard(9, 6, 25.0).has_two_readings
    assert not charuco(8, 6, 25.0, 20.0).has_two_readings


def test_tags_of_a_grid_begin_below_and_their_corners_run_counterclockwise():
    board = aprilgrid(2, 2, 80.0, 20.0)
    np.testing.assert_array_equal(board.points[:4, :2], [[0, 0], [80, 0], [80, 80], [0, 80]])
    np.testing.assert_array_equal(board.points[[4, 8], :2], [[100, 0], [0, 100]])


@pytest.mark.parametrize(
    "text",
    [
        "charuco:8x11,15mm,11mm,4x4_50",
        "charuco:8x11,15mm,11mm,4x4_50,legacy",
        "chessboard:9x6,25mm",
        "aprilgrid:6x6,88mm,26.4mm",
        "aprilgrid:6x6,88mm,26.4mm,apriltag_25h9",
    ],
)
def test_the_name_of_a_board_is_its_text(text):
    if text.endswith("25h9"):
        text = text.replace("6x6", "5x6")  # that dictionary has 35 tags
    board = parse_board(text)
    kind, across, down = board.kind, board.across, board.down
    maker = {"charuco": charuco, "chessboard": chessboard, "aprilgrid": aprilgrid}[kind]
    lengths = [length for length in (board.side_mm, board.marker_mm) if length]
    options = {"dictionary": board.dictionary} if board.dictionary else {}
    options |= {"is_legacy": True} if board.is_legacy else {}
    assert maker(across, down, *lengths, **options).name == text


def test_a_text_states_what_is_known_of_the_size():
    assert parse_board("chessboard:9x6,25mm").u_scale == 0.002
    assert parse_board("chessboard:9x6,25mm,u=0.05%").u_scale == pytest.approx(5e-4, rel=1e-12)
    assert parse_board("charuco:8x11,0.015m,1.1cm").side_mm == 15.0
    board = named_board("left=charuco:8x11,15mm,11mm,DICT_5X5_100")
    assert (board.name, board.dictionary) == ("left", "5x5_100")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("charuco", "expected a board"),
        ("checkerboard:9x6,25mm", "expected a board"),
        ("charuco:8x11,15,11mm", "with no unit"),
        ("charuco:8x11,15km,11mm", "unit 'km'"),
        ("charuco:8x11,15mm", "expected charuco:8x11"),
        ("charuco:8,15mm,11mm", "expected charuco:8x11"),
        ("charuco:8x11,11mm,15mm", "markers smaller than the squares"),
        ("charuco:1x11,15mm,11mm", "along each side"),
        ("charuco:999x999,15mm,11mm", "along each side"),
        ("charuco:8x11,15mm,11mm,4x4_51", "a dictionary as 4x4_50"),
        ("charuco:40x30,15mm,11mm,4x4_50", "has fewer"),
        ("chessboard:9x6,25mm,4x4_50", "has no markers"),
        ("chessboard:9x6,25mm,u=30%", "up to 10 %"),
        ("chessboard:9x6,1e300mm", "expected a length as 15mm"),
        ("chessboard:9x6,9000000mm", "from 0.1 mm to 5 m"),
        ("aprilgrid:6x6,88mm,26.4mm,apriltag_25h9", "has fewer"),
        ("points:nowhere.csv", "does not exist"),
    ],
)
def test_other_texts_are_refused_with_what_is_wrong(text, problem, tmp_path):
    with pytest.raises(InputError, match=problem):
        parse_board(text, folder=tmp_path)


def test_a_list_of_points_is_a_board(tmp_path):
    file = tmp_path / "points.csv"
    file.write_text("corner,x_mm,y_mm,z_mm\n10,0,0,0\n4,50,0,0\n7,0,50,0\n2,50,50,8.5\n")
    board = parse_board("points:points.csv,u=0.01%", folder=tmp_path)
    np.testing.assert_array_equal(board.points_of(np.array([2, 10, 2])), [[50, 50, 8.5], [0, 0, 0], [50, 50, 8.5]])
    assert not board.is_flat
    with pytest.raises(InputError, match="no corner 3; its 4 corners are 2 to 10"):
        board.points_of(np.array([4, 3]))
    file.write_text("corner,x_mm,y_mm,z_mm\n1,0,0,0\n4,50,0,0\n1,0,50,0\n2,50,50,8.5\n")
    with pytest.raises(InputError, match=r"line 4, column 'corner': corner 1 stands here twice"):
        read_points(file)
