"""Images of a virtual arm, written by `simulate`, and their corners, found by `corners`."""

import json

import numpy as np
import pytest
from PIL import Image

import truearm as ta
from truearm.errors import InputError
from truearm.pages.html import render
from truearm.wings.camera.lenses import camera_yaml
from truearm.wings.camera.observations import read_pixels

pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
N = 5


def made():
    return ta.simulate_images("ur5", poses=N, board="charuco:7x6,40mm,30mm", seed=1, size_px=(640, 512))


@pytest.fixture(scope="module")
def cell():
    return made()


@pytest.fixture(scope="module")
def folder(cell, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    cell.save(folder / "joints.csv")
    return folder


@pytest.fixture(scope="module")
def found(cell, folder):
    return ta.find_corners(folder / "joints.csv", folder / "joints-images", board=cell.board, camera=cell.cell.lens)


def test_corners_of_a_simulation_are_where_the_board_is(cell, found):
    exact = cell.cell.project(cell.seen.T_camera_board)
    miss = []
    for row, image in enumerate(found.images):
        corners = np.searchsorted(cell.board.corners, image.detection.corners)
        miss.append(image.detection.pixels - exact[row][:, corners].T)
        assert image.reading == row + 1
    miss = np.concatenate(miss)
    assert len(miss) > 0.5 * N * len(cell.board)
    # Where little of a square is in the image single corners are worse, which a fit takes for gross errors.
    assert np.sqrt(np.median((miss**2).sum(axis=1)) / 1.386) < 0.05  # px: the median of two coordinates' squares
    assert np.abs(np.median(miss, axis=0)).max() < 0.02


@pytest.mark.parametrize("eye_in_hand", [False, pytest.param(True, marks=pytest.mark.weekly)])
def test_a_grid_of_tags_is_seen_from_its_front(eye_in_hand, tmp_path):
    made = ta.simulate_images(
        "ur5", poses=4, board="aprilgrid:4x3,40mm,12mm", eye_in_hand=eye_in_hand, seed=2, size_px=(640, 512)
    )
    made.save(tmp_path / "joints.csv")
    found = ta.find_corners(tmp_path / "joints.csv", tmp_path / "joints-images", board=made.board)
    exact = made.cell.project(made.seen.T_camera_board)
    for row, image in enumerate(found.images):
        miss = image.detection.pixels - exact[row][:, image.detection.corners].T
        assert np.median(np.abs(miss)) < 0.4  # px: at 640 px a cell of a tag has three or four


def test_what_is_found_has_a_table_a_text_and_a_page(found, tmp_path):
    found.save(tmp_path / "pixels.csv")
    read = read_pixels(tmp_path / "pixels.csv")
    assert len(read) == len(found.pixels)
    assert read.board[0] == found.board.name
    text = str(found)
    assert f"in {N} of {N} images" in text
    assert "about the poses of the board that fit best" in text
    page = render(found.page())
    for image in found.images:
        assert image.name in page
    assert found.to_dict()["n_found"] == N


def test_a_board_may_have_a_name_in_the_table(truearm, folder, tmp_path):
    board = "A=charuco:7x6,40mm,30mm"
    out = tmp_path / "pixels.csv"
    done = truearm("corners", folder / "joints.csv", folder / "joints-images", "--board", board, "--out", out)
    assert done.code == 0, done.err
    assert set(read_pixels(out).board) == {"A"}
    assert "of board A" in done.out


def test_the_same_simulation_is_written_again_the_same_and_replaces_nothing(cell, folder, tmp_path):
    again = made()
    again.save(tmp_path / "joints.csv")
    for name in ["joints.csv", *(f"joints-images/{name}" for name in cell.image_names())]:
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes()
    with pytest.raises(InputError, match="the folder of the images exists already"):
        again.save(tmp_path / "joints.csv")
    assert len(ta.read_session(tmp_path / "joints.csv")) == N


def test_images_without_a_board_are_named_and_the_others_used(cell, folder, tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    for k, name in enumerate(cell.image_names()):
        grey = np.array(Image.open(folder / "joints-images" / name))
        Image.fromarray(np.full_like(grey, 120) if k == 2 else grey).save(images / name)
    found = ta.find_corners(folder / "joints.csv", images, board=cell.board)
    assert found.n_found == N - 1
    assert f"{cell.image_names()[2]} (reading 3) is not used: no board found" in str(found)
    assert "without: they are the first below" in render(found.page())
    for name in cell.image_names()[:2]:
        Image.fromarray(np.full((512, 640), 120, np.uint8)).save(images / name)
    with pytest.raises(InputError, match=r"2 images of 5 show board .*, expected 4: image_1.png, no board found"):
        ta.find_corners(folder / "joints.csv", images, board=cell.board)


def test_images_of_another_size_or_another_camera_are_refused(cell, folder, tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    for k, name in enumerate(cell.image_names()):
        grey = np.array(Image.open(folder / "joints-images" / name))
        Image.fromarray(grey[:500] if k == 1 else grey).save(images / name)
    with pytest.raises(InputError, match="the image is 640 x 500 px, those before 640 x 512 px"):
        ta.find_corners(folder / "joints.csv", images, board=cell.board)
    camera = tmp_path / "camera.yaml"
    camera.write_text(camera_yaml(cell.cell.lens).replace("image_width: 640", "image_width: 650"))
    with pytest.raises(InputError, match="the camera's file is of 650 x 512 px"):
        ta.find_corners(folder / "joints.csv", folder / "joints-images", board=cell.board, camera=camera)


def test_the_commands_go_from_nothing_to_a_table_of_pixels(truearm, tmp_path):
    joints, pixels, page = tmp_path / "joints.csv", tmp_path / "pixels.csv", tmp_path / "page.html"
    board, images = "charuco:7x6,30mm,22mm", tmp_path / "joints-images"
    simulate = ("simulate", "ur5", "--out", joints)
    ran = truearm(*simulate, "--instrument", "camera-in-hand", "--poses", 4, "--board", board).done()
    assert "a camera on the flange" in ran.out
    ran = truearm("corners", joints, images, "--board", board, "--out", pixels, "--page", page, "--json").done()
    assert json.loads(ran.out)["n_found"] == 4
    assert page.exists()
    before = pixels.read_bytes()
    ran = truearm("corners", joints, images, "--board", "charuco:7x6,30,22mm", "--out", pixels).refused()
    assert "expected a length with its unit" in ran.err
    assert pixels.read_bytes() == before


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--instrument", "sextant"), "expected an instrument out of camera, camera-in-hand, got 'sextant'"),
        (("--board", "charuco:7x6,30mm,22mm"), "--board applies to --instrument only"),
        (("--instrument", "camera", "--seats", 3), "--seats does not apply to --instrument"),
        (("--instrument", "camera", "--poses", 5000), "expected 1 to 1000 poses with a camera"),
        (("--instrument", "camera", "--board", "points:nothing.csv"), "does not exist"),
    ],
)
def test_a_simulation_that_cannot_be_is_refused_and_writes_nothing(truearm, options, problem, tmp_path):
    assert problem in truearm("simulate", "ur5", "--out", tmp_path / "a.csv", *options).refused().err
    assert not list(tmp_path.iterdir())
