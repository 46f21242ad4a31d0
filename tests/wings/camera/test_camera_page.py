"""The page of the camera: its tables are read, and its commands print what it shows."""

import contextlib
from pathlib import Path

import pytest

from page_transcripts import block, blocks, check_printed, commands
from truearm.wings.camera.observations import read_pixels


def test_the_table_of_the_page_is_read(tmp_path):
    (tmp_path / "pixels.csv").write_text(block("camera.md", "csv pixels"), encoding="utf-8")
    read = read_pixels(tmp_path / "pixels.csv")
    assert (len(read), read.images) == (2, ("image_01.png",))


@pytest.mark.weekly
def test_the_commands_of_the_page_print_what_it_shows(truearm, tmp_path):
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    with contextlib.chdir(tmp_path):
        for text in blocks("camera.md", "console"):
            for (_, *arguments), shown in commands(text):
                check_printed(shown, truearm(*arguments).done().out.splitlines())
        assert Path("corners.html").stat().st_size < 3_000_000
