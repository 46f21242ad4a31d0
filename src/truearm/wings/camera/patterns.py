"""What is printed on a board: black rectangles, exact to the edge, for the printer and for rendered images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from truearm.errors import InputError, extra_module
from truearm.typing import BoolArray, FloatArray
from truearm.wings.camera.boards import Board

# Edges nearer than this are one [mm]: far below what is printed, far above rounding.
_SAME_MM = 1e-6


@dataclass(frozen=True, eq=False)
class Pattern:
    """A black and white pattern whose edges are parallel to x and y.

    Frame of the sheet: x to the right, y down, from the pattern's upper left corner.

    Attributes
    ----------
    rectangles : (n, 4) array
        What is black: left, top, right, bottom [mm]; they do not overlap.
    origin_mm : (2,) array
        The origin of the board's frame on the sheet.
    y_is_up : bool
        Whether the board's y axis points up.
    """

    rectangles: FloatArray
    origin_mm: FloatArray
    y_is_up: bool = False

    @cached_property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Where black and white meet along x and y [mm]."""
        return _edges(self.rectangles[:, [0, 2]]), _edges(self.rectangles[:, [1, 3]])

    @cached_property
    def _black(self) -> BoolArray:
        """Which of the cells between the edges are black; around them all is white."""
        x, y = self.edges
        black = np.zeros((len(y) + 1, len(x) + 1), bool)
        left, right = (np.searchsorted(x, self.rectangles[:, k] + _SAME_MM) for k in (0, 2))
        top, bottom = (np.searchsorted(y, self.rectangles[:, k] + _SAME_MM) for k in (1, 3))
        for i0, i1, j0, j1 in zip(left, right, top, bottom, strict=True):
            black[j0:j1, i0:i1] = True
        return black

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height [mm]."""
        return float(self.rectangles[:, 2].max()), float(self.rectangles[:, 3].max())

    def on_sheet(self, points: FloatArray) -> FloatArray:
        """Points (2, n) of the board's frame on the sheet [mm]."""
        sign = np.array([[1.0], [-1.0 if self.y_is_up else 1.0]])
        return np.asarray(self.origin_mm[:, None] + sign * points)

    def is_black(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Whether the sheet is black at places [mm]; outside the pattern it is white."""
        along_x, along_y = self.edges
        return np.asarray(self._black[np.searchsorted(along_y, y), np.searchsorted(along_x, x)])


def pattern_of(board: Board) -> Pattern:
    """The pattern of a board.

    Raises
    ------
    InputError
        If the board is a list of points.
    MissingTool
        If its markers are needed and OpenCV is not installed.
    """
    side, inside = board.side_mm, board.marker_mm
    if board.kind == "chessboard":
        squares = _black_squares(board.across + 1, board.down + 1, side, first_is_black=True)
        return Pattern(squares, np.array([side, side]))
    if board.kind == "charuco":
        # Before OpenCV 4.6 a board with an even number of rows began with a white square.
        first_is_black = not (board.is_legacy and board.down % 2 == 0)
        squares = _black_squares(board.across, board.down, side, first_is_black=first_is_black)
        places = [
            (side * i + (side - inside) / 2, side * j + (side - inside) / 2)
            for j in range(board.down)
            for i in range(board.across)
            if ((i + j) % 2 == 0) != first_is_black
        ]
        return Pattern(np.concatenate([squares, _markers(board.dictionary, places, inside)]), np.zeros(2))
    if board.kind == "aprilgrid":
        height = board.down * side + (board.down - 1) * inside
        places = [
            ((side + inside) * i, height - side - (side + inside) * j)
            for j in range(board.down)
            for i in range(board.across)
        ]
        return Pattern(_markers(board.dictionary, places, side), np.array([0.0, height]), y_is_up=True)
    raise InputError(f"board {board.name} is a list of points: what is printed on it is not known")


def opencv() -> Any:
    """OpenCV, on one thread: images are worked on in parallel.

    Raises
    ------
    MissingTool
        If it is not installed, or too old.
    """
    install = "pip install 'truearm[camera]'"
    found = extra_module("cv2", "boards with markers and corners of images need OpenCV 4.10 or later", install)
    if not hasattr(getattr(found, "aruco", None), "CharucoDetector"):
        raise InputError(f"OpenCV {found.__version__} finds no ChArUco boards", hint=install)
    return found


def opencv_dictionary(name: str) -> Any:
    """OpenCV's dictionary of markers by its name, as ``4x4_50``."""
    cv2 = opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))


def _black_squares(across: int, down: int, side: float, *, first_is_black: bool) -> FloatArray:
    j, i = np.nonzero((np.add.outer(np.arange(down), np.arange(across)) % 2 == 0) == first_is_black)
    corner = side * np.column_stack([i, j])
    return np.hstack([corner, corner + side])


def _markers(dictionary: str, places: list[tuple[float, float]], side: float) -> FloatArray:
    """The black parts of markers 0, 1, .. at their upper left corners."""
    markers = opencv_dictionary(dictionary)
    cells = int(markers.markerSize) + 2
    step, parts = side / cells, []
    for number, place in enumerate(places):
        image = markers.generateImageMarker(number, cells, borderBits=1)
        for j, row in enumerate(np.asarray(image) == 0):
            ends = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]])))
            for start, stop in zip(ends[::2], ends[1::2], strict=True):
                parts.append([start, j, stop, j + 1] * np.array(step) + np.tile(place, 2))
    return np.array(parts)


def _edges(values: FloatArray) -> FloatArray:
    """Sorted values, without those that are equal to rounding."""
    values = np.sort(values, axis=None)
    return np.asarray(values[np.concatenate([[True], np.diff(values) > _SAME_MM])])
