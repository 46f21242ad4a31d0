"""The commands of cameras: board, plan-images, corners, fit-images and hand-eye."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.commands import check_table, with_arm_file
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_model_output, check_new_output, check_output
from truearm.wings.camera import TransformFormat

BOARD = Option("--board", help="The board, as charuco:8x11,15mm,11mm; see truearm board.")
CAMERA = Option("--camera", help="The camera's intrinsics: camera_info of ROS, .yaml.")
BoardOption = Annotated[str, BOARD]
CameraOption = Annotated[Path | None, CAMERA]


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


@options.of_verb(
    "truearm.wings.camera.plan_images:plan_images", called={"distance_mm": "--distance"}, within={"poses": (6, 300)}
)
def plan_images(
    verb: Any,
    arm: options.ArmArgument,
    out: Annotated[Path, Option(help="Session file to fill in, .csv.")],
    board: Annotated[str | None, Option(help="The board, as charuco:8x11,15mm,11mm; see truearm board.")] = None,
    camera: CameraOption = None,
    start: Annotated[
        str | None,
        Option(metavar="Q1,Q2,..", help="Joints at which the board is in the middle of the image [deg, mm]."),
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Plan the images that determine an arm and its camera best.

    The result is a session file with the joint angles to aim at in columns of notes. Drive to them, take an image of
    each, fill in the joints as the controller shows them, and give the file to truearm corners and truearm fit-images.
    Without --camera images have 1280 x 1024 px and 49 deg from side to side.
    """
    from truearm.arm.catalogue import arm_path
    from truearm.verbs.inputs import to_arm

    check_new_output(out, arm_path(arm), camera, force=force, endings=(".csv",))
    nominal = to_arm(arm)
    if start is not None:
        shown = ",".join(f"{value:.0f}" for value in nominal.working)
        typed = options.numbers_of(start, "--start", shown)
        slides = [*nominal.chain.is_prismatic.tolist(), *[False] * len(typed)]
        given["start"] = [value if slide else radians(value) for value, slide in zip(typed, slides, strict=False)]
    with progress("planning"):
        planned = verb(nominal, board=board, camera=camera, **given)
    planned.save(out, force=force)
    print_record(planned, as_json=as_json, files={"session": out})


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
    apply: options.ArmOut = None,
    force: options.Force = False,
    details: options.Details = False,
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
    if apply is not None:
        check_new_output(apply, *files, out, force=force, endings=(".toml", ".urdf"))
        check_table(arm, apply)
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
        fitted, apply = with_arm_file(result.fitted, apply, out)
        result = replace(result, fitted=fitted)
    print_record(result, as_json=as_json, files={"model": out, "arm": apply, **outputs}, details=details)


@options.of_verb("truearm.wings.camera.hand_eye:hand_eye")
def hand_eye(
    verb: Any,
    samples: Annotated[
        Path, Argument(metavar="SAMPLES", help="Poses of the board, and joints or flange poses: table, .yaml, .json.")
    ],
    robot: Annotated[
        Path | None, Argument(metavar="ROBOT", help="Joints or flange poses, if SAMPLES has none.", show_default=False)
    ] = None,
    arm: options.ArmOption = None,
    out: Annotated[Path | None, Option(help="File of the transform to write, in the format --as.")] = None,
    format: Annotated[TransformFormat | None, Option("--as", help="Format of --out.", show_default=False)] = None,
    frame_names: Annotated[
        str, Option(metavar="BASE,FLANGE,CAMERA", help="Names of the frames in --out.")
    ] = "base_link,tool0,camera_optical_frame",
    out_model: options.FittedModelOut = None,
    model: options.ModelOption = "kinematic",
    page: options.Page = None,
    force: options.Force = False,
    details: options.Details = False,
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
    from truearm.wings.camera.mounts import write_transforms

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
