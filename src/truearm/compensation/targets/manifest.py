"""What every exported file states of itself: its origin, its direction, its loss and five check poses.

The manifest is one line of JSON after the marker ``truearm-export: ``, in a comment, a metadata field or a key of the
file's format, so that any reader finds it.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.provenance import Finite, Provenance, Text, provenance_of
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.typing import FloatArray

MARKER = "truearm-export"
N_CHECK_POSES = 5
# Points of different programs agree to rounding, some 1e-10 mm; files print fewer digits.
EXACT_MM = 1e-6
MAX_BYTES = 64 * 2**20
_BEGIN = re.compile(rf"{MARKER}[^{{]{{0,16}}(?={{)")

Direction = Literal["predict", "command", "feedback"]
"""``predict``: from encoder angles to the true tip. ``command``: from planned joints to those to send, so that the arm
goes there. ``feedback``: from encoder angles to those with which the nominal arm shows the true tip."""

Numbers = Annotated[tuple[Finite, ...], Field(max_length=100)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


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
        Of the nominal arm with base and tip identified, and of the file.
    model_mm : float
        Standard uncertainty of the full model's tips there, root mean square of the three coordinates together.
    exported_max_mm : float
        Largest distance of the file.
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
    frame: Literal["reference", "base"] = "reference"
    provenance: Provenance
    tolerance_mm: Finite = EXACT_MM
    check_poses: Annotated[tuple[CheckPose, ...], Field(max_length=N_CHECK_POSES)]
    loss: ExportLoss | None = None
    tool: Numbers | None = None

    def line(self) -> str:
        """The marker and one line of JSON that may stand in comments of XML and C: without ``--``, ``*/`` or breaks."""
        text = json.dumps(self.model_dump(mode="json"), separators=(",", ":"))
        return f"{MARKER}: " + text.replace("--", "-\\u002d").replace("*/", "*\\/")

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
        frame: Literal["reference", "base"] = "reference",
        loss: ExportLoss | None = None,
        tolerance_mm: float = EXACT_MM,
        corrected_joints: FloatArray | None = None,
    ) -> Self:
        """Manifest of a file made from a model.

        Parameters
        ----------
        model : Compensator
            Fitted.
        format : str
        tips : (5, 3) array, optional
            What the file gives at `check_joints` [mm]; the model's points by default.
        direction, frame, loss, tolerance_mm
            As the attributes.
        corrected_joints : (5, n_joints) array, optional
            Joints that the file gives there [rad, or mm].
        """
        joints = check_joints(model)
        tips = model.predict(joints) if tips is None else tips
        corrected = [None] * len(joints) if corrected_joints is None else corrected_joints.tolist()
        poses = tuple(
            CheckPose(joints=tuple(q), tip_mm=tuple(tip), corrected_joints=None if back is None else tuple(back))
            for q, tip, back in zip(joints.tolist(), tips.tolist(), corrected, strict=True)
        )
        return cls(
            format=format,
            direction=direction,
            frame=frame,
            provenance=provenance_of(model),
            tolerance_mm=tolerance_mm,
            check_poses=poses,
            loss=loss,
        )


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
    """The text of a file as Latin-1, the start and end of the manifest's JSON in it, and the manifest."""
    text = read_limited(path, limit_bytes=MAX_BYTES).decode("latin-1")
    begin = _BEGIN.search(text)
    if begin is None:
        raise InputError(
            "the file has no check poses: truearm did not export it, or they were removed",
            file=path,
            hint="truearm export MODEL --out FILE",
        )
    try:
        data, end = json.JSONDecoder().raw_decode(text, begin.end())
        kind = TargetsManifest if "content_sha256" in data else Manifest
        return text, begin.end(), end, kind.model_validate_json(json.dumps(data))
    except (ValueError, RecursionError, ValidationError) as error:
        line = text.count("\n", 0, begin.start()) + 1
        problem = str(error).splitlines()[0]
        raise InputError(f"the line {MARKER} is damaged ({problem})", file=path, line=line) from None
