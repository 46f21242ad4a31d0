"""``truearm plan-images``: which images to take."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_new_output
from truearm.wings.camera.corners_command import CameraOption


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
