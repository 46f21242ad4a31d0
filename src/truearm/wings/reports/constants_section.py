"""Section of a report page: the constants of an arm beside the drawing."""

from __future__ import annotations

from collections.abc import Mapping

from truearm.models import Compensator, IdentifiedModel, NominalModel
from truearm.number_format import RoundedNumber, format_number
from truearm.pages.page import Cell, Column, Section, Table
from truearm.wings.exports.formats.constants_table import NOMINAL, ArmConstant, ConstantsTable, constants_table
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.exports.targets.manifest import ExportLoss

# Rotations of an arm are stated in degrees; their changes are thousandths of one.
DEG = 57.29577951308232
SIGNIFICANT = 2.0  # standard uncertainties of a change
MOST_SHOWN = 8


def constants_section(
    table: ConstantsTable, loss: ExportLoss, *, reach_mm: float, name: str = "", folded: bool = False
) -> Section:
    """The constants of an arm beside the drawing, with their changes and standard uncertainties.

    Parameters
    ----------
    table : ConstantsTable
    loss : ExportLoss
        Of the arm with these constants alone.
    reach_mm : float
        Of the arm: what a rotation moves.
    name : str
        Of the model, where there are several.
    folded : bool
        Whether the section shows its title only.
    """
    rows = [_row(one) for one in table.constants]
    columns = Column.of(
        "constant",
        Column("nominal", digits=7),
        Column("identified", digits=7),
        Column("change", digits=3),
        Column("standard uncertainty", digits=2),
        "unit",
        "status",
    )
    changed = _changed(table, reach_mm)
    short = Table(
        columns[:-1],
        tuple(rows[i][:-1] for i in changed[:MOST_SHOWN]),
        f"{len(changed)} of {len(rows)} constants differ from the drawing by more than twice their standard uncertainty"
        + (f"; the {MOST_SHOWN} with the largest effect at full reach" if len(changed) > MOST_SHOWN else ""),
    )
    shown = Table(
        columns,
        tuple(rows),
        f"All constants of the best rigid arm, {'modified ' if table.identified.convention == 'mdh' else ''}"
        "Denavit-Hartenberg, in the branch of the nominal table",
        folded=True,
    )
    # Below a nanometre is the rounding of the arithmetic.
    exported, nominal = (
        "less than 0.000001" if error < 1e-6 else format_number(error, digits=2)
        for error in (loss.exported_mm, loss.nominal_mm)
    )
    text = (
        "Of all arms with constants alone, without harmonics and gravity, this one comes nearest to the model: over "
        f"the {loss.region}, held out, it differs from the model by {exported} mm on average, the nominal arm by "
        f"{nominal} mm. "
        "Angles are in the nominal branch; nearly parallel axes have beta, a rotation about y, and keep d. A constant "
        "that is identifiable only as a sum stays nominal, and the other part of the sum takes the change. One with "
        "the status nominal is held: nothing that the model has learned moves it."
    )
    title = "Constants: drawn and identified"
    return Section(f"{title}: {name}" if name else title, text, tables=(short, shown), folded=folded)


def _row(one: ArmConstant) -> tuple[Cell, ...]:
    factor, unit = (DEG, "deg") if one.unit == "rad" else (1.0, "mm")
    u, drawn = factor * one.std, factor * one.nominal
    if one.status == NOMINAL:  # what is held differs from the drawing by rounding at most
        return f"{one.place} {one.name}", drawn, drawn, None, None, unit, one.status
    identified, change = (RoundedNumber(factor * value, u) for value in (one.identified, one.change))
    return f"{one.place} {one.name}", drawn, identified, change, u or None, unit, one.status


def _changed(table: ConstantsTable, reach_mm: float) -> list[int]:
    """Rows of the arm's own constants with a significant change, the one with the largest effect first."""
    effect = {
        i: abs(one.change) * (reach_mm if one.unit == "rad" else 1.0)
        for i, one in enumerate(table.constants)
        if one.place not in ("base", "tip") and one.std > 0 and abs(one.change) > SIGNIFICANT * one.std
    }
    return sorted(effect, key=lambda i: -effect[i])


def constants_sections(models: Mapping[str, Compensator]) -> list[Section]:
    """Constants beside the drawing of every identified arm whose file keeps poses of its training."""
    identified = {
        name: model
        for name, model in models.items()
        if isinstance(model, IdentifiedModel)
        and not isinstance(model, NominalModel)
        and model.training_.angle_sample is not None
    }
    sections = []
    for name, model in identified.items():
        rigid = best_rigid_arm(model)
        title = name if len(identified) > 1 else ""
        table, reach = constants_table(model, rigid), model.arm.chain.reach
        sections.append(
            constants_section(table, rigid.loss, reach_mm=reach, name=title, folded=name != list(identified)[-1])
        )
    return sections
