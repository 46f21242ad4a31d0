"""Fit images: an arm, the camera and the board from the corners that images show beside the joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from truearm.acceptance import accepts, contradict
from truearm.arm import Arm
from truearm.arm.rigid_motions import cross_matrix
from truearm.choices import ModelName
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.findings import Finding, in_order
from truearm.identification.estimation.common_errors import CommonErrors
from truearm.identification.references.prepared_readings import MIN_ROWS, PreparedReadings
from truearm.models.identified_model import IdentifiedModel, require_identified
from truearm.readings import Lengths, Session, read_lengths
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.fit import fit
from truearm.verbs.inputs import ArmLike, LengthsLike, SessionLike, to_arm, to_session
from truearm.verbs.record import TextTable, format_fixed, number_of
from truearm.wings.camera.boards import Board, parse_board
from truearm.wings.camera.closed_form import closed_form, inverse, motion, refined
from truearm.wings.camera.hand_eye import HandEyeResult
from truearm.wings.camera.image_poses import ImagePoses
from truearm.wings.camera.images import (
    GROSS_STDS,
    LEAST_CORNERS,
    LEAST_GROSS_PX,
    Adjustment,
    Images,
    adjust,
    first_poses,
    guess_lens,
)
from truearm.wings.camera.interpretation import OF_IMAGES, Interpretation, interpret
from truearm.wings.camera.lenses import Lens, camera_yaml, read_camera
from truearm.wings.camera.mounts import Transform, of_model
from truearm.wings.camera.observations import PixelObservations, read_pixels
from truearm.wings.camera.pose_files import Poses

BoardLike: TypeAlias = Board | str
CameraLike: TypeAlias = Lens | str | Path
PixelsLike: TypeAlias = PixelObservations | str | Path

# Intrinsics that are kept are contradicted, or doubted, from so many standard uncertainties and this share of the focal
# length on: that is by how much distances from the camera are wrong.
CONTRADICTED, DOUBTED, LEAST_SHARE = 10.0, 4.0, 0.003
# The board's size is said from so many standard uncertainties and this share on.
SAID_SIZE, LEAST_SIZE = 3.0, 5e-4
# Corners of the board that are gross errors in this share of the images are the board's, not the images'.
OFTEN = 0.5


@one_blas_thread()
@accepts
def fit_images(
    arm: ArmLike,
    session: SessionLike,
    pixels: PixelsLike,
    *,
    board: BoardLike,
    camera: CameraLike | None = None,
    u_camera_px: float | None = None,
    eye_in_hand: bool = False,
    model: ModelName = "auto",
    lengths: LengthsLike | None = None,
    accept: str | None = None,
    progress: Callable[[int, str], None] | None = None,
) -> ImageFit:
    """Identify an arm, its camera and the board from the corners that images show.

    Pixels are one more kind of reference: arm, poses of camera and board, intrinsics and the size of the board are
    estimated together, each as far as the pixels, what is stated and the joints determine it.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm.
    session : Session, DataFrame, str or Path
        Joints of every reading; seats beside them are used too.
    pixels : PixelObservations, str or Path
        Corners in the images, with the number of the reading of each (docs/camera.md).
    board : Board or str
        Such as ``charuco:12x9,20mm,15mm``; ``u=0.05%`` behind it states the uncertainty of its size, 0.2 % by default.
    camera : Lens, str or Path, optional
        The camera's intrinsics: ROS's camera_info. Without it they are found from the images.
    u_camera_px : float, optional
        Standard uncertainty of the stated focal lengths and centre [px]; 0 keeps all intrinsics as they are stated. By
        default they are free.
    eye_in_hand : bool
        The camera is on the flange and the board stands. By default the camera stands and the board is on the flange.
    model : {"auto", "nominal", "kinematic", "physical", "network", "hybrid"}
        As of `fit`: one that identifies the arm.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
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
        If pixels are of readings or corners that there are not, or fewer than four images show the board.
    Contradiction
        If robot and camera turn differently, the camera is elsewhere, or the images contradict the stated camera.

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
        raise InputError("u_camera_px is of a stated camera, and none is stated", hint="state the camera's file")
    if u_camera_px is not None and not 0 <= u_camera_px < np.inf:
        raise InputError(f"expected u_camera_px of 0 or more, got {u_camera_px}")
    known_lengths = read_lengths(lengths) if isinstance(lengths, str | Path) else lengths
    seen = read_pixels(pixels) if isinstance(pixels, str | Path) else pixels
    of_board = parse_board(board) if isinstance(board, str) else board
    lens = read_camera(camera) if isinstance(camera, str | Path) else camera
    rows, images, findings = images_of(seen, len(readings), of_board, lens, u_camera_px)
    called = _names_of(seen, readings, rows)
    adjusted, images, found = _adjusted(images, called)
    findings += found
    if lens is not None:
        findings += _camera_findings(images, adjusted)
    depth = float(np.round(np.median(adjusted.t[:, 2]))) if eye_in_hand else 0.0
    poses = ImagePoses(
        readings=readings, rows=rows, images=images, adjusted=adjusted, is_in_hand=eye_in_hand, depth_mm=depth
    )
    placed = _Placed.of(known, poses, called)
    free = ("base", "tip")
    try:
        settled = placed.poses.settled(placed.arm, free)
        result = fit(
            placed.arm, settled.session(), model=model, lengths=known_lengths, accept=accept, progress=progress
        )
    except InputError as error:
        raise placed.contradiction or error from None
    identified = require_identified(result.model, "images need an identified arm", hint="--model kinematic")
    common = _with_size(identified, settled, result.session, known_lengths)
    values, covariance = settled.adjusted.unknowns + common.values, common.covariance
    of_camera, of_middle = (
        replace(one, covariance=identified.birge_ratio_**2 * one.covariance)
        for one in of_model(identified, eye_in_hand=eye_in_hand, centre=settled.centre)
    )
    of_the_board = _moved(of_middle, -settled.images.values(values)[1] * of_board.points.mean(axis=0))
    names = [Finding("hand-eye", one) for one in placed.sentences]
    if settled.images.free[-1]:
        scale, u = settled.images.values(values)[1], float(np.sqrt(covariance[-1, -1]) * settled.images.units[-1])
        findings += _size_findings(scale, u)
    return ImageFit(
        camera=of_camera,
        board=of_the_board,
        eye_in_hand=eye_in_hand,
        n_images=len(np.unique(seen.image)),
        n_used=len(settled.rows),
        turn_deg=placed.turn_deg,
        alone_mm=placed.alone_mm,
        fitted=result,
        findings=in_order((*findings, *names, *result.findings)),
        poses=settled,
        unknowns=values,
        unknowns_covariance=covariance,
    )


def _moved(one: Transform, origin: FloatArray) -> Transform:
    """The frame with its origin elsewhere, given along its own axes (3,) [mm]."""
    apart = one.T_parent_child[:3, :3] @ origin
    by = np.eye(6)
    by[:3, 3:] = -cross_matrix(apart)
    T = one.T_parent_child @ motion(np.eye(3), origin)
    return replace(one, T_parent_child=T, covariance=by @ one.covariance @ by.T)


def images_of(
    seen: PixelObservations, n_readings: int, board: Board, lens: Lens | None, u_camera_px: float | None
) -> tuple[Any, Images, list[Finding]]:
    """The rows (m,) of the readings with images that show the board, these images, and what is to be said of others.

    Raises
    ------
    InputError
        If there are several cameras, boards or images of a reading, or too few images.
    """
    seen.check_readings(n_readings)
    for name in ("camera", "board"):
        if len(names := np.unique(getattr(seen, name))) > 1:
            raise InputError(
                f"expected the pixels of one {name}, got {len(names)} ({', '.join(names[:3].tolist())})",
                file=seen.file,
                column=name,
                hint=f"fit the images of one {name} at a time",
            )
    _check_board_of(seen, board)
    if lens is not None and seen.size_px is not None and seen.size_px != (lens.width, lens.height):
        raise InputError(
            f"the images are {seen.size_px[0]} x {seen.size_px[1]} px, the camera's file is of {lens.width} x "
            f"{lens.height} px",
            file=seen.file,
            hint="the intrinsics of this resolution, or none: they are found with the arm",
        )
    image = np.unique(seen.image, return_inverse=True)[1]
    of_reading = np.unique(np.stack([seen.reading, image]), axis=1)[0]
    if len(twice := of_reading[1:][np.diff(of_reading) == 0]):
        raise InputError(
            f"expected one image a reading, got several of reading {twice[0]}", file=seen.file, column="image"
        )
    board.points_of(seen.corner)  # which refuses corners that it has not
    order = np.argsort(board.corners)
    where = order[np.searchsorted(board.corners, seen.corner, sorter=order)]
    pixels = np.full((len(of_reading), 2, len(board)), np.nan)
    pixels[np.searchsorted(of_reading, seen.reading), :, where] = seen.pixels
    shows = (~np.isnan(pixels[:, 0])).sum(axis=1) >= LEAST_CORNERS
    if shows.sum() < MIN_ROWS:
        raise InputError(f"expected {MIN_ROWS} or more images that show the board, got {shows.sum()}", file=seen.file)
    findings = []
    if n := int((~shows).sum()):
        said = f"{number_of(n, 'image')} of {len(shows)} show fewer than {LEAST_CORNERS} corners of the board; ignored."
        findings.append(Finding("hand-eye", said, {"n": n}))
    corners = board.points - board.points.mean(axis=0)
    if lens is None:
        if not board.is_flat:
            raise InputError("a board that is not flat needs the camera's intrinsics", hint="state the camera's file")
        size = seen.size_px or (np.ceil(np.nanmax(pixels, axis=(0, 2))).astype(int) + 1).tolist()
        lens = guess_lens(corners, pixels[shows], size)
    u = np.full(len(lens.intrinsics), np.inf if u_camera_px is None else u_camera_px)
    if u_camera_px:
        u[4:] = np.inf
    return of_reading[shows] - 1, Images(corners, pixels[shows], lens, u, board.u_scale), findings


def _check_board_of(seen: PixelObservations, board: Board) -> None:
    """Refuse pixels of a board of another kind or number of squares; its lengths may have been measured since."""
    try:
        other = parse_board(str(seen.board[0]), folder=seen.file.parent if seen.file else ".")
    except InputError:
        return  # a name of another detector
    if (other.kind, other.across, other.down) != (board.kind, board.across, board.down):
        raise InputError(
            f"the corners are those of board {other.name}, not of {board.name}",
            file=seen.file,
            column="board",
            hint=f"--board {other.name}, or the pixels of the other board",
        )


def _names_of(seen: PixelObservations, readings: Session, rows: IntArray) -> Callable[[int], str]:
    """What a message calls an image by its place in `rows`: ``image_05.png (line 6)``."""
    names = dict(zip(seen.reading.tolist(), seen.image.tolist(), strict=True))

    def called(place: int) -> str:
        row = int(rows[place])
        name, reading = names[row + 1], readings.called(row)
        return reading if name == f"reading {row + 1}" else f"{name} ({reading})"

    return called


def _adjusted(images: Images, called: Callable[[int], str]) -> tuple[Adjustment, Images, list[Finding]]:
    """Poses and camera by the pixels, without gross errors of corners."""
    adjusted = adjust(images, *first_poses(images))
    off = np.linalg.norm(np.nan_to_num(adjusted.residuals), axis=1) > max(GROSS_STDS * adjusted.std_px, LEAST_GROSS_PX)
    off &= ((images.seen & ~off).sum(axis=1) >= LEAST_CORNERS)[:, None]
    if not off.any():
        return adjusted, images, []
    findings = [_said_of_corners(called, images, adjusted, off)]
    images = replace(images, pixels=np.where(off[:, None], np.nan, images.pixels))
    return adjust(images, adjusted.R, adjusted.t, adjusted.unknowns), images, findings


def _said_of_corners(called: Callable[[int], str], images: Images, adjusted: Adjustment, off: BoolArray) -> Finding:
    """Which corners are gross errors; those that are another one are exchanged."""
    of_image = np.flatnonzero(off.any(axis=1))
    limit = max(GROSS_STDS * adjusted.std_px, LEAST_GROSS_PX)
    exchanged: dict[tuple[int, int], int] = {}
    for i in of_image:
        wrong = np.flatnonzero(off[i])
        predicted = images.pixels[i] + adjusted.residuals[i]
        apart = np.linalg.norm(images.pixels[i][:, wrong, None] - predicted[:, None, wrong], axis=0)
        for a, b in np.argwhere(apart <= 3 * limit):
            if a < b and apart[b, a] <= 3 * limit:
                pair = int(wrong[a]), int(wrong[b])
                exchanged[pair] = exchanged.get(pair, 0) + 1
    n, listed = int(off.sum()), [f"{int(off[i].sum())} of {called(int(i))}" for i in of_image[:4]]
    more = f" and {len(of_image) - 4} more" if len(of_image) > 4 else ""
    said = f"{number_of(n, 'corner')} of {number_of(len(of_image), 'image')} are gross errors, ignored: "
    said += ", ".join(listed) + more + "."
    pairs = [f"{a} and {b}" for a, b in list(exchanged)[:4]]
    if pairs:
        said += f" Corners {', '.join(pairs)} are exchanged."
    often = np.flatnonzero(off.sum(axis=0) > OFTEN * np.maximum(images.seen.sum(axis=0), 1))
    if len(often) and not pairs:
        said += f" Corners {', '.join(map(str, often[:6].tolist()))} are so in most images: is it this board?"
    return Finding("hand-eye", said, {"n": n, "n_images": len(of_image)})


def _camera_findings(images: Images, adjusted: Adjustment) -> list[Finding]:
    """Whether the images contradict what is stated of the camera.

    Raises
    ------
    Contradiction
        If they do, and the intrinsics are kept.
    """
    n = len(images.u_intrinsics)
    if not np.isfinite(images.u_intrinsics[:4]).all():
        return []
    bare = replace(images, u_intrinsics=np.full(n, np.inf), u_scale=0.0)
    free = adjust(bare, adjusted.R, adjusted.t)
    change, u = free.unknowns[:4], free.u_unknowns[:4]
    worst = int(np.argmax(np.abs(change) / np.hypot(u, images.u_intrinsics[:4])))
    sure = abs(change[worst]) / np.hypot(u[worst], images.u_intrinsics[worst])
    if sure < DOUBTED:
        return []
    name, stated = images.lens.names[worst], float(images.lens.intrinsics[worst])
    share = float(change[worst] / images.lens.fx)
    said = (
        f"the images contradict the stated camera: {name} is {stated + change[worst]:.1f} px (u {u[worst]:.1f}) by "
        f"them, stated {stated:.1f} px ({100 * share:+.2g} % of the focal length)"
    )
    if not images.u_intrinsics[worst] and sure > CONTRADICTED and abs(share) > LEAST_SHARE:
        contradict(InputError(said, hint="let truearm find the intrinsics (omit --u-camera), or calibrate the camera"))
    numbers = {"change_px": float(change[worst]), "u_px": float(u[worst])}
    return [Finding("hand-eye", f"{said[0].upper()}{said[1:]}.", numbers)]


def _size_findings(scale: float, u: float) -> Iterator[Finding]:
    """That the board has another size than stated."""
    if abs(scale - 1) > max(SAID_SIZE * u, LEAST_SIZE):
        said = f"By the arm's lengths the board is {scale:.5f} (u {u:.2g}) times its stated size: measure it."
        yield Finding("hand-eye", said, {"size": scale, "u": u})


@dataclass(frozen=True, eq=False)
class _Placed:
    """Images that belong to their poses, and the nominal arm with its tip: the board, or the point before the camera.

    `contradiction` is what robot and camera contradict each other by, if they do: an arm with large joint offsets
    does so, and is right.
    """

    arm: Arm
    poses: ImagePoses
    sentences: tuple[str, ...]
    turn_deg: float
    alone_mm: float
    contradiction: InputError | None

    @classmethod
    def of(cls, arm: Arm, poses: ImagePoses, called: Callable[[int], str]) -> _Placed:
        pose = arm.chain.with_tip(np.zeros(3)).pose(poses.readings.angles[poses.rows])
        flange, seen = motion(pose.R_base_tip, pose.tip_in_base), poses.T_camera_board
        found: Interpretation | None = None
        contradiction = None
        try:
            found = interpret(
                _stated_in_mm(flange),
                _stated_in_mm(seen),
                eye_in_hand=poses.is_in_hand,
                called=called,
                remedies=OF_IMAGES,
            )
        except InputError as error:
            contradiction = error
        if found is None:
            A = inverse(flange) if poses.is_in_hand else flange
            start = closed_form(A, seen, sized=False)
            turn, sentences = float("nan"), tuple[str, ...]()
        else:
            A, seen, start, turn, sentences = found.A, found.C, found.start, found.turn_deg, found.sentences
            poses = poses.select(found.rows)
        alone = refined(A, seen, start)
        X, Y = alone.X, alone.Y
        tip = inverse(X) @ np.append(poses.centre, 1.0) if poses.is_in_hand else Y[:, 3]
        equipped = replace(arm, chain=arm.chain.with_tip(tip[:3]))
        return cls(equipped, poses, sentences, turn, float(alone.held_out_mm.mean()), contradiction)


def _stated_in_mm(T: FloatArray) -> Poses:
    return Poses.of_motions(T, "mm")


def _with_size(model: IdentifiedModel, poses: ImagePoses, session: Session, lengths: Lengths | None) -> CommonErrors:
    """Camera and board by images and arm; the model's uncertainty is completed.

    A board that is larger on a larger arm looks the same: only what is expected of the arm's lengths, and what is
    stated of the board, tells the size of both. The evidence of few readings may expect these lengths to be better
    than arms are; so the size is no more certain than usual arms make it, unless a length is known.
    """
    prepared = model.prepare(session, lengths)
    assert isinstance(prepared, PreparedReadings)
    found = CommonErrors.of(model.fit_, prepared)
    found = replace(found, covariance=model.birge_ratio_**2 * found.covariance)
    if poses.images.free[-1] and prepared.lengths is None:
        of_size = {"unit": float(poses.images.units[-1]), "precision": float(poses.images.precision[-1])}
        found, model.fit_ = found.with_usual_size(model.fit_, **of_size)
    return found


@dataclass(frozen=True, eq=False, repr=False)
class ImageFit(HandEyeResult):
    """Where the camera and the board are, the camera's intrinsics and the identified arm.

    Attributes
    ----------
    poses : ImagePoses
        The images that were used, with the poses of the board.
    unknowns, unknowns_covariance : (a,), (a, a) array
        Changes of the stated intrinsics and of the board's size, in the units that `poses.images.names` states.
    """

    poses: ImagePoses
    unknowns: FloatArray
    unknowns_covariance: FloatArray

    @property
    def lens(self) -> Lens:
        """The camera with the intrinsics found."""
        return self.poses.images.values(self.unknowns)[0]

    @property
    def board_scale(self) -> float:
        """True size of the board over the stated one."""
        return self.poses.images.values(self.unknowns)[1]

    @property
    def u_intrinsics(self) -> FloatArray:
        """(p + 1,) standard uncertainties of the intrinsics, and last of the board's size."""
        u = np.zeros(len(self.poses.images.free))
        u[self.poses.images.free] = np.sqrt(np.diag(self.unknowns_covariance)) * self.poses.images.units
        return u

    def save_camera(self, path: str | Path) -> None:
        """Write the intrinsics found as a file of ROS's camera_info."""
        u = ", ".join(f"{name} {value:.2g}" for name, value in zip(self.lens.names, self.u_intrinsics, strict=False))
        with atomic_file(path, read=read_camera) as part:
            part.write_text(camera_yaml(self.lens, notes=(f"u: {u}",)), encoding="utf-8")

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield from super().blocks()
        n, std_px = int(self.poses.images.seen.sum()), self.poses.adjusted.std_px
        yield f"{number_of(n, 'corner')} scatter by {std_px:.2g} px a coordinate about the poses of their images."
        yield TextTable(("of the camera and the board", "value", "u"), self._rows())

    def _rows(self) -> Sequence[Sequence[str]]:
        rows = []
        names, values = [*self.lens.names, "size of the board"], [*self.lens.intrinsics, self.board_scale]
        for name, value, u in zip(names, values, self.u_intrinsics, strict=True):
            digits = max(0, 1 - int(np.floor(np.log10(u)))) if u > 0 else 0
            shown = (format_fixed(value, digits), format_fixed(u, digits)) if u > 0 else (f"{value:.6g}", "as stated")
            rows.append((name, *shown))
        return rows

    def _json(self) -> dict[str, Any]:
        lens, u = self.lens, self.u_intrinsics
        return {
            **super()._json(),
            "intrinsics": dict(zip(lens.names, lens.intrinsics.tolist(), strict=True)),
            "u_intrinsics": dict(zip(lens.names, u[:-1].tolist(), strict=True)),
            "board_scale": self.board_scale,
            "u_board_scale": float(u[-1]),
            "std_px": self.poses.adjusted.std_px,
            "tip_mm": self.poses.centre,
        }
