"""A board on paper: to scale."""

import json

import numpy as np
import pytest

import truearm as ta
from truearm.errors import InputError
from truearm.wings.camera.boards import parse_board
from truearm.wings.camera.detection import Detector


@pytest.mark.parametrize("text", ["charuco:8x11,15mm,11mm", "aprilgrid:4x3,40mm,12mm", "chessboard:9x6,25mm"])
def test_the_print_has_the_size_that_it_states(text, tmp_path):
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 is not installed")
    sheet = ta.draw_board(text)
    sheet.save(tmp_path / "board.pdf")
    document = pdfium.PdfDocument(tmp_path / "board.pdf")
    page = document[0]
    np.testing.assert_allclose(np.array(page.get_size()) / 72 * 25.4, [sheet.width_mm, sheet.height_mm], atol=1e-3)
    picture = page.render(scale=6 * 25.4 / 72, grayscale=True).to_numpy()
    px_per_mm = np.array(picture.shape)[::-1] / [sheet.width_mm, sheet.height_mm]  # 6, but for whole pixels
    page.close()
    document.close()
    board = parse_board(text)
    found = Detector(board).find(np.ascontiguousarray(picture))
    assert len(found) == len(board)
    apart = [np.linalg.norm(np.diff(part, axis=0), axis=1) for part in (board.points, found.pixels / px_per_mm)]
    np.testing.assert_allclose(*apart, atol=0.015, rtol=2e-4)  # mm: 0.1 px, and whole pixels of the page


def test_the_smallest_paper_is_taken_and_the_rulers_are_whole_centimetres():
    assert ta.draw_board("chessboard:9x6,25mm").paper == "a4"
    assert ta.draw_board("chessboard:9x6,30mm").paper == "a3"
    sheet = ta.draw_board("chessboard:9x6,25mm", paper="a3")
    assert (sheet.width_mm, sheet.height_mm, sheet.rulers_mm) == (420.0, 297.0, (250, 170))
    with pytest.raises(InputError, match="too large for A4"):
        ta.draw_board("chessboard:9x6,30mm", paper="a4")
    with pytest.raises(InputError, match="out of a4, a3"):
        ta.draw_board("chessboard:9x6,30mm", paper="b5")


def test_the_same_board_gives_the_same_bytes(tmp_path):
    for name in ("a.pdf", "b.pdf"):
        ta.draw_board("chessboard:5x4,20mm").save(tmp_path / name)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
    with pytest.raises(InputError, match=r"ends in \.pdf"):
        ta.draw_board("chessboard:5x4,20mm").save(tmp_path / "a.png")


def test_the_command_writes_the_sheet_and_says_how_to_check_it(truearm, tmp_path):
    out = tmp_path / "board.pdf"
    ran = truearm("board", "chessboard:9x6,25mm", "--out", out).done()
    assert "Print it at 100 %" in ran.out
    assert out.read_bytes().startswith(b"%PDF")
    ran = truearm("board", "chessboard:9x6,25mm", "--out", out, "--json").done()
    assert json.loads(ran.out)["rulers_mm"] == [250, 170]
