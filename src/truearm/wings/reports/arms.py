"""Arms: the catalogue, the constants of one arm, and the arm that a model has identified."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from truearm.arm import Arm, Chain, DHTable, list_arms, load_arm, nearest_table
from truearm.arm.arm import joint_zeros
from truearm.arm.catalogue import MAKERS, maker_of
from truearm.arm.couplings import coupling_text
from truearm.arm.rigid_motions import xyz_rpy_from_frame
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.models import Compensator
from truearm.models.identified_model import require_identified
from truearm.pages.drawings.page_record import PageRecord, version_row
from truearm.typing import FloatArray
from truearm.verbs.inputs import ArmLike, ModelLike, is_model_file, to_arm, to_model, to_model_of_tip
from truearm.verbs.record import TableRecord, TextTable, format_fixed

if TYPE_CHECKING:
    from truearm.pages.page import Page

# Base and flange that differ from none by less, in mm and as a matrix, are not shown.
ROUNDING = 1e-9
# Of the servos of printed arms: Feetech STS3215, Dynamixel X.
COUNTS_PER_TURN = 4096


def catalogue(search: str = "") -> Catalogue:
    """List the arms that are known by name, of one maker after the other.

    Parameters
    ----------
    search : str
        Words, as in `list_arms`.

    Raises
    ------
    InputError
        If no arm matches.
    """
    names = list_arms(search)
    if not names:
        raise InputError(f"no arm of the catalogue matches {search!r}", hint=f"a maker: {MAKERS}")
    return Catalogue(tuple(sorted(map(load_arm, names), key=lambda arm: (maker_of(arm.title).casefold(), arm.name))))


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
        fitted = to_model(arm)
        identified = identified_arm(fitted)
        zeros = joint_zeros(identified.chain, fitted.arm_, free=fitted.free)
        return ArmDescription(identified, convention, fitted.arm_.chain, zeros)
    return ArmDescription(to_arm(arm), convention)


def identified_arm(model: ModelLike) -> Arm:
    """The arm of a model with the constants that were identified; its base frame is that of the reference.

    Raises
    ------
    InputError
        If the model is a network, which identifies no arm.
    """
    fitted = require_identified(
        to_model_of_tip(model),
        "a model with a network identifies no arm that predicts the same points",
        file=None if isinstance(model, Compensator) else model,
        hint="give a kinematic or physical model",
    )
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
class Catalogue(TableRecord):
    """The arms that are known by name."""

    arms: tuple[Arm, ...]

    def blocks(self) -> Iterator[TextTable]:
        """See `Record.blocks`."""
        rows, before = [], None
        for arm in self.arms:
            maker = maker_of(arm.title)
            cells = (arm.name, str(arm.n_joints), f"{arm.chain.reach:.0f}", arm.title.removeprefix(f"{maker} "))
            rows.append(("" if maker == before else maker or "no maker", *cells))
            before = maker
        yield TextTable(("maker", "name", "joints", "reach mm", "what it is"), rows, left_aligned=(0, 1, 4))

    def columns(self) -> dict[str, list[object]]:
        """A row for each arm."""
        return {
            "name": [arm.name for arm in self.arms],
            "maker": [maker_of(arm.title) for arm in self.arms],
            "title": [arm.title for arm in self.arms],
            "n_joints": [arm.n_joints for arm in self.arms],
            "reach_mm": [arm.chain.reach for arm in self.arms],
        }

    def _json(self) -> object:
        return {
            arm.name: {
                "maker": maker_of(arm.title) or None,
                "title": arm.title,
                "source": arm.source,
                "n_joints": arm.n_joints,
                "reach_mm": arm.chain.reach,
            }
            for arm in self.arms
        }


@dataclass(frozen=True, eq=False, repr=False)
class ArmDescription(TableRecord, PageRecord):
    """The constants of an arm: its D-H table, in the branch nearest to that of a nominal chain. It has a page.

    Attributes
    ----------
    arm : Arm
    convention : {"dh", "mdh"}
    nominal : Chain or None
        Of an identified arm.
    zeros : (n_joints,) array or None
        Of an identified arm: what is to be added to the angles of the nominal arm [rad; of sliding joints mm].
    """

    arm: Arm
    convention: Convention
    nominal: Chain | None = None
    zeros: FloatArray | None = None

    @property
    def table(self) -> DHTable:
        """The table, in the frame of the arm's base."""
        chain = self.arm.chain
        return nearest_table(chain, self.nominal or chain, convention=self.convention)

    def page(self) -> Page:
        """The arm to be turned, with sliders, the tip's coordinates and the tables."""
        from truearm.wings.reports.arm_page import arm_page

        return arm_page(self.arm, self.table, facts=[version_row()], is_identified=self.nominal is not None)

    def columns(self) -> dict[str, object]:
        """The D-H table, a row for each joint; of an identified arm the zeros too."""
        return {"joint": list(self.arm.joint_names), **self.table.columns(), **self._zero_columns()}

    def _json(self) -> object:
        """The fixed motions between joints, and a D-H table."""
        arm = self.arm
        frames = [xyz_rpy_from_frame(frame) for frame in arm.chain.fixed]
        return {
            "name": arm.name,
            "title": arm.title,
            "serial_number": arm.serial_number or None,
            "source": arm.source,
            "joint_names": arm.joint_names,
            "fixed_xyz_mm": [xyz for xyz, _ in frames],
            "fixed_rpy_deg": [np.degrees(rpy) for _, rpy in frames],
            "tip_in_flange_mm": arm.chain.tip_in_flange,
            "reach_mm": arm.chain.reach,
            "gravity_in_base": arm.gravity_direction,
            **({} if arm.chain.coupling is None else {"coupling": arm.chain.coupling}),
            **({} if arm.masses is None else {"mass_kg": arm.masses.mass_kg}),
            **self._zero_columns(),
            self.convention: self.table.columns(),
        }

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        arm, table = self.arm, self.table
        yield f"{arm.name}: {arm.title}"
        yield from arm.remarks
        yield self._joint_table()
        if zeros := self._zero_columns():
            slides = self.arm.chain.is_prismatic
            rows = [
                (joint, f"{zeros['zero_deg'][i]:+.3f}", f"{zeros['zero_counts'][i]:+.1f}")
                for i, joint in enumerate(arm.joint_labels)
                if not slides[i]
            ]
            yield TextTable(("joint", "zero deg", f"counts of {COUNTS_PER_TURN}"), rows)
            yield "zero: what to add to the angles of the nominal arm; new zero of a servo = old zero - sign x counts"
        for where, frame in (("before J1", table.base), (f"after J{arm.n_joints}", table.flange)):
            if np.abs(frame - np.eye(4)).max() > ROUNDING:
                xyz, rpy = xyz_rpy_from_frame(frame)
                numbers = (", ".join(map(format_fixed, one)) for one in (xyz, np.degrees(rpy)))
                yield "{}: {} mm, roll pitch yaw {} deg".format(where, *numbers)
        if (coupling := arm.chain.coupling) is not None:
            yield f"joints by the encoders: {coupling_text(coupling)}"
        yield f"tip in the flange: {', '.join(map(format_fixed, table.tip_in_flange))} mm"
        if arm.masses is not None:
            yield f"masses of the links: {', '.join(f'{mass:.4g}' for mass in arm.masses.mass_kg)} kg"
        if (arm.gravity_direction != [0, 0, -1]).any():
            yield f"direction of gravity in the base frame: {', '.join(map(format_fixed, arm.gravity_direction))}"
        if arm.serial_number:
            yield f"serial number: {arm.serial_number}"
        yield f"source: {arm.source}"

    def _zero_columns(self) -> dict[str, FloatArray]:
        """Zeros of the turning joints of an identified arm; NaN of sliding ones."""
        if self.zeros is None or not self.zeros.any():
            return {}
        turns = np.where(self.arm.chain.is_prismatic, np.nan, self.zeros / (2 * np.pi))
        return {"zero_deg": 360 * turns, "zero_counts": COUNTS_PER_TURN * turns}

    def _joint_table(self) -> TextTable:
        shown = self.table.used_columns()
        rows = []
        for i, joint in enumerate(self.arm.joint_labels):
            limits = self.arm.limits[i] if self.arm.joint_units[i] == "mm" else np.degrees(self.arm.limits[i])
            cells = [format_fixed(column[i]) for column in shown.values()]
            ends = [format_fixed(end, 1) for end in limits]
            rows.append([joint, *cells, *ends, self.arm.joint_units[i]])
        return TextTable(("joint", *shown, "min", "max", ""), rows)
