"""Transforms as files of other programs: a static transform of ROS, a calibration of easy_handeye, plain YAML."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.wings.camera import TransformFormat
from truearm.wings.camera.mounts import Transform

# Frames of ROS: base and flange of the arm, camera. That of the board is no name of a robot.
FRAMES = ("base_link", "tool0", "camera_optical_frame")
BOARD = "board"


def write_transforms(
    path: str | Path,
    camera: Transform,
    board: Transform,
    *,
    format: TransformFormat,
    frames: Sequence[str] = FRAMES,
) -> None:
    """Write where the camera is, in m, and in plain YAML the board too.

    Parameters
    ----------
    path : path
        It appears whole or not at all.
    camera, board : Transform
    format : {"ros-transform", "easy-handeye", "yaml"}
        A command line that publishes the transform, a calibration that easy_handeye2 publishes, or plain YAML.
    frames : three str
        Names of base, flange and camera.

    Raises
    ------
    InputError
        If the names are not three words.
    """
    if len(frames) != 3 or not all(name and name.isprintable() and not set(name) & set(" :#'\"\\") for name in frames):
        raise InputError(f"expected names of base, flange and camera, got {frames!r}", hint=",".join(FRAMES))
    names = {"base": frames[0], "flange": frames[1], "camera": frames[2], "board": BOARD}
    written = {"ros-transform": _ros, "easy-handeye": _easy_handeye, "yaml": _yaml}[format]
    with atomic_file(path) as beside:
        beside.write_text("\n".join(written(camera, board, names)) + "\n", encoding="utf-8")


def _numbers(one: Transform) -> tuple[dict[str, str], dict[str, str]]:
    """Position [m] and quaternion by their names."""
    where = zip("xyz", one.position_mm / 1000, strict=True)
    turned = zip("xyzw", one.quaternion_xyzw, strict=True)
    return {name: _number(x) for name, x in where}, {name: _number(x) for name, x in turned}


def _number(x: float) -> str:
    text = f"{x:.9f}"
    return text.lstrip("-") if not text.strip("-0.") else text


def _origin(one: Transform) -> str:
    return f"truearm hand-eye: U (k = 2) {one.U_mm:.2g} mm, {one.U_deg:.2g} deg"


def _ros(camera: Transform, board: Transform, names: dict[str, str]) -> Iterator[str]:
    del board
    where, turned = _numbers(camera)
    position = " ".join(f"--{name} {x}" for name, x in where.items())
    quaternion = " ".join(f"--q{name} {x}" for name, x in turned.items())
    yield f"# {_origin(camera)}"
    yield (
        f"ros2 run tf2_ros static_transform_publisher {position} {quaternion} "
        f"--frame-id {names[camera.parent]} --child-frame-id {names['camera']}"
    )


def _easy_handeye(camera: Transform, board: Transform, names: dict[str, str]) -> Iterator[str]:
    del board
    yield f"# {_origin(camera)}"
    yield "parameters:"
    yield "  name: truearm"
    yield f"  calibration_type: {'eye_in_hand' if camera.parent == 'flange' else 'eye_on_base'}"
    yield f"  robot_base_frame: {names['base']}"
    yield f"  robot_effector_frame: {names['flange']}"
    yield f"  tracking_base_frame: {names['camera']}"
    yield f"  tracking_marker_frame: {names['board']}"
    yield "  freehand_robot_movement: true"
    yield "  move_group_namespace: /"
    yield "  move_group: manipulator"
    yield "transform:"
    yield from _as_yaml(camera)


def _yaml(camera: Transform, board: Transform, names: dict[str, str]) -> Iterator[str]:
    yield "# Lengths in m, quaternions x, y, z, w; U is for k = 2."
    yield "transforms:"
    for one in (camera, board, camera.inverted(), board.inverted()):
        yield f"- frame_id: {names[one.parent]}"
        yield f"  child_frame_id: {names[one.child]}"
        yield from _as_yaml(one)
        yield f"  U_position_m: {_number(one.U_mm / 1000)}"
        yield f"  U_orientation_deg: {one.U_deg:.3g}"


def _as_yaml(one: Transform) -> Iterator[str]:
    for name, numbers in zip(("translation", "rotation"), _numbers(one), strict=True):
        yield f"  {name}:"
        for axis, x in numbers.items():
            yield f"    {axis}: {x}"
