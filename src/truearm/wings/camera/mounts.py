"""Where the camera and the board are: in the base and on the flange of an arm, with uncertainty.

The frames are those of the arm's description, as its URDF has them. Of an identified arm the base is the frame in which
the axis and the zero of joint 1 are nominal, and the flange the one in which those of the last joint are: no reading
shows another base or flange (`truearm.identification.terms.constants` calls these motions equivalent).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.acceptance import accepted
from truearm.arm import Arm, Chain
from truearm.arm.rigid_motions import cross_matrix, inverse, motion, xyz_rpy_from_frame
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.findings import Finding, format_mm, in_order
from truearm.identification.judgement.description_check import explain_readings
from truearm.models import IdentifiedModel
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.verbs.fit import FitResult
from truearm.verbs.record import Record, TextTable, format_fixed, number_of
from truearm.wings.camera import TransformFormat
from truearm.wings.camera.closed_form import HandEyeAlone
from truearm.wings.camera.interpretation import IS_FIXED, MEASURE, PAIRED, Interpretation, Remedies

# Standard uncertainties of a difference quotient.
STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Transform:
    """Where a frame is in another one, with its uncertainty.

    Attributes
    ----------
    child, parent : str
        ``camera`` in ``base``.
    T_parent_child : (4, 4) array
        Translation in mm.
    covariance : (6, 6) array
        Of the position [mm], then of a rotation [rad], along the axes of the parent.
    """

    child: str
    parent: str
    T_parent_child: FloatArray
    covariance: FloatArray

    def inverted(self) -> Transform:
        """The parent in the child."""
        back = inverse(self.T_parent_child)
        R, K = back[:3, :3], cross_matrix(self.T_parent_child[:3, 3])
        by = -np.block([[R, R @ K], [np.zeros((3, 3)), R]])
        return Transform(self.parent, self.child, back, by @ self.covariance @ by.T)

    @property
    def position_mm(self) -> FloatArray:
        """(3,) position of the child's origin."""
        return np.asarray(self.T_parent_child[:3, 3])

    @property
    def quaternion_xyzw(self) -> FloatArray:
        """(4,) unit quaternion x, y, z, w with w of zero or more."""
        return np.asarray(Rotation.from_matrix(self.T_parent_child[:3, :3]).as_quat(canonical=True))

    @property
    def rpy_deg(self) -> FloatArray:
        """(3,) roll, pitch, yaw about the fixed axes x, y, z, as URDF has them."""
        return np.degrees(xyz_rpy_from_frame(self.T_parent_child)[1])

    @property
    def U_mm(self) -> float:
        """Expanded uncertainty (k = 2) of the position in the direction in which it is largest."""
        return float(2 * np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1].clip(0)))

    @property
    def U_deg(self) -> float:
        """Expanded uncertainty (k = 2) of the orientation about the axis about which it is largest."""
        return float(np.degrees(2 * np.sqrt(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1].clip(0))))

    def cells(self) -> tuple[str, ...]:
        """Cells of a table: child, parent, position, roll, pitch, yaw and both uncertainties."""
        position = (format_fixed(x, 2) for x in self.position_mm)
        turned = (format_fixed(angle, 3) for angle in self.rpy_deg)
        return (self.child, self.parent, *position, *turned, f"{self.U_mm:.2g}", f"{self.U_deg:.2g}")

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "child": self.child,
            "parent": self.parent,
            "position_mm": self.position_mm,
            "quaternion_xyzw": self.quaternion_xyzw,
            "rpy_deg": self.rpy_deg,
            "matrix_mm": self.T_parent_child,
            "U_mm": self.U_mm,
            "U_deg": self.U_deg,
            "u_position_mm": np.sqrt(np.diag(self.covariance)[:3]),
            "u_rotation_deg": np.degrees(np.sqrt(np.diag(self.covariance)[3:])),
        }


def explained(error: InputError, arm: Arm, angles: FloatArray, moved: FloatArray) -> InputError:
    """What robot and camera contradict each other by, with what is wrong of arm or joints, if that is it, as a remedy.

    By the poses (n, 4, 4) of what moves: of the board in the camera, or of a camera on the flange in the board.
    """
    hint = error.hint or ""
    if not hint.startswith((PAIRED, IS_FIXED, MEASURE)):
        return error
    remedy = explain_readings(arm, Session(angles, moved[:, :3, 3]))
    if remedy is None or (hint.startswith(MEASURE) and "the arm is" not in remedy):  # a size has units of its own
        return error
    return error.with_hint(f"{remedy.partition('; `truearm arms`')[0]})")


@contextmanager
def of_boards(remedies: Remedies) -> Iterator[None]:
    """Where a fit finds that all lengths of the arm are wrong alike, that is the size of the boards."""
    try:
        yield
    except InputError as error:
        larger = _AS_DRAWN.search(error.hint or "")
        if larger is None:
            raise
        size = f"{1 / float(larger[1]):.4g}"
        of_arm = error.problem.partition(": no arm is made so")[0]
        problem = f"the board is {size} times {remedies.size_of}, or the arm is another one: {of_arm}"
        hint = f"{remedies.sized.format(size=size)}; the focus must be fixed, and not change with the distance"
        raise type(error)(problem, file=error.file, hint=hint) from None


_AS_DRAWN = re.compile(r"divided by ([\d.]+) it fits the drawing")


def of_cell(findings: Iterable[Finding], standing: str, carried: str, apart: str | None = None) -> Iterator[Finding]:
    """Findings of a fit with what stands, camera or board, and what the flange carries in place of reference and tip.

    A focal length that changes moves all boards along the axis of the camera, as a camera does that moves. `apart` is
    what to do about a change in place of what a session file needs.
    """
    names = {"base or the reference": f"base or the {standing}", "tip": f"{carried} on the flange"}
    for one in findings:
        said = one.sentence
        if one.what == "change":
            for here, there in names.items():
                said = said.replace(f"he {here}", f"he {there}{' (or its focus)' * ('camera' in there)}")
            if apart and (advice := said.find(" Enter one name")) > 0:
                said = f"{said[:advice]} {apart[0].upper()}{apart[1:]}."
        yield replace(one, sentence=said)


def with_all_accepted(result: FitResult) -> FitResult:
    """A fit says what it accepted itself; before and after it was more."""
    found = accepted(result.model.accepted_)
    if not found:
        return result
    result.model.accepted_ = found
    said = (Finding("acceptance", str(one)) for one in found)
    return replace(result, findings=in_order((*said, *(one for one in result.findings if one.what != "acceptance"))))


def mounts(chain: Chain, nominal: Chain) -> tuple[FloatArray, FloatArray]:
    """``T_base_reference`` and ``T_flange_tip`` of an identified chain, (4, 4) each, in the axes of the nominal arm."""
    last = chain.n_joints
    start, end = chain.fixed[0], inverse(nominal.fixed[-1]) @ chain.fixed[-1]
    if last > 1:
        first = chain.fixed[1] @ inverse(nominal.fixed[1])  # the motion at joint 1: about its axis it is the base's
        turn = Rotation.from_matrix(first[:3, :3]).as_rotvec()
        start = start @ motion(Rotation.from_rotvec([0, 0, turn[2]]).as_matrix(), np.array([0, 0, first[2, 3]]))
    if last > 2:
        before = chain.fixed[last - 1] @ inverse(nominal.fixed[last - 1])
        along = float(before[:3, 3] @ nominal.fixed[last - 1, :3, 2])  # along the last joint's axis it is the flange's
        end = inverse(nominal.fixed[-1]) @ motion(np.eye(3), np.array([0, 0, along])) @ chain.fixed[-1]
    T_flange_tip = end @ motion(np.eye(3), chain.tip_in_flange)
    return inverse(start @ inverse(nominal.fixed[0])), T_flange_tip


def small_motion(T: FloatArray, T0: FloatArray) -> FloatArray:
    """(6,) by how much T differs from T0: translation [mm], rotation [rad], along the axes of their parent."""
    turn = Rotation.from_matrix(T[:3, :3] @ T0[:3, :3].T).as_rotvec()
    return np.concatenate([T[:3, 3] - T0[:3, 3], turn])


def where_it_stands(model: IdentifiedModel, name: str) -> Transform:
    """What stands, a camera or a board, in the base: the frame of the readings of the session of that name."""
    nominal, frame = model.arm_.chain, model.session_frames_.get(name, np.eye(4))
    return _transform(model, name, "base", lambda chain: mounts(chain, nominal)[0] @ frame)


def where_it_is_carried(model: IdentifiedModel, name: str, T_child_tip: FloatArray) -> Transform:
    """What the flange carries, a board or a camera, by the tip of that name in its frame (4, 4) [mm]."""
    nominal, back = model.arm_.chain, inverse(T_child_tip)
    return _transform(model, name, "flange", lambda chain: mounts(chain, nominal)[1] @ back)


def of_model(model: IdentifiedModel, *, eye_in_hand: bool, centre: FloatArray) -> tuple[Transform, Transform]:
    """The camera and the board of a model of one of each.

    Parameters
    ----------
    model : IdentifiedModel
        Fitted to the board in the camera or, where the camera is on the flange, to a point of it in the board.
    eye_in_hand : bool
    centre : (3,) array
        Of the camera on the flange: that point in its frame [mm].
    """
    standing, carried = ("board", "camera") if eye_in_hand else ("camera", "board")
    found = where_it_stands(model, standing), where_it_is_carried(model, carried, motion(np.eye(3), centre))
    return found[::-1] if eye_in_hand else found


def _transform(model: IdentifiedModel, child: str, parent: str, of: Callable[[Chain], FloatArray]) -> Transform:
    """A motion that depends on the constants of a model where a session or a tip is the child, to first order."""
    chain, covariance, x = model.fit_.perturbed_chain, model.fit_.covariance, model.fit_.coefficients
    which = chain.constants_of(child, child)
    moves = np.flatnonzero(which)
    T, std = of(chain.with_constants(x, which)), np.sqrt(np.diag(covariance)[moves])
    changes = np.zeros((len(moves), 6))
    for change, i, one in zip(changes, moves.tolist(), std.tolist(), strict=True):
        if one > 0:
            moved = x.copy()
            moved[i] += STEP * one
            change[:] = small_motion(of(chain.with_constants(moved, which)), T) / STEP
    alike = covariance[np.ix_(moves, moves)] / np.maximum(np.outer(std, std), np.finfo(float).tiny)
    return Transform(child, parent, T, changes.T @ alike @ changes)


def of_alone(alone: HandEyeAlone, *, eye_in_hand: bool) -> tuple[Transform, Transform]:
    """Camera and board by hand-eye alone."""
    base, flange = ("flange", "base") if eye_in_hand else ("base", "flange")
    camera = Transform(base, "camera", alone.X, alone.covariance[:6, :6]).inverted()
    return camera, Transform("board", flange, alone.Y, alone.covariance[6:, 6:])


# Frames of ROS: base and flange of the arm, camera. That of the board is no name of a robot.
FRAMES = ("base_link", "tool0", "camera_optical_frame")
BOARD = "board"


def write_transforms(
    path: str | Path, camera: Transform, board: Transform, *, format: TransformFormat, frames: Sequence[str] = FRAMES
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
    return {name: format_fixed(x, 9) for name, x in where}, {name: format_fixed(x, 9) for name, x in turned}


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
        yield f"  U_position_m: {format_fixed(one.U_mm / 1000, 9)}"
        yield f"  U_orientation_deg: {one.U_deg:.3g}"


def _as_yaml(one: Transform) -> Iterator[str]:
    for name, numbers in zip(("translation", "rotation"), _numbers(one), strict=True):
        yield f"  {name}:"
        for axis, x in numbers.items():
            yield f"    {axis}: {x}"


@dataclass(frozen=True, eq=False, repr=False)
class CameraAndBoard(Record):
    """Where the camera and the board are, with uncertainty, and the identified arm.

    Attributes
    ----------
    camera, board : Transform
        The camera in the base and the board in the flange; where the camera is on the flange, the camera in the flange
        and the board in the base.
    eye_in_hand : bool
    n_images, n_used : int
        Images that were given, and without those that contradict the others.
    turn_deg : float
        Root mean square difference between the turns of robot and camera.
    alone_mm : float
        Mean distance of a board from where the other images put it, on the arm as its controller has it.
    fitted : FitResult or None
        The identified arm; None without joints.
    findings : tuple of Finding
    """

    camera: Transform
    board: Transform
    eye_in_hand: bool
    n_images: int
    n_used: int
    turn_deg: float
    alone_mm: float
    fitted: FitResult | None
    findings: tuple[Finding, ...]

    @property
    def held_out_mm(self) -> tuple[float, float]:
        """Mean error of the board's position on held-out images: with the arm as it is, and with it identified."""
        found = None if self.fitted is None else self.fitted.held_out_mm
        return (self.alone_mm, self.alone_mm) if found is None else (found[1], found[0])

    @property
    def transforms(self) -> tuple[Transform, ...]:
        """Camera and board, and both the other way round."""
        return (self.camera, self.board, self.camera.inverted(), self.board.inverted())

    def summary(self) -> str:
        """The answer in one sentence."""
        one = self.camera
        return (
            f"The camera in the {one.parent} is known to {format_mm(one.U_mm)} and {one.U_deg:.2g} deg (U, k = 2), "
            f"from {number_of(self.n_used, 'image')}."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        alone, identified = self.held_out_mm
        is_nominal = self.fitted is None or self.fitted.model_name == "nominal"
        with_arm = "" if is_nominal else f", with the arm identified {format_mm(identified)}"
        yield f"Hand-eye alone leaves {format_mm(alone)} of the board's position on held-out images (mean){with_arm}."
        yield from map(str, self.findings)
        yield TextTable(
            ("frame", "in", "x mm", "y mm", "z mm", "roll deg", "pitch deg", "yaw deg", "U mm", "U deg"),
            [one.cells() for one in self.transforms],
            left_aligned=(0, 1),
        )
        yield TextTable(
            ("frame", "in", "qx", "qy", "qz", "qw"),
            [(one.child, one.parent, *(format_fixed(q, 6) for q in one.quaternion_xyzw)) for one in self.transforms],
            left_aligned=(0, 1),
        )
        if np.isfinite(self.turn_deg):
            yield f"The turns of robot and camera agree to {self.turn_deg:.2g} deg."

    def details(self) -> Iterator[str | TextTable]:
        """See `Record.details`."""
        if self.fitted is not None:
            yield from self.fitted.blocks()

    def _json(self) -> dict[str, Any]:
        alone, identified = self.held_out_mm
        return {
            **self._named("eye_in_hand", "n_images", "n_used", "turn_deg"),
            "transforms": [one.to_dict() for one in self.transforms],
            "held_out": {"hand_eye_alone_mm": alone, "arm_identified_mm": identified},
            "findings": [str(one) for one in self.findings],
            "fit": None if self.fitted is None else self.fitted.to_dict(),
        }


@dataclass(frozen=True, eq=False, repr=False)
class HandEyeByImages(CameraAndBoard):
    """Where the camera and the board are by poses of the board, image by image.

    Attributes
    ----------
    names : tuple of str
        What the images are called.
    interpretation : Interpretation
        What the poses mean, and how far robot and camera turn alike.
    alone : HandEyeAlone
        Hand-eye on the arm as its controller has it, by the images of the interpretation.
    readings : Session or None
        The images that were used as readings of the arm's tip.
    files : tuple of Path
        Those that were read.
    """

    names: tuple[str, ...] = field(kw_only=True)
    interpretation: Interpretation = field(kw_only=True)
    alone: HandEyeAlone = field(kw_only=True)
    readings: Session | None = field(kw_only=True)
    files: tuple[Path, ...] = field(kw_only=True)
