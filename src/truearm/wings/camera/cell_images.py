"""Images of a robot cell from tables of pixels: which camera sees which board at which reading of the arm."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from truearm.errors import InputError
from truearm.findings import Finding
from truearm.identification.references.prepared_readings import MIN_ROWS
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.verbs.record import number_of
from truearm.wings.camera.boards import Board, parse_board
from truearm.wings.camera.images import LEAST_CORNERS, Images, guess_lens, homography_misfit
from truearm.wings.camera.lenses import Lens, read_camera
from truearm.wings.camera.observations import PixelObservations, read_pixels

BoardLike: TypeAlias = Board | str
CameraLike: TypeAlias = Lens | str | Path
PixelsLike: TypeAlias = PixelObservations | str | Path
# NAME=TEXT; the text of a board may have an equals sign itself, behind its colon.
_NAMED = re.compile(r"([^:=]+)=(.+)")
# What gives two boards of one text two names.
NAMING = "truearm corners --board NAME=TEXT"
# Corners that lie as those of a board are this share of their spread or less from a homography of it, with distortion.
LAID_OUT = 0.2


def by_name(words: Sequence[str]) -> dict[str, str]:
    """What several options state, ``NAME=TEXT`` each, by its name; of one without a name by an empty one."""
    named = {}
    for word in words:
        match = _NAMED.fullmatch(word)
        named[match[1] if match else ""] = match[2] if match else word
    if len(named) < len(words):
        hint = "NAME=TEXT each, with the names in the table of pixels"
        raise InputError(f"expected a name of its own before each of {len(words)}, got {', '.join(words)}", hint=hint)
    return named


@dataclass(frozen=True, eq=False)
class CellImages:
    """Images of boards, each of one reading.

    Attributes
    ----------
    readings : Session
        One with several images stands there as often.
    rows : (m,) int array
        The readings of the images.
    images : Images
    numbers : (m,) int array
        Of these readings in the session, counted from 1.
    names : tuple of str
        Of the images.
    in_hand : (k,) bool array
        Whether each camera is on the flange.
    boards : mapping of str to Board
        By their names in the tables.
    lenses : mapping of str to Lens or None
        Of the cameras by their names there, as stated.
    sizes_px : mapping of str to (int, int)
        Width and height of the images of a camera, where they are known.
    n_images : int
        That the tables have, also those that show too little.
    findings : tuple of Finding
        What is to be said of images that are ignored.
    """

    readings: Session
    rows: IntArray
    images: Images
    numbers: IntArray
    names: tuple[str, ...]
    in_hand: BoolArray
    boards: Mapping[str, Board]
    lenses: Mapping[str, Lens | None]
    sizes_px: Mapping[str, tuple[int, int]]
    n_images: int
    findings: tuple[Finding, ...]

    def called(self, place: int) -> str:
        """What a message calls an image: ``image_05.png (line 6)``."""
        name, reading = self.names[place], self.readings.called(int(self.rows[place]))
        return reading if name == f"reading {self.numbers[place]}" else f"{name} ({reading})"

    def seen_by(self, place: int) -> str:
        """What a message about the images of a camera and a board begins with where there are several."""
        of = self.images
        return _said_of(of, (of.cameras[of.camera[place]],), (of.boards[of.board[place]],))

    @classmethod
    def of(
        cls,
        readings: Session,
        pixels: PixelsLike | Sequence[PixelsLike],
        board: BoardLike | Mapping[str, BoardLike],
        camera: CameraLike | Mapping[str, CameraLike] | None,
        u_camera_px: float | None,
        eye_in_hand: bool | Sequence[str],
    ) -> CellImages:
        """What `fit_images` is given.

        Raises
        ------
        InputError
            If the tables name other cameras or boards than are stated, or there are several images of a reading by one
            camera, or too few images.
        """
        seen = _table(readings, pixels)
        boards = _boards(seen, board)
        lenses = _lenses(seen, camera)
        in_hand = _in_hand(list(lenses), eye_in_hand, seen)
        return _images(readings, seen, boards, lenses, u_camera_px, in_hand, MIN_ROWS)

    def others(self, readings: Session, pixels: PixelsLike | Sequence[PixelsLike]) -> CellImages:
        """Other images by these cameras.

        Raises
        ------
        InputError
            As `of`, and if they are of another camera or board, or at joints of these images.
        """
        seen = _table(readings, pixels)
        for what, known in (("camera", self.lenses), ("board", self.boards)):
            names = [*known, *(np.unique(getattr(seen, what)).tolist() if len(known) > 1 else known)]
            _check_names(seen, what, list(known), dict.fromkeys(names), "images of the cameras and boards of the fit")
        if len(self.lenses) == 1:
            (name,), sizes = self.lenses, [*seen.sizes_px.values()]
            of_camera = dict(zip(self.lenses, sizes, strict=False))
            seen = replace(seen, camera=np.full(len(seen), name), sizes_px=of_camera)
        if len(self.boards) == 1:
            seen = replace(seen, board=np.full(len(seen), next(iter(self.boards))))
        for name, size in seen.sizes_px.items():
            if (known_px := self.sizes_px.get(name, size)) != size:
                here, there = (f"{width} x {height} px" for width, height in (size, known_px))
                problem = f"the images of the test are {here}, those of the fit {there}"
                hint = "images of one camera at one resolution, uncropped"
                raise InputError(problem, file=seen.file, column="width_px", hint=hint)
        lenses = dict(zip(self.lenses, self.images.lenses, strict=True))
        found = _images(readings, seen, self.boards, lenses, 0.0, self.in_hand, 1)
        used = {row.tobytes() for row in self.readings.angles[self.rows]}
        if again := [i for i, row in enumerate(found.readings.angles[found.rows]) if row.tobytes() in used]:
            problem = f"the test has {number_of(len(again), 'image')} at joints of the fit: {found.called(again[0])}"
            raise InputError(problem, hint="images at poses that are not in the fit")
        return found


def _table(readings: Session, pixels: PixelsLike | Sequence[PixelsLike]) -> PixelObservations:
    """All tables in one, of these readings."""
    parts = [pixels] if isinstance(pixels, PixelsLike) else pixels
    tables = [read_pixels(one) if isinstance(one, str | Path) else one for one in parts]
    seen = tables[0] if len(tables) == 1 else PixelObservations.joined(tables)
    seen.check_readings(len(readings))
    return seen


def _boards(seen: PixelObservations, stated: BoardLike | Mapping[str, BoardLike]) -> dict[str, Board]:
    """Every board of the table as it is stated."""
    given = stated if isinstance(stated, Mapping) else {"": stated}
    known = {name: parse_board(one) if isinstance(one, str) else one for name, one in given.items()}
    names = np.unique(seen.board).tolist()
    if "" in known and len(known) == len(names) == 1:
        return {names[0]: _checked_board(seen, names[0], known[""])}
    _check_names(seen, "board", names, known, f"--board NAME=TEXT for each name in the tables, {NAMING} writes them")
    return {name: _checked_board(seen, name, known[name]) for name in names}


def _lenses(seen: PixelObservations, stated: CameraLike | Mapping[str, CameraLike] | None) -> dict[str, Lens | None]:
    """Every camera of the table, with its intrinsics where they are stated."""
    given = stated if isinstance(stated, Mapping) else {} if stated is None else {"": stated}
    known = {name: read_camera(one) if isinstance(one, str | Path) else one for name, one in given.items()}
    names = np.unique(seen.camera).tolist()
    if "" in known and len(known) == len(names) == 1:
        known = {names[0]: known[""]}
    _check_names(seen, "camera", names, {**dict.fromkeys(names), **known}, "--camera NAME=FILE")
    for name, lens in known.items():
        size = seen.sizes_px.get(name)
        if size is not None and size != (lens.width, lens.height):
            raise InputError(
                f"the images are {size[0]} x {size[1]} px, the camera's file is of {lens.width} x {lens.height} px",
                file=seen.file,
                hint="the intrinsics of this resolution, or none: they are found with the arm",
            )
    return {name: known.get(name) for name in names}


def _check_names(seen: PixelObservations, what: str, names: list[str], stated: Mapping[str, object], hint: str) -> None:
    """Refuse names that are stated and not in the table, or the other way round."""
    for here, there, text in (
        (stated, names, f"{what} {{}} is stated, and the pixels are of {', '.join(names)}"),
        (names, stated, f"the pixels are of {what} {{}} too, which is not stated"),
    ):
        if missing := [name for name in here if name not in there]:
            said = text.format(repr(missing[0]) if missing[0] else "without a name")
            raise InputError(said, file=seen.file, column=what, hint=hint)


def _checked_board(seen: PixelObservations, name: str, board: Board) -> Board:
    """Refuse pixels of a board of another kind or number of squares; its lengths may have been measured since."""
    board.points_of(seen.corner[seen.board == name])  # which refuses corners that it has not
    try:
        other = parse_board(name, folder=seen.file.parent if seen.file else ".")
    except InputError:
        return board  # a name of another detector
    if (other.kind, other.across, other.down) != (board.kind, board.across, board.down):
        raise InputError(
            f"the corners are those of board {other.name}, not of {board.name}",
            file=seen.file,
            column="board",
            hint=f"--board {other.name}, or the pixels of the other board",
        )
    return board


def _in_hand(cameras: list[str], stated: bool | Sequence[str], seen: PixelObservations) -> BoolArray:
    """Which cameras are on the flange; a board is on the flange for all cameras that see it, or stands."""
    named = cameras if stated is True else [] if stated is False else stated
    _check_names(seen, "camera", cameras, {**dict.fromkeys(cameras), **dict.fromkeys(named)}, "--on-flange NAME")
    on_flange = np.isin(seen.camera, named)
    for board in np.unique(seen.board).tolist():
        mounts = [np.unique(seen.camera[(seen.board == board) & of]).tolist() for of in (on_flange, ~on_flange)]
        if all(mounts):
            raise InputError(
                f"board {board} is seen by camera {mounts[0][0]} on the flange and by {mounts[1][0]}, which stands: a "
                "board stands, or is on the flange",
                file=seen.file,
                column="board",
                hint=f"give two boards two names ({NAMING}), or correct --on-flange",
            )
    return np.isin(cameras, named)


def _images(
    readings: Session,
    seen: PixelObservations,
    boards: Mapping[str, Board],
    lenses: Mapping[str, Lens | None],
    u_camera_px: float | None,
    in_hand: BoolArray,
    least: int,
) -> CellImages:
    images_by_name = np.unique(seen.image, return_inverse=True)
    of_camera, of_board = np.searchsorted(list(lenses), seen.camera), np.searchsorted(list(boards), seen.board)
    key = np.stack([seen.reading, of_camera, images_by_name[1], of_board])
    (reading, camera, image, board), which = np.unique(key, axis=1, return_inverse=True)
    taken = np.unique(np.stack([reading, camera, image]), axis=1)
    again = (np.diff(taken[:2], axis=1) == 0).all(axis=0)
    if again.any():
        whose = f" by camera {list(lenses)[taken[1, 1:][again][0]]}" if len(lenses) > 1 else ""
        problem = f"expected one image a reading{whose}, got several of reading {taken[0, 1:][again][0]}"
        raise InputError(problem, file=seen.file, column="image")
    pixels = np.full((len(reading), 2, max(map(len, boards.values()))), np.nan)
    for k, one in enumerate(boards.values()):
        rows = of_board == k
        order = np.argsort(one.corners)
        where = order[np.searchsorted(one.corners, seen.corner[rows], sorter=order)]
        pixels[which.reshape(-1)[rows], :, where] = seen.pixels[rows]
    cameras = list(lenses) if len(lenses) > 1 else ["camera"]
    names = list(boards) if len(boards) > 1 else ["board"]
    if both := {*cameras} & {*names}:
        raise InputError(f"{min(both)!r} is the name of a camera and of a board", file=seen.file, column="board")
    copied = _copies(pixels, readings.angles[reading - 1], camera)
    shows, findings = _enough(pixels, copied, camera, board, cameras, names, seen, least)
    points = tuple(one.points - one.points.mean(axis=0) for one in boards.values())
    index = _index_of_readings(reading[shows] - 1, len(readings))
    rows = np.flatnonzero(np.isin(index, reading[shows] - 1))
    images = Images(
        points,
        pixels[shows],
        (),
        (),
        np.array([one.u_scale for one in boards.values()]),
        camera[shows],
        board[shows],
        tuple(cameras),
        tuple(names),
    )
    _check_layout(images, list(boards.values()), seen)
    flat = [one.is_flat for one in boards.values()]
    found = [_lens(images, k, lens, u_camera_px, seen.sizes_px.get(name), flat)
             for k, (name, lens) in enumerate(lenses.items())]  # fmt: skip
    images = replace(images, lenses=tuple(lens for lens, _ in found), u_intrinsics=tuple(u for _, u in found))
    of_rows = readings if len(index) == len(readings) else readings.rows(index)
    chosen = tuple(images_by_name[0][image[shows]].tolist())
    return CellImages(
        of_rows,
        rows,
        images,
        reading[shows],
        chosen,
        in_hand,
        boards,
        lenses,
        seen.sizes_px,
        taken.shape[1],
        tuple(findings),
    )


def _copies(pixels: FloatArray, angles: FloatArray, camera: IntArray) -> BoolArray:
    """Images (m,) with every digit of an earlier one, at its joints: of one file twice, which tells nothing new."""
    keys = [(seen.tobytes(), at.tobytes(), by) for seen, at, by in zip(pixels, angles, camera.tolist(), strict=True)]
    first = {key: place for place, key in reversed([*enumerate(keys)])}
    return np.array([first[key] < place for place, key in enumerate(keys)])


def _index_of_readings(of_images: IntArray, n: int) -> IntArray:
    """Readings, each as often as it has images, and once without one."""
    return np.repeat(np.arange(n), np.maximum(np.bincount(of_images, minlength=n), 1))


def _enough(
    pixels: FloatArray,
    copied: BoolArray,
    camera: IntArray,
    board: IntArray,
    cameras: list[str],
    boards: list[str],
    seen: PixelObservations,
    least: int,
) -> tuple[BoolArray, list[Finding]]:
    """The images that show a board, of cameras that see it often enough to know where they are."""
    shows = (~np.isnan(pixels[:, 0])).sum(axis=1) >= LEAST_CORNERS
    findings = []
    if n := int((~shows).sum()):
        said = f"{number_of(n, 'image')} of {len(shows)} show fewer than {LEAST_CORNERS} corners of the board; ignored."
        findings.append(Finding("hand-eye", said, {"n": n}))
    if n := int((shows & copied).sum()):
        said = f"{number_of(n, 'image')} of {len(shows)} are copies of others, with their joints; ignored."
        findings.append(Finding("hand-eye", said, {"n": n}))
    shows &= ~copied
    several = len(cameras) > 1 or len(boards) > 1
    for a, b in np.unique(np.stack([camera, board], axis=1), axis=0).tolist():
        own = (camera == a) & (board == b)
        if several and 0 < (n := int((shows & own).sum())) < least:
            said = f"Camera {cameras[a]} sees board {boards[b]} in {number_of(n, 'image')} only; ignored."
            findings.append(Finding("hand-eye", said, {"n": n}))
            shows &= ~own
    for kind, names, of, text in (
        ("camera", cameras, camera, f"images by camera {{}} that show a board (one board in {least} of them)"),
        ("board", boards, board, "images that show board {} by one camera"),
    ):
        for k, name in enumerate(names):
            if (n := int((shows & (of == k)).sum())) < least > 1 or not shows.any():
                what = text.format(name) if several else "images that show the board"
                problem = f"expected {least} or more {what}, got {n}"
                hint = f"take more images, or remove the rows of this {kind}" if several else None
                raise InputError(problem, file=seen.file, column=kind if several else None, hint=hint)
    return shows, findings


def _said_of(images: Images, cameras: Sequence[str] = (), boards: Sequence[str] = ()) -> str:
    """Camera and board that a message begins with, of those of which there are several."""
    named = [f"camera {name}" for name in cameras if len(images.cameras) > 1]
    named += [f"board {name}" for name in boards if len(images.boards) > 1]
    return f"{', '.join(named)}: " if named else ""


def _check_layout(images: Images, boards: Sequence[Board], seen: PixelObservations) -> None:
    """Refuse corners that do not lie as those of their flat board: it has other numbers of squares."""
    for k, board in enumerate(boards):
        pixels = images.pixels[images.board == k]
        if not board.is_flat or homography_misfit(images.corners[k], pixels) <= LAID_OUT:
            continue
        turned = board.turned
        problem = f"the corners do not lie in the images as those of board {board.name}"
        hint = "the board that the images show, in --board"
        if turned is not None and homography_misfit(turned.points, pixels) <= LAID_OUT:
            problem += f", but as those of {turned.name}"
            hint = f"--board {f'{images.boards[k]}=' * (len(boards) > 1)}{turned.name}"
        raise InputError(_said_of(images, boards=(images.boards[k],)) + problem, file=seen.file, hint=hint)


def _lens(
    images: Images, k: int, stated: Lens | None, u_px: float | None, size: tuple[int, int] | None, is_flat: list[bool]
) -> tuple[Lens, FloatArray]:
    """The intrinsics of a camera as stated, or a first guess, and their standard uncertainties."""
    rows = images.camera == k
    if stated is not None:
        u = np.full(len(stated.intrinsics), np.inf if u_px is None else u_px)
        if u_px:
            u[4:] = np.inf
        return stated, u
    if not all(is_flat[b] for b in np.unique(images.board[rows])):
        raise InputError("a board that is not flat needs the camera's intrinsics", hint="--camera FILE")
    pixels = images.pixels[rows]
    at_least = (np.ceil(np.nanmax(pixels, axis=(0, 2))).astype(int) + 1).tolist()
    try:
        lens = guess_lens(images.corners_of_images[rows], pixels, size or at_least)
    except InputError as error:
        raise InputError(f"{_said_of(images, (images.cameras[k],))}{error.problem}", hint=error.hint) from None
    return lens, np.full(len(lens.intrinsics), np.inf)
