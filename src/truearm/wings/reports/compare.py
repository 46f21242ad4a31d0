"""Compare: what has changed between two models of one arm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.models import IdentifiedModel
from truearm.models.identified_model import require_identified
from truearm.models.training_conditions import TrainingConditions
from truearm.readings.readings import PAYLOAD
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ModelLike, to_model_of_tip
from truearm.verbs.record import TableRecord, TextTable, columns_of, format_fixed, number_of, to_plain
from truearm.wings.exports.formats.constants_change import FALSE_ALARM, ArmChange, ConstantChange, constants_change
from truearm.wings.exports.formats.rigid_arm import same_chain

# Share by which mean payloads differ before it is said.
PAYLOAD_TOLERANCE = 0.05
# Constants that are printed.
MAX_ROWS = 10


@one_blas_thread()
def compare(old: ModelLike, new: ModelLike, *, tip: str | None = None) -> ModelChange:
    """Compare two models of one arm: which constants changed, and how far that moves the tip.

    The arm was fitted again after a year, a crash or a repair. A constant changed if its two values differ by more than
    their uncertainties explain. Where the base stands and which tip is on the flange is no change of the arm if the
    models identified it: both are aligned first.

    Parameters
    ----------
    old, new : Compensator, str or Path
        Two fitted nominal, kinematic or physical models of the same nominal arm, or their files.
    tip : str, optional
        Name of the tip, of models with several.

    Returns
    -------
    ModelChange

    Raises
    ------
    InputError
        If a model has no constants (network, hybrid), the nominal arms differ, a model has several tips and none is
        named, or it keeps no poses of its training.

    See Also
    --------
    truearm.wings.exports.formats.constants_change.constants_change : The method, with its sources.

    Examples
    --------
    >>> import truearm as ta
    >>> sessions = [ta.simulate("gao2017", poses=60, seed=seed).session for seed in (1, 2)]
    >>> old, new = (ta.fit("gao2017", session, model="kinematic").model for session in sessions)
    >>> [one.name for one in ta.compare(old, new).changed]
    []
    """
    models = [_to_identified_model(model, tip) for model in (old, new)]
    before, after = models
    _check_one_arm(before, after)
    change = constants_change(before, after)
    return ModelChange(before, after, change, tuple(_remarks(before, after, change)))


def _to_identified_model(model: ModelLike, tip: str | None) -> IdentifiedModel:
    fitted = to_model_of_tip(model, tip)
    return require_identified(
        fitted,
        f"expected a nominal, kinematic or physical model, got a {type(fitted).__name__}: its networks have no "
        "constants to compare",
        file=model if isinstance(model, str | Path) else None,
        hint="fit the same readings with --model physical and compare these models",
    )


def _check_one_arm(old: IdentifiedModel, new: IdentifiedModel) -> None:
    """Check that both models are of the same nominal arm."""
    if not same_chain(old.arm_.chain, new.arm_.chain):
        raise InputError(
            f"expected two models of one nominal arm, got {old.arm_.name!r} ({number_of(old.arm_.n_joints, 'joint')}) "
            f"and {new.arm_.name!r} ({number_of(new.arm_.n_joints, 'joint')}) with other nominal constants",
            hint="fit the readings of both with the same arm file",
        )


def _remarks(old: IdentifiedModel, new: IdentifiedModel, change: ArmChange) -> Iterator[str]:
    serials = old.arm_.serial_number, new.arm_.serial_number
    if all(serials) and serials[0] != serials[1]:
        yield f"The serial numbers differ ({serials[0]}, {serials[1]}): these are two arms of one type."
    if nominal := [which for which, model in (("old", old), ("new", new)) if model.kind == "nominal"]:
        yield f"The {nominal[0]} model is nominal: changes are differences from the drawing, not changes in time."
    if old.data_fingerprint_ == new.data_fingerprint_:
        yield "Both models are of the same readings: what differs are the models, not the arm."
    if own := sorted({term.name for model in (old, new) for term in model.terms}):
        yield f"Terms of your own ({', '.join(own)}) are not compared: constants may contain their change."
    for which, model in (("old", old), ("new", new)):
        yield from model.doubts(f"the {which} model")
        if model.is_refitted:
            yield f"The {which} model was refitted: its constants are those of before, updated by few readings."
    if change.displacement.region == "either":
        yield "Few poses are in the trained range of both models: those of either are compared."
        if not old.kind == new.kind == "physical":
            yield (
                "Constants of a kinematic model contain errors that depend on the pose, and differ between regions: "
                "compare physical models."
            )
    temperatures = [model.training_.temperature_degC for model in (old, new)]
    means = [one.mean for one in temperatures if one is not None]
    if len(means) == len(temperatures) and abs(means[0] - means[1]) > TrainingConditions.temperature_tolerance_K:
        yield (
            f"The mean temperatures of the training differ ({means[0]:.1f} and {means[1]:.1f} degC): longer or shorter "
            "links may be thermal expansion."
        )
    loads = [known.mean if (known := model.training_.columns.get(PAYLOAD)) else 0.0 for model in (old, new)]
    if abs(loads[0] - loads[1]) > PAYLOAD_TOLERANCE * max(loads):
        yield f"The payloads of the training differ ({loads[0]:g} and {loads[1]:g} kg): the arm bends otherwise."


@dataclass(frozen=True, eq=False, repr=False)
class ModelChange(TableRecord):
    """What has changed between two models of one arm.

    Attributes
    ----------
    old, new : IdentifiedModel
    change : ArmChange
        All constants compared, the displacement of the tip, and where base and tip went.
    remarks : tuple of str
    """

    old: IdentifiedModel
    new: IdentifiedModel
    change: ArmChange
    remarks: tuple[str, ...]

    @property
    def constants(self) -> tuple[ConstantChange, ...]:
        """The constants compared, from base to tip."""
        return self.change.constants

    @property
    def changed(self) -> tuple[ConstantChange, ...]:
        """The constants that changed, the one first that moves the tip most."""
        return tuple(sorted((one for one in self.constants if one.is_changed), key=lambda one: -one.tip_mm))

    def summary(self) -> str:
        """The answer in one sentence: how many constants changed, and how far the tip moves."""
        n, m, tip = len(self.changed), len(self.constants), self.change.displacement
        models = f"New model of {self.new.arm_.name} against the old one"
        moves = f"the tip moves by {format_mm(tip.mean_mm)} on average, {format_mm(tip.max_mm)} at most"
        if n:
            return f"{models}: {n} of {number_of(m, 'constant')} changed by more than the uncertainty; {moves}."
        answer = f"{models}: no constant changed by more than its uncertainty ({m} compared)"
        if tip.is_significant:
            return f"{answer}, but {moves}, more than the uncertainties explain."
        return f"{answer}; {moves}, within the uncertainty."

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        tip, changed = self.change.displacement, self.changed
        if changed:
            first = changed[0]
            yield f"{first.place} {first.name} moves the tip most: {format_mm(first.tip_mm)} on average by itself."
        yield (
            f"Root mean square displacement {format_mm(tip.rms_mm)}; that of an unchanged arm is below "
            f"{format_mm(tip.limit_mm)} in {100 * (1 - FALSE_ALARM):g} % of cases. {self._compared_at()}."
        )
        if tip.is_significant and not changed:
            yield "What changed may depend on the pose (gears, bearings, bending), or is spread over several constants."
        if self.constants:
            yield from self._table()
        yield from self._base_and_tip()
        yield from self.remarks

    def _compared_at(self) -> str:
        parts = {"base": self.change.base_shift_mm, "tip": self.change.tip_shift_mm}
        aligned = " and ".join(part for part, moved in parts.items() if moved is not None)
        trained = "both models" if self.change.displacement.region == "both" else "either model"
        poses = f"{number_of(self.change.displacement.n_poses, 'pose')} in the trained range of {trained}"
        return f"Compared at {poses}" + (f", with {aligned} aligned" if aligned else "")

    def _table(self) -> Iterator[str | TextTable]:
        """The constants that changed, then others, those first that move the tip most; at most `MAX_ROWS`."""
        rest = sorted((one for one in self.constants if not one.is_changed), key=lambda one: -one.tip_mm)
        shown, k = (*self.changed, *rest)[:MAX_ROWS], self.constants[0].coverage_factor
        columns = ("constant", "unit", "old", "new", "change", f"U (k = {k:.2f})", "changed", "moves tip, mm")
        yield TextTable(columns, map(_row, shown), left_aligned=(0, 1, 6))
        more = len(self.constants) - len(shown)
        yield (
            f"U is the uncertainty of the change; with this k, {100 * FALSE_ALARM:g} % of unchanged arms or fewer have "
            "any change. Not determined: by the readings of one model or both."
            + (f" {number_of(more, 'more constant')}: --json or to_dict()." if more else "")
        )

    def _base_and_tip(self) -> Iterator[str]:
        """Where base and tip went, which says nothing about the arm."""
        if (shift := self.change.base_shift_mm) is not None:
            assert self.change.base_turn_rad is not None
            turn = format_fixed(degrees(self.change.base_turn_rad))
            yield f"Base: {format_fixed(shift, 3)} mm and {turn} deg from the old one; a new set-up is no change."
        if (moved := self.change.tip_shift_mm) is not None:
            shifts = ", ".join(format_fixed(value, 3, sign=True) for value in moved)
            yield f"Tip: {shifts} mm (x, y, z of the flange) from the old one; another tip is no change."

    def columns(self) -> dict[str, list[Any]]:
        """A row for each constant compared, from base to tip, in its ``unit`` (rad or mm)."""
        return columns_of(self._constants_json())

    def _constants_json(self) -> list[dict[str, Any]]:
        return [
            {**to_plain(one), "expanded_uncertainty": one.U, "is_changed": one.is_changed} for one in self.constants
        ]

    def _json(self) -> object:
        """Angles in rad, lengths in mm."""
        return {
            "summary": self.summary(),
            "arm": self.new.arm_.name,
            "n_constants": len(self.constants),
            "n_changed": len(self.changed),
            "constants": self._constants_json(),
            "displacement": {
                **to_plain(self.change.displacement),
                "is_significant": self.change.displacement.is_significant,
            },
            "base_shift_mm": self.change.base_shift_mm,
            "base_turn_rad": self.change.base_turn_rad,
            "tip_shift_mm": self.change.tip_shift_mm,
            "remarks": self.remarks,
        }


def _row(one: ConstantChange) -> tuple[str, ...]:
    """The cells of a constant in deg or mm."""
    factor, unit, decimals = (degrees(1.0), "deg", 4) if one.unit == "rad" else (1.0, "mm", 3)
    old, new = (format_fixed(factor * value, decimals) for value in (one.old, one.new))
    change = format_fixed(factor * one.change, decimals, sign=True)
    U = format_fixed(factor * one.U, decimals) if one.is_determined or one.is_changed else "not determined"
    tip = format_fixed(one.tip_mm, 3)
    return (f"{one.place} {one.name}", unit, old, new, change, U, "yes" if one.is_changed else "no", tip)
