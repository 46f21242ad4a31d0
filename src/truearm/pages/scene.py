"""Interactive scenes of a page: points, lines and a mechanism in space that a reader turns, points at and selects.

A scene is drawn by scripts of our own (``scene_*.mjs``) on a canvas. They are part of the page, which names them by
their SHA-256 in its content security policy and permits no other. The numbers stand in the page as JSON. Without
scripts, and on paper, the page shows the still figure of the scene.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.number_format import format_number
from truearm.pages.arrays import finite_array
from truearm.pages.plotting import Figure
from truearm.typing import BoolArray, FloatArray, IntArray

# Every later one imports from those before it.
SCRIPTS = ("space", "cloud", "paint", "plots", "controls", "view")
# More squares than this hide each other, and the page has to stay below 3 MB.
MOST_POINTS = 12_000
# Share of the points that are kept for their large values where there are too many.
_LARGEST_SHARE = 0.05
# A few outliers, beyond this quantile, must not take the whole scale of colours.
_USUAL_PERCENT, _FAR = 99.0, 1.5
_STEPS = 2000  # of a column's span, at least: finer differences are not visible


@dataclass(frozen=True, eq=False)
class PointColumn:
    """A number that every point of a cloud has.

    Parameters
    ----------
    name, unit : str
    values : (n,) array
        In this unit.
    top : float, optional
        Upper end of the colours, such as a limit; by default that of the usual values.
    """

    name: str
    unit: str
    values: npt.ArrayLike
    top: float | None = None

    def checked(self, n: int) -> FloatArray:
        """The values as (n,) array.

        Raises
        ------
        InputError
            If there are not n of them, or one is not finite.
        """
        values = finite_array(self.values, f"values of {self.name!r}")
        if len(values) != n:
            raise InputError(f"expected {n} values of {self.name!r}, one a point, got {len(values)}")
        return values


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in space with what is known of each.

    Parameters
    ----------
    points : (n, 3) array
        In the unit of the scene.
    names : sequence of str
        Of the n points.
    values : sequence of PointColumn
        Not negative; one of them colours the points, the reader chooses which.
    axes : sequence of PointColumn
        Each has a plot of the value against it, in which a range can be selected.
    notes : sequence of PointColumn
        Further numbers that are shown of a single point.
    noun : str
        What a point is, for "3 points selected".
    shown : int
        Which of the values colours the points at first.
    spans : mapping of int to (2, 3) array
        Points, by number, that stand for something between two ends: a line in the colour of the point joins them.
    marked : mapping of int to str
        Points, by number, that have a ring and this label.
    """

    points: npt.ArrayLike
    names: Sequence[str]
    values: Sequence[PointColumn]
    axes: Sequence[PointColumn] = ()
    notes: Sequence[PointColumn] = ()
    noun: str = "point"
    shown: int = 0
    spans: Mapping[int, npt.ArrayLike] = field(default_factory=dict)
    marked: Mapping[int, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The cloud for the script: whole numbers of steps, of at most `MOST_POINTS` points.

        Raises
        ------
        InputError
            If the columns do not fit the points, a number is not finite, a value is negative, or there is no point of
            the number of a span or a mark.
        """
        points = finite_array(self.points, "points", width=3)
        n = len(points)
        if len(self.names) != n or not self.values or not 0 <= self.shown < len(self.values):
            raise InputError(f"expected {n} names of points and at least one value, got {len(self.names)} names")
        values = [column.checked(n) for column in self.values]
        for column, numbers in zip(self.values, values, strict=True):
            if numbers.min() < 0:
                raise InputError(f"expected values of {column.name!r} of zero or more, got {numbers.min():g}")
        if strange := sorted({*self.spans, *self.marked} - {*range(n)}):
            raise InputError(f"expected spans and marks of the points 0 to {n - 1}, got one of point {strange[0]}")
        kept = np.union1d(thinned(values), np.array(sorted(self.marked), dtype=int))
        place = {number: i for i, number in enumerate(kept.tolist())}
        return {
            "noun": self.noun,
            "total": n,
            "shown": self.shown,
            "names": _numbered([str(self.names[i]) for i in kept.tolist()]),
            "at": [_steps(points[kept, axis]) for axis in range(3)],
            "values": [
                {
                    "name": column.name,
                    "unit": column.unit,
                    **_steps(numbers[kept], fine=True),
                    **_top(numbers, column.top),
                }
                for column, numbers in zip(self.values, values, strict=True)
            ],
            "axes": [self._column(column, kept, n) | _ends(column.checked(n)) for column in self.axes],
            # A note is read as a number, not seen on a scale.
            "notes": [self._column(column, kept, n, fine=True) for column in self.notes],
            "spans": [
                [place[i], *finite_array(ends, "the ends of a span", width=3).round(4).ravel().tolist()]
                for i, ends in self.spans.items()
                if i in place
            ],
            "marked": [[place[i], text] for i, text in self.marked.items()],
        }

    @staticmethod
    def _column(column: PointColumn, kept: IntArray, n: int, *, fine: bool = False) -> dict[str, Any]:
        return {"name": column.name, "unit": column.unit, **_steps(column.checked(n)[kept], fine=fine)}


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A serial chain of pivots, each turning about or sliding along its own z axis, with fixed motions between them.

    Parameters
    ----------
    fixed : (k + 1, 4, 4) array
        Rigid motions before, between and after the k pivots.
    end : (3,) array
        The end of the chain in the frame after the last of them.
    links : sequence of (m, 3) arrays
        The k + 1 links as polylines: that before the first pivot in the frame of the scene, each other one in the
        frame after its pivot, the last of them to the end of the chain.
    names, units : sequences of str
        Of the pivots; a unit is ``deg`` or, of a sliding one, that of the scene.
    lower, upper : (k,) arrays
        Ends of the sliders, in these units.
    limited : (k,) bool array
        Which of these ends are limits.
    start : (k,) array
        Values of the first view.
    end_name, value_name : str
        What the end of the chain is called, and what the values are.
    controls : bool
        Whether there are sliders and fields.
    follows : sequence of int, optional
        For each pivot the axis of the cloud that has its values: the mechanism goes to the point that a reader points
        at.
    """

    fixed: FloatArray
    end: FloatArray
    links: Sequence[npt.ArrayLike]
    names: Sequence[str]
    units: Sequence[str]
    lower: FloatArray
    upper: FloatArray
    limited: BoolArray
    start: FloatArray
    end_name: str
    value_name: str
    controls: bool = False
    follows: Sequence[int] | None = None

    def to_json(self, unit: str) -> dict[str, Any]:
        """The mechanism for the script, in full precision.

        Raises
        ------
        InputError
            If the parts do not fit together.
        """
        k = len(self.names)
        lengths = {len(self.fixed) - 1, len(self.links) - 1, len(self.units), len(self.lower), len(self.upper)}
        if lengths | {len(self.start), len(self.limited)} != {k}:
            raise InputError(f"expected the parts of a mechanism with {k} pivots, got other numbers of them")
        paths = [np.asarray(link, dtype=float) for link in self.links]
        length = sum(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in paths[1:])
        return {
            "fixed": [np.asarray(frame)[:3].ravel().tolist() for frame in self.fixed],
            "end": np.asarray(self.end).tolist(),
            "links": [path.round(4).tolist() for path in paths],
            "slides": [one != "deg" for one in self.units],
            "names": list(self.names),
            "units": list(self.units),
            "low": np.asarray(self.lower).tolist(),
            "high": np.asarray(self.upper).tolist(),
            "limited": np.asarray(self.limited).tolist(),
            "start": np.asarray(self.start).tolist(),
            "endName": self.end_name,
            "valueName": self.value_name,
            "unit": unit,
            "size": 0.11 * max(length, 1e-6),
            "controls": self.controls,
            "follows": None if self.follows is None else list(self.follows),
        }


@dataclass(frozen=True, eq=False)
class Scene:
    """Points, lines and a mechanism in space, with the figure that stands for them on paper.

    Parameters
    ----------
    label : str
        What the view shows, for readers who do not see it.
    unit : str
        Of lengths.
    still : Figure
        Shown on paper and where scripts are not run; its caption is that of the scene.
    cloud : PointCloud, optional
    mechanism : Mechanism, optional
    lines : sequence of (m, 3) arrays
        Polylines.
    """

    label: str
    unit: str
    still: Figure
    cloud: PointCloud | None = None
    mechanism: Mechanism | None = None
    lines: Sequence[npt.ArrayLike] = ()

    def to_json(self) -> str:
        """The data block of the page."""
        data = {
            "label": self.label,
            "unit": self.unit,
            "points": None if self.cloud is None else self.cloud.to_json(),
            "mechanism": None if self.mechanism is None else self.mechanism.to_json(self.unit),
            "lines": [{"at": finite_array(line, "a line", width=3).round(4).tolist()} for line in self.lines],
        }
        return data_block(data)

    @property
    def remark(self) -> str:
        """What a reader must know if not all points are drawn; empty if they are."""
        if self.cloud is None or len(self.cloud.names) <= MOST_POINTS:
            return ""
        return (
            f"The view has {format_number(MOST_POINTS)} of {format_number(len(self.cloud.names))} {self.cloud.noun}s: "
            "those with the largest values, and an even selection of the others."
        )


def data_block(data: object) -> str:
    """Data of a page as JSON. No text in it can end the block: ``<`` is written as an escape."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def scene_script(after: str = "") -> str:
    """The script of a page with scenes: our modules as one, in a scope of their own.

    Parameters
    ----------
    after : str
        A further module, which runs when the scenes are drawn.
    """
    parts = [files("truearm.pages").joinpath(f"scene_{name}.mjs").read_text(encoding="utf-8") for name in SCRIPTS]
    code = re.sub(r"^import [^;]*;\n", "", "\n".join([*parts, "start();", after]), flags=re.MULTILINE)
    code = re.sub(r"^export ", "", code, flags=re.MULTILINE)
    return f'(() => {{\n"use strict";\n{code}\n}})();\n'


@cache
def script_hash(script: str) -> str:
    """The hash of a script, as a content security policy names it."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def thinned(values: Sequence[FloatArray], most: int = MOST_POINTS) -> IntArray:
    """Choose at most `most` points: the largest of each value, and evenly of the others."""
    n = len(values[0])
    if n <= most:
        return np.arange(n)
    each = max(1, int(_LARGEST_SHARE * most / len(values)))
    largest = np.unique(np.concatenate([np.argsort(one, kind="stable")[-each:] for one in values]))
    others = np.setdiff1d(np.arange(n), largest)
    even = others[np.linspace(0, len(others) - 1, most - len(largest)).round().astype(int)]
    return np.sort(np.concatenate([largest, even]))


def _numbered(names: list[str]) -> dict[str, Any]:
    """Names that differ in their last number only as the number; others in full."""
    parts = [re.fullmatch(r"(.*?)(0|[1-9]\d{0,8})", name, flags=re.DOTALL) for name in names]
    if all(parts) and len({part[1] for part in parts if part}) == 1:
        return {"before": parts[0][1] if parts[0] else "", "last": [int(part[2]) for part in parts if part]}
    return {"before": "", "last": names}


def _steps(values: FloatArray, *, fine: bool = False) -> dict[str, Any]:
    """A column as whole numbers of a step that is too small to be seen."""
    span = float(np.ptp(values)) if len(values) else 0.0
    small = float(np.median(np.abs(values))) / 1000 if fine else 0.0
    step = max(min(span / _STEPS, small) if small else span / _STEPS, float(np.abs(values).max(initial=0.0)) * 1e-9)
    power = 10.0 ** np.floor(np.log10(step)) if step > 0 else 1.0
    step = max((k * power for k in (1, 2, 5) if k * power <= step), default=power)
    if span == 0.0 and values.any():
        step = float(np.abs(values[0]))
    return {"step": float(step), "data": np.round(values / step).astype(np.int64).tolist()}


def _top(values: FloatArray, top: float | None = None) -> dict[str, Any]:
    """The upper end of the colours, and whether single values lie beyond it."""
    if top is not None:
        return {"top": top, "beyond": bool(values.max() > top)}
    usual, largest = float(np.percentile(values, _USUAL_PERCENT)), float(values.max())
    beyond = len(values) > 20 and largest > _FAR * usual > 0
    return {"top": usual if beyond else max(largest, 1e-12), "beyond": beyond}


def _ends(values: FloatArray) -> dict[str, float]:
    low, high = float(values.min()), float(values.max())
    margin = max(0.02 * (high - low), 1e-9 + 1e-6 * abs(high))
    return {"low": low - margin, "high": high + margin}
