"""Arms: the catalogue, the constants of one arm, and the arm that a model has identified."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from truearm.arm import Arm, dh_table, list_arms, load_arm, mdh_table
from truearm.arm.rigid_motions import xyz_rpy_from_frame
from truearm.compensation.models import Compensator
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.errors import InputError
from truearm.workflows.inputs import ArmLike, ModelLike, is_model_file, to_arm, to_model
from truearm.workflows.record import Record, TextTable, format_fixed, to_plain

Convention = Literal["dh", "mdh"]


def catalogue() -> Catalogue:
    """List the arms that are known by name."""
    return Catalogue(tuple(load_arm(name) for name in list_arms()))


def describe_arm(arm: ArmLike | ModelLike, *, convention: Convention = "dh") -> ArmDescription:
    """Describe an arm; of a model or its file the identified one.

    Parameters
    ----------
    arm : Arm, Compensator, str or Path
        An arm, its name or file; a fitted model or its file.
    convention : {"dh", "mdh"}
        Of the table of constants.
    """
    if isinstance(arm, Compensator) or (isinstance(arm, str | Path) and is_model_file(arm)):
        return ArmDescription(identified_arm(arm), convention)
    return ArmDescription(to_arm(arm), convention)


def identified_arm(model: ModelLike) -> Arm:
    """The arm of a model with the constants that were identified; its base frame is that of the reference.

    Raises
    ------
    InputError
        If the model is a network, which identifies no arm.
    """
    fitted = to_model(model)
    if not isinstance(fitted, IdentifiedModel):
        file = None if isinstance(model, Compensator) else model
        raise InputError("a network model identifies no arm", file=file, hint="give a kinematic or physical model")
    chain = fitted.fit_.chain
    # Seen from the base frame, which is the reference's now, gravity has another direction.
    turn = chain.fixed[0, :3, :3] @ fitted.arm.chain.fixed[0, :3, :3].T
    return replace(
        fitted.arm,
        chain=chain,
        gravity_in_base=turn @ fitted.arm.gravity_direction,
        name=f"{fitted.arm.name}-identified",
        title=f"{fitted.arm.title}, identified from {fitted.n_train_} readings".strip(", "),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Catalogue(Record):
    """The arms that are known by name."""

    arms: tuple[Arm, ...]

    def blocks(self) -> Iterator[TextTable]:
        """See `Record.blocks`."""
        rows = [(arm.name, str(arm.n_joints), f"{arm.chain.reach:.0f}", arm.title) for arm in self.arms]
        yield TextTable(("name", "joints", "reach mm", "what it is"), rows, left_aligned=(0, 3))

    def to_dict(self) -> dict[str, Any]:
        """See `Record.to_dict`."""
        return {
            arm.name: {"title": arm.title, "n_joints": arm.n_joints, "reach_mm": arm.chain.reach} for arm in self.arms
        }


@dataclass(frozen=True, eq=False, repr=False)
class ArmDescription(Record):
    """The constants of an arm: its D-H table, or where it has none the frames of its joints."""

    arm: Arm
    convention: Convention

    def to_dict(self) -> dict[str, Any]:
        """See `Record.to_dict`: the fixed motions between joints always, a D-H table where the arm has one."""
        arm = self.arm
        frames = [xyz_rpy_from_frame(frame) for frame in arm.chain.fixed]
        facts: dict[str, Any] = {
            "name": arm.name,
            "title": arm.title,
            "source": arm.source,
            "joint_names": list(arm.joint_names),
            "fixed_xyz_mm": [xyz for xyz, _ in frames],
            "fixed_rpy_deg": [np.degrees(rpy) for _, rpy in frames],
            "tip_in_flange_mm": arm.chain.tip_in_flange,
            "reach_mm": arm.chain.reach,
            "gravity_in_base": arm.gravity_direction,
        }
        if arm.masses is not None:
            facts["mass_kg"] = arm.masses.mass_kg
        try:
            table = (dh_table if self.convention == "dh" else mdh_table)(arm.chain)
        except InputError:  # axes that are almost parallel have no bounded table
            pass
        else:
            facts[self.convention] = {
                "a_mm": table.a,
                "d_mm": table.d,
                "alpha_deg": np.degrees(table.alpha),
                "theta_deg": np.degrees(table.theta),
            }
        plain: dict[str, Any] = to_plain(facts)
        return plain

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        arm, facts = self.arm, self.to_dict()
        yield f"{arm.name}: {arm.title}"
        yield self._table(facts)
        if (arm.chain.fixed[0] != np.eye(4)).any():
            xyz, rpy = (", ".join(map(format_fixed, facts[key][0])) for key in ("fixed_xyz_mm", "fixed_rpy_deg"))
            yield f"before J1: {xyz} mm, roll pitch yaw {rpy} deg"
        yield f"tip in the flange: {', '.join(map(format_fixed, facts['tip_in_flange_mm']))} mm"
        if arm.masses is not None:
            yield f"masses of the links: {', '.join(f'{mass:.4g}' for mass in arm.masses.mass_kg)} kg"
        if (arm.gravity_direction != [0, 0, -1]).any():
            yield f"direction of gravity in the base frame: {', '.join(map(format_fixed, arm.gravity_direction))}"
        yield f"source: {arm.source}"

    def _table(self, facts: dict[str, Any]) -> TextTable:
        columns = facts.get(self.convention)
        if columns is None:
            frames = np.hstack([facts["fixed_xyz_mm"], facts["fixed_rpy_deg"]])[1:]
            heads = ["x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
            columns = dict(zip(heads, frames.T.tolist(), strict=True))
        rows = []
        for i, name in enumerate(self.arm.joint_names):
            slides = self.arm.chain.is_prismatic[i]
            limits = self.arm.limits[i] if slides else np.degrees(self.arm.limits[i])
            cells = [format_fixed(column[i]) for column in columns.values()]
            ends = [format_fixed(end, 1) for end in limits]
            joint = f"J{i + 1}" if name == f"J{i + 1}" else f"J{i + 1} {name}"
            rows.append([joint, *cells, *ends, "mm" if slides else "deg"])
        return TextTable(("joint", *columns, "min", "max", ""), rows)
