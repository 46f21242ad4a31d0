"""Formats of exported files: their endings, the module that writes and reads each, what it holds."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from truearm.errors import InputError
from truearm.wings.exports.formats import ExportFormat


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
    """

    suffixes: tuple[str, ...]
    module: str
    options: tuple[str, ...]
    content: str
    is_code: bool = False

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
    "constants": FormatSpec((".csv",), "constants", (*_CONSTANTS, "convention"), "Constants beside the nominal ones"),
    "ur-kinematics": FormatSpec((".yaml", ".yml"), "ur_kinematics", (*_CONSTANTS, "source"), "UR kinematics file"),
    "joint-offsets": FormatSpec((".yaml", ".yml"), "joint_offsets", _CONSTANTS, "ROS joint offsets"),
    "c": FormatSpec((".c",), "c_source", (), "C99 source", True),
    "js": FormatSpec((".mjs", ".js"), "es_module", (), "ES module", True),
    "onnx": FormatSpec((".onnx",), "onnx_graph", (), "ONNX graph"),
    "json": FormatSpec((".json",), "json_model", (), "JSON document"),
}
# Formats that their suffix alone decides.
BY_SUFFIX: dict[str, ExportFormat] = {
    ".urdf": "urdf",
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
