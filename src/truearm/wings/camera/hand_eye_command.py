"""``truearm hand-eye``: where the camera and the board are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_model_output, check_new_output
from truearm.wings.camera import TransformFormat


@options.of_verb("truearm.wings.camera.hand_eye:hand_eye")
def hand_eye(
    verb: Any,
    samples: Annotated[
        Path, Argument(metavar="SAMPLES", help="Poses of the board, and joints or flange poses: table, .yaml, .json.")
    ],
    robot: Annotated[
        Path | None,
        Argument(metavar="ROBOT", help="Joints or flange poses, if SAMPLES has none.", show_default=False),
    ] = None,
    arm: options.ArmOption = None,
    out: Annotated[Path | None, Option(help="File of the transform to write, in the format --as.")] = None,
    format: Annotated[TransformFormat | None, Option("--as", help="Format of --out.", show_default=False)] = None,
    frame_names: Annotated[
        str, Option(metavar="BASE,FLANGE,CAMERA", help="Names of the frames in --out.")
    ] = "base_link,tool0,camera_optical_frame",
    out_model: Annotated[
        Path | None, Option(help="Where a model fitted to the readings is saved; replaces one of the same arm.")
    ] = None,
    model: options.ModelOption = "kinematic",
    page: options.Page = None,
    force: options.Force = False,
    details: Annotated[
        bool, Option("--details", help="Print groups of terms, what is not identifiable, and terms not offered too.")
    ] = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Find where the camera and the board are.

    The camera stands and sees a board on the flange or, with --eye-in-hand, is on the flange and sees a board that
    stands. SAMPLES is a table with a row for each image, samples of easy_handeye, pairs of MoveIt or arrays of OpenCV;
    docs/hand-eye.md has all columns and conventions. With joints (q1_deg ..) and --arm the arm is identified; with
    poses of the flange it stays as the controller has it.

    First robot and camera are compared by how far they turn from image to image: this names images of other poses,
    boards seen half turned and rotations in another order before anything is fitted. Then come the size of the board,
    a closed form, and a fit of the arm with both mounts. --page shows the cell, the turns and every image.
    """
    from truearm.arm.catalogue import arm_path
    from truearm.pages.drawings.page_record import check_page_path
    from truearm.wings.camera.transform_files import write_transforms

    if (out is None) != (format is None):
        raise InputError("--out and --as belong together", hint="--out camera.yaml --as easy-handeye")
    files = samples, robot, None if arm is None else arm_path(arm)
    if out is not None:
        check_new_output(out, *files, force=force)
    if out_model is not None:
        check_model_output(out_model, None, *files, force=force)
    check_page_path(page, *files)
    with progress(f"hand-eye of {samples.name}") as report:
        result = verb(samples, robot, arm=arm, model=model, **given, progress=report)
        if out_model is not None:
            if result.fitted is None:
                hint = "give the joints of the images, and --arm"
                raise InputError("without joints there is no model to write", file=out_model, hint=hint)
            check_model_output(out_model, result.fitted.model.arm_, force=force)
            result.fitted.save(out_model)
        if out is not None:
            write_transforms(out, result.camera, result.board, format=format, frames=frame_names.split(","))  # type: ignore[arg-type]
        if page is not None:
            result.save_page(page)
    written = {"transform": out, "model": out_model, "page": page}
    print_record(result, as_json=as_json, files=written, details=details)
