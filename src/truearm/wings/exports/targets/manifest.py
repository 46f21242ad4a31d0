"""What every exported file states of itself: its origin, its direction, its loss and five check poses.

The origin is the model, its arm, what it was trained on, the program and the date. The manifest is one line of JSON
after the marker ``truearm-export: ``, in a comment, a metadata field or a key of the file's format, so that any reader
finds it.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence, Sized
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from truearm import __version__
from truearm.acceptance import Acceptance, accepted
from truearm.arm import Arm
from truearm.arm.couplings import coupling_text
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.models import Compensator
from truearm.models.model_archive import model_bytes
from truearm.typing import FloatArray
from truearm.wings.exports.targets import Frame as Frame

Finite = Annotated[float, Field(allow_inf_nan=False)]
MAX_TEXT = 300
Text = Annotated[str, Field(max_length=MAX_TEXT)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class TrainedTemperature(_Strict):
    """Temperature in training [degC]: its mean and the range."""

    mean: Finite
    lower: Finite
    upper: Finite


class Provenance(_Strict):
    """Where an exported file comes from.

    Attributes
    ----------
    model_sha256 : str
        Of the model file, as ``sha256sum`` prints it.
    model : str
        Its kind.
    arm, serial_number : str
        Type and unit of the arm; an empty serial number is not stated.
    joint_names : tuple of str
        In the order of the chain; in a URDF made from the robot's own file those of that file.
    joint_units : tuple of {"rad", "mm"}
    trained_ranges : tuple of (float, float)
        Smallest and largest training angle of each joint, in its unit.
    trained_temperature_degC : TrainedTemperature or None
        None where the readings state none.
    n_readings : int
        Training readings.
    date : str
        Day of the export (UTC), as 2026-11-22.
    truearm : str
        Version of the program.
    accepted : tuple of Acceptance
        Contradictions that a person accepted in the fit, or of the file that was made from, with the reasons.
    """

    model_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    model: Text
    arm: Text
    serial_number: Text
    joint_names: Annotated[tuple[Text, ...], Field(max_length=100)]
    joint_units: Annotated[tuple[Literal["rad", "mm"], ...], Field(max_length=100)]
    trained_ranges: Annotated[tuple[tuple[Finite, Finite], ...], Field(max_length=100)]
    trained_temperature_degC: TrainedTemperature | None
    n_readings: int
    date: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    truearm: Text
    accepted: Annotated[tuple[Acceptance, ...], Field(max_length=100)] = ()


def stated_text(text: str) -> str:
    """A name as a file may state it: cut at `MAX_TEXT` characters, and with ``?`` for what is no character."""
    return text[:MAX_TEXT].encode("utf-8", "replace").decode("utf-8")


def check_not_coupled(arm: Arm, format: str) -> None:
    """Refuse an arm with coupled joints, which a file of some format cannot state.

    Raises
    ------
    InputError
    """
    if arm.chain.coupling is not None:
        raise InputError(
            f"the joints of {arm.name!r} are coupled ({coupling_text(arm.chain.coupling)}), which a file of format "
            f"{format} cannot state",
            hint="of a robot with mimic joints: --as urdf with --original, its own URDF; truearm correct works without",
        )


def provenance_of(model: Compensator) -> Provenance:
    """The provenance of what is exported from a fitted model today.

    Raises
    ------
    InputError
        If the model is not fitted, or a joint has a name longer than `MAX_TEXT` or with half a character.
    """
    sha256 = hashlib.sha256(model_bytes(model)).hexdigest()
    training, arm = model.training_, model.arm_
    for name in arm.joint_names:
        if stated_text(name) != name:
            raise InputError(
                f"expected names of joints with at most {MAX_TEXT} characters, of Unicode, got {name[:60]!r}",
                hint="rename the joint in the arm file",
            )
    temperature = training.temperature_degC
    return Provenance(
        model_sha256=sha256,
        model=model.kind,
        arm=stated_text(arm.name),
        serial_number=stated_text(arm.serial_number),
        joint_names=arm.joint_names,
        joint_units=tuple(np.where(arm.chain.is_prismatic, "mm", "rad").tolist()),
        trained_ranges=tuple((float(low), float(high)) for low, high in training.angle_ranges),
        trained_temperature_degC=None
        if temperature is None
        else TrainedTemperature(mean=temperature.mean, lower=temperature.lower, upper=temperature.upper),
        n_readings=training.n_readings,
        date=datetime.now(UTC).date().isoformat(),
        truearm=__version__,
        accepted=accepted(model.accepted_),
    )


MARKER = "truearm-export"
N_CHECK_POSES = 5
# Points of different programs agree to rounding, some 1e-10 mm; files print fewer digits.
EXACT_MM = 1e-6
MAX_BYTES = 64 * 2**20
# A manifest is one line; of an arm of 100 joints with the longest names it is shorter.
MAX_CHARACTERS = 1_000_000
# Names that stand before the manifest may contain the marker, by mistake or to mislead.
MAX_CANDIDATES = 10
_BEGIN = re.compile(rf"{MARKER}[^{{]{{0,16}}(?={{)")

Direction = Literal["predict", "command", "feedback"]
"""``predict``: from encoder angles to the true tip. ``command``: from planned joints to those to send, so that the arm
goes there. ``feedback``: from encoder angles to those with which the nominal arm shows the true tip."""

Numbers = Annotated[tuple[Finite, ...], Field(max_length=100)]


class CheckPose(_Strict):
    """Joints, and what the file must give there.

    Attributes
    ----------
    joints : tuple of float
        [rad, or mm].
    tip_mm : tuple of 3 floats
        Tip that the file gives in its frame.
    corrected_joints : tuple of float, optional
        Joints that the file gives, where it corrects joints [rad, or mm].
    """

    joints: Numbers
    tip_mm: tuple[Finite, Finite, Finite]
    corrected_joints: Numbers | None = None


class ExportLoss(_Strict):
    """Mean distance from the full model's tips over a region [mm]: what a simpler file cannot say.

    Attributes
    ----------
    nominal_mm, exported_mm : float
        Of the nominal arm with base and tip identified, and of the file: at poses held out, with constants identified
        from the other parts of the region.
    model_mm : float
        Standard uncertainty of the full model's tips there, root mean square of the three coordinates together.
    exported_max_mm : float
        Largest distance of the file, at poses held out.
    region : str
        The poses, in words.
    n_poses : int
    """

    nominal_mm: Finite
    exported_mm: Finite
    model_mm: Finite
    exported_max_mm: Finite
    region: Text
    n_poses: int


class Manifest(_Strict):
    """What an exported file states of itself.

    Attributes
    ----------
    format : str
    direction : Direction
    frame : {"reference", "base"}
        Frame of the tips: that of the reference instrument, or the arm's own base frame.
    provenance : Provenance
    tolerance_mm : float
        Within which a reader of the file must reproduce the check poses; joints within the same share of the reach.
    check_poses : tuple of CheckPose
    loss : ExportLoss, optional
        Only of files that hold less than the full model.
    tool : tuple of 6 floats, optional
        Tip in the flange [mm], and roll, pitch, yaw [rad], of joint targets for another tool than that of the readings.
    """

    format: Text
    direction: Direction
    frame: Frame = "reference"
    provenance: Provenance
    tolerance_mm: Finite = EXACT_MM
    check_poses: Annotated[tuple[CheckPose, ...], Field(min_length=N_CHECK_POSES, max_length=N_CHECK_POSES)]
    loss: ExportLoss | None = None
    tool: Numbers | None = None

    @model_validator(mode="after")
    def _of_one_arm(self) -> Self:
        origin = self.provenance
        n = len(origin.joint_names)
        lists: list[Sized] = [origin.joint_units, origin.trained_ranges]
        for pose in self.check_poses:
            lists += [pose.joints, pose.joints if pose.corrected_joints is None else pose.corrected_joints]
        if any(len(one) != n for one in lists):
            raise ValueError(f"expected {n} joints everywhere")
        if self.tool is not None and len(self.tool) != 6:
            raise ValueError("expected 6 numbers of the tool")
        return self

    def line(self) -> str:
        """The marker and one line of JSON that may stand in comments of XML and C: without ``--``, ``*/`` or breaks."""
        text = json.dumps(self.model_dump(mode="json"), separators=(",", ":"))
        return f"{MARKER}: " + text.replace("--", "-\\u002d").replace("*/", "*\\/")

    def of_joints(self, names: tuple[str, ...]) -> Self:
        """The manifest with other names of the joints, such as those of the robot's own file."""
        origin = self.provenance.model_copy(update={"joint_names": names})
        return self.model_copy(update={"provenance": origin})

    @property
    def joints(self) -> FloatArray:
        """(5, n_joints) joints of the check poses [rad, or mm]."""
        return np.array([pose.joints for pose in self.check_poses])

    @property
    def machine_joints(self) -> FloatArray:
        """Joints that the encoders read at the tips of the check poses [rad, or mm], NaN where the file has none.

        Of commands the corrected ones, of all else those of the check poses.
        """
        if self.direction != "command":
            return self.joints
        nothing = (float("nan"),) * self.joints.shape[-1]
        return np.array([pose.corrected_joints or nothing for pose in self.check_poses])

    @property
    def tips(self) -> FloatArray:
        """(5, 3) tips of the check poses [mm]."""
        return np.array([pose.tip_mm for pose in self.check_poses])

    @classmethod
    def of(
        cls,
        model: Compensator,
        format: str,
        *,
        tips: FloatArray | None = None,
        direction: Direction = "predict",
        corrected_joints: Sequence[tuple[float, ...] | None] | None = None,
        **stated: Any,
    ) -> Self:
        """Manifest of a file made from a model.

        Parameters
        ----------
        model : Compensator
            Fitted.
        format : str
        tips : (5, 3) array, optional
            What the file gives at `check_joints` [mm]; the model's points by default.
        direction, **stated
            As the attributes.
        corrected_joints : sequence of 5 tuples of float or None, optional
            Joints that the file gives there [rad, or mm].
        """
        joints = check_joints(model)
        tips = model.predict(joints) if tips is None else tips
        rows = zip(joints.tolist(), tips.tolist(), corrected_joints or [None] * len(joints), strict=True)
        poses = tuple(CheckPose(joints=tuple(q), tip_mm=tuple(tip), corrected_joints=back) for q, tip, back in rows)
        return cls(format=format, direction=direction, provenance=provenance_of(model), check_poses=poses, **stated)


class TargetsManifest(Manifest):
    """Manifest of a file of corrected targets, which no program can evaluate.

    Attributes
    ----------
    content_sha256 : str
        SHA-256 of the file without the manifest's JSON (`content_hash`).
    """

    content_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]

    @classmethod
    def for_content(cls, manifest: Manifest, comment: str, content: str) -> Self:
        """The manifest of a file that begins with it in a comment and continues with `content` in the next line."""
        digest = hashlib.sha256(f"{comment} {MARKER}: \n{content}".encode()).hexdigest()
        return cls(**dict(manifest), content_sha256=digest)


def content_hash(path: str | Path) -> str:
    """SHA-256 of an exported file without its manifest's JSON, in hexadecimal; CRLF counts as LF.

    Raises
    ------
    InputError
        As `read_manifest`.
    """
    text, begin, end, _ = _parsed(path)
    rest = f"{text[:begin]}{text[end:]}".replace("\r\n", "\n")
    return hashlib.sha256(rest.encode("latin-1")).hexdigest()


def check_joints(model: Compensator) -> FloatArray:
    """(5, n_joints) joints at which files from a model are checked [rad, or mm].

    Well spread over the middle 80 % of the trained ranges, so that a wrong sign, unit or order of joints moves one of
    the tips. Rounded to 1e-6, so that a person can type them.
    """
    low, high = model.training_.angle_ranges.T
    # A Kronecker sequence: multiples of square roots of primes, modulo 1.
    steps = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37])
    shares = np.outer(np.arange(1, N_CHECK_POSES + 1), np.resize(steps, len(low))) % 1
    return np.asarray((low + (0.1 + 0.8 * shares) * (high - low)).round(6))


def read_manifest(path: str | Path) -> Manifest:
    """The manifest of an exported file of any format.

    Raises
    ------
    InputError
        If the file is missing or too large, has no manifest, or one that is damaged.
    """
    *_, manifest = _parsed(path)
    return manifest


def _parsed(path: str | Path) -> tuple[str, int, int, Manifest]:
    """The text of a file as Latin-1, where the manifest's JSON begins and ends in it, and the manifest."""
    text = read_limited(path, limit_bytes=MAX_BYTES).decode("latin-1")
    damage: InputError | None = None
    for begin in islice(_BEGIN.finditer(text), MAX_CANDIDATES):
        try:
            data, length = json.JSONDecoder().raw_decode(text[begin.end() : begin.end() + MAX_CHARACTERS])
            kind = TargetsManifest if "content_sha256" in data else Manifest
            return text, begin.end(), begin.end() + length, kind.model_validate_json(json.dumps(data))
        except (ValueError, RecursionError, ValidationError) as error:
            line = text.count("\n", 0, begin.start()) + 1
            problem = f"the line {MARKER} is damaged ({_reason(error)})"
            damage = damage or InputError(problem, file=path, line=line, hint="truearm export MODEL --out FILE")
    raise damage or InputError(
        "the file has no check poses: truearm did not export it, or they were removed",
        file=path,
        hint="truearm export MODEL --out FILE",
    )


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return ": ".join(part for part in (".".join(map(str, first["loc"])), first["msg"]) if part)
    return str(error).splitlines()[0]
