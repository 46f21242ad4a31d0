"""Orientations in foreign tables: rotation vectors, Euler angles, quaternions and matrices become quaternions."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.typing import FloatArray

OrientationUnit = Literal["deg", "rad"]
# Makes an error from row, problem, hint and column (among those of the orientation).
Refuse = Callable[[int, str, str, int], InputError]

QUATERNION_ORDERS = ("wxyz", "xyzw")
_EULER = re.compile(r"([xyz])(?!\1)([xyz])(?!\2)[xyz]|([XYZ])(?!\3)([XYZ])(?!\4)[XYZ]")

# By the number of columns.
FORMS = {
    3: "rotation vector rx, ry, rz, or Euler angles",
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


def check_orientation_columns(n_columns: int, unit: OrientationUnit | None, order: str | None = None) -> None:
    """Refuse a number of columns that is no orientation, and angles without their unit or in no order.

    Raises
    ------
    InputError
    """
    if n_columns not in (0, *FORMS):
        forms = "; ".join(f"{n} ({what})" for n, what in FORMS.items())
        raise InputError(f"expected the columns of an orientation, {forms}, got {n_columns}")
    if n_columns == 3 and unit not in ("deg", "rad"):
        got = "none" if unit is None else repr(unit)
        what = "rotation vector" if order is None else "Euler angles"
        raise InputError(f"expected the unit of the {what}, deg or rad, got {got}", hint="UR controllers state rad")
    if n_columns != 3 and unit is not None:
        raise InputError("a unit belongs to a rotation vector or Euler angles (three columns) only")
    if order is None or (n_columns == 4 and order in QUATERNION_ORDERS) or (n_columns == 3 and _EULER.fullmatch(order)):
        return
    raise InputError(
        f"expected the order of {FORMS.get(n_columns, 'an orientation')}, got {order!r}",
        hint="xyzw for a quaternion with its scalar last; for Euler angles ZYX (each about the axis turned before, as "
        "KUKA's A, B, C) or xyz (about fixed axes, as roll, pitch, yaw or Fanuc's W, P, R)",
    )


def read_orientations(
    values: FloatArray, unit: OrientationUnit | None, order: str | None, refuse: Refuse
) -> FloatArray:
    """Turn the columns of an orientation into quaternions.

    Parameters
    ----------
    values : (n, k) array
        With k of `FORMS`. A row with NaN has no orientation.
    unit : {"deg", "rad"}, optional
        Of rotation vectors and Euler angles.
    order : str, optional
        Of a quaternion's numbers, ``wxyz`` by default or ``xyzw``; of Euler angles as SciPy has it: ``ZYX`` turns about
        the axes as turned before, ``xyz`` about fixed ones.
    refuse : callable
        Makes the error of a row, from the row, the problem, what to do and the number of the column among these.

    Returns
    -------
    (n, 4) array
        Quaternions of the flange in the frame of the points, w first.

    Raises
    ------
    InputError
        If a row is no rotation: left-handed, scaled, skew, longer than a full turn; with its line.
    """
    is_known = ~np.isnan(values).any(axis=1)
    rows = np.flatnonzero(is_known)

    def of_known(row: int, problem: str, hint: str, column: int = 0) -> InputError:
        return refuse(int(rows[row]), problem, hint, column)

    quaternion = np.full((len(values), 4), np.nan)
    if len(rows):
        quaternion[rows] = _quaternions(values[rows], unit, order, of_known)
    return quaternion


def _quaternions(values: FloatArray, unit: OrientationUnit | None, order: str | None, refuse: Refuse) -> FloatArray:
    """(n, 4) quaternions, w first, of rows without gaps."""
    k = values.shape[1]
    if k == 4:
        return values[:, [3, 0, 1, 2]] if order == "xyzw" else values  # the session checks its length
    if k == 3:
        factor = np.pi / 180 if unit == "deg" else 1.0
        angles = np.clip(values, -LARGEST_ENTRY, LARGEST_ENTRY) * factor
        if order is not None:
            return Rotation.from_euler(order, angles).as_quat(scalar_first=True)
        length = np.linalg.norm(angles, axis=1)
        if (length > FULL_TURN).any():
            row = int(np.argmax(length > FULL_TURN))
            size = float(np.linalg.norm(angles[row])) / factor
            hint = "check its unit, deg or rad" if unit == "rad" else "check its columns; Euler angles need their order"
            problem = f"expected a rotation vector of a full turn at most, got one of {size:.6g} {unit}"
            raise refuse(row, problem, hint, 0)
        return Rotation.from_rotvec(angles).as_quat(scalar_first=True)
    rows = values.reshape(len(values), -1, 3 if k == 9 else 4)
    if k == 16:
        off = np.abs(rows[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > LAST_ROW_TOLERANCE
        if off.any():
            row = int(np.argmax(off))
            got = ", ".join(f"{number:g}" for number in rows[row, 3])
            hint = "state the columns row by row; a file that has them column by column needs another order"
            raise refuse(row, f"expected 0, 0, 0, 1 as the last row of a 4 x 4 matrix, got {got}", hint, 12)
    R = np.clip(rows[:, :3, :3], -LARGEST_ENTRY, LARGEST_ENTRY)  # larger ones are no rotations, and would overflow
    off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2)) > ROTATION_TOLERANCE
    wrong = off | (np.linalg.det(R) < 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise refuse(row, *_what_is_wrong(R[row]), 0)
    return Rotation.from_matrix(R).as_quat(scalar_first=True)


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
