"""Boards of known points: ChArUco, chessboard, AprilTag grid, or a list of points.

A board's text, as ``charuco:8x11,15mm,11mm``, says all that is known of it; `parse_board` reads it.

Frames are those of the makers of each kind. OpenCV: x to the right, y down, z into the board; of a ChArUco board from
the corner of the board, of a chessboard from its first inner corner. AprilTag grid (Kalibr): x to the right, y up, z
out of the board, from the lower left corner of tag 0.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import check_names, quoted_cell, read_columns, read_form
from truearm.typing import FloatArray, IntArray

Kind = Literal["charuco", "chessboard", "aprilgrid", "points"]

# A printer is off by 0.2 %: relative standard uncertainty of the size of a board that nobody measured.
PRINTED_U_SCALE = 0.002
# Squares or tags along a side, and corners of a list: more than any camera resolves.
MOST_ALONG = 100
MOST_CORNERS = 20_000
_MM = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_LENGTH = re.compile(r"(\d{1,7}(?:\.\d{0,20})?|\.\d{1,20})\s*([a-z]*)", re.ASCII)
_GRID = re.compile(r"(\d{1,3})\s*x\s*(\d{1,3})")
_DICTIONARY = re.compile(r"(?:dict_)?((?:4x4|5x5|6x6|7x7)_(?:50|100|250|1000)|apriltag_(?:16h5|25h9|36h10|36h11))")
# Markers of OpenCV's predefined dictionaries of 4 x 4 cells: the smallest that has enough is the default.
_SIZES = (50, 100, 250, 1000)
FORMS = {
    "charuco": "charuco:8x11,15mm,11mm (squares across x down, side of a square, side of a marker)",
    "chessboard": "chessboard:9x6,25mm (inner corners across x down, side of a square)",
    "aprilgrid": "aprilgrid:6x6,88mm,26.4mm (tags across x up, side of a tag, gap between tags)",
    "points": "points:FILE.csv (columns corner, x_mm, y_mm, z_mm)",
}


@dataclass(frozen=True, eq=False)
class Board:
    """A board of known points.

    Attributes
    ----------
    name : str
        Its text, unless another name is stated.
    kind : {"charuco", "chessboard", "aprilgrid", "points"}
    corners : (n,) int array
        Numbers of the corners, as detectors give them.
    points : (n, 3) array
        Their positions in the board's frame [mm].
    u_scale : float
        Relative standard uncertainty of the board's size.
    across, down : int
        Squares, inner corners or tags along the two sides; 0 of a list of points.
    side_mm : float
        Side of a square, or of a tag [mm].
    marker_mm : float
        Of a ChArUco board the side of a marker, of an AprilTag grid the gap between two tags [mm].
    dictionary : str
        OpenCV's name of the markers; empty of a chessboard.
    is_legacy : bool
        Of a ChArUco board: whether its pattern is that of OpenCV before 4.6, which begins with a marker where the
        number of rows is even.
    """

    name: str
    kind: Kind
    corners: IntArray
    points: FloatArray
    u_scale: float = PRINTED_U_SCALE
    across: int = 0
    down: int = 0
    side_mm: float = 0.0
    marker_mm: float = 0.0
    dictionary: str = ""
    is_legacy: bool = False

    def __len__(self) -> int:
        return len(self.corners)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the pattern, or of the box that holds a list of points [mm]."""
        if self.kind == "charuco":
            return self.across * self.side_mm, self.down * self.side_mm
        if self.kind == "chessboard":
            return (self.across + 1) * self.side_mm, (self.down + 1) * self.side_mm
        width, height = np.ptp(self.points[:, :2], axis=0).tolist()
        return width, height

    @property
    def is_flat(self) -> bool:
        """Whether all points lie in the plane z = 0."""
        return not self.points[:, 2].any()

    @property
    def has_two_readings(self) -> bool:
        """Whether half a turn maps the pattern onto itself, colours and all, so that no image tells which is which."""
        return self.kind == "chessboard" and (self.across + self.down) % 2 == 0

    def points_of(self, corners: IntArray) -> FloatArray:
        """Positions (m, 3) of corners by their numbers [mm].

        Raises
        ------
        InputError
            If the board has no such corner.
        """
        order = np.argsort(self.corners)
        places = order[np.searchsorted(self.corners, corners, sorter=order).clip(max=len(self) - 1)]
        if (missing := self.corners[places] != corners).any():
            raise InputError(
                f"board {self.name} has no corner {int(np.asarray(corners)[missing][0])}; its {len(self)} corners are "
                f"{self.corners.min()} to {self.corners.max()}"
            )
        found: FloatArray = self.points[places]
        return found

    @property
    def turned(self) -> Board | None:
        """The board with the numbers along its sides exchanged; None of a list of points and of equal ones."""
        if self.across == self.down:
            return None
        first, sign, rest = self.name.partition(f"{self.across}x{self.down}")
        return parse_board(f"{first}{self.down}x{self.across}{rest}") if sign else None


def charuco(
    across: int,
    down: int,
    side_mm: float,
    marker_mm: float,
    *,
    dictionary: str | None = None,
    is_legacy: bool = False,
    u_scale: float = PRINTED_U_SCALE,
) -> Board:
    """A ChArUco board of ``across x down`` squares; corner k is at ``(1 + k % (across - 1), 1 + k // (across - 1))``.

    Raises
    ------
    InputError
        If it has fewer than 2 x 2 squares, or its markers do not fit into the squares or the dictionary.
    """
    _check_grid(across, down, least=2)
    if not marker_mm < side_mm:
        raise InputError(
            f"expected markers smaller than the squares, got {marker_mm:g} mm in {side_mm:g} mm",
            hint="the side of a square first: charuco:8x11,15mm,11mm",
        )
    n_markers = across * down // 2
    if dictionary is None:
        dictionary = f"4x4_{next((n for n in _SIZES if n >= n_markers), _SIZES[-1])}"
    if n_markers > dictionary_size(dictionary):
        raise InputError(f"the board needs {n_markers} markers; dictionary {dictionary} has fewer")
    points = side_mm * (1.0 + _grid(across - 1, down - 1))
    name = f"charuco:{across}x{down},{side_mm:g}mm,{marker_mm:g}mm,{dictionary}" + ",legacy" * is_legacy
    return Board(
        name,
        "charuco",
        *_numbered(points),
        u_scale,
        across=across,
        down=down,
        side_mm=side_mm,
        marker_mm=marker_mm,
        dictionary=dictionary,
        is_legacy=is_legacy,
    )


def chessboard(across: int, down: int, side_mm: float, *, u_scale: float = PRINTED_U_SCALE) -> Board:
    """A chessboard with ``across x down`` inner corners, numbered row by row.

    Raises
    ------
    InputError
        If it has fewer than 3 x 3 inner corners, the least that OpenCV finds.
    """
    _check_grid(across, down, least=3)
    name = f"chessboard:{across}x{down},{side_mm:g}mm"
    corners, points = _numbered(side_mm * _grid(across, down))
    return Board(name, "chessboard", corners, points, u_scale, across=across, down=down, side_mm=side_mm)


def aprilgrid(
    across: int,
    up: int,
    tag_mm: float,
    gap_mm: float,
    *,
    dictionary: str | None = None,
    u_scale: float = PRINTED_U_SCALE,
) -> Board:
    """An AprilTag grid as Kalibr has it: tags row by row from below, corner 4 t + i of tag t, i counterclockwise.

    Raises
    ------
    InputError
        If it has no tag, or more than its dictionary.
    """
    _check_grid(across, up, least=1)
    dictionary = dictionary or "apriltag_36h11"
    if across * up > dictionary_size(dictionary):
        raise InputError(f"the board needs {across * up} tags; dictionary {dictionary} has fewer")
    lower_left = (tag_mm + gap_mm) * _grid(across, up)
    points = lower_left[:, None] + tag_mm * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    name = f"aprilgrid:{across}x{up},{tag_mm:g}mm,{gap_mm:g}mm" + f",{dictionary}" * (dictionary != "apriltag_36h11")
    return Board(
        name,
        "aprilgrid",
        *_numbered(points.reshape(-1, 2)),
        u_scale,
        across=across,
        down=up,
        side_mm=tag_mm,
        marker_mm=gap_mm,
        dictionary=dictionary,
    )


def read_points(path: str | Path, *, u_scale: float = PRINTED_U_SCALE) -> Board:
    """Read a board of any points: CSV with the columns corner, x_mm, y_mm, z_mm.

    Raises
    ------
    InputError
        If the file is no such table, a corner is no whole number or stands there twice, or there are fewer than four.
    """
    sheet = read_form(Path(path))
    needed = ("corner", "x_mm", "y_mm", "z_mm")
    check_names(sheet, needed, ())
    numbers, _ = read_columns(sheet, [sheet.names.index(name) for name in needed])
    corners = whole_numbers(numbers[:, 0], "corner", sheet.error)
    if len(corners) > MOST_CORNERS:
        raise sheet.error(f"expected at most {MOST_CORNERS} corners, got {len(corners)}")
    if len(corners) < 4:
        raise sheet.error(f"expected at least 4 corners, got {len(corners)}")
    unique, first = np.unique(corners, return_index=True)
    if len(unique) < len(corners):
        row = int(np.setdiff1d(np.arange(len(corners)), first)[0])
        raise sheet.error(f"corner {corners[row]} stands here twice", row, column="corner")
    return Board(f"points:{Path(path).name}", "points", corners, numbers[:, 1:], u_scale)


def parse_board(text: str, *, folder: str | Path = ".") -> Board:
    """Read a board's text.

    Parameters
    ----------
    text : str
        ``charuco:8x11,15mm,11mm``, ``chessboard:9x6,25mm``, ``aprilgrid:6x6,88mm,26.4mm`` or ``points:FILE.csv``;
        behind it ``u=0.05%`` (standard uncertainty of the board's size, 0.2 % by default), the dictionary of the
        markers as ``5x5_100``, and ``legacy`` for a ChArUco board of OpenCV before 4.6.
    folder : path
        In which the file of points is.

    Raises
    ------
    InputError
        If the text is another, a length has no unit, or there is no such board.

    Examples
    --------
    >>> from truearm.wings.camera.boards import parse_board
    >>> board = parse_board("charuco:8x11,15mm,11mm")
    >>> len(board), board.points[0].tolist()
    (70, [15.0, 15.0, 0.0])
    """
    kind, _, rest = text.strip().partition(":")
    kind = kind.strip().lower()
    if kind not in FORMS or not rest.strip():
        raise InputError(f"expected a board, got {quoted_cell(text)}", hint="; ".join(FORMS.values()))
    parts = [part.strip() for part in rest.split(",")]
    if kind == "points":
        u_scale, others, _ = _options(parts[1:], kind)
        _refuse_dictionary(others, kind)
        return replace(read_points(Path(folder) / parts[0], u_scale=u_scale), name=text.strip())
    n_lengths = 1 if kind == "chessboard" else 2
    grid = _GRID.fullmatch(parts[0].lower())
    if grid is None or len(parts) < 1 + n_lengths:
        raise InputError(f"expected {FORMS[kind]}, got {quoted_cell(text)}")
    across, down = int(grid[1]), int(grid[2])
    lengths = [_length_mm(part, kind) for part in parts[1 : 1 + n_lengths]]
    u_scale, dictionary, is_legacy = _options(parts[1 + n_lengths :], kind)
    if kind == "chessboard":
        _refuse_dictionary(dictionary, kind)
        board = chessboard(across, down, lengths[0], u_scale=u_scale)
    elif kind == "aprilgrid":
        board = aprilgrid(across, down, lengths[0], lengths[1], dictionary=dictionary, u_scale=u_scale)
    else:
        board = charuco(across, down, *lengths, dictionary=dictionary, is_legacy=is_legacy, u_scale=u_scale)
    return replace(board, name=text.strip())


def named_board(text: str, *, folder: str | Path = ".") -> Board:
    """Read ``NAME=TEXT``, a board by a name of its own, or the text alone; errors as of `parse_board`."""
    name, sign, spec = text.partition("=")
    if sign and ":" not in name:
        return replace(parse_board(spec, folder=folder), name=name.strip())
    return parse_board(text, folder=folder)


def dictionary_size(dictionary: str) -> int:
    """Number of markers of one of OpenCV's predefined dictionaries, by its name as ``4x4_50``."""
    of_tags = {"apriltag_16h5": 30, "apriltag_25h9": 35, "apriltag_36h10": 2320, "apriltag_36h11": 587}
    return of_tags.get(dictionary) or int(dictionary.rpartition("_")[2])


def whole_numbers(values: FloatArray, column: str, error: Callable[..., InputError]) -> IntArray:
    """Numbers of a column as whole ones, not negative; `error` is that of its `Sheet`.

    Raises
    ------
    InputError
        If one is negative, has decimals or has more than nine digits.
    """
    bad = (values != np.round(values)) | (values < 0) | (values > 999_999_999)
    if bad.any():
        row = int(np.argmax(bad))
        raise error(f"expected a whole number, got {values[row]:g}", row, column=column)
    return values.astype(np.intp)


def _numbered(flat: FloatArray) -> tuple[IntArray, FloatArray]:
    """Numbers of corners (n,) from 0, and their positions (n, 3) from those in the plane (n, 2)."""
    return np.arange(len(flat)), np.column_stack([flat, np.zeros(len(flat))])


def _grid(across: int, down: int) -> FloatArray:
    """Columns and rows (n, 2) of a grid, row by row."""
    k = np.arange(across * down)
    return np.column_stack([k % across, k // across]).astype(float)


def _check_grid(across: int, down: int, *, least: int) -> None:
    if not (least <= across <= MOST_ALONG and least <= down <= MOST_ALONG):
        raise InputError(f"expected {least} to {MOST_ALONG} along each side of the board, got {across} x {down}")


def _length_mm(text: str, kind: str) -> float:
    found = _LENGTH.fullmatch(text.lower())
    if found is None:
        raise InputError(f"expected a length as 15mm, got {quoted_cell(text)}", hint=FORMS[kind])
    if found[2] not in _MM:
        got = f"unit {found[2]!r}" if found[2] else "no unit"
        raise InputError(
            f"expected a length with its unit ({', '.join(_MM)}), got {quoted_cell(text)} with {got}",
            hint=f"{found[1]}mm",
        )
    length = round(float(found[1]) * _MM[found[2]], 9)
    if not 0.1 <= length <= 5000:
        raise InputError(f"expected a length from 0.1 mm to 5 m, got {quoted_cell(text)}")
    return length


def _options(parts: list[str], kind: str) -> tuple[float, str | None, bool]:
    """Standard uncertainty of the scale, dictionary and whether the pattern is the legacy one."""
    u_scale, dictionary, is_legacy = PRINTED_U_SCALE, None, False
    for part in parts:
        word = part.lower()
        if word.startswith("u="):
            u_scale = _share(part)
        elif found := _DICTIONARY.fullmatch(word):
            dictionary = found[1]
        elif word == "legacy" and kind == "charuco":
            is_legacy = True
        else:
            raise InputError(
                f"expected u=0.05%, a dictionary as 4x4_50 or legacy behind the board's lengths, "
                f"got {quoted_cell(part)}",
                hint=FORMS[kind],
            )
    return u_scale, dictionary, is_legacy


def _share(part: str) -> float:
    found = re.fullmatch(r"u=\s*(\d{1,3}(?:\.\d{0,9})?)\s*%", part, re.IGNORECASE)
    if found is None or float(found[1]) > 10:
        raise InputError(f"expected the scale's standard uncertainty up to 10 %, as u=0.05%, got {quoted_cell(part)}")
    return float(found[1]) / 100


def _refuse_dictionary(dictionary: str | None, kind: str) -> None:
    if dictionary is not None:
        raise InputError(f"a board of kind {kind} has no markers, got dictionary {dictionary}")
