"""Orientations of the flange in foreign tables: rotation vectors, quaternions and matrices become quaternions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.typing import FloatArray

OrientationUnit = Literal["deg", "rad"]

# By the number of columns.
FORMS = {
    3: "rotation vector rx, ry, rz",
    4: "quaternion w, x, y, z",
    9: "3 x 3 matrix, row by row",
    12: "3 x 4 matrix, row by row",
    16: "4 x 4 matrix, row by row",
}
# A matrix printed with three decimals is a rotation to this.
ROTATION_TOLERANCE = 2e-3
# The last row of a 4 x 4 matrix is 0 0 0 1, and printed as such.
LAST_ROW_TOLERANCE = 1e-9
LARGEST_ENTRY = 1e6
# A rotation vector is no longer than a full turn; this is for rounding.
FULL_TURN = 2 * np.pi * (1 + 1e-6)


class TableOrientations(NamedTuple):
    """Orientations of a table.

    Attributes
    ----------
    quaternion : (n, 4) array
        Of the flange in the frame of the points, w first.
    translation : (n, 3) array or None
        That of 3 x 4 and 4 x 4 matrices, in the table's unit.
    """

    quaternion: FloatArray
    translation: FloatArray | None


def check_orientation_columns(n_columns: int, unit: OrientationUnit | None) -> None:
    """Refuse a number of columns that is no orientation, and a rotation vector without its unit.

    Raises
    ------
    InputError
    """
    if n_columns not in (0, *FORMS):
        forms = "; ".join(f"{n} ({what})" for n, what in FORMS.items())
        raise InputError(f"expected the columns of an orientation, {forms}, got {n_columns}")
    if n_columns == 3 and unit not in ("deg", "rad"):
        got = "none" if unit is None else repr(unit)
        raise InputError(
            f"expected the unit of the rotation vector, deg or rad, got {got}", hint="UR controllers state rad"
        )
    if n_columns != 3 and unit is not None:
        raise InputError("a unit belongs to a rotation vector (three columns) only")


def read_orientations(
    values: FloatArray, unit: OrientationUnit | None, *, file: Path, first_line: int, names: Sequence[str]
) -> TableOrientations:
    """Turn the columns of an orientation into quaternions.

    Parameters
    ----------
    values : (n, k) array
        With k of `FORMS`.
    unit : {"deg", "rad"}, optional
        Of rotation vectors.
    file, first_line, names
        Of the table and the columns, for messages.

    Raises
    ------
    InputError
        If a row is no rotation: left-handed, scaled, skew, longer than a full turn; with its line.
    """

    def refuse(row: int, problem: str, hint: str, column: str | None = None) -> InputError:
        return InputError(problem, file=file, line=first_line + row, column=column or names[0], hint=hint)

    k = values.shape[1]
    if k == 4:
        return TableOrientations(values, None)  # the session checks its length
    if k == 3:
        factor = np.pi / 180 if unit == "deg" else 1.0
        vectors = np.clip(values, -LARGEST_ENTRY, LARGEST_ENTRY) * factor
        length = np.linalg.norm(vectors, axis=1)
        if (length > FULL_TURN).any():
            row = int(np.argmax(length > FULL_TURN))
            size = float(np.linalg.norm(vectors[row])) / factor
            hint = "check its unit, deg or rad" if unit == "rad" else "check its columns"
            raise refuse(row, f"expected a rotation vector of a full turn at most, got one of {size:.6g} {unit}", hint)
        return TableOrientations(Rotation.from_rotvec(vectors).as_quat(scalar_first=True), None)
    rows = values.reshape(len(values), -1, 3 if k == 9 else 4)
    if k == 16:
        off = np.abs(rows[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > LAST_ROW_TOLERANCE
        if off.any():
            row = int(np.argmax(off))
            got = ", ".join(f"{number:g}" for number in rows[row, 3])
            hint = "state the columns row by row; a file that has them column by column needs another order"
            raise refuse(row, f"expected 0, 0, 0, 1 as the last row of a 4 x 4 matrix, got {got}", hint, names[12])
    R = np.clip(rows[:, :3, :3], -LARGEST_ENTRY, LARGEST_ENTRY)  # larger ones are no rotations, and would overflow
    off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2)) > ROTATION_TOLERANCE
    wrong = off | (np.linalg.det(R) < 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise refuse(row, *_what_is_wrong(R[row]))
    quaternion = Rotation.from_matrix(R).as_quat(scalar_first=True)
    return TableOrientations(quaternion, None if k == 9 else rows[:, :3, 3])


def _what_is_wrong(matrix: FloatArray) -> tuple[str, str]:
    """Problem and hint of a matrix that is no rotation."""
    lengths = np.linalg.norm(matrix, axis=0)
    scale = float(lengths.mean())
    if scale > 0 and np.abs(matrix.T @ matrix / scale**2 - np.eye(3)).max() <= ROTATION_TOLERANCE:
        if abs(scale - 1) > ROTATION_TOLERANCE:
            return f"expected a rotation matrix, got one scaled by {scale:.6g}", "divide it by its scale"
        return (
            "expected a rotation matrix, got a left-handed one (determinant -1)",
            "check the order and the signs of its columns",
        )
    shown = ", ".join(f"{length:.4g}" for length in lengths)
    return (
        f"expected a rotation matrix, got columns of lengths {shown} that are not perpendicular to each other"
        if np.abs(lengths - 1).max() <= ROTATION_TOLERANCE
        else f"expected a rotation matrix, got columns of lengths {shown}",
        "state its columns row by row: r11, r12, r13, r21, ..",
    )
