"""``truearm fit-images``: identify an arm and its camera from corners in images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_model_output, check_new_output
from truearm.wings.camera.corners_command import BOARD, CAMERA


@options.of_verb("truearm.wings.camera.fit_images:fit_images", called={"u_camera_px": "--u-camera"})
def fit_images(
    verb: Any,
    session: Annotated[Path, Argument(metavar="SESSION", help="Session file with the joints of every image.")],
    pixels: Annotated[
        list[Path], Argument(metavar="PIXELS", help="Corners in the images: reading, corner, u_px, v_px.")
    ],
    arm: Annotated[str, Option("--arm", help=f"Nominal arm. {options.ARM_HELP}")],
    board: Annotated[list[str], BOARD],
    out: options.ModelOut,
    camera: Annotated[list[Path] | None, CAMERA] = None,
    eye_in_hand: Annotated[
        bool,
        Option(
            "--eye-in-hand",
            help="The camera is on the flange and the board stands. By default the camera stands and the board is on "
            "the flange.",
        ),
    ] = False,
    on_flange: Annotated[
        list[str] | None, Option("--on-flange", metavar="NAME", help="Name of a camera on the flange; others stand.")
    ] = None,
    camera_out: Annotated[
        Path | None, Option("--camera-out", help="File to write with the intrinsics found, .yaml.")
    ] = None,
    test: Annotated[
        tuple[Path, Path] | None,
        Option("--test-images", metavar="SESSION PIXELS", help="Other images, at poses that are not in the fit."),
    ] = None,
    model: options.ModelOption = "auto",
    force: options.Force = False,
    details: Annotated[
        bool, Option("--details", help="Print groups of terms, what is not identifiable, and terms not offered too.")
    ] = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Identify an arm and its cameras from images.

    The boards are identified with them.

    The camera stands beside the robot and the board is on its flange, or with --eye-in-hand the camera is on the flange
    and the board stands. PIXELS has a row for each corner: reading (the row of SESSION, counted from 1), corner,
    u_px, v_px. There may be several such tables, of several cameras and boards, which they then name: --board and
    --camera are stated for each, as NAME=TEXT.

    The intrinsics are found with the arm; --camera states them, --u-camera 2 how well they are known [px], and
    --u-camera 0 keeps them. The board's size is known to 0.2 %, as printers print; u=0.05% behind the board states
    another uncertainty.
    """
    from truearm.wings.camera.cell_images import by_name
    from truearm.wings.camera.observations import camera_files

    boards, lenses = by_name(board), by_name([str(one) for one in camera or ()])
    given["eye_in_hand"] = on_flange or eye_in_hand
    files = session, *pixels, *map(Path, lenses.values()), given["lengths"], *(test or ())
    check_model_output(out, None, *files, force=force)
    outputs: dict[str, Path] = {}
    if camera_out is not None:
        check_new_output(camera_out, *files, out, force=force, endings=(".yaml",))
        outputs = camera_files(camera_out, pixels, lenses)
        for path in outputs.values():
            check_new_output(path, *files, out, force=force)
    with progress("fitting images", total=4 if model == "auto" else None) as report:
        given |= {"board": boards, "camera": lenses or None, "test": test, "model": model}
        result = verb(arm, session, pixels, **given, progress=report)
        check_model_output(out, result.fitted.model.arm_, force=force)
        result.fitted.save(out)
        if outputs:
            result.save_cameras(outputs)
    print_record(result, as_json=as_json, files={"model": out, **outputs}, details=details)
