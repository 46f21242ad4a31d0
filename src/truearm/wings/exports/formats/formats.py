"""Formats of exported files: their endings, who writes and reads each, what it holds, whether it is of a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Literal, NamedTuple

import numpy as np

from truearm import __version__
from truearm.errors import InputError, MissingTool
from truearm.identification.references.alignment import align
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.formats import ExportFormat
from truearm.wings.exports.targets.manifest import EXACT_MM, Manifest, TargetsManifest, content_hash, provenance_of
from truearm.wings.exports.targets.pose_models import with_tool


class FormatSpec(NamedTuple):
    """One format of exported files.

    Attributes
    ----------
    suffixes : tuple of str
        Names of its files end in one of these.
    module : str
        In `truearm.wings.exports.formats`; its `write` makes the file, its `tips` evaluates it.
    options : tuple of str
        Options of `truearm.export` that apply to it. Formats with a region hold constants only: no harmonics,
        deflection or temperature.
    content : str
        In words.
    is_code : bool
        Whether `tips` runs the file's own code.
    states_origin : bool
        Whether it has a manifest; one without a place for it is never replaced.
    """

    suffixes: tuple[str, ...]
    module: str
    options: tuple[str, ...]
    content: str
    is_code: bool = False
    states_origin: bool = True

    @property
    def holds_constants(self) -> bool:
        """Whether a file holds the constants of a rigid arm only."""
        return bool(self.options)

    def load(self) -> ModuleType:
        """The module, imported when it is needed."""
        return import_module(f"truearm.wings.exports.formats.{self.module}")


_CONSTANTS = ("region", "frame")
FORMATS: dict[ExportFormat, FormatSpec] = {
    "urdf": FormatSpec((".urdf",), "urdf", (*_CONSTANTS, "source"), "URDF"),
    "mjcf": FormatSpec((".xml",), "mjcf", ("region", "source"), "MJCF"),
    "constants": FormatSpec((".csv",), "constants", (*_CONSTANTS, "convention"), "Constants beside the nominal ones"),
    "ur-kinematics": FormatSpec((".yaml", ".yml"), "ur_kinematics", (*_CONSTANTS, "source"), "UR kinematics file"),
    "kinematics-yaml": FormatSpec(
        (".yaml", ".yml"), "kinematics_yaml", (*_CONSTANTS, "source"), "Maker's kinematics file"
    ),
    "joint-offsets": FormatSpec((".yaml", ".yml"), "joint_offsets", _CONSTANTS, "ROS joint offsets"),
    "lerobot": FormatSpec((".json",), "lerobot", ("region", "source"), "LeRobot calibration", states_origin=False),
    "c": FormatSpec((".c",), "c_source", (), "C99 source", True),
    "js": FormatSpec((".mjs", ".js"), "es_module", (), "ES module", True),
    "onnx": FormatSpec((".onnx",), "onnx_graph", (), "ONNX graph"),
    "json": FormatSpec((".json",), "json_model", (), "JSON document"),
}
# Formats that their suffix alone decides.
BY_SUFFIX: dict[str, ExportFormat] = {
    ".urdf": "urdf",
    ".xml": "mjcf",
    ".c": "c",
    ".mjs": "js",
    ".js": "js",
    ".onnx": "onnx",
    ".json": "json",
}


def format_of(out: str | Path, format: str | None) -> ExportFormat:
    """The format that is asked for, or that of the suffix.

    Raises
    ------
    InputError
        If there is no such format, or a file of it has another suffix.
    """
    suffix = Path(out).suffix.lower()
    if format is None:
        if suffix not in BY_SUFFIX:
            several = [name for name, spec in FORMATS.items() if suffix in spec.suffixes]
            problem = f"several formats end in {suffix}" if several else f"no format ends in {suffix!r}"
            raise InputError(problem, file=out, hint=f"--as {' or '.join(several or FORMATS)}")
        return BY_SUFFIX[suffix]
    found = next((name for name in FORMATS if name == format), None)
    if found is None:
        raise InputError(f"expected a format among {', '.join(FORMATS)}, got {format!r}")
    if suffix not in FORMATS[found].suffixes:
        ends = " or ".join(FORMATS[found].suffixes)
        raise InputError(f"a file of format {format} ends in {ends}, got {Path(out).name!r}", file=out)
    return found


# Ratios of tips by which a wrong unit of length is recognised, with their names.
UNITS = {1e-3: "metres for millimetres", 1e3: "millimetres for metres", 25.4: "inches for millimetres"}
# Share within which such a ratio is met.
UNIT_SHARE = 0.02
# At the check poses, spread over the trained ranges, a file of constants may err by more than over its region.
LOSS_FACTOR = 3.0
# Two descriptions of one nominal arm, and no error of constants, differ by less [mm].
NOMINAL_MM = 0.01


@dataclass(frozen=True)
class Comparison:
    """One comparison.

    Attributes
    ----------
    what : str
    outcome : {"agrees", "differs", "not run"}
    detail : str
    """

    what: str
    outcome: Literal["agrees", "differs", "not run"]
    detail: str


def compare_with_model(model: Compensator, manifest: Manifest, file: Path) -> Iterator[Comparison]:
    """Compare an exported file with a model: its arm, its model, its check poses, its content.

    Code is run only if it is, line for line, what truearm writes for this model.
    """
    own, origin = provenance_of(model), manifest.provenance
    names = [f"{of.arm} {'serial number ' * bool(of.serial_number)}{of.serial_number}".strip() for of in (origin, own)]
    same_arm = names[0] == names[1]
    yield _finding("arm", same_arm, names[0] if same_arm else "{} in the file, {} in the model".format(*names))
    same = own.model_sha256 == origin.model_sha256
    made_from = "this model" if same else f"another one on {origin.date}"
    yield _finding("model", same, f"the file was made from {made_from}")
    if manifest.joints.shape[1:] != (model.arm.n_joints,):
        detail = f"{manifest.joints.shape[-1]} in the file, {model.arm.n_joints} in the arm"
        yield _finding("joints", False, detail)
        return
    spec = next((spec for name, spec in FORMATS.items() if name == manifest.format), None)
    yield _check_poses(model, manifest, spec)
    if spec is None:
        yield _as_written(manifest, file)
    elif spec.is_code and not same:
        yield Comparison("content", "not run", "code of another model is not run")
    elif spec.is_code and (foreign := _foreign_line(model, manifest, spec, file)):
        yield _finding("content", False, f"{foreign}; the code was not run")
    else:
        yield _as_evaluated(manifest, spec, file)


def _finding(what: str, agrees: bool, detail: str) -> Comparison:
    return Comparison(what, "agrees" if agrees else "differs", detail)


def _foreign_line(model: Compensator, manifest: Manifest, spec: FormatSpec, file: Path) -> str:
    """Where a file of code is not what truearm writes for the model; empty if it is, so that it is safe to run."""
    with TemporaryDirectory() as folder:
        own = Path(folder) / file.name
        spec.load().write(model, manifest, own)
        lines, given = own.read_bytes().splitlines(), file.read_bytes().splitlines()
    if lines == given:
        return ""
    pairs = enumerate(zip_longest(lines, given), 1)
    number = next(i for i, (one, other) in pairs if one != other)
    by = manifest.provenance.truearm
    version = "" if by == __version__ else f" (it was written by version {by}, this is {__version__})"
    return f"line {number} is not what truearm writes for this model{version}"


def _check_poses(model: Compensator, manifest: Manifest, spec: FormatSpec | None) -> Comparison:
    """Compare what the file is said to give with what the model gives."""
    equipped = model if manifest.tool is None else with_tool(model, np.array(manifest.tool))
    rows = np.isfinite(manifest.machine_joints).all(axis=1)
    if not rows.any():
        return Comparison("check poses", "not run", "none of them could be corrected")
    try:
        tips = equipped.predict(manifest.machine_joints[rows])
    except InputError as error:
        return _finding("check poses", False, f"the model refuses their joints: {error.problem}")
    expected = manifest.tips[rows]
    if manifest.frame == "base":  # the arm's own: only the shape is compared
        T = align(expected, tips)
        expected = expected @ T[:3, :3].T + T[:3, 3]
    largest = float(np.linalg.norm(expected - tips, axis=1).max())
    limit = _limit_mm(equipped, manifest, spec, tips)
    detail = f"tips of the check poses differ by {largest:.3g} mm from the model's, at most {limit:.3g} mm expected"
    return _finding("check poses", largest <= limit, detail)


def _as_written(manifest: Manifest, file: Path) -> Comparison:
    """Compare corrected targets, which nobody can evaluate, with what was written."""
    if not isinstance(manifest, TargetsManifest):
        return _finding("content", False, "the file does not say what was written: correct the targets again")
    same = content_hash(file) == manifest.content_sha256
    return _finding(
        "content",
        same,
        "the targets are those that were written" if same else "the file was changed after it was written",
    )


def _limit_mm(model: Compensator, manifest: Manifest, spec: FormatSpec | None, tips: FloatArray) -> float:
    """How far the check poses may be from the model: by the format, and not further than the nominal arm is."""
    if spec is None or not spec.holds_constants or manifest.loss is None:
        return EXACT_MM
    nominal = model.predict_nominal(manifest.joints)
    largest = float(np.linalg.norm(nominal - tips, axis=1).max())
    return LOSS_FACTOR * min(max(manifest.loss.exported_max_mm, EXACT_MM), max(largest, NOMINAL_MM))


def _as_evaluated(manifest: Manifest, spec: FormatSpec, file: Path) -> Comparison:
    """Compare what the file gives with what it is said to give."""
    try:
        tips = np.asarray(spec.load().tips(file, manifest.joints))
    except MissingTool as error:
        return Comparison("content", "not run", str(error))
    except InputError as error:
        return _finding("content", False, error.problem)
    largest = float(np.linalg.norm(tips - manifest.tips, axis=1).max())
    if largest <= EXACT_MM:  # not the file's own tolerance
        return _finding("content", True, f"evaluated at the check poses: {largest:.2g} mm at most")
    return _finding("content", False, f"evaluated at the check poses: {largest:.4g} mm off{_likely(tips, manifest)}")


def _likely(tips: FloatArray, manifest: Manifest) -> str:
    """The likely cause, if the sizes show one."""
    ratio = float(np.linalg.norm(tips) / np.linalg.norm(manifest.tips))
    for unit, name in UNITS.items():
        if abs(ratio / unit - 1) < UNIT_SHARE:
            return f"; its lengths are {ratio:.4g} times as long: {name}"
    return "; its numbers were changed after the export"
