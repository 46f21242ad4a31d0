"""The table of pixels: back the same, and its faults by line and column."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.wings.camera.observations import PixelObservations, camera_files, read_pixels

TABLE = """reading,image,camera,board,corner,u_px,v_px
1,a.png,camera,"charuco:8x11,15mm,11mm",0,100.5,200.25
1,a.png,camera,"charuco:8x11,15mm,11mm",1,130.5,201.25
3,b.png,camera,"charuco:8x11,15mm,11mm",0,90.125,180
"""


def test_a_table_is_written_as_it_was_read(tmp_path):
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    first.write_text(TABLE)
    read = read_pixels(first)
    assert (len(read), read.images) == (3, ("a.png", "b.png"))
    np.testing.assert_array_equal(read.of_image("b.png").pixels, [[90.125, 180.0]])
    read.save(second)
    assert second.read_text() == TABLE.replace("180\n", "180.0\n")
    joined = PixelObservations.joined([read.of_image(image) for image in read.images])
    np.testing.assert_array_equal(joined.pixels, read.pixels)


def test_one_camera_and_one_board_need_no_columns(tmp_path):
    file = tmp_path / "pixels.csv"
    file.write_text("reading;corner;u_px;v_px\n2;0;1,5;2,5\n2;1;3,5;2,5\n")
    read = read_pixels(file)
    assert (read.images, read.camera[0], read.board[0]) == (("reading 2",), "camera", "board")
    np.testing.assert_array_equal(read.pixels, [[1.5, 2.5], [3.5, 2.5]])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("reading,image", "row,image", "unknown column 'row'"),
        ("3,b.png", "0,b.png", r"line 4, column 'reading': expected the number of a reading, counted from 1, got 0"),
        ("3,b.png", "1.5,b.png", r"line 4, column 'reading': expected a whole number, got 1.5"),
        ("3,b.png", "3,a.png", r"line 4, column 'reading': expected one reading an image, got a second one, 3"),
        ("3,b.png", "3,", r"line 4, column 'image': expected the name of the image, got an empty cell"),
        (",1,130.5", ",0,130.5", r"line 3, column 'corner': corner 0 stands twice in this image"),
        ("130.5", "1e9", r"line 3, column 'u_px': expected pixels from -30000 to 30000, got 1e\+09"),
        ("130.5", "nan", r"line 3, column 'u_px': expected a finite number"),
    ],
)
def test_faults_are_named_by_line_and_column(old, new, problem, tmp_path):
    file = tmp_path / "pixels.csv"
    file.write_text(TABLE.replace(old, new, 1))
    with pytest.raises(InputError, match=problem):
        read_pixels(file)


def test_rows_beyond_the_joints_table_are_refused(tmp_path):
    file = tmp_path / "pixels.csv"
    file.write_text(TABLE)
    read_pixels(file).check_readings(3)
    with pytest.raises(InputError, match="expected readings 1 to 2, the rows of the joints table, got 3"):
        read_pixels(file).check_readings(2)


def test_the_size_of_the_images_is_kept_and_is_needed_for_a_camera_file(tmp_path):
    plain, sized, other = tmp_path / "plain.csv", tmp_path / "sized.csv", tmp_path / "other.csv"
    plain.write_text(TABLE)
    with pytest.raises(InputError, match="the size of the images is not stated"):
        camera_files(Path("camera.yaml"), [plain], {})
    replace(read_pixels(plain), sizes_px={"camera": (1280, 1024)}).save(sized)
    assert camera_files(Path("camera.yaml"), [sized], {}) == {"camera": Path("camera.yaml")}
    read = read_pixels(sized)
    assert read.sizes_px == read.of_image("b.png").sizes_px == PixelObservations.joined([read]).sizes_px
    other.write_text(sized.read_text().replace(",1024\n3", ",1025\n3"))
    with pytest.raises(InputError, match="column 'height_px': expected one size of all images of a camera, got 1025"):
        read_pixels(other)
    other.write_text(sized.read_text().replace("height_px", "note"))
    with pytest.raises(InputError, match="the column height_px is missing"):
        read_pixels(other)
