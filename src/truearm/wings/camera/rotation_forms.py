"""How three, four or nine numbers say a rotation: the conventions of files, controllers and libraries."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.typing import FloatArray

# Names that people know, and what they mean. Small letters: about fixed axes; capitals: about the turned ones.
ALIASES = {
    "rpy": "xyz:rad",
    "kuka": "ZYX:deg",
    "fanuc": "xyz:deg",
    "ur": "rotvec:rad",
}
QUATERNIONS = ("xyzw", "wxyz")
# A quaternion or a matrix that is farther from a rotation is in another order, or no rotation.
ROUNDED = 0.02


def _euler_orders() -> list[str]:
    proper = ["".join(one) for one in permutations("xyz")]
    repeated = [a + b + a for a, b in permutations("xyz", 2)]
    return [*proper, *repeated, *map(str.upper, (*proper, *repeated))]


THREE = [f"{order}:{unit}" for order, unit in product(("rotvec", *_euler_orders()), ("deg", "rad"))]
FORMS = (*QUATERNIONS, "matrix", *THREE, *ALIASES)


def checked_form(text: str) -> str:
    """The form that a person names, without aliases.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if text not in FORMS:
        hint = "xyzw, wxyz, matrix, rotvec:rad, ZYX:deg (turned axes), xyz:rad (fixed axes), rpy, kuka, fanuc, ur"
        raise InputError(f"expected a form of rotations, got {text!r}", hint=hint)
    return ALIASES.get(text, text)


def read_rotations(numbers: FloatArray, form: str) -> Rotation | None:
    """The rotations of numbers (n, 3), (n, 4) or (n, 9) in a form; None if they are none in it."""
    if form in QUATERNIONS:
        is_unit = np.abs(np.linalg.norm(numbers, axis=1) - 1) < ROUNDED
        return Rotation.from_quat(numbers, scalar_first=form == "wxyz") if is_unit.all() else None
    if form == "matrix":
        R = numbers.reshape(-1, 3, 3)
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        return Rotation.from_matrix(R) if ((off < ROUNDED) & (np.linalg.det(R) > 0)).all() else None
    order, _, unit = form.partition(":")
    angles = np.radians(numbers) if unit == "deg" else numbers
    if np.abs(angles).max() > 2 * np.pi * 1.01:  # degrees, taken for radians
        return None
    return Rotation.from_rotvec(angles) if order == "rotvec" else Rotation.from_euler(order, angles)


def forms_of(numbers: FloatArray) -> dict[str, Rotation]:
    """All rotations that numbers may mean, by their forms; of forms that mean the same the first."""
    names = {4: QUATERNIONS, 9: ("matrix",), 3: tuple(THREE)}.get(numbers.shape[1], ())
    found = {name: read for name in names if (read := read_rotations(numbers, name)) is not None}
    return dict(found)


def described(form: str) -> str:
    """A form in words."""
    if form in QUATERNIONS:
        return f"quaternions in the order {', '.join(form)}"
    if form == "matrix":
        return "matrices"
    order, _, unit = form.partition(":")
    if order == "rotvec":
        return f"rotation vectors in {unit}"
    axes = "fixed" if order.islower() else "turned"
    return f"Euler angles in {unit} about the {axes} axes {', '.join(order.lower())}"


__all__ = ["ALIASES", "FORMS", "checked_form", "described", "forms_of", "read_rotations"]
