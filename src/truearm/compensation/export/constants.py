"""Constants beside the drawing as CSV, one a row: nominal, identified, change, uncertainty, identifiable or not."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.denavit_hartenberg import Convention, DHTable
from truearm.compensation.export.constants_table import NOMINAL, ArmConstant, ConstantsTable, constants_table
from truearm.compensation.export.rigid_arm import RigidArm, best_rigid_arm
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.targets.manifest import Frame, Manifest, check_joints, read_manifest
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import escape_formula
from truearm.files.file_reading import read_limited
from truearm.typing import FloatArray

FORMAT = "constants"
COLUMNS = ("place", "constant", "unit", "nominal", "identified", "change", "standard_uncertainty", "status")
FORMULAS: Mapping[Convention, str] = {
    "dh": "dh: Rz(q + theta) Tz(d) Tx(a) Ty(b) Rx(alpha) Ry(beta)",
    "mdh": "mdh: Tx(a) Ty(b) Rx(alpha) Ry(beta) Rz(q + theta) Tz(d)",
}
MAX_BYTES = 1_000_000
# Columns that say the same agree to the rounding of doubles, in mm and rad.
ROUNDING = 1e-9
IN_MM = ("d", "a", "b", "x", "y", "z")
_ROW = ("theta", "d", "a", "alpha", "beta", "b")
_FRAME = ("x", "y", "z", "rx", "ry", "rz")


def write(
    model: Compensator,
    path: str | Path,
    *,
    angles: npt.ArrayLike | None = None,
    region: str = "",
    frame: Frame = "base",
    convention: Convention | None = None,
) -> RigidArm:
    """Write the constants of a model's best rigid stand-in beside the nominal ones.

    Parameters
    ----------
    model : Compensator
        Fitted.
    path : path
        Written whole or not at all.
    angles, region
        As in `best_rigid_arm`.
    frame : {"base", "reference"}
        Frame of the table's base: the arm's own base, or that of the model's points.
    convention : {"dh", "mdh"}, optional
        By default that of the nominal arm's own table.

    Returns
    -------
    RigidArm
        The stand-in, with its loss.

    Raises
    ------
    InputError
        As `best_rigid_arm`.
    """
    rigid = best_rigid_arm(model, angles, region=region)
    table = constants_table(model, rigid, convention=convention)
    if frame == "base":
        table = table.in_own_base()
    found = table.identified.chain().tip_in_base(check_joints(model))
    manifest = Manifest.of(model, FORMAT, tips=found, frame=frame, loss=rigid.loss)
    text = io.StringIO()
    text.write(f"# {manifest.line()}\n# {FORMULAS[table.identified.convention]}, rad and mm\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for one in (*table.constants, *_flange(table)):
        numbers = [repr(value) for value in (one.nominal, one.identified, one.change, one.std)]
        writer.writerow([escape_formula(one.place), one.name, one.unit, *numbers, one.status])
    with atomic_file(path) as beside:
        beside.write_text(text.getvalue(), encoding="utf-8")
    return rigid


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """(n, 3) tips [mm] by the identified constants of a file at joints (n, n_joints) [rad, or mm].

    Raises
    ------
    InputError
        If the file is missing, too large or damaged.
    """
    manifest = read_manifest(path)
    try:
        return _table_of(read_limited(path, limit_bytes=MAX_BYTES), manifest).chain().tip_in_base(joints)
    except InputError as error:
        raise error.in_file(path) from None


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


def _table_of(content: bytes, manifest: Manifest) -> DHTable:
    try:
        comments, table = after_comments(content.decode("utf-8"))
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text", hint="export the file again") from None
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
        rows["a"],
        rows["d"],
        rows["alpha"],
        rows["theta"],
        np.array([unit == "mm" for unit in manifest.provenance.joint_units]),
        _frame([values["base", name] for name in _FRAME]),
        _frame([values.get(("flange", name), 0.0) for name in _FRAME]),
        np.array([values["tip", axis] for axis in "xyz"]),
        rows["beta"],
        rows["b"],
    )


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
    frame = np.eye(4)
    frame[:3, 3] = numbers[:3]
    frame[:3, :3] = Rotation.from_rotvec(numbers[3:]).as_matrix()
    return frame
