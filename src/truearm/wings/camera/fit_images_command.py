"""``truearm fit-images``: identify an arm and its camera from corners in images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_model_output, check_new_output
from truearm.wings.camera.corners_command import BoardOption, CameraOption


@options.of_verb("truearm.wings.camera.fit_images:fit_images", called={"u_camera_px": "--u-camera"})
def fit_images(
    verb: Any,
    session: Annotated[Path, Argument(metavar="SESSION", help="Session file with the joints of every image.")],
    pixels: Annotated[Path, Argument(metavar="PIXELS", help="Corners in the images: reading, corner, u_px, v_px.")],
    arm: Annotated[str, Option("--arm", help=f"Nominal arm. {options.ARM_HELP}")],
    board: BoardOption,
    out: options.ModelOut,
    camera: CameraOption = None,
    camera_out: Annotated[
        Path | None, Option("--camera-out", help="File to write with the intrinsics found, .yaml.")
    ] = None,
    model: options.ModelOption = "auto",
    force: options.Force = False,
    details: Annotated[
        bool, Option("--details", help="Print groups of terms, what is not identifiable, and terms not offered too.")
    ] = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Identify an arm and its camera from images.

    The board is identified with them.

    The camera stands beside the robot and the board is on its flange, or with --eye-in-hand the camera is on the flange
    and the board stands. PIXELS has a row for each corner: reading (the row of SESSION, counted from 1), corner,
    u_px, v_px.

    The intrinsics are found with the arm; --camera states them, --u-camera 2 how well they are known [px], and
    --u-camera 0 keeps them. The board's size is known to 0.2 %, as printers print; u=0.05% behind the board states
    another uncertainty.
    """
    from truearm.wings.camera.observations import check_size_is_known

    files = session, pixels, camera, given["lengths"]
    check_model_output(out, None, *files, force=force)
    if camera_out is not None:
        check_new_output(camera_out, *files, out, force=force, endings=(".yaml",))
        if camera is None:
            check_size_is_known(pixels)
    with progress("fitting images", total=4 if model == "auto" else None) as report:
        result = verb(arm, session, pixels, board=board, camera=camera, model=model, **given, progress=report)
        check_model_output(out, result.fitted.model.arm_, force=force)
        result.fitted.save(out)
        if camera_out is not None:
            result.save_camera(camera_out)
    print_record(result, as_json=as_json, files={"model": out, "camera": camera_out}, details=details)
