"""Check an exported file: whose it is, whether it was changed, and whether it gives what the model gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, Literal

import numpy as np

from truearm import __version__
from truearm.compensation.models import Compensator
from truearm.compensation.models.provenance import provenance_of
from truearm.compensation.targets.manifest import EXACT_MM, Manifest, TargetsManifest, content_hash, read_manifest
from truearm.compensation.targets.pose_models import with_tool
from truearm.errors import InputError, MissingTool
from truearm.identification.references.alignment import align
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.workflows.export import FORMATS
from truearm.workflows.inputs import ModelLike, to_model_of_tip
from truearm.workflows.record import Record, TextTable, to_plain

# Ratios of tips by which a wrong unit of length is recognised, with their names.
UNITS = {1e-3: "metres for millimetres", 1e3: "millimetres for metres", 25.4: "inches for millimetres"}
# Share within which such a ratio is met.
UNIT_SHARE = 0.02
# At the check poses, spread over the trained ranges, a file of constants may err by more than over its region.
LOSS_FACTOR = 3.0
# Two descriptions of one nominal arm, and no error of constants, differ by less [mm].
NOMINAL_MM = 0.01

Verdict = Literal["agrees", "not verified", "differs"]


@dataclass(frozen=True)
class Finding:
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
    return ExportCheck(Path(file), manifest, tuple(_findings(fitted, manifest, Path(file))))


def _findings(model: Compensator, manifest: Manifest, file: Path) -> Iterator[Finding]:
    own, origin = provenance_of(model), manifest.provenance
    yield _same_arm(own.arm, own.serial_number, origin.arm, origin.serial_number)
    same = own.model_sha256 == origin.model_sha256
    yield Finding(
        "model",
        "agrees" if same else "differs",
        "the file was made from this model" if same else f"the file was made from another one on {origin.date}",
    )
    if manifest.joints.shape[1:] != (model.arm.n_joints,):
        yield Finding("joints", "differs", f"{manifest.joints.shape[-1]} in the file, {model.arm.n_joints} in the arm")
        return
    yield _as_the_model(model, manifest)
    if manifest.format not in FORMATS:
        yield _as_written(manifest, file)
        return
    if FORMATS[manifest.format].is_code:
        if not same:
            yield Finding("content", "not run", "code of another model is not run")
            return
        if foreign := _foreign_line(model, manifest, file):
            yield Finding("content", "differs", f"{foreign}; the code was not run")
            return
    yield _as_evaluated(manifest, file)


def _foreign_line(model: Compensator, manifest: Manifest, file: Path) -> str:
    """Where a file of code is not what truearm writes for the model; empty if it is, so that it is safe to run."""
    with TemporaryDirectory() as folder:
        own = Path(folder) / file.name
        _module(manifest.format).write(model, manifest, own)
        lines, given = own.read_bytes().splitlines(), file.read_bytes().splitlines()
    if lines == given:
        return ""
    pairs = enumerate(zip_longest(lines, given), 1)
    number = next(i for i, (one, other) in pairs if one != other)
    by = manifest.provenance.truearm
    version = "" if by == __version__ else f" (it was written by version {by}, this is {__version__})"
    return f"line {number} is not what truearm writes for this model{version}"


def _module(format: str) -> ModuleType:
    return import_module(f"truearm.compensation.export.{FORMATS[format].module}")


def _same_arm(own: str, own_serial: str, arm: str, serial: str) -> Finding:
    same = own == arm and own_serial == serial
    name, own_name = (f"{a} {f'serial number {s}' if s else ''}".strip() for a, s in ((arm, serial), (own, own_serial)))
    return Finding(
        "arm", "agrees" if same else "differs", name if same else f"{name} in the file, {own_name} in the model"
    )


def _as_the_model(model: Compensator, manifest: Manifest) -> Finding:
    """Compare what the file is said to give with what the model gives."""
    equipped = model if manifest.tool is None else with_tool(model, np.array(manifest.tool))
    rows = np.isfinite(manifest.machine_joints).all(axis=1)
    if not rows.any():
        return Finding("check poses", "not run", "none of them could be corrected")
    try:
        tips = equipped.predict(manifest.machine_joints[rows])
    except InputError as error:
        return Finding("check poses", "differs", f"the model refuses their joints: {error.problem}")
    expected = manifest.tips[rows] if manifest.frame == "reference" else _aligned(manifest.tips[rows], tips)
    largest = float(np.linalg.norm(expected - tips, axis=1).max())
    limit = _limit_mm(equipped, manifest, tips)
    detail = f"tips of the check poses differ by {largest:.3g} mm from the model's, at most {limit:.3g} mm expected"
    return Finding("check poses", "agrees" if largest <= limit else "differs", detail)


def _as_written(manifest: Manifest, file: Path) -> Finding:
    """Compare corrected targets, which nobody can evaluate, with what was written."""
    if not isinstance(manifest, TargetsManifest):
        return Finding("content", "differs", "the file does not say what was written: correct the targets again")
    if content_hash(file) == manifest.content_sha256:
        return Finding("content", "agrees", "the targets are those that were written")
    return Finding("content", "differs", "the file was changed after it was written")


def _limit_mm(model: Compensator, manifest: Manifest, tips: FloatArray) -> float:
    """How far the check poses may be from the model: by the format, and not further than the nominal arm is."""
    spec = FORMATS.get(manifest.format)
    if spec is None or not spec.holds_constants or manifest.loss is None:
        return EXACT_MM
    nominal = model.predict_nominal(manifest.joints)
    largest = float(np.linalg.norm(nominal - tips, axis=1).max())
    return LOSS_FACTOR * min(max(manifest.loss.exported_max_mm, EXACT_MM), max(largest, NOMINAL_MM))


def _as_evaluated(manifest: Manifest, file: Path) -> Finding:
    """Compare what the file gives with what it is said to give."""
    try:
        tips = np.asarray(_module(manifest.format).tips(file, manifest.joints))
    except MissingTool as error:
        return Finding("content", "not run", str(error))
    except InputError as error:
        return Finding("content", "differs", error.problem)
    largest = float(np.linalg.norm(tips - manifest.tips, axis=1).max())
    if largest <= EXACT_MM:  # not the file's own tolerance
        return Finding("content", "agrees", f"evaluated at the check poses: {largest:.2g} mm at most")
    return Finding("content", "differs", f"evaluated at the check poses: {largest:.4g} mm off{_likely(tips, manifest)}")


def _likely(tips: FloatArray, manifest: Manifest) -> str:
    """The likely cause, if the sizes show one."""
    ratio = float(np.linalg.norm(tips) / np.linalg.norm(manifest.tips))
    for unit, name in UNITS.items():
        if abs(ratio / unit - 1) < UNIT_SHARE:
            return f"; its lengths are {ratio:.4g} times as long: {name}"
    return "; its numbers were changed after the export"


def _aligned(points: FloatArray, to: FloatArray) -> FloatArray:
    """Points (n, 3) of the arm's own base frame in the frame of others [mm]: only their shape is compared."""
    T = align(points, to)
    return points @ T[:3, :3].T + T[:3, 3]


@dataclass(frozen=True, eq=False, repr=False)
class ExportCheck(Record):
    """What the check of an exported file found.

    Attributes
    ----------
    file : Path
    manifest : Manifest
    findings : tuple of Finding
    """

    file: Path
    manifest: Manifest
    findings: tuple[Finding, ...]

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

    def to_dict(self) -> dict[str, Any]:
        """See `Record.to_dict`."""
        plain: dict[str, Any] = to_plain(
            {
                "agrees": self.agrees,
                "verdict": self.verdict,
                "format": self.manifest.format,
                "direction": self.manifest.direction,
                "findings": self.findings,
            }
        )
        return plain
