"""The arrays a figure may be drawn from: of the right shape, not empty, finite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray


def finite_array(values: npt.ArrayLike, what: str, *, width: int | None = None) -> FloatArray:
    """Give `values` as a new (n,) array, or as (n, width) where `width` is given.

    Raises
    ------
    InputError
        If the shape is another, there is no reading, or a number is not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"expected numbers as {what}, got {type(values).__name__}") from None
    wanted = "(n,)" if width is None else f"(n, {width})"
    if array.ndim != (1 if width is None else 2) or (width is not None and array.shape[1] != width):
        raise InputError(f"expected {what} as an array {wanted}, got the shape {array.shape}")
    if array.shape[0] == 0:
        raise InputError(f"expected at least one reading in {what}, got none")
    bad = ~np.isfinite(array)
    if bad.any():
        place = np.argwhere(bad)[0]
        raise InputError(
            f"expected finite numbers in {what}, got {array[tuple(place)]} in reading {place[0] + 1} "
            f"({int(np.count_nonzero(bad))} in all)",
            hint="leave those readings out of the figure",
        )
    return array


def finite_arrays(
    values: Mapping[str, npt.ArrayLike], what: str, *, width: int | None = None, same_length: bool = False
) -> dict[str, FloatArray]:
    """Give every array of a mapping checked as by `finite_array`; `same_length` asks for as many readings in each."""
    if not values:
        raise InputError(f"expected {what} of at least one model, got none")
    arrays = {name: finite_array(array, f"{what} of {name!r}", width=width) for name, array in values.items()}
    counts = {name: len(array) for name, array in arrays.items()}
    if same_length and len(set(counts.values())) > 1:
        told = ", ".join(f"{name!r} {count}" for name, count in counts.items())
        raise InputError(f"expected {what} of the same readings for every model, got {told}")
    return arrays


def nonnegative_arrays(values: Mapping[str, npt.ArrayLike], what: str) -> dict[str, FloatArray]:
    """Give every (n,) array of a mapping, none of them negative."""
    arrays = finite_arrays(values, what)
    for name, array in arrays.items():
        if array.min() < 0:
            raise InputError(
                f"expected {what} of {name!r} of zero or more, got {array.min():g} in reading {array.argmin() + 1}",
                hint="the length of the difference of two points, not one coordinate of it",
            )
    return arrays


def joint_names(names: Sequence[str] | None, joints: int) -> list[str]:
    """Give one name a joint: `names`, or q1, q2, ... where there are none."""
    if names is None:
        return [f"q{i + 1}" for i in range(joints)]
    if len(names) != joints:
        raise InputError(f"expected {joints} joint names, got {len(names)}")
    return [str(name) for name in names]


def joint_matrix(angles: npt.ArrayLike, *, readings: int | None = None) -> FloatArray:
    """Give joint positions as (n, joints), of `readings` readings where that is known."""
    shape = np.shape(angles)
    if len(shape) != 2 or shape[1] == 0:
        raise InputError(f"expected angles as an array (n, joints), got the shape {shape}")
    array = finite_array(angles, "angles", width=shape[1])
    if readings is not None and len(array) != readings:
        raise InputError(f"expected angles of the same {readings} readings as the errors, got {len(array)}")
    return array
