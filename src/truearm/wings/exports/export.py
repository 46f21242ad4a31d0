"""`export`: the model as a file of another program; `check_export`: such a file compared with the model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from truearm.acceptance import acceptance_remarks, accepts
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.arm_check import check_has_kinematics
from truearm.pages.drawings.page_record import input_files
from truearm.readings import check_angles
from truearm.readings.readings import PAYLOAD
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ModelLike, SessionLike, to_model_of_tip, to_session
from truearm.verbs.outputs import check_output
from truearm.verbs.record import Record, TableRecord, TextTable, columns_of, format_fixed
from truearm.wings.exports.formats import ExportFormat
from truearm.wings.exports.formats.formats import FORMATS, Comparison, compare_with_model, format_of
from truearm.wings.exports.targets import Frame
from truearm.wings.exports.targets.manifest import Manifest, read_manifest

Verdict = Literal["agrees", "not verified", "differs"]

FRAMES = {"reference": "that of the reference instrument", "base": "the arm's own base"}


@one_blas_thread()
@accepts
def export(
    model: ModelLike,
    out: str | Path,
    *,
    format: ExportFormat | None = None,
    region: SessionLike | None = None,
    source: str | Path | None = None,
    frame: Frame | None = None,
    convention: Convention | None = None,
    tip: str | None = None,
    accept: str | None = None,
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
        One of `truearm.wings.exports.formats.ExportFormat`; by default that of the file's suffix.
    region : Session, DataFrame, str or Path, optional
        Joint angles at which a file of constants must be good, the poses of your task; by default a sample of the
        training readings.
    source : str or Path, optional
        The robot's own file, of which all but the constants is kept: URDF, MJCF, kinematics yaml, LeRobot calibration.
    frame : {"base", "reference"}, optional
        For files of constants: the frame of the file's root is the arm's own base (default), or that of the reference.
    convention : {"dh", "mdh"}, optional
        For ``constants``: Denavit-Hartenberg or modified; by default the one with the nominal arm's
        numbers.
    tip : str, optional
        Name of the tip, of a model with several.
    accept : str, optional
        Why `source` is right where it would be refused as that of another robot; the file states it.

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
    name = format_of(out, format)
    spec, fitted = FORMATS[name], to_model_of_tip(model, tip)
    if spec.holds_constants:
        check_has_kinematics(fitted.arm_, "constants need")
    check_output(out, *input_files(model, region, source), read=read_manifest)
    given = {"region": region, "source": source, "frame": frame, "convention": convention}
    options: dict[str, Any] = {option: value for option, value in given.items() if value is not None}
    if surplus := sorted(options.keys() - set(spec.options)):
        raise InputError(
            f"the option {surplus[0]} does not apply to the format {name}",
            hint=f"its options are {', '.join(spec.options)}" if spec.options else "leave it out: the model is whole",
        )
    remarks: tuple[str, ...] = ()
    if not spec.holds_constants:
        spec.load().write(fitted, Manifest.of(fitted, name), out)
        manifest = read_manifest(out)
    else:
        if region is not None:
            name_of_region = Path(region).name if isinstance(region, str | Path) else "the poses given"
            session = to_session(region, n_joints=fitted.arm.n_joints)
            check_angles(session, n_joints=fitted.arm.n_joints, prismatic=fitted.arm.chain.is_prismatic)
            options |= {"angles": session.angles, "region": name_of_region}
        written = spec.load().write(fitted, out, **options)
        remarks, manifest = written.remarks, read_manifest(out) if spec.states_origin else written.manifest
    return ExportResult(fitted, Path(out), name, manifest, acceptance_remarks(accept), remarks)


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
    accepted : tuple of str
        What `accept` overrode.
    remarks : tuple of str
        What changed, where the file has no place to say it.
    """

    model: Compensator
    path: Path
    format: ExportFormat
    manifest: Manifest
    accepted: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

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
                f"{nominal} mm; the model's own uncertainty {own} mm), by cross-validation over {loss.n_poses} poses "
                f"({loss.region})."
            )
            if origin.model == "physical":
                yield self._what_is_lost()
        if origin.model == "physical" and (payload := self.model.training_.columns.get(PAYLOAD)) is not None:
            yield f"It applies to the payload of the training, {payload.mean:g} kg."
        yield from (*self.remarks, *self.accepted)
        yield from self.model.doubts()
        if not spec.states_origin:
            return
        yield f"Frame of the file: {FRAMES[manifest.frame]}."
        yield "Five check poses are in the file: truearm export MODEL --check FILE compares them."

    def _what_is_lost(self) -> str:
        """What constants of a physical model lack, and what has it: only formats that take this model."""
        from truearm.wings.exports.formats.plain_model import plain_model

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

    def _json(self) -> object:
        return {"format": self.format, "manifest": self.manifest.model_dump(mode="json")}


@one_blas_thread()
def check_export(model: ModelLike, file: str | Path, *, tip: str | None = None) -> ExportCheck:
    """Compare an exported file with the model.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    file : str or Path
        A file of `export` or `correct`, of any format.
    tip : str, optional
        Name of the tip that the file is of, of a model with several.

    Returns
    -------
    ExportCheck

    Raises
    ------
    InputError
        If the file has no check poses, or they are damaged.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=60, seed=1).session
    >>> fit = ta.fit("ur10", session, model="kinematic")
    >>> _ = ta.export(fit.model, "arm.urdf")
    >>> ta.check_export(fit.model, "arm.urdf").agrees
    True
    """
    fitted, manifest = to_model_of_tip(model, tip), read_manifest(file)
    return ExportCheck(Path(file), manifest, tuple(compare_with_model(fitted, manifest, Path(file))))


@dataclass(frozen=True, eq=False, repr=False)
class ExportCheck(TableRecord):
    """What the check of an exported file found.

    Attributes
    ----------
    file : Path
    manifest : Manifest
    findings : tuple of Comparison
    """

    file: Path
    manifest: Manifest
    findings: tuple[Comparison, ...]

    @property
    def verdict(self) -> Verdict:
        """``not verified`` if nothing differs, but not everything was run."""
        outcomes = {finding.outcome for finding in self.findings}
        return "differs" if "differs" in outcomes else "not verified" if "not run" in outcomes else "agrees"

    @property
    def agrees(self) -> bool:
        """Whether everything was compared, and nothing differs."""
        return self.verdict == "agrees"

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        if self.verdict == "agrees":
            yield f"{self.file.name} agrees with the model ({self.manifest.format}, {self.manifest.direction})."
        elif self.verdict == "not verified":
            yield f"{self.file.name} is not verified: {self._those('not run')} not run, nothing else differs."
        else:
            yield (
                f"{self.file.name} does not agree with the model: {self._those('differs')}. Do not use it; "
                "export it again."
            )
        rows = [(finding.what, finding.outcome, finding.detail) for finding in self.findings]
        yield TextTable(("comparison", "outcome", "detail"), rows, left_aligned=(0, 1, 2))

    def _those(self, outcome: str) -> str:
        return ", ".join(finding.what for finding in self.findings if finding.outcome == outcome)

    def columns(self) -> dict[str, list[Any]]:
        """A row for each comparison."""
        return columns_of(self.findings)

    def _json(self) -> object:
        origin = {"format": self.manifest.format, "direction": self.manifest.direction}
        return {**self._named("agrees", "verdict"), **origin, "findings": self.findings}
