"""``truearm board``: a board as a PDF to scale."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record
from truearm.verbs.outputs import check_output


@options.of_verb("truearm.wings.camera.sheets:draw_board")
def board(
    verb: Any,
    board: Annotated[str, Argument(metavar="BOARD", help="Its text, as charuco:8x11,15mm,11mm.")],
    out: Annotated[Path, Option(help="Sheet to write, .pdf.")],
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Write a board to print, for a camera.

    charuco:8x11,15mm,11mm is a ChArUco board of 8 x 11 squares of 15 mm with markers of 11 mm; chessboard:9x6,25mm a
    chessboard with 9 x 6 inner corners; aprilgrid:6x6,24mm,7.2mm an AprilTag grid with the gap between the tags. Behind
    the lengths may stand a dictionary (5x5_100), legacy (OpenCV before 4.6), and u=0.05%, what is known of the size.

    A ChArUco board may be seen in part, and it cannot be taken for itself half-turned: it is the first choice.
    """
    check_output(out, endings=(".pdf",))
    sheet = verb(board, **given)
    sheet.save(out)
    print_record(sheet, as_json=as_json, files={"board": out})
