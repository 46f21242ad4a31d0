"""Export: the model as a file of another program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

from truearm.compensation.models import Compensator
from truearm.compensation.targets.manifest import Manifest, read_manifest
from truearm.errors import InputError
from truearm.files.atomic_write import check_writable
from truearm.readings.checks import check_angles
from truearm.readings.readings import PAYLOAD
from truearm.solve.threads import one_blas_thread
from truearm.workflows.inputs import ModelLike, SessionLike, to_model_of_tip, to_session
from truearm.workflows.outputs import check_output_is_not_input, input_files
from truearm.workflows.record import Record, format_fixed, to_plain

Format = Literal["urdf", "constants", "deltas", "ur-kinematics", "joint-offsets", "c", "js", "onnx", "json"]


class FormatSpec(NamedTuple):
    """One format of exported files.

    Attributes
    ----------
    suffixes : tuple of str
        Names of its files end in one of these.
    module : str
        In `truearm.compensation.export`; its `write` makes the file, its `tips` evaluates it.
    options : tuple of str
        Options of `export` that apply to it. Formats with a region hold constants only: no harmonics, deflection or
        temperature.
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


CONSTANTS = ("region", "frame")
FORMATS: dict[str, FormatSpec] = {
    "urdf": FormatSpec((".urdf",), "urdf", (*CONSTANTS, "source"), "URDF"),
    "constants": FormatSpec((".csv",), "constants", (*CONSTANTS, "convention"), "Constants beside the nominal ones"),
    "deltas": FormatSpec((".csv", ".json"), "deltas", (*CONSTANTS, "convention"), "Changes of constants"),
    "ur-kinematics": FormatSpec((".yaml", ".yml"), "ur_kinematics", (*CONSTANTS, "source"), "UR kinematics file"),
    "joint-offsets": FormatSpec((".yaml", ".yml"), "joint_offsets", CONSTANTS, "ROS joint offsets"),
    "c": FormatSpec((".c",), "c_source", (), "C99 source", True),
    "js": FormatSpec((".mjs", ".js"), "es_module", (), "ES module", True),
    "onnx": FormatSpec((".onnx",), "onnx_graph", (), "ONNX graph"),
    "json": FormatSpec((".json",), "json_model", (), "JSON document"),
}
# Formats that their suffix alone decides.
BY_SUFFIX = {".urdf": "urdf", ".c": "c", ".mjs": "js", ".js": "js", ".onnx": "onnx", ".json": "json"}


@one_blas_thread()
def export(
    model: ModelLike,
    out: str | Path,
    *,
    format: Format | None = None,
    region: SessionLike | None = None,
    source: str | Path | None = None,
    frame: Literal["base", "reference"] | None = None,
    convention: Literal["dh", "mdh"] | None = None,
    tip: str | None = None,
) -> ExportResult:
    """Write a model as a file of another program, with its origin, its loss and five check poses.

    C, JavaScript, ONNX and JSON hold the whole model. The other formats hold constants only: those of the rigid arm
    that is nearest to the model over a region, and the result states what is lost.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    out : str or Path
        File to write, whole or not at all.
    format : str, optional
        One of `FORMATS`; by default that of the file's suffix.
    region : Session, DataFrame, str or Path, optional
        Joint angles at which a file of constants must be good, the poses of your task; by default a sample of the
        training readings.
    source : str or Path, optional
        For ``urdf`` and ``ur-kinematics``: the robot's own file, of which everything but the constants is kept.
    frame : {"base", "reference"}, optional
        For files of constants: the frame of the file's root is the arm's own base (default), or that of the reference.
    convention : {"dh", "mdh"}, optional
        For ``constants`` and ``deltas``: Denavit-Hartenberg or modified; by default the one with the nominal arm's
        numbers.
    tip : str, optional
        Name of the tip, of a model with several.

    Returns
    -------
    ExportResult

    Raises
    ------
    InputError
        If the format is unknown or cannot hold this model, an option does not apply to it, or the file cannot be
        written.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> fit = ta.fit("ur10", session, model="kinematic")
    >>> ta.export(fit.model, "arm.urdf").format
    'urdf'
    """
    name = _format_of(out, format)
    spec, fitted = FORMATS[name], to_model_of_tip(model, tip)
    check_output_is_not_input(out, *input_files(model, region, source))
    check_writable(out)
    given = {"region": region, "source": source, "frame": frame, "convention": convention}
    options: dict[str, Any] = {option: value for option, value in given.items() if value is not None}
    if surplus := sorted(options.keys() - set(spec.options)):
        raise InputError(
            f"the option {surplus[0]} does not apply to the format {name}",
            hint=f"its options are {', '.join(spec.options)}" if spec.options else "leave it out: the model is whole",
        )
    module = import_module(f"truearm.compensation.export.{spec.module}")
    if not spec.holds_constants:
        module.write(fitted, Manifest.of(fitted, name), out)
    else:
        if region is not None:
            session = to_session(region, n_joints=fitted.arm.n_joints)
            check_angles(session, n_joints=fitted.arm.n_joints, prismatic=fitted.arm.chain.is_prismatic)
            options |= {"angles": session.angles, "region": _region_name(region)}
        module.write(fitted, out, **options)
    return ExportResult(fitted, Path(out), name, read_manifest(out))


def _format_of(out: str | Path, format: str | None) -> str:
    """The format that is asked for, or that of the suffix."""
    suffix = Path(out).suffix.lower()
    if format is None:
        if suffix not in BY_SUFFIX:
            several = [name for name, spec in FORMATS.items() if suffix in spec.suffixes]
            problem = f"several formats end in {suffix}" if several else f"no format ends in {suffix!r}"
            raise InputError(problem, file=out, hint=f"--as {' or '.join(several or FORMATS)}")
        return BY_SUFFIX[suffix]
    if format not in FORMATS:
        raise InputError(f"expected a format among {', '.join(FORMATS)}, got {format!r}")
    if suffix not in FORMATS[format].suffixes:
        ends = " or ".join(FORMATS[format].suffixes)
        raise InputError(f"a file of format {format} ends in {ends}, got {Path(out).name!r}", file=out)
    return format


def _region_name(region: SessionLike | None) -> str:
    return Path(region).name if isinstance(region, str | Path) else "the poses given"


@dataclass(frozen=True, eq=False, repr=False)
class ExportResult(Record):
    """An exported file.

    Attributes
    ----------
    model : Compensator
    path : Path
    format : str
    manifest : Manifest
        What the file states of itself: origin, frame, loss, check poses.
    """

    model: Compensator
    path: Path
    format: str
    manifest: Manifest

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        spec, manifest = FORMATS[self.format], self.manifest
        loss, origin = manifest.loss, manifest.provenance
        if loss is None:
            yield f"{spec.content} of the whole {origin.model} model of {origin.arm}."
        else:
            exported, nominal, own, largest = (
                format_fixed(value, 3)
                for value in (loss.exported_mm, loss.nominal_mm, loss.model_mm, loss.exported_max_mm)
            )
            yield (
                f"{spec.content}: {exported} mm from the model's points on average, {largest} mm at most (nominal arm "
                f"{nominal} mm; the model's own uncertainty {own} mm), at {loss.n_poses} poses held out: {loss.region}."
            )
            if origin.model == "physical":
                yield self._what_is_lost()
        if origin.model == "physical" and (payload := self.model.training_.columns.get(PAYLOAD)) is not None:
            yield f"It applies to the payload of the training, {payload.mean:g} kg."
        yield f"Frame of the file: {FRAMES[manifest.frame]}."
        yield "Five check poses are in the file: truearm export MODEL --check FILE compares them."

    def _what_is_lost(self) -> str:
        """What constants of a physical model lack, and what has it: only formats that take this model."""
        from truearm.compensation.export.plain_model import plain_model

        lost = "without harmonics, deflection and temperature"
        if PAYLOAD in self.model.training_.columns:
            lost += ", without the effect of the payload"
        if self.model.arm_.chain.is_prismatic.any():
            lost += ", without the errors along the travel"
        try:
            plain_model(self.model)
        except InputError:
            return f"It holds constants only, {lost}. Corrected targets (truearm correct) have them."
        return (
            f"It holds constants only, {lost}. Corrected targets (truearm correct) and the formats c, js, onnx and "
            "json have them."
        )

    def to_dict(self) -> dict[str, Any]:
        """See `Record.to_dict`: the manifest."""
        plain: dict[str, Any] = to_plain({"format": self.format, "manifest": self.manifest.model_dump(mode="json")})
        return plain


FRAMES = {"reference": "that of the reference instrument", "base": "the arm's own base"}
