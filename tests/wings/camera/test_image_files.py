"""Image files: grey values, bounds, and which image belongs to which reading."""

import numpy as np
import pytest
from PIL import Image

from truearm.errors import InputError
from truearm.wings.camera import image_files
from truearm.wings.camera.image_files import images_of_readings, list_images, read_image

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8) * 5


@pytest.mark.parametrize("name", ["a.png", "a.bmp", "a.tif", "a.pgm"])
def test_grey_values_come_back_the_same(name, tmp_path):
    Image.fromarray(GREY).save(tmp_path / name)
    np.testing.assert_array_equal(read_image(tmp_path / name), GREY)


def test_colours_become_grey_and_sixteen_bits_eight(tmp_path):
    Image.fromarray(np.stack([GREY] * 3, axis=2)).save(tmp_path / "rgb.png")
    np.testing.assert_array_equal(read_image(tmp_path / "rgb.png"), GREY)
    Image.fromarray(GREY.astype(np.uint16) * 16).save(tmp_path / "deep.png")  # 12 bits
    np.testing.assert_allclose(read_image(tmp_path / "deep.png"), GREY * (255 / GREY.max()), atol=1)


def test_an_image_is_not_turned_by_its_metadata(tmp_path):
    picture = Image.fromarray(GREY)
    exif = picture.getexif()
    exif[0x0112] = 6  # the camera was held upright
    picture.save(tmp_path / "a.jpg", exif=exif, quality=95)
    assert read_image(tmp_path / "a.jpg").shape == GREY.shape


def test_files_that_are_no_images_are_refused_with_their_name(tmp_path, monkeypatch):
    broken = tmp_path / "broken.png"
    Image.fromarray(np.tile(GREY, (20, 20))).save(broken)
    broken.write_bytes(broken.read_bytes()[:120])
    text = tmp_path / "text.png"
    text.write_text("no image")
    gif = tmp_path / "moving.png"
    Image.fromarray(GREY).save(tmp_path / "a.gif")
    gif.write_bytes((tmp_path / "a.gif").read_bytes())
    for path in (broken, text, gif):
        with pytest.raises(InputError, match=f"{path.name}: the image cannot be read"):
            read_image(path)
    monkeypatch.setattr(image_files, "MAX_PIXELS", 40)
    Image.fromarray(GREY).save(tmp_path / "large.png")
    with pytest.raises(InputError, match="got 8 x 6"):
        read_image(tmp_path / "large.png")
    with pytest.raises(InputError, match="folder"):
        read_image(tmp_path)


def folder_of(tmp_path, names):
    for name in names:
        Image.fromarray(GREY).save(tmp_path / name)
    return tmp_path


def test_images_are_in_the_order_in_which_people_number_them(tmp_path):
    folder = folder_of(tmp_path, ["b10.png", "b2.png", "a.bmp", "b1.PNG"])
    (folder / "notes.txt").write_text("no image")
    assert [path.name for path in list_images(folder)] == ["a.bmp", "b1.PNG", "b2.png", "b10.png"]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="no images"):
        list_images(empty)
    with pytest.raises(InputError, match="expected a folder with images, got a file"):
        list_images(folder / "a.bmp")
    with pytest.raises(InputError, match="expected a folder with images, got nothing of this name"):
        list_images(tmp_path / "none")


def test_without_names_image_k_is_of_reading_k_if_there_are_as_many(tmp_path):
    images = list_images(folder_of(tmp_path, ["1.png", "2.png"]))
    found, said = images_of_readings(None, images, 2)
    assert found == images
    assert said == "Image k is that of reading k, in the order of their names: 1.png to 2.png."
    with pytest.raises(InputError, match=r"2 images and 3 readings: .*a column note_image"):
        images_of_readings(None, images, 3)


def test_names_in_the_table_say_which_image_is_of_which_reading(tmp_path):
    images = list_images(folder_of(tmp_path, ["1.png", "2.png", "3.png"]))
    table = tmp_path / "joints.csv"
    table.write_text("q1_deg,note_image\n1,3.png\n2,\n3,C:\\run\\1.png\n4,2\n")
    found, said = images_of_readings(table, images, 4)
    assert [path and path.name for path in found] == ["3.png", None, "1.png", "2.png"]
    assert said == ""
    table.write_text("q1_deg,note_image\n1,3.png\n2,5.png\n")
    with pytest.raises(InputError, match=r"line 3, column 'note_image': there is no image '5.png' .*an empty cell"):
        images_of_readings(table, images, 2)
    table.write_text("q1_deg,note_image\n1,3.png\n2,3.png\n")
    with pytest.raises(InputError, match=r"line 3, column 'note_image': the image '3.png' stands here twice"):
        images_of_readings(table, images, 2)
