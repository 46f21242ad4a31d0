"""Where an exported file comes from: the model, its arm, what it was trained on, the program and the date."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from truearm import __version__
from truearm.acceptance import Acceptance, accepted
from truearm.arm import Arm
from truearm.arm.couplings import coupling_text
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.model_archive import model_bytes

Finite = Annotated[float, Field(allow_inf_nan=False)]
MAX_TEXT = 300
Text = Annotated[str, Field(max_length=MAX_TEXT)]


class TrainedTemperature(BaseModel):
    """Temperature in training [degC]: its mean and the range."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())
    mean: Finite
    lower: Finite
    upper: Finite


class Provenance(BaseModel):
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

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())
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
            hint="of a robot with mimic joints: --as urdf with --source, its own URDF; truearm correct works without",
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
