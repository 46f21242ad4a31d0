"""Constants beside the drawing as CSV, one a row: nominal, identified, change, uncertainty, identifiable or not."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm import Chain, DHTable
from truearm.arm.rigid_motions import motion
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.files.delimited import escape_formula
from truearm.files.file_reading import utf8_text
from truearm.typing import FloatArray
from truearm.wings.exports.formats.constants_table import (
    NOMINAL,
    ArmConstant,
    ConstantsFile,
    ConstantsRequest,
    ConstantsTable,
    reader,
    writer,
)
from truearm.wings.exports.targets.manifest import Manifest

COLUMNS = ("place", "constant", "unit", "nominal", "identified", "change", "standard_uncertainty", "status")
FORMULAS: Mapping[Convention, str] = {
    "dh": "dh: Rz(q + theta) Tz(d) Tx(a) Ty(b) Rx(alpha) Ry(beta)",
    "mdh": "mdh: Tx(a) Ty(b) Rx(alpha) Ry(beta) Rz(q + theta) Tz(d)",
}
# Columns that say the same agree to the rounding of doubles, in mm and rad.
ROUNDING = 1e-9
IN_MM = ("d", "a", "b", "x", "y", "z")
_ROW = ("theta", "d", "a", "alpha", "beta", "b")
_FRAME = ("x", "y", "z", "rx", "ry", "rz")


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    rigid, table = request.table()

    def content(manifest: Manifest) -> str:
        text = io.StringIO()
        text.write(f"# {manifest.line()}\n# {FORMULAS[table.identified.convention]}, rad and mm\n")
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for one in (*table.constants, *_flange(table)):
            numbers = [repr(value) for value in (one.nominal, one.identified, one.change, one.std)]
            rows.writerow([escape_formula(one.place), one.name, one.unit, *numbers, one.status])
        return text.getvalue()

    return ConstantsFile(rigid, table.identified.chain(), content)


def _flange(table: ConstantsTable) -> list[ArmConstant]:
    """The flange's frame, which is nominal in both tables."""
    if (table.nominal.flange == np.eye(4)).all():
        return []
    turn = Rotation.from_matrix(table.nominal.flange[:3, :3]).as_rotvec()
    numbers = [*table.nominal.flange[:3, 3].tolist(), *turn.tolist()]
    return [
        ArmConstant("flange", name, "mm" if name in "xyz" else "rad", value, value, 0.0, NOMINAL)
        for name, value in zip(_FRAME, numbers, strict=True)
    ]


def _chain_of(content: bytes, manifest: Manifest) -> Chain:
    comments, table = after_comments(utf8_text(content))
    convention = next((name for name, formula in FORMULAS.items() if any(formula in line for line in comments)), None)
    if convention is None:
        raise InputError(f"expected a comment with one of the formulas {'; '.join(FORMULAS.values())}")
    names = manifest.provenance.joint_names
    values = _identified(table, len(comments), {escape_formula(name): name for name in names})
    known = {(joint, name) for joint in names for name in _ROW} | {
        (place, name) for place in ("base", "flange") for name in _FRAME
    }
    known |= {("tip", axis) for axis in "xyz"}
    if unknown := values.keys() - known:
        raise InputError(f"there is no constant {' '.join(sorted(unknown)[0])} in this arm")
    needed = [("base", name) for name in _FRAME] + [(joint, name) for joint in names for name in _ROW[:4]]
    for place, name in [*needed, *(("tip", axis) for axis in "xyz")]:
        if (place, name) not in values:
            raise InputError(f"the constant {name} of {place} is missing")
    rows = {name: np.array([values.get((joint, name), 0.0) for joint in names]) for name in _ROW}
    return DHTable(
        convention,
        **rows,
        prismatic=np.array([unit == "mm" for unit in manifest.provenance.joint_units]),
        base=_frame([values["base", name] for name in _FRAME]),
        flange=_frame([values.get(("flange", name), 0.0) for name in _FRAME]),
        tip_in_flange=np.array([values["tip", axis] for axis in "xyz"]),
    ).chain()


def after_comments(text: str) -> tuple[list[str], str]:
    """The lines of comments with which a file begins, and what follows them: later a name may begin with ``#``."""
    comments = []
    while text.startswith("#"):
        line, _, text = text.partition("\n")
        comments.append(line.rstrip("\r"))
    return comments, text


def _identified(text: str, before: int, names: Mapping[str, str]) -> dict[tuple[str, str], float]:
    """Identified constants by place and name, from the rows after some lines; names of joints by their cells."""
    values: dict[tuple[str, str], float] = {}
    header = False
    reader = csv.reader(io.StringIO(text, newline=""))
    for cells in reader:
        number = before + reader.line_num
        if not cells:
            continue
        if not header:
            if tuple(cells) != COLUMNS:
                raise InputError(f"expected the columns {','.join(COLUMNS)}", line=number)
            header = True
            continue
        if len(cells) != len(COLUMNS):
            raise InputError(f"expected {len(COLUMNS)} cells, got {len(cells)}", line=number)
        place, name, identified = names.get(cells[0], cells[0]), cells[1], cells[COLUMNS.index("identified")]
        if (place, name) in values:
            raise InputError(f"the constant {name} of {place} is stated twice", line=number)
        try:
            values[place, name] = float(identified)
            was, change = (float(cells[COLUMNS.index(column)]) for column in ("nominal", "change"))
        except ValueError:
            values[place, name] = was = change = math.nan
        if not math.isfinite(values[place, name]):
            raise InputError(f"expected a finite number, got {identified[:60]!r}", line=number, column="identified")
        if not abs(was + change - values[place, name]) <= ROUNDING * max(1.0, abs(was)):
            raise InputError(f"nominal and change of {name} of {place} are not the identified constant", line=number)
        unit = "mm" if name in IN_MM else "rad"
        if cells[COLUMNS.index("unit")] != unit:
            raise InputError(f"expected {name} of {place} in {unit}", line=number, column="unit")
    return values


def _frame(numbers: Sequence[float]) -> FloatArray:
    """A frame [mm] of its position and rotation vector."""
    return motion(Rotation.from_rotvec(numbers[3:]).as_matrix(), numbers[:3])


write = writer("constants", _file_of)
tips = reader(_chain_of)
