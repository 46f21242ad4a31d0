"""The page of a connected arm: one HTML document with its style, its script and the arm; the server sends the rest.

The arm drawn is the identified one in the frame of its reference, else the nominal one in its base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import jinja2
import numpy as np
from markupsafe import Markup

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.pages.drawings.arm_scene import arm_mechanism
from truearm.pages.palette import style_rules
from truearm.pages.scene import data_block, scene_script, script_hash
from truearm.printable_text import printable
from truearm.typing import FloatArray
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.recording.reference_point import TYPED


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """The arm that the page draws.

    Attributes
    ----------
    arm : Arm
    is_identified : bool
        Whether it stands in the frame of the reference, not in its base.
    """

    arm: Arm
    is_identified: bool

    def pivots(self, angles_rad: FloatArray) -> list[float]:
        """The values of its pivots at joint angles (n_joints,) [deg, or mm of sliding joints]."""
        scale = np.where(self.arm.chain.is_prismatic, 1.0, np.degrees(1.0))
        values: list[float] = (self.arm.chain.joint_angles(angles_rad) * scale).tolist()
        return values

    def tips_mm(self, angles_rad: FloatArray) -> list[list[float]]:
        """Its tips at joint angles (n, n_joints) [mm]."""
        tips: list[list[float]] = self.arm.chain.tip_in_base(angles_rad).tolist()
        return tips


def drawn_arm(arm: Arm | None, model: Compensator | None) -> DrawnArm:
    """The arm that the page draws.

    Raises
    ------
    InputError
        If there is none, or nothing is known of its kinematics.
    """
    found = None if model is None else to_identified(model)
    if found is not None:
        return DrawnArm(replace(found.arm, chain=found.fit_.chain), is_identified=True)
    if arm is None:
        raise InputError("the page needs the arm", hint="--arm ARM, or --model-file MODEL")
    if not arm.has_kinematics:
        raise InputError(f"of arm {arm.name!r} only the joints are known", hint="truearm record takes its readings")
    return DrawnArm(arm, is_identified=False)


FULL_TURN_DEG = 180.0  # what the strip of a joint without limit spans, to each side


def live_page(recording: Recording, drawn: DrawnArm) -> str:
    """The page as one HTML document.

    Parameters
    ----------
    recording : Recording
    drawn : DrawnArm
    """
    arm, script = drawn.arm, scene_script(_text("live.mjs"))
    label = f"The arm {arm.name} in space as it moves, and the readings taken"
    scene = {"label": label, "unit": "mm", "points": None, **drawn_scene(drawn)}
    sheets = [style_rules(), *(files("truearm.pages").joinpath(name).read_text("utf-8") for name in _SHEETS)]
    page = _template().render(
        arm=arm,
        out=str(recording.out),
        source=recording.source.name,
        has_model_file=recording.out_model is not None,
        has_next=recording.plan is not None or recording.rank,
        can_steer=recording.source.steer is not None,
        is_typed=recording.reference == TYPED,
        joints=list(zip(arm.joint_labels, arm.joint_units, strict=True)),
        scene=Markup(data_block(scene)),  # noqa: S704, every sign of markup in it is an escape
        settings=Markup(data_block(_settings(recording, drawn))),  # noqa: S704
        style=Markup("".join([*sheets, _text("live.css")])),  # noqa: S704, our own files
        script=Markup(script),  # noqa: S704, our own files
        script_hash=Markup(script_hash(script)),  # noqa: S704
    )
    return printable(page)


_SHEETS = ("page.css", "scene.css")


def drawn_scene(drawn: DrawnArm) -> dict[str, object]:
    """The arm as data of a scene."""
    mechanism = arm_mechanism(drawn.arm, from_origin=not drawn.is_identified)
    return {"mechanism": mechanism.to_json("mm"), "lines": [], "is_identified": drawn.is_identified}


def _settings(recording: Recording, drawn: DrawnArm) -> dict[str, object]:
    """What the script of the page must know of the recording."""
    return {
        "spans": _spans(drawn),
        "takes_by_itself": recording.on == "still",
        "n_poses": None if recording.plan is None else len(recording.plan),
        "arm": recording.arm_given or "ARM",
    }


def _spans(drawn: DrawnArm) -> list[list[float]]:
    """The ends of each joint's strip [deg, or mm of sliding joints]."""
    arm = drawn.arm
    slides = arm.chain.is_prismatic
    ends = arm.limits * np.where(slides, 1.0, np.degrees(1.0))[:, None]
    widest = np.where(slides, arm.chain.reach, FULL_TURN_DEG)[:, None] * [-1.0, 1.0]
    spans: list[list[float]] = np.where(np.isfinite(ends), ends, widest).tolist()
    return spans


def _text(name: str) -> str:
    return files("truearm.wings.bench.live_server").joinpath(name).read_text("utf-8")


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_text("live.html.j2"))
