"""Hand-eye: where the camera and the board are, from poses of the board and of the robot; the arm with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.acceptance import acceptance_remarks, accepts, contradict
from truearm.arm import Arm
from truearm.arm.rigid_motions import cross_matrix, inverse, motion
from truearm.choices import ModelName
from truearm.errors import Contradiction, InputError
from truearm.findings import Finding, format_mm, in_order
from truearm.identification.judgement.change_point import session_changes
from truearm.models.identified_model import require_identified
from truearm.pages.drawings.page_record import PageRecord
from truearm.readings import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray
from truearm.verbs.fit import FitResult, fit
from truearm.verbs.inputs import ArmLike, to_arm
from truearm.verbs.record import format_fixed, number_of
from truearm.wings.camera.closed_form import HandEyeAlone, refined
from truearm.wings.camera.interpretation import NOT_AGAIN, OF_POSES, Interpretation, Remedies, all_together, interpret
from truearm.wings.camera.mounts import (
    HandEyeByImages,
    Transform,
    explained,
    of_alone,
    of_boards,
    of_cell,
    of_model,
    with_all_accepted,
)
from truearm.wings.camera.pose_files import Poses, Samples, Unit, checked_form, read_samples

if TYPE_CHECKING:
    from truearm.pages.page import Page

SamplesLike: TypeAlias = "npt.ArrayLike | str | Path"
Inverted = Literal["board", "robot"]

# Images from which the arm is identified, and below which its errors are not told from those of the poses.
FEWEST_TO_IDENTIFY = 10
# Of the variance of "after it" poses leave a smaller share where they tell which images come after a change.
OTHER_POSES = 0.5
# The poses of a robot are those of another frame than its flange where they differ by more.
SAME_MM, SAME_DEG = 3.0, 0.5


@one_blas_thread()
@accepts
def hand_eye(
    samples: SamplesLike,
    robot: SamplesLike | None = None,
    *,
    arm: ArmLike | None = None,
    eye_in_hand: bool | None = None,
    rotation: str | None = None,
    robot_rotation: str | None = None,
    unit: Unit | None = None,
    robot_unit: Unit | None = None,
    invert: Inverted | None = None,
    board_size: float = 1.0,
    model: ModelName = "kinematic",
    accept: str | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> HandEyeResult:
    """Find where the camera and the board are, with the arm that carries one of them.

    With the joints the arm is identified in the same fit (`fit`). With poses of the flange alone it stays as the
    controller has it.

    Parameters
    ----------
    samples : str, Path or (n, 4, 4) array
        File with the board in the camera, and joints or poses of the flange where it has them (docs/hand-eye.md); or
        the board in the camera as motions, in mm.
    robot : str, Path, (n, n_joints) or (n, 4, 4) array, optional
        File of joints or poses of the flange, in the same order; joints [rad, or mm], or the flange in the base, in mm.
    arm : Arm, str or Path, optional
        The nominal arm; joints need it.
    eye_in_hand : bool, optional
        The camera is on the flange and the board stands. By default as the file states, else the camera stands and the
        board is on the flange.
    rotation : str, optional
        Form of the board's rotations: xyzw, wxyz, matrix, rotvec:rad, an order of Euler angles as xyz:rad (fixed axes)
        or ZYX:deg (turned axes), rpy, kuka, fanuc or ur. By default as the file states, else the one in which the turns
        of robot and camera agree.
    robot_rotation : str, optional
        The same of the robot's rotations.
    unit : {"mm", "m"}, optional
        Of the board's positions, where the file does not state it.
    robot_unit : {"mm", "m"}, optional
        Of the robot's positions, where the file does not state it.
    invert : {"board", "robot"}, optional
        Whose poses are inverted: the camera in the board, the base in the flange.
    board_size : float
        True size of the board over the size with which its poses were computed.
    model : {"auto", "nominal", "kinematic", "physical", "network", "hybrid"}
        As of `fit`; the uncertainty of a nominal arm says nothing of the arm's errors.
    accept : str, optional
        Why the poses are right where they would be refused as contradicted; the reason is kept.
    progress : callable, optional
        As of `fit`.

    Returns
    -------
    HandEyeResult

    Raises
    ------
    InputError
        If the poses are too few, of different number, in no form that fits, or turn about one axis only.
    Contradiction
        If robot and camera turn differently, the camera is elsewhere, or the board has another size.

    Examples
    --------
    >>> import numpy as np
    >>> import truearm as ta
    >>> arm = ta.load_arm("ur10")
    >>> joints = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6)) + [0.0, -1.2, 1.5, 0.0, 1.2, 0.0]
    >>> pose = arm.chain.pose(joints)
    >>> flange = np.zeros((20, 4, 4))
    >>> flange[:, :3, :3], flange[:, :3, 3], flange[:, 3, 3] = pose.R_base_tip, pose.tip_in_base, 1.0
    >>> camera_base, flange_board = np.diag([1.0, -1.0, -1.0, 1.0]), np.eye(4)
    >>> camera_base[:3, 3], flange_board[:3, 3] = [100.0, 200.0, 2500.0], [10.0, 20.0, 30.0]
    >>> found = ta.hand_eye(camera_base @ flange @ flange_board, flange)
    >>> found.camera.position_mm.round(3).tolist()
    [-100.0, 200.0, 2500.0]
    """
    if not 0 < board_size < np.inf:
        raise InputError(
            f"expected a board size above zero, got {board_size}", hint="true size over stated size: 0.998"
        )
    seen, moved = _sides(samples, robot)
    known_arm, said = None if arm is None else to_arm(arm), list[str]()
    in_hand = _where(seen, moved, eye_in_hand, said)
    board = _stated(seen.board, rotation, unit)
    board = board.inverted() if invert == "board" else board
    flange = None if moved.robot is None else _stated(moved.robot, robot_rotation, robot_unit)
    if flange is not None:
        flange = flange.inverted() if moved.inverts_standing and not in_hand else flange
        flange = flange.inverted() if invert == "robot" else flange
    if moved.joints is not None:
        flange = _by_joints(moved, flange, known_arm, said)
    assert flange is not None

    def judged(flange: Poses, remedies: Remedies = OF_POSES) -> Interpretation:
        return interpret(
            flange, board, eye_in_hand=in_hand, called=seen.called, board_size=board_size, remedies=remedies
        )

    fitted, seen_from, contradiction = None, None, None
    try:
        found = judged(flange)
    except Contradiction as error:
        if known_arm is None or moved.joints is None or not board.forms:
            raise
        found = all_together(flange, board, in_hand=in_hand, board_size=board_size)
        seen_at = inverse(found.C) if in_hand else found.C
        contradiction = explained(error, known_arm, moved.joints, seen_at)
    if moved.joints is None:
        alone = refined(found.A, found.C, found.start)
        said += [*_ignored(found, alone, seen.called), *_moved_between(found, alone, in_hand, seen.called)]
        camera, mounted = _without_arm(alone, in_hand, said)
    else:
        assert known_arm is not None

        def with_arm(found: Interpretation) -> tuple[HandEyeAlone, Session, FloatArray, FitResult]:
            alone = refined(found.A, found.C, found.start)
            readings, centre = _session(found, cast(FloatArray, moved.joints), seen.lines, alone.rows, in_hand)
            kind: ModelName = "nominal" if len(readings) < FEWEST_TO_IDENTIFY and model == "kinematic" else model
            equipped = _equipped(known_arm, alone.Y, alone.X, centre, in_hand)
            with of_boards(OF_POSES):
                return alone, readings, centre, fit(equipped, readings, model=kind, accept=accept, progress=progress)

        try:
            alone, seen_from, centre, fitted = with_arm(found)
        except InputError as error:
            raise contradiction or error from None
        zeros = fitted.model.nominal_check_.identified
        if fitted.identifies_constants and zeros and zeros.zeros and (contradiction or not found.test.agree.all()):
            # Right images contradict an arm whose zeros are off: they are judged again by the zeros found. The size of
            # such an arm is judged by the fit.
            try:
                turned = _by_joints(moved, None, fitted.arm_with_zeros(), said)
                again = judged(turned, replace(OF_POSES, of_others=False))
                alone, seen_from, centre, fitted = with_arm(again)
                found, contradiction = again, None
            except InputError as error:
                said.append(NOT_AGAIN.format(error.problem))
        if contradiction is not None:
            raise contradiction
        fitted = with_all_accepted(fitted)
        said += _ignored(found, alone, seen.called)
        if fitted.model_name == "nominal" and len(seen_from) < FEWEST_TO_IDENTIFY and model == "kinematic":
            said.append(f"{len(seen_from)} images are too few to identify the arm: {FEWEST_TO_IDENTIFY} or more do.")
        identified = require_identified(fitted.model, "hand-eye needs an identified arm", hint="--model kinematic")
        camera, mounted = of_model(identified, eye_in_hand=in_hand, centre=centre)
    standing, carried = ("board", "camera") if in_hand else ("camera", "board")
    findings = (
        *(Finding("acceptance", one) for one in acceptance_remarks(accept if fitted is None else None)),
        *(Finding("hand-eye", one) for one in said),
        *(() if fitted is None else of_cell(fitted.findings, standing, carried, OF_POSES.apart)),
    )
    return HandEyeResult(
        camera=camera,
        board=mounted,
        eye_in_hand=in_hand,
        n_images=len(seen),
        n_used=int(alone.rows.sum()),
        turn_deg=found.turn_deg,
        alone_mm=float(alone.held_out_mm.mean()),
        fitted=fitted,
        findings=in_order(findings),
        names=tuple(map(seen.called, range(len(seen)))),
        interpretation=found,
        alone=alone,
        readings=seen_from,
        files=tuple(one.file for one in (seen, moved) if one.file is not None),
    )


def _ignored(found: Interpretation, alone: HandEyeAlone, called: Callable[[int], str]) -> Iterator[str]:
    """What is said of the images."""
    yield from found.sentences
    if len(out := found.rows[~alone.rows]):
        listed = ", ".join(map(called, out.tolist()))
        yield f"Ignored, as their positions are gross errors: {number_of(len(out), 'image')} ({listed})."


def _moved_between(
    found: Interpretation, alone: HandEyeAlone, in_hand: bool, called: Callable[[int], str]
) -> Iterator[str]:
    """Where the camera or the board moved between two images, beside an arm whose errors stay as they are."""
    rows, A, C = found.rows[alone.rows], found.A[alone.rows], found.C[alone.rows]
    seen = alone.X @ A @ alone.Y
    R = Rotation.from_matrix(A[:, :3, :3])
    # Rotation vectors of like poses are alike where they are about the mean: a flange that points down is half turned.
    poses = np.concatenate([A[:, :3, 3], (R.mean().inv() * R).as_rotvec()], axis=1)
    away = seen[:, :3, 3] - seen[:, :3, 3].mean(axis=0)
    by_camera = np.concatenate([-cross_matrix(away), np.tile(np.eye(3), (len(seen), 1, 1))], axis=2)
    camera, board = "camera (its focus, or the controller's tool)", "board (or the controller's tool)"
    camera, board = (camera, "board") if in_hand else ("camera (or its focus)", board)
    motions = {camera: by_camera, board: alone.X[:3, :3] @ A[:, :3, :3]}
    weights = np.full((len(seen), 3), alone.position_std**-2)
    for one in session_changes(poses, motions, seen[:, :3, 3] - C[:, :3, 3], weights, np.arange(len(seen))):
        before, after = called(int(rows[one.row - 1])), called(int(rows[one.row]))
        is_after = (np.arange(len(seen)) >= one.row).astype(float)
        known = np.column_stack([np.ones(len(seen)), poses])
        left = is_after - known @ np.linalg.lstsq(known, is_after)[0]
        elsewhere = ", or the arm errs so at other poses" if left.var() < OTHER_POSES * is_after.var() else ""
        if one.kind == "step" and one.shift_mm > alone.position_std:
            yield (
                f"The {one.what} moved between {before} and {after}, by {format_mm(one.shift_mm)} or more{elsewhere}: "
                f"{OF_POSES.apart}."
            )


def _without_arm(alone: HandEyeAlone, in_hand: bool, said: list[str]) -> tuple[Transform, Transform]:
    if (n := int(alone.rows.sum())) < FEWEST_TO_IDENTIFY:
        said.append(f"Only {n} images: U comes from their scatter, which so few do not show. Take 25 or more.")
    said.append("Without joints the arm is not identified: its errors are in the uncertainty on average only.")
    return of_alone(alone, eye_in_hand=in_hand)


def _sides(samples: SamplesLike, robot: SamplesLike | None) -> tuple[Samples, Samples]:
    """The board's side and the robot's, of one file or of two, with as many images."""
    seen = _to_samples(samples, "board")
    moved = seen if robot is None else _to_samples(robot, "robot")
    if robot is not None and moved.robot is None and moved.joints is None:
        moved = replace(moved, robot=moved.board)  # a file of poses alone
    if robot is not None and seen.board is None:
        seen, moved = moved, replace(seen, robot=seen.robot)
    if seen.board is None:
        raise InputError("expected poses of the board in the camera, got none", file=seen.file, hint="x_mm .., qx ..")
    if moved.joints is None and moved.robot is None:
        hint = "columns q1_deg .., or the file of joints or flange poses after it"
        raise InputError("expected joints or poses of the flange, got none", file=moved.file, hint=hint)
    n, m = len(seen.board.positions), len(moved)
    if n != m:
        raise InputError(f"got {n} poses of the board and {m} of the robot", hint="one row each of every image")
    return seen, moved


def _to_samples(given: SamplesLike, of: str) -> Samples:
    if isinstance(given, str | Path):
        return read_samples(given)
    array = np.asarray(given, dtype=float)
    if array.ndim == 3 and array.shape[1:] == (4, 4) and np.isfinite(array).all():
        poses = Poses.of_motions(array, "mm")
        return Samples(None, "motions", board=poses) if of == "board" else Samples(None, "motions", robot=poses)
    if of == "robot" and array.ndim == 2 and np.isfinite(array).all():
        return Samples(None, "joints", joints=array)
    raise InputError(f"expected finite motions (n, 4, 4) of the {of}, got an array of shape {array.shape}")


def _where(seen: Samples, moved: Samples, stated: bool | None, said: list[str]) -> bool:
    """Whether the camera is on the flange, by the option, else by the file, else not."""
    by_file = moved.eye_in_hand if moved.eye_in_hand is not None else seen.eye_in_hand
    if stated is not None:
        if by_file is not None and by_file != stated and moved.inverts_standing:
            # Poses of the base in the effector are read the other way round: either fits as well.
            where, option = ("on the flange", "--eye-in-hand") if by_file else ("beside the robot", "--no-eye-in-hand")
            problem = f"the samples say that the camera is {where} (calibration_type)"
            contradict(InputError(problem, file=moved.file, hint=f"omit the option, or {option}"))
        return stated
    if by_file is None and moved.inverts_standing:
        said.append("The samples do not state where the camera is: taken to stand (--eye-in-hand if it is on the arm).")
    return bool(by_file)


def _stated(poses: Poses | None, form: str | None, unit: Unit | None) -> Poses:
    assert poses is not None
    return replace(poses, form=poses.form if form is None else checked_form(form), unit=unit or poses.unit)


def _by_joints(moved: Samples, flange: Poses | None, arm: Arm | None, said: list[str]) -> Poses:
    """The flange by the joints of the nominal arm, compared with the poses that the file has beside them."""
    assert moved.joints is not None
    if arm is None:
        raise InputError("joints need the nominal arm", hint="--arm ARM: a name of `truearm arms`, or a file")
    if moved.joints.shape[1] != arm.n_joints:
        got = moved.joints.shape[1]
        raise InputError(f"expected {arm.n_joints} joints of {arm.name}, got {got}", file=moved.file)
    F = motion(*arm.chain.with_tip(np.zeros(3)).pose(moved.joints))
    if flange is not None and flange.unit is not None:
        form = flange.form or next(iter(flange.forms), None)
        if form in flange.forms:
            scale = 1000.0 if flange.unit == "m" else 1.0
            of_file = motion(flange.forms[form].as_matrix(), scale * flange.positions)
            said += _other_frame(inverse(F) @ of_file, moved.called)
    return Poses.of_motions(F, "mm")


def _other_frame(T: FloatArray, called: Callable[[int], str]) -> list[str]:
    """What the poses of a file are, beside those of the flange by the joints (n, 4, 4)."""
    turn = Rotation.from_matrix(T[:, :3, :3])
    middle = np.median(T[:, :3, 3], axis=0)
    typical = int(np.linalg.norm(T[:, :3, 3] - middle, axis=1).argmin())
    off_mm = np.linalg.norm(T[:, :3, 3] - T[typical, :3, 3], axis=1)
    off_deg = np.degrees((turn[typical].inv() * turn).magnitude())
    differ = (off_mm > 3 * SAME_MM) | (off_deg > 3 * SAME_DEG)
    if differ.mean() > 0.5:
        return ["The poses of the robot in the file are not those of its joints: another arm, base or order. Not used."]
    sentences = []
    where = ", ".join(format_fixed(x, 1) for x in T[typical, :3, 3])
    if np.linalg.norm(T[typical, :3, 3]) > SAME_MM or np.degrees(turn[typical].magnitude()) > SAME_DEG:
        angle = float(np.degrees(turn[typical].magnitude()))
        turned = "" if angle < SAME_DEG else f", turned by {angle:.1f} deg"
        sentences.append(
            f"The poses of the robot in the file are of a tool at ({where}) mm on the "
            f"flange{turned}. The joints are used, and transforms are of the flange."
        )
    if differ.any():
        rows = ", ".join(called(row) for row in np.flatnonzero(differ)[:8].tolist())
        sentences.append(
            f"The tool of the controller was another one at {number_of(int(differ.sum()), 'image')}: {rows}."
        )
    return sentences


def _session(
    found: Interpretation, joints: FloatArray, lines: IntArray | None, rows: npt.NDArray[np.bool_], in_hand: bool
) -> tuple[Session, FloatArray]:
    """The poses as readings of a tip, and of a camera on the flange the point of its frame that is the tip [mm].

    That point is where the boards were: a rotation of the board by noise moves it least.
    """
    C, centre, used = found.C[rows], np.zeros(3), found.rows[rows]
    if in_hand:
        centre = C[:, :3, 3].mean(axis=0)
        C = inverse(C)
    points = C[:, :3, 3] + C[:, :3, :3] @ centre
    quaternion = Rotation.from_matrix(C[:, :3, :3]).as_quat(scalar_first=True)
    numbers = used + 1 if lines is None else np.asarray(lines)[used]
    by_line = lines is not None
    return Session(joints[used], points=points, quaternion=quaternion, numbers=numbers, by_line=by_line), centre


def _equipped(arm: Arm, Y: FloatArray, X: FloatArray, centre: FloatArray, in_hand: bool) -> Arm:
    """The nominal arm with the board, or the point before the camera, as its tip: fits converge from there."""
    tip = inverse(X) @ np.append(centre, 1.0) if in_hand else Y[:, 3]
    return replace(arm, chain=arm.chain.with_tip(tip[:3]))


@dataclass(frozen=True, eq=False, repr=False)
class HandEyeResult(HandEyeByImages, PageRecord):
    """Where the camera and the board are by poses of the board; it has a page.

    See `CameraAndBoard` and `HandEyeByImages` for its attributes.
    """

    def page(self) -> Page:
        """See `PageRecord`."""
        from truearm.wings.camera.hand_eye_page import hand_eye_page

        return hand_eye_page(self)
