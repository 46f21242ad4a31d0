"""Where the coordinates of measured points come from: the arm's own software, or a model of truearm.

An arm with a model is another item than the arm with its maker's software: results of one say nothing of the other.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from truearm.errors import InputError
from truearm.files.delimited import quoted_cell
from truearm.files.toml_documents import reject_control_characters
from truearm.typing import BoolArray, IntArray, NameArray

# The columns of a file of points; the last three only where a model computed the coordinates.
FROM, MODEL, MODEL_SHA256, OUTSIDE = "coordinates_from", "model", "model_sha256", "outside_training"
ORIGIN_COLUMNS = (FROM, MODEL, MODEL_SHA256, OUTSIDE)
ARM_SOFTWARE, VIRTUAL_ARM, PROGRAM = "arm software", "virtual arm", "truearm"
# With it begin the serial numbers of virtual arms that have none of their own, see `VirtualArm.serial_number`.
VIRTUAL_SERIAL = "virtual-"
NO_ARM = "no arm was measured"
# Runs of lines that a message lists.
_MOST_RUNS = 6


@dataclass(frozen=True)
class CoordinateOrigin:
    """Where coordinates come from.

    Attributes
    ----------
    source : str
        ``arm software``, ``virtual arm``, or ``truearm`` with its version; empty if it is not stated.
    model, model_sha256 : str
        Of truearm's model: its file or kind, and the SHA-256 of its file.
    n_outside, n_points : int
        Readings outside the range that the model was trained on, of how many.
    """

    source: str = ""
    model: str = ""
    model_sha256: str = ""
    n_outside: int = 0
    n_points: int = 0

    @property
    def is_model(self) -> bool:
        """Whether a model of truearm computed them."""
        return bool(self.model)

    @property
    def is_virtual(self) -> bool:
        """Whether they are simulated."""
        return self.source == VIRTUAL_ARM

    @property
    def computed_with(self) -> str:
        """Program, model and hash, for a sentence; empty without a model."""
        return f"{self.source} with the model {self.model}, SHA-256 {self.model_sha256}" if self.is_model else ""

    @property
    def cells(self) -> dict[str, str]:
        """The cells that are the same in all rows of a file of points, by column."""
        return {FROM: self.source, MODEL: self.model, MODEL_SHA256: self.model_sha256}

    def describe(self) -> str:
        """Describe the origin in a sentence."""
        if self.is_model:
            return (
                f"Coordinates: computed from joint angles by {self.computed_with}; {self.n_outside} of {self.n_points} "
                "readings are outside the range that the model was trained on."
            )
        if self.is_virtual:
            return f"Coordinates: simulated by a virtual arm; {NO_ARM}."
        if self.source:
            return "Coordinates: from the software of the arm, without a model of truearm."
        return "Coordinates: the points do not state where they come from."

    def to_json(self) -> dict[str, object]:
        """The entries for machines."""
        return {
            "from": self.source or None,
            "model": self.model or None,
            "model_sha256": self.model_sha256 or None,
            "n_outside_training": self.n_outside if self.is_model else None,
            "n_points": self.n_points or None,
        }


NOT_STATED = CoordinateOrigin()


def origin_of_cells(
    cells: Mapping[str, NameArray], first_line: int, error: Callable[[str, int, str, str], InputError]
) -> CoordinateOrigin:
    """Return the origin that the rows of a file of points state.

    Parameters
    ----------
    cells : mapping of str to (n,) array of str
        The texts of `ORIGIN_COLUMNS`.
    first_line : int
        Line of the first row in the file.
    error : callable
        Makes an error of problem, row, column and hint.

    Raises
    ------
    InputError
        If rows have different origins, an origin is unknown, or that of a model is not complete.
    """
    for column in ORIGIN_COLUMNS[1:]:
        stray = (cells[column] != "") & ~_of_program(cells[FROM])
        if stray.any():
            hint = f"write {PROGRAM} with its version into {FROM}, or leave this cell empty"
            raise error(f"a model is stated, but {FROM} does not name {PROGRAM}", int(np.argmax(stray)), column, hint)
    named = np.stack([cells[column] for column in ORIGIN_COLUMNS[:3]], axis=1)
    origins, first, which = np.unique(named, axis=0, return_index=True, return_inverse=True)
    if len(origins) > 1:
        problem = "; ".join(
            f"{_short(origins[i])} in {_lines(np.flatnonzero(which.ravel() == i) + first_line)}"
            for i in first.argsort()
        )
        hint = "verify points of one origin: the arm with a model is another item than the arm with its own software"
        raise error(f"the coordinates have {len(origins)} origins: {problem}", int(np.sort(first)[1]), FROM, hint)
    source, model, digest = map(str, origins[0])
    for column, text in zip(ORIGIN_COLUMNS[:3], (source, model, digest), strict=True):
        try:
            reject_control_characters(text)
        except InputError as wrong:
            raise error(wrong.problem, 0, column, wrong.hint or "") from None
    if not _of_program(named[:1, 0])[0]:
        if source not in ("", ARM_SOFTWARE, VIRTUAL_ARM):
            hint = f"write {ARM_SOFTWARE!r}, or {PROGRAM!r} with its version and the model"
            raise error(f"unknown origin of coordinates {quoted_cell(source)}", 0, FROM, hint)
        return CoordinateOrigin(source, n_points=len(named) if source else 0)
    if not model:
        raise error("the model that computed the coordinates is not named", 0, MODEL, "write its name or kind")
    if not re.fullmatch("[0-9a-f]{64}", digest):
        hint = "write that of the model file, as sha256sum prints it"
        raise error(f"expected the SHA-256 of the model file, got {quoted_cell(digest)}", 0, MODEL_SHA256, hint)
    outside = cells[OUTSIDE]
    if (bad := ~np.isin(outside, ("0", "1"))).any():
        row = int(np.argmax(bad))
        hint = "1 where the reading is outside the range that the model was trained on, otherwise 0"
        raise error(f"expected 0 or 1, got {quoted_cell(str(outside[row]))}", row, OUTSIDE, hint)
    return CoordinateOrigin(source, model, digest, int((outside == "1").sum()), len(outside))


def _of_program(sources: NameArray) -> BoolArray:
    return np.asarray(np.char.startswith(sources, f"{PROGRAM} "))


def _short(origin: Iterable[str]) -> str:
    source, model, digest = origin
    return f"{source}, model {model} ({digest[:12]})" if model else source or "not stated"


def _lines(lines: IntArray) -> str:
    """Numbers of lines, of which runs are joined: ``lines 2 to 30, 41``."""
    starts = [int(lines[0]), *(int(b) for a, b in pairwise(lines) if b > a + 1)]
    ends = [*(int(a) for a, b in pairwise(lines) if b > a + 1), int(lines[-1])]
    runs = [f"{a}" if a == b else f"{a} to {b}" for a, b in zip(starts, ends, strict=True)]
    more = f" and {len(runs) - _MOST_RUNS} more runs" if len(runs) > _MOST_RUNS else ""
    return f"line{'s' if len(lines) > 1 else ''} {', '.join(runs[:_MOST_RUNS])}{more}"
