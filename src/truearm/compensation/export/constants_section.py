"""Section of a report page: the constants of an arm beside the drawing."""

from __future__ import annotations

from truearm.compensation.export.constants_table import ConstantsTable
from truearm.compensation.targets.manifest import ExportLoss
from truearm.pages.number_format import RoundedNumber, format_number
from truearm.pages.page import Column, Section, Table

# Rotations of an arm are stated in degrees; their changes are thousandths of one.
DEG = 57.29577951308232


def constants_section(table: ConstantsTable, loss: ExportLoss, *, name: str = "") -> Section:
    """The constants of an arm beside the drawing, with their changes and standard uncertainties.

    Parameters
    ----------
    table : ConstantsTable
    loss : ExportLoss
        Of the arm with these constants alone.
    name : str
        Of the model, where there are several.
    """
    rows = []
    for one in table.constants:
        factor, unit = (DEG, "deg") if one.unit == "rad" else (1.0, "mm")
        u = factor * one.std
        identified, change = (RoundedNumber(factor * value, u) for value in (one.identified, one.change))
        rows.append((f"{one.place} {one.name}", factor * one.nominal, identified, change, u or None, unit, one.status))
    shown = Table(
        (
            Column("constant"),
            Column("nominal", digits=7),
            Column("identified", digits=7),
            Column("change", digits=3),
            Column("standard uncertainty", digits=2),
            Column("unit"),
            Column("status"),
        ),
        tuple(rows),
        f"Constants of the best rigid arm, {'modified ' if table.identified.convention == 'mdh' else ''}"
        "Denavit-Hartenberg, in the branch of the nominal table",
    )
    exported, nominal = (format_number(error, digits=2) for error in (loss.exported_mm, loss.nominal_mm))
    text = (
        "Of all arms with constants alone, without harmonics and gravity, this one comes nearest to the model: over "
        f"the {loss.region}, held out, it differs from the model by {exported} mm on average, the nominal arm by "
        f"{nominal} mm. "
        "Angles are in the nominal branch; nearly parallel axes have beta, a rotation about y, and keep d. A constant "
        "that is identifiable only as a sum stays nominal, and the other part of the sum takes the change."
    )
    title = "Constants of the arm"
    return Section(f"{title}: {name}" if name else title, text, tables=(shown,), folded=True)
