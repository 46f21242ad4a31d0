"""Fit images: an arm, cameras and boards from the corners that images show beside the joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.acceptance import accepts, contradict
from truearm.arm import Arm
from truearm.arm.rigid_motions import cross_matrix, inverse, motion
from truearm.choices import ModelName
from truearm.errors import Contradiction, InputError
from truearm.files.atomic_write import atomic_file
from truearm.findings import Finding, format_mm, in_order
from truearm.identification.estimation.common_errors import CommonErrors
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.models import IdentifiedModel
from truearm.models.identified_model import require_identified
from truearm.readings import Lengths, Session, read_lengths
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.fit import FitResult, fit
from truearm.verbs.inputs import ArmLike, LengthsLike, SessionLike, to_arm, to_session
from truearm.verbs.record import TextTable, format_fixed, number_of
from truearm.wings.camera.cell_images import NAMING, BoardLike, CameraLike, CellImages, PixelsLike
from truearm.wings.camera.cell_poses import CellPoses, ImageErrors
from truearm.wings.camera.closed_form import closed_form, refined
from truearm.wings.camera.images import (
    GROSS_STDS,
    LEAST_CORNERS,
    LEAST_GROSS_PX,
    PER_MILLE,
    Adjustment,
    Images,
    adjust,
    first_poses,
)
from truearm.wings.camera.interpretation import NOT_AGAIN, OF_IMAGES, Interpretation, interpret
from truearm.wings.camera.lenses import Lens, camera_yaml, read_camera
from truearm.wings.camera.mounts import (
    CameraAndBoard,
    Transform,
    explained,
    of_boards,
    of_cell,
    where_it_is_carried,
    where_it_stands,
    with_all_accepted,
)
from truearm.wings.camera.pose_files import Poses

# Stated intrinsics are contradicted, or doubted, from so many standard uncertainties and this share of the focal length
# on: that is by how much distances from the camera are wrong. So is a distortion with which corners scatter so many
# times more than with the one that fits best: by chance a thousand of them do by 1.03.
CONTRADICTED, DOUBTED, LEAST_SHARE, SCATTERS = 10.0, 4.0, 0.003, 1.25
# The board's size is said from so many standard uncertainties and this share on.
SAID_SIZE, LEAST_SIZE = 3.0, 5e-4
# What two cameras share, or two boards, sits differently before both where the images of each leave so many times more
# with what the other's say of it than alone, and the identified arm leaves so many times more of all of them.
LEAST_APART, LEAST_LEFT = 4.0, 2.5
# The focal length is doubted from so many images on, where distances scatter so many times more than positions across,
# and than corners explain. Of right images of 16 arms distances scatter by 1.2 times as much at most, where they
# scatter by so much more.
LEAST_FOCUSED, ALONG, BEYOND = 12, 1.8, 3.5
# Corners of the board that are gross errors in this share of the images are the board's, not the images'.
OFTEN = 0.5


@one_blas_thread()
@accepts
def fit_images(
    arm: ArmLike,
    session: SessionLike,
    pixels: PixelsLike | Sequence[PixelsLike],
    *,
    board: BoardLike | Mapping[str, BoardLike],
    camera: CameraLike | Mapping[str, CameraLike] | None = None,
    u_camera_px: float | None = None,
    eye_in_hand: bool | Sequence[str] = False,
    model: ModelName = "auto",
    lengths: LengthsLike | None = None,
    test: tuple[SessionLike, PixelsLike] | None = None,
    accept: str | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> ImageFit:
    """Identify an arm, its cameras and the boards from the corners that images show.

    Pixels are one more kind of reference: arm, poses of cameras and boards, intrinsics and the sizes of the boards are
    estimated together, each as far as the pixels, what is stated and the joints determine it.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm.
    session : Session, DataFrame, str or Path
        Joints of every reading; seats beside them are used too.
    pixels : PixelObservations, str or Path, or several
        Corners in the images, with the number of the reading of each (docs/camera.md).
    board : Board or str, or mapping
        Such as ``charuco:12x9,20mm,15mm``; ``u=0.05%`` behind it states the uncertainty of its size, 0.2 % by default.
        Of several boards each by its name in the table of pixels.
    camera : Lens, str or Path, or mapping, optional
        The camera's intrinsics: ROS's camera_info; of several cameras each by its name. Without them they are found
        from the images.
    u_camera_px : float, optional
        Standard uncertainty of the stated focal lengths and centres [px]; 0 keeps all intrinsics as they are stated. By
        default they are free.
    eye_in_hand : bool or several str
        The cameras are on the flange and the boards stand; or the names of those that are on the flange. By default
        cameras stand and boards are on the flange.
    model : {"auto", "nominal", "kinematic", "physical", "network", "hybrid"}
        As of `fit`: one that identifies the arm.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
    test : session and pixels, optional
        Other images, at poses that are not in the fit: how far the boards are from where they are predicted.
    accept : str, optional
        Why the images are right where they would be refused as contradicted; the reason is kept.
    progress : callable, optional
        As of `fit`.

    Returns
    -------
    ImageFit

    Raises
    ------
    InputError
        If pixels are of readings, corners, boards or cameras that there are not, or fewer than four images show a board
        to a camera.
    Contradiction
        If robot and camera turn differently, a camera is elsewhere, or the images contradict a stated camera.

    Examples
    --------
    >>> import truearm as ta
    >>> from truearm.wings.camera.virtual_cell import small_cell
    >>> cell = small_cell("ur5", seed=1)
    >>> session, pixels = cell.table(20, seed=2)
    >>> found = ta.fit_images("ur5", session, pixels, board=cell.board, camera=cell.lens, model="kinematic")
    >>> found.n_used
    20
    """
    known, readings = to_arm(arm), to_session(session, n_joints=to_arm(arm).n_joints)
    if u_camera_px is not None and camera is None:
        raise InputError("--u-camera (u_camera_px) is of a stated camera: none is", hint="--camera FILE, or omit it")
    if u_camera_px is not None and not 0 <= u_camera_px < np.inf:
        raise InputError(f"expected u_camera_px of 0 or more, got {u_camera_px}")
    known_lengths = read_lengths(lengths) if isinstance(lengths, str | Path) else lengths
    cell = CellImages.of(readings, pixels, board, camera, u_camera_px, eye_in_hand)
    others = None if test is None else cell.others(to_session(test[0], n_joints=known.n_joints), test[1])

    def fitted(placed: _Placed) -> tuple[CellPoses, FitResult]:
        settled = placed.poses.settled(placed.arm, ("base", "tip"))
        at = settled.session()
        with of_boards(OF_IMAGES):
            return settled, fit(placed.arm, at, model=model, lengths=known_lengths, accept=accept, progress=progress)

    placed = _Placed.of(known, cell, known)
    try:
        settled, result = fitted(placed)
    except InputError as error:
        raise placed.contradiction or error from None
    zeros, doubted = result.model.nominal_check_.identified, any(pair.sentences for pair in placed.pairs)
    if result.identifies_constants and zeros is not None and zeros.zeros and (doubted or placed.contradiction):
        # Right images contradict an arm whose zeros are off: they are judged again by the zeros found.
        try:
            again = _Placed.of(known, cell, result.arm_with_zeros())
            settled, result = fitted(again)
            placed = again
        except InputError as error:
            told = NOT_AGAIN.format(error.problem)
            placed = replace(placed, findings=(*placed.findings, Finding("hand-eye", told)))
    if placed.contradiction and not isinstance(placed.contradiction, Contradiction):
        told = f"{placed.contradiction.problem[0].upper()}{placed.contradiction.problem[1:]}."
        placed = replace(placed, findings=(*placed.findings, Finding("hand-eye", told)))
    elif placed.contradiction:
        left = result.held_out_mm
        if left is None or LEAST_APART * left[0] > placed.alone_mm:
            raise placed.contradiction
    _check_apart(placed, result)
    return _fitted(cell, placed, settled, with_all_accepted(result), known_lengths, others)


def _fitted(
    cell: CellImages,
    placed: _Placed,
    settled: CellPoses,
    result: FitResult,
    lengths: Lengths | None,
    others: CellImages | None,
) -> ImageFit:
    """Cameras and boards by the identified arm, and their errors in other images."""
    identified = require_identified(result.model, "images need an identified arm", hint="--model kinematic")
    assert result.nominal is not None  # of an identified model there is one
    common = _with_sizes(identified, settled, result.session, lengths)
    joint = np.block([[identified.fit_.covariance, common.with_arm.T], [common.with_arm, common.covariance]])
    values, images = settled.adjusted.unknowns + common.values, settled.images
    scales, u_scales = images.values(values)[1], images.u_of(common.covariance)[-len(images.boards) :]
    where = {}
    for name in (*images.cameras, *images.boards):
        own = settled.T_child_tip.get(name)
        one = where_it_stands(identified, name) if own is None else where_it_is_carried(identified, name, own)
        where[name] = replace(one, covariance=identified.birge_ratio_**2 * one.covariance)
    for name, scale, board in zip(images.boards, scales, cell.boards.values(), strict=True):
        where[name] = _moved(where[name], -scale * board.points.mean(axis=0))
    cameras, boards = (tuple(where[name] for name in names) for names in (images.cameras, images.boards))
    of_fit = [*_of_cell(cell, result.findings)]
    findings = [*cell.findings, *placed.findings, *_size_findings(images, scales, u_scales), *of_fit]
    if not any(one.what == "change" for one in of_fit):
        findings += _focus_findings(identified, cell)
    return ImageFit(
        camera=cameras[0],
        board=boards[0],
        eye_in_hand=bool(cell.in_hand.all()),
        n_images=cell.n_images,
        n_used=settled.n_images,
        turn_deg=placed.turn_deg,
        alone_mm=placed.alone_mm,
        fitted=result,
        findings=in_order(findings),
        poses=settled,
        unknowns=values,
        unknowns_covariance=common.covariance,
        cameras=cameras,
        boards=boards,
        test=None if others is None else ImageErrors.of(identified, result.nominal, settled, values, joint, others),
    )


def _of_cell(cell: CellImages, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Findings of a fit with camera and board by their names."""
    of, either = cell.in_hand, "camera or board"
    standing, carried = ("board", "camera") if of.all() else (either, either) if of.any() else ("camera", "board")
    return of_cell(findings, standing, carried)


def _moved(one: Transform, origin: FloatArray) -> Transform:
    """The frame with its origin elsewhere, given along its own axes (3,) [mm]."""
    apart = one.T_parent_child[:3, :3] @ origin
    by = np.eye(6)
    by[:3, 3:] = -cross_matrix(apart)
    T = one.T_parent_child @ motion(np.eye(3), origin)
    return replace(one, T_parent_child=T, covariance=by @ one.covariance @ by.T)


def _adjusted(cell: CellImages) -> tuple[Adjustment, Images, list[Finding]]:
    """Poses and cameras by the pixels, without gross errors of corners; and what contradicts what is stated."""
    images = cell.images
    adjusted = adjust(images, *first_poses(images))
    limit = np.maximum(GROSS_STDS * adjusted.std_px, LEAST_GROSS_PX)[images.camera]
    off = np.linalg.norm(np.nan_to_num(adjusted.residuals), axis=1) > limit[:, None]
    off &= ((images.seen & ~off).sum(axis=1) >= LEAST_CORNERS)[:, None]
    findings = []
    if off.any():
        findings.append(_said_of_corners(cell.called, images, adjusted, off, limit))
        images = replace(images, pixels=np.where(off[:, None], np.nan, images.pixels))
        adjusted = adjust(images, adjusted.R, adjusted.t, adjusted.unknowns)
    return adjusted, images, findings + _camera_findings(images, adjusted)


def _said_of_corners(
    called: Callable[[int], str], images: Images, adjusted: Adjustment, off: BoolArray, limit: FloatArray
) -> Finding:
    """Which corners are gross errors; those that are another one are exchanged."""
    of_image = np.flatnonzero(off.any(axis=1))
    exchanged: dict[tuple[int, int], int] = {}
    for i in of_image:
        wrong = np.flatnonzero(off[i])
        predicted = images.pixels[i] + adjusted.residuals[i]
        apart = np.linalg.norm(images.pixels[i][:, wrong, None] - predicted[:, None, wrong], axis=0)
        for a, b in np.argwhere(apart <= 3 * limit[i]):
            if a < b and apart[b, a] <= 3 * limit[i]:
                pair = int(wrong[a]), int(wrong[b])
                exchanged[pair] = exchanged.get(pair, 0) + 1
    n, listed = int(off.sum()), [f"{int(off[i].sum())} of {called(int(i))}" for i in of_image[:4]]
    more = f" and {len(of_image) - 4} more" if len(of_image) > 4 else ""
    said = f"{number_of(n, 'corner')} of {number_of(len(of_image), 'image')} are gross errors, ignored: "
    said += ", ".join(listed) + more + "."
    pairs = [f"{a} and {b}" for a, b in list(exchanged)[:4]]
    if pairs:
        said += f" Corners {', '.join(pairs)} are exchanged."
    for b, name in enumerate(images.boards):
        own = images.board == b
        often = np.flatnonzero(off[own].sum(axis=0) > OFTEN * np.maximum(images.seen[own].sum(axis=0), 1))
        if len(often) and not pairs:
            which = f"board {name}" if len(images.boards) > 1 else "this board"
            said += f" Corners {', '.join(map(str, often[:6].tolist()))} are so in most images: is it {which}?"
    return Finding("hand-eye", said, {"n": n, "n_images": len(of_image)})


def _camera_findings(images: Images, adjusted: Adjustment) -> list[Finding]:
    """Whether the images contradict what is stated of the cameras.

    Raises
    ------
    Contradiction
        If they do so by far.
    """
    stated = [bool(np.isfinite(u[:4]).all()) for u in images.u_intrinsics]
    if not any(stated):
        return []
    unknown = tuple(np.full_like(u, np.inf) for u in images.u_intrinsics)
    bare = replace(images, u_intrinsics=unknown, u_scale=0.0 * images.u_scale)
    free = adjust(bare, adjusted.R, adjusted.t)
    several = len(images.cameras) > 1
    findings = []
    for k, (name, lens, u_stated, own, is_stated) in enumerate(
        zip(images.cameras, images.lenses, images.u_intrinsics, images.intrinsics, stated, strict=True)
    ):
        change, u = free.unknowns[own][:4], free.u_unknowns[own][:4]
        worst = int(np.argmax(np.abs(change) / np.hypot(u, u_stated[:4])))
        sure = abs(change[worst]) / np.hypot(u[worst], u_stated[worst])
        less = adjusted.std_px[k] / free.std_px[k]
        if not is_stated or max(sure / DOUBTED, less / SCATTERS) < 1:
            continue
        value, share = float(lens.intrinsics[worst]), float(change[worst] / lens.fx)
        said = f"the images contradict the stated camera{f' {name}' if several else ''}: "
        if sure >= DOUBTED:
            said += (
                f"{lens.names[worst]} is {value + change[worst]:.1f} px (u {u[worst]:.1f}) by them, stated {value:.1f} "
                f"px ({100 * share:+.2f} % of the focal length)"
            )
        else:
            said += (
                f"corners scatter by {adjusted.std_px[k]:.2g} px with it, and by {free.std_px[k]:.2g} px with another "
                "distortion"
            )
        if (sure > CONTRADICTED and abs(share) > LEAST_SHARE) or less > SCATTERS:
            contradict(
                InputError(said, hint="let truearm find the intrinsics (omit --u-camera), or calibrate the camera")
            )
        numbers = {"change_px": float(change[worst]), "u_px": float(u[worst])}
        findings.append(Finding("hand-eye", f"{said[0].upper()}{said[1:]}.", numbers))
    return findings


def _size_findings(images: Images, scales: FloatArray, u_scales: FloatArray) -> Iterator[Finding]:
    """That a board has another size than stated."""
    for name, scale, u in zip(images.boards, scales.tolist(), u_scales.tolist(), strict=True):
        if u and abs(scale - 1) > max(SAID_SIZE * u, LEAST_SIZE):
            board = f"board {name}" if len(images.boards) > 1 else "the board"
            said = f"By the arm's lengths {board} is {scale:.5f} (u {u:.2g}) times its stated size: measure it."
            yield Finding("hand-eye", said, {"size": scale, "u": u})


def _focus_findings(model: IdentifiedModel, cell: CellImages) -> Iterator[Finding]:
    """That boards scatter along the axis of the camera, as they do where its focal length changes."""
    part = next(one for one in model.fit_.references if one.kind == "pose")
    used = part.robust_weight > 0  # one image of another pose scatters along any axis
    if used.sum() < LEAST_FOCUSED:
        return
    first, second, along = np.sqrt((part.residuals[:3, used] ** 2).mean(axis=1))  # by how well the corners show them
    across, shown = float(np.hypot(first, second) / np.sqrt(2)), float(np.sqrt((part.std[2, used] ** 2).mean()))
    if along > max(ALONG * across, BEYOND * shown):
        stated = ", or is the stated one wrong" if any(np.isfinite(u[0]) for u in cell.images.u_intrinsics) else ""
        said = (
            f"The arm leaves {format_mm(along)} of the distance of the board from the camera, and {format_mm(across)} "
            f"across it, where corners show {format_mm(shown)}: did the focal length change between images{stated}? "
            "Switch the autofocus off."
        )
        yield Finding("hand-eye", said, {"along_mm": float(along), "across_mm": across})


def _begun(who: str, said: str) -> str:
    """A sentence that says first of what it is: ``Camera left: the board ..``."""
    return f"{who[0].upper()}{who[1:]}{said[0].lower()}{said[1:]}" if who else said


@dataclass(frozen=True, eq=False)
class _Pair:
    """A camera and a board that it sees: the images that belong to their poses, and where both are."""

    carried: str
    standing: str
    rows: IntArray
    T_flange_carried: FloatArray
    T_base_standing: FloatArray
    flange: FloatArray
    seen: FloatArray
    held_out_mm: FloatArray
    turn_deg: float
    sentences: tuple[str, ...]
    contradiction: InputError | None

    @classmethod
    def of(
        cls, names: tuple[str, str], rows: IntArray, flange: FloatArray, seen: FloatArray, cell: CellImages, arm: Arm
    ) -> _Pair:
        """By the poses (n, 4, 4) of the flange in the base, and of the board in the camera."""
        camera = int(cell.images.camera[rows[0]])
        in_hand, who, remedies = bool(cell.in_hand[camera]), cell.seen_by(int(rows[0])), OF_IMAGES
        if len(name := cell.images.cameras) > 1:
            others = f"--on-flange of the cameras on the flange only, without {name[camera]}"
            remedies = replace(OF_IMAGES, mounts=(f"--on-flange {name[camera]}", others))
        found: Interpretation | None = None
        contradiction = None
        try:
            found = interpret(
                Poses.of_motions(flange, "mm"),
                Poses.of_motions(seen, "mm"),
                eye_in_hand=in_hand,
                called=lambda i: cell.called(int(rows[i])),
                remedies=remedies,
            )
        except InputError as error:
            named = explained(error, arm, cell.readings.angles[cell.rows[rows]], inverse(seen) if in_hand else seen)
            contradiction = type(error)(f"{who}{error.problem}", hint=named.hint)
        if found is None:
            A = inverse(flange) if in_hand else flange
            start, turn, sentences = closed_form(A, seen, sized=False), float("nan"), tuple[str, ...]()
        else:
            A, seen, start, turn = found.A, found.C, found.start, found.turn_deg
            sentences = tuple(_begun(who, said) for said in found.sentences)
            rows = rows[found.rows]
        alone = refined(A, seen, start)
        carried, standing = (inverse(alone.X), alone.Y) if in_hand else (alone.Y, inverse(alone.X))
        flange, seen = (inverse(A), inverse(seen)) if in_hand else (A, seen)
        return cls(*names, rows, carried, standing, flange, seen, alone.held_out_mm, turn, sentences, contradiction)

    def left_mm(self, other: _Pair) -> float:
        """Root mean square distance that is left with what `other` says of what both share, carried or standing."""
        moved, seen = self.flange @ other.T_flange_carried, self.seen
        if self.carried != other.carried:
            moved, seen = inverse(self.flange) @ other.T_base_standing, inverse(seen)
        R = Rotation.from_matrix(moved[:, :3, :3] @ seen[:, :3, :3].transpose(0, 2, 1)).mean().as_matrix()
        left = moved[:, :3, 3] - seen[:, :3, 3] @ R.T
        return float(np.sqrt(((left - left.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _check_apart(placed: _Placed, result: FitResult) -> None:
    """Refuse what sits differently before one camera than before another, or with one board than with another."""
    is_camera = set(placed.poses.images.cameras).__contains__
    for one, other in combinations(placed.pairs, 2):
        shared = {one.carried, one.standing} & {other.carried, other.standing}
        alone = max(float(np.sqrt((pair.held_out_mm**2).mean())) for pair in (one, other))
        if not shared or (result.held_out_mm is not None and result.held_out_mm[0] < LEAST_LEFT * alone):
            continue
        apart = min(one.left_mm(other), other.left_mm(one))
        if apart < LEAST_APART * alone:
            continue
        name = next(iter(shared))
        kind, whose, hint = "board", "camera", f"give the two boards two names ({NAMING})"
        if is_camera(name):
            kind, whose, hint = "camera", "board", "give the camera two names (truearm corners --camera-name)"
        places = [pair.standing if name == pair.carried else pair.carried for pair in (one, other)]
        said = (
            f"{'the board' if name == kind else f'{kind} {name}'} sits differently for {whose} {places[0]} and for "
            f"{places[1]}: the images of each leave {format_mm(alone)} alone, and {format_mm(apart)} where it sits for "
            "the other"
        )
        contradict(InputError(said, hint=f"if it was moved between them, {hint}"))


@dataclass(frozen=True, eq=False)
class _Placed:
    """Images that belong to their poses, and the nominal arm with its tip on the flange, see `CellPoses`.

    `contradiction` is what robot and camera contradict each other by, if they do: an arm with large joint offsets
    does so, and is right.
    """

    arm: Arm
    poses: CellPoses
    findings: tuple[Finding, ...]
    turn_deg: float
    alone_mm: float
    contradiction: InputError | None
    pairs: tuple[_Pair, ...]

    @classmethod
    def of(cls, arm: Arm, cell: CellImages, turned: Arm) -> _Placed:
        """Of an arm, by the motions of the flange that it has with its zeros as they were `turned`."""
        adjusted, images, findings = _adjusted(cell)
        poses = CellPoses(
            readings=cell.readings,
            rows=cell.rows,
            images=images,
            adjusted=adjusted,
            in_hand=cell.in_hand,
            T_child_tip={},
        )
        flange = motion(*turned.chain.with_tip(np.zeros(3)).pose(cell.readings.angles[cell.rows]))
        seen = poses.T_camera_board
        pairs = []
        for carried, standing, own in poses.pairs():
            rows = np.flatnonzero(own)
            pairs.append(_Pair.of((carried, standing), rows, flange[rows], seen[rows], cell, arm))
        T_child_tip, tip = _tips(poses, pairs)
        poses = replace(poses, T_child_tip=T_child_tip).named().select(np.sort(np.concatenate([p.rows for p in pairs])))
        return cls(
            replace(arm, chain=arm.chain.with_tip(tip)),
            poses,
            (*findings, *(Finding("hand-eye", said) for pair in pairs for said in pair.sentences)),
            float(np.sqrt(np.mean([pair.turn_deg**2 for pair in pairs]))),
            float(np.concatenate([pair.held_out_mm for pair in pairs]).mean()),
            next((pair.contradiction for pair in pairs if pair.contradiction), None),
            tuple(pairs),
        )


def _tips(poses: CellPoses, pairs: Sequence[_Pair]) -> tuple[dict[str, FloatArray], FloatArray]:
    """The tip in the frames of all that the flange carries, and on the nominal flange (3,) [mm], see `CellPoses`."""
    best = {pair.carried: pair for pair in sorted(pairs, key=lambda pair: len(pair.rows))}
    T = {name: best[name].T_flange_carried for name in dict.fromkeys(poses.carried)}
    centres = {}
    for name in T:
        depths = poses.adjusted.t[np.array(poses.carried) == name, 2]
        centres[name] = np.array(
            [0.0, 0.0, float(np.round(np.median(depths))) if name in poses.images.cameras else 0.0]
        )
    tip = np.mean([T[name][:3, :3] @ centre + T[name][:3, 3] for name, centre in centres.items()], axis=0)
    first = next(iter(T.values()))
    found = {}
    for name, one in T.items():
        centre = centres[name] if len(T) == 1 else one[:3, :3].T @ (tip - one[:3, 3])
        found[name] = motion(np.eye(3) if one is first else one[:3, :3].T @ first[:3, :3], centre)
    return found, tip


def _with_sizes(model: IdentifiedModel, poses: CellPoses, session: Session, lengths: Lengths | None) -> CommonErrors:
    """Cameras and boards by images and arm; the model's uncertainty is completed.

    A board that is larger on a larger arm looks the same: only what is expected of the arm's lengths, and what is
    stated of the board, tells the size of both. The evidence of few readings may expect these lengths to be better
    than arms are; so the size is no more certain than usual arms make it, unless a length is known.
    """
    prepared = model.prepare(session, lengths)
    assert isinstance(prepared, PreparedReadings)
    found = CommonErrors.of(model.fit_, prepared)
    found = replace(found, covariance=model.birge_ratio_**2 * found.covariance)
    n = int((poses.images.u_scale > 0).sum())
    if n == len(poses.images.boards) and prepared.lengths is None:
        of_sizes = poses.images.precision[-n:]
        found, model.fit_ = found.with_usual_size(model.fit_, unit=PER_MILLE, precision=of_sizes)
    return found


@dataclass(frozen=True, eq=False, repr=False)
class ImageFit(CameraAndBoard):
    """Where cameras and boards are, the cameras' intrinsics and the identified arm.

    Attributes
    ----------
    cameras, boards : tuple of Transform
        All of them, each in the base or the flange; `camera` and `board` are the first.
    poses : CellPoses
        The images that were used, with the poses of the boards.
    unknowns, unknowns_covariance : (a,), (a, a) array
        Changes of the stated intrinsics and of the boards' sizes, in the units that `poses.images.names` states.
    test : ImageErrors or None
        Errors in images that are not in the fit.
    """

    poses: CellPoses
    unknowns: FloatArray
    unknowns_covariance: FloatArray
    cameras: tuple[Transform, ...]
    boards: tuple[Transform, ...]
    test: ImageErrors | None = None

    @property
    def transforms(self) -> tuple[Transform, ...]:
        """Cameras and boards, and all the other way round."""
        both = (*self.cameras, *self.boards)
        return (*both, *(one.inverted() for one in both))

    @property
    def lenses(self) -> tuple[Lens, ...]:
        """The cameras with the intrinsics found."""
        return self.poses.images.values(self.unknowns)[0]

    @property
    def board_scales(self) -> FloatArray:
        """(b,) true sizes of the boards over the stated ones."""
        return self.poses.images.values(self.unknowns)[1]

    @property
    def u_intrinsics(self) -> FloatArray:
        """(n,) standard uncertainties of the intrinsics of all cameras, and last of the sizes of the boards."""
        return self.poses.images.u_of(self.unknowns_covariance)

    def save_cameras(self, paths: Mapping[str, Path]) -> None:
        """Write the intrinsics of every camera as a file of ROS's camera_info, by its name."""
        images = self.poses.images
        for name, lens, own in zip(images.cameras, self.lenses, images.intrinsics, strict=True):
            u = ", ".join(f"{of} {value:.2g}" for of, value in zip(lens.names, self.u_intrinsics[own], strict=True))
            with atomic_file(paths[name], read=read_camera) as part:
                part.write_text(camera_yaml(lens, notes=(f"u: {u}",)), encoding="utf-8")

    def summary(self) -> str:
        """The answer in one sentence."""
        if len(self.cameras) == 1:
            return super().summary()
        known = [f"camera {one.child} in the {one.parent} is known to {format_mm(one.U_mm)} and {one.U_deg:.2g} deg"
                 for one in self.cameras]  # fmt: skip
        return f"{', '.join(known).capitalize()} (U, k = 2), from {number_of(self.n_used, 'image')}."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield from super().blocks()
        if self.test is not None:
            yield from self.test.blocks()
        images, stds = self.poses.images, self.poses.adjusted.std_px
        for k, (name, std_px) in enumerate(zip(images.cameras, stds.tolist(), strict=True)):
            n = number_of(int(images.seen[images.camera == k].sum()), "corner")
            by = f" of camera {name}" if len(stds) > 1 else ""
            yield f"{n}{by} scatter by {std_px:.2g} px a coordinate about the poses of their images."
        heading = "cameras and the boards" if len(images.cameras) + len(images.boards) > 2 else "camera and the board"
        yield TextTable((f"of the {heading}", "value", "u"), self._rows())

    def _rows(self) -> Sequence[Sequence[str]]:
        rows = []
        values = np.concatenate([*(lens.intrinsics for lens in self.lenses), self.board_scales])
        for name, value, u in zip(self.poses.images.labels, values.tolist(), self.u_intrinsics.tolist(), strict=True):
            digits = max(0, 1 - int(np.floor(np.log10(u)))) if u > 0 else 0
            shown = (format_fixed(value, digits), format_fixed(u, digits)) if u > 0 else (f"{value:.6g}", "as stated")
            rows.append((name, *shown))
        return rows

    def _json(self) -> dict[str, Any]:
        images, n = self.poses.images, len(self.poses.images.boards)
        lenses = np.concatenate([lens.intrinsics for lens in self.lenses])
        sizes, u = self.board_scales, self.u_intrinsics
        tips = {name: T[:3, 3] for name, T in self.poses.T_child_tip.items()}

        def by_name(names: Sequence[str], values: Sequence[object]) -> object:
            return values[0] if len(names) == 1 else dict(zip(names, values, strict=True))

        return {
            **super()._json(),
            "intrinsics": dict(zip(images.labels[:-n], lenses.tolist(), strict=True)),
            "u_intrinsics": dict(zip(images.labels[:-n], u[:-n].tolist(), strict=True)),
            "board_scale": by_name(images.boards, sizes.tolist()),
            "u_board_scale": by_name(images.boards, u[-n:].tolist()),
            "std_px": by_name(images.cameras, self.poses.adjusted.std_px.tolist()),
            "test": None if self.test is None else self.test.to_dict(),
            "tip_mm": by_name(list(tips), list(tips.values())),
        }
