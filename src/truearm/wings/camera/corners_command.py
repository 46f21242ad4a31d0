"""``truearm corners``: corners of a board in images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress

BOARD = Option("--board", help="The board, as charuco:8x11,15mm,11mm; see truearm board.")
CAMERA = Option("--camera", help="The camera's intrinsics: camera_info of ROS, .yaml.")
BoardOption = Annotated[str, BOARD]
CameraOption = Annotated[Path | None, CAMERA]


@options.of_verb("truearm.wings.camera.find_corners:find_corners", omit=("progress",))
def corners(
    verb: Any,
    session: options.SessionFile,
    images: Annotated[Path, Argument(metavar="IMAGES", help="Folder with an image for each reading.")],
    board: BoardOption,
    out: Annotated[Path, Option(help="Table of pixels to write, .csv.")],
    camera: CameraOption = None,
    page: options.Page = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Find the corners of a board in images, for a fit.

    SESSION has the joint angles, a row for each image. Its column note_image has the names of the images; without it,
    image k in the order of their names belongs to row k. --page shows every image with its corners and residuals.

    The table is that of reading, image, camera, board, corner, u_px, v_px; other detectors may write it too.
    Of several cameras and boards --camera-name and --board NAME=TEXT give the names there.
    """
    from truearm.wings.camera.find_corners import check_corners_output
    from truearm.wings.camera.image_files import list_images

    check_corners_output(out, page, session, camera)
    with progress(f"finding corners in {images.name}", len(list_images(images))) as step:
        found = verb(session, images, board=board, camera=camera, progress=step, **given)
    found.save(out)
    if page is not None:
        found.save_page(page)
    print_record(found, as_json=as_json, files={"pixels": out, "page": page})
