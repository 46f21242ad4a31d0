"""Source code from templates: the same tables and the same functions, in the same order, for C and JavaScript."""

from __future__ import annotations

import re
import shutil
import string
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np
import numpy.typing as npt

from truearm.arm import Chain
from truearm.errors import InputError, MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.identification.estimation.extrapolation import Extrapolation
from truearm.identification.terms import Expression, link_vectors
from truearm.identification.terms.links import UNKNOWN_MATERIAL
from truearm.models import Compensator
from truearm.models.training_conditions import TrainingConditions
from truearm.readings import Session
from truearm.readings.readings import PAYLOAD
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.wings.exports.formats.plain_model import (
    PlainModel,
    ValueLayout,
    ValueTables,
    depends_on_payload,
    plain_model,
)
from truearm.wings.exports.formats.reduced_covariance import ReducedCovariance, reduced_covariance
from truearm.wings.exports.targets.correction import CORRECTION_STEPS, MAX_CORRECTION, usual_change
from truearm.wings.exports.targets.inverse import MAX_CONDITION, TOLERANCE_MM, TOLERANCE_RAD
from truearm.wings.exports.targets.manifest import Manifest, read_manifest

LINE_WIDTH = 118
# In place of an infinite limit: no joint is beyond.
NO_LIMIT = 1e300
# What a text may have in the middle of code; all else becomes a code point.
_PLAIN = frozenset(string.ascii_letters + string.digits + " _-.,:;()%")
# Numbers of the rules by which targets are corrected, by their names in the code.
RULES = {
    "max_joint": Session.largest_angle,
    "full_turn": 2 * np.pi,
    "least_travel": Extrapolation.least_travel_mm,
    "most_turns": TrainingConditions.most_turns,
    "most_off": TrainingConditions.most_off_alone,
    "max_load": Session.largest_load,
    "max_correction": MAX_CORRECTION,
    "max_condition": MAX_CONDITION,
    "correction_steps": CORRECTION_STEPS,
    "tolerance_mm": TOLERANCE_MM,
    "tolerance_rad": TOLERANCE_RAD,
    "limit_tolerance": Session.limit_tolerance,
    "coldest": Session.coldest_degC,
    "warmest": Session.warmest_degC,
    "temperature_tolerance": TrainingConditions.temperature_tolerance_K,
    "reference_degC": REFERENCE_DEGC,
}


# A compiler needs seconds for a file of 2 MB.
MAX_SECONDS = 300


class Language(NamedTuple):
    """A language: its template in the folder ``templates``, and how it writes lists, joint angles and functions."""

    template: str
    brackets: str
    angle: str
    function: str


class Code(str):
    """Text that a template prints as it is: code that truearm has made, no text from a model file."""


def write_source(model: Compensator, manifest: Manifest, path: str | Path, language: Language) -> None:
    """Write a model as source code that needs no other file.

    Parameters
    ----------
    model : Compensator
        Fitted: a nominal, kinematic or physical model.
    manifest : Manifest
        Goes into the first comment; its check poses are in a function of the file.
    path : path
        Written whole or not at all.
    language : Language

    Raises
    ------
    InputError
        If the model is a network, or has terms of a basis without expressions.
    """
    plain = plain_model(model)
    values = ValueTables.of(plain)
    covariance = reduced_covariance(plain, values.layout)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("truearm.wings.exports.formats"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 (source code: `_printed` escapes all that is not `Code`)
        finalize=_printed,
    )
    environment.filters |= {"number": number, "rows": _rows, "table": _table_filter(language.brackets)}
    origin = {"manifest": _in_comment(manifest.line()), "sha256": manifest.provenance.model_sha256}
    checks = {"check_joints": manifest.joints, "check_tips": manifest.tips}
    usual = {f"usual_{way}": usual_change(plain.model, direction=way).T for way in ("command", "feedback")}
    formulas = {"formulas": [[at, _code(one, values.layout, language)] for one, at in values.layout.formulas.items()]}
    parts = {"plain": plain, "training": plain.model.training_, "layout": values.layout, "values": values}
    context = RULES | origin | checks | usual | parts | _tables(plain, values, covariance) | formulas
    text = environment.get_template(language.template).render(context)
    with atomic_file(path, read=read_manifest) as beside:
        beside.write_text(text, encoding="ascii")


def joints_of_file(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """Joints (n, n_joints) for a written file.

    Raises
    ------
    InputError
        If truearm did not write the file, or it is of another number of joints.
    """
    checked = np.ascontiguousarray(joints, dtype=float)
    n_joints = len(read_manifest(path).provenance.joint_names)
    if checked.ndim != 2 or checked.shape[1] != n_joints:
        raise InputError(f"expected joints of shape (n, {n_joints}), got {checked.shape}", file=path)
    return checked


def run_tool(program: str, name: str, package: str, arguments: Sequence[str], path: str | Path, text: str = "") -> str:
    """What a compiler or interpreter prints of a written file.

    Raises
    ------
    MissingTool
        If it is not installed.
    InputError
        If it refuses the file, or does not finish.
    """
    tool = shutil.which(program)
    if tool is None:
        raise MissingTool(f"such a file is checked with {name}, which is not installed", hint=f"apt install {package}")
    try:
        done = subprocess.run(  # noqa: S603
            [tool, *arguments], input=text, capture_output=True, text=True, timeout=MAX_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{name} did not finish the file in {MAX_SECONDS} s", file=path) from None
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "error" in line.lower()), done.stderr[:200])
        raise InputError(f"{name} refuses the file: {first}", file=path)
    return done.stdout


def _tables(plain: PlainModel, values: ValueTables, covariance: ReducedCovariance) -> dict[str, Any]:
    """What the templates print beside the attributes of plain model, values and covariance."""
    model, layout, rest = plain.model, values.layout, covariance.remainder
    training, share = model.training_, model.variance_function_
    temperature, names = training.temperature_range, sorted(training.columns)
    macros = macros_of(names)
    moved = {run.component // 6 for run in values.runs}
    directions = training.direction_ranges
    one_way = None if directions is None else np.where(directions[:, 0] == directions[:, 1], directions[:, 0], 0.0)
    return {
        "n": plain.n_joints,
        "covariance": covariance,
        "rounds": training.angle_std is not None and training.angle_sample is not None,
        "only_direction": np.zeros(plain.n_joints) if one_way is None else one_way,
        "payload": names.index(PAYLOAD) if PAYLOAD in names and depends_on_payload(model) else -1,
        "columns": [{"name": name, "macro": macros[name]} for name in names],
        "used_columns": [{"name": name, "macro": macros[name]} for name in layout.columns],
        "moved": [int(place in moved) for place in range(plain.n_joints + 2)],
        "folded": _rows(_folded(plain.chain, values.constant_motions, moved)),
        "slides": plain.chain.is_prismatic.astype(int),
        "limits": np.clip(model.arm_.limits, -NO_LIMIT, NO_LIMIT),
        "temperature": [temperature.mean, temperature.std, temperature.lower, temperature.upper],
        "column_ranges": [
            [known.mean, known.std, known.lower, known.upper] for known in map(training.columns.__getitem__, names)
        ],
        "uses_harmonics": any(highest for _, highest in layout.harmonics) or bool(layout.further),
        # A third of the reach, the usual lever of a joint: as in `truearm.wings.exports.targets.correction`.
        "length": max(plain.nominal_chain.reach, model.nominal_.chain.reach, 3.0) / 3,
        "variance_share": np.stack([share.centre, share.spread, share.slope, share.curvature], axis=1),
        "well_trained": training.angle_ranges if share.beyond is None else share.beyond.ranges,
        "growth": [0.0, 0.0] if share.beyond is None else [share.beyond.growth, share.beyond.nominal],
        "seen": [Extrapolation.seen, Extrapolation.not_seen],
        "links": link_vectors(plain.nominal_chain),
        "material": UNKNOWN_MATERIAL,
        "links_degC": [training.links_range.lower, training.links_range.upper],
        "rank": covariance.rank if covariance.entries.size else 0,
        "quantum": covariance.quantum.astype(np.float32),
        "entry_type": "short" if np.abs(covariance.entries).max(initial=0) < 2**15 else "int",
        "nodes": [] if rest is None else np.stack([rest.first, rest.count], axis=1),
        "node_at": [] if rest is None else np.stack([rest.lower, rest.per_unit], axis=1),
        "node_variance": [] if rest is None else rest.variance.astype(np.float32),
    }


def number(value: float) -> Code:
    """A number that reads back exactly."""
    return Code(value if isinstance(value, int) else repr(float(value)))


def macros_of(names: Sequence[str]) -> dict[str, Code]:
    """Names in C for names of columns: letters, digits and _; of two that become equal, one has a number."""
    macros: dict[str, Code] = {}
    for name in sorted(names, key=lambda name: (_as_macro(name) != name, name)):
        macro, count = _as_macro(name), 2
        while macro in macros.values():
            macro, count = f"{_as_macro(name)}_{count}", count + 1
        macros[name] = Code(macro)
    return macros


def _code(expression: Expression, layout: ValueLayout, language: Language) -> Code:
    """An expression in the language, of angles and of values that stand before it."""
    of = expression.arguments
    parts = [_code(one, layout, language) for one in of if isinstance(one, Expression)]
    match expression.operation:
        case "number":
            return Code(f"({number(float(of[0]))})")
        case "angle":
            return Code(language.angle.format(of[0] - 1))
        case "sum" | "product":
            return Code("(" + (" + " if expression.operation == "sum" else " * ").join(parts) + ")")
        case "power":
            return Code(f"{language.function}pow({parts[0]}, {of[1]})")
        case "cos" | "sin":
            return Code(f"{language.function}{expression.operation}({parts[0]})")
    return Code(f"value[{layout.index(expression)}]")


def _as_macro(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


def _printed(value: object) -> object:
    """What a template prints: code and numbers as they are, texts so that no comment or string ends in them."""
    if isinstance(value, Code | int):
        return value
    units = str(value).encode("utf-16-be", "surrogatepass")
    pairs = (int.from_bytes(units[at : at + 2], "big") for at in range(0, len(units), 2))
    return "".join(chr(unit) if chr(unit) in _PLAIN else f"\\u{unit:04x}" for unit in pairs)


def _table_filter(brackets: str) -> Callable[..., Code]:
    opening, closing = brackets[0], brackets[1]

    def table(values: npt.NDArray[Any] | Sequence[Any], suffix: str = "") -> Code:
        """Nested lists of numbers over several lines."""
        if isinstance(values, np.ndarray) and values.dtype == np.float32:  # seven digits hold it
            texts = [f"{value:.8g}" for value in values.tolist()]
            return _wrapped([text + ("" if set(text) & set(".e") else ".0") + suffix for text in texts])
        rows = values.tolist() if isinstance(values, np.ndarray) else list(values)
        if rows and isinstance(rows[0], list | tuple):
            return Code(opening + ",\n".join(table(row) for row in rows) + closing)
        return _wrapped([number(value) for value in rows])

    def _wrapped(texts: Sequence[str]) -> Code:
        lines, width = [[]], 0  # type: list[list[str]], int
        for text in texts:
            if width + len(text) + 1 > LINE_WIDTH:
                lines.append([])
                width = 0
            lines[-1].append(text)
            width += len(text) + 1
        return Code(opening + ",\n".join(",".join(line) for line in lines) + closing)

    return table


def _rows(chain: Chain) -> list[list[float]]:
    """Three rows of four numbers of each fixed motion, one after the other."""
    rows: list[list[float]] = chain.fixed[:, :3].reshape(-1, 12).tolist()
    return rows


def _folded(chain: Chain, constant: FloatArray, moved: set[int]) -> Chain:
    """The chain with those motions that never change; that of the tip stands by itself."""
    motions = constant.copy()
    motions[[*moved, chain.n_places - 1]] = 0.0
    return chain.with_motions(motions)


def _in_comment(line: str) -> Code:
    """The manifest in a comment of C: nothing that opens a comment or is a trigraph, which compilers warn of.

    `Manifest.line` has no line break, and nothing that ends a comment.
    """
    return Code(line.replace("/*", "/\\u002a").replace("??", "?\\u003f"))
