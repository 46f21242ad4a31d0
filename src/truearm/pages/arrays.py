"""Checks that arrays can be drawn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray


def finite_array(values: npt.ArrayLike, what: str, *, width: int | None = None) -> FloatArray:
    """Check an array and return a copy of shape (n,), or (n, width) where `width` is given.

    Raises
    ------
    InputError
        If the shape is another, the array is empty, or a number is not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"expected numbers as {what}, got {type(values).__name__}") from None
    wanted = "(n,)" if width is None else f"(n, {width})"
    if array.ndim != (1 if width is None else 2) or (width is not None and array.shape[1] != width):
        raise InputError(f"expected {what} as an array {wanted}, got the shape {array.shape}")
    if array.shape[0] == 0:
        raise InputError(f"expected at least one value in {what}, got none")
    bad = ~np.isfinite(array)
    if bad.any():
        place = np.argwhere(bad)[0]
        raise InputError(
            f"expected finite numbers in {what}, got {array[tuple(place)]} as number {place[0] + 1} "
            f"({int(np.count_nonzero(bad))} in all)",
            hint="remove them before drawing the figure",
        )
    return array


def finite_arrays(
    values: Mapping[str, npt.ArrayLike], what: str, *, width: int | None = None, same_length: bool = False
) -> dict[str, FloatArray]:
    """Check every array of a mapping with `finite_array`; `same_length` requires equal lengths."""
    if not values:
        raise InputError(f"expected {what} under at least one name, got none")
    arrays = {name: finite_array(array, f"{what} of {name!r}", width=width) for name, array in values.items()}
    counts = {name: len(array) for name, array in arrays.items()}
    if same_length and len(set(counts.values())) > 1:
        lengths = ", ".join(f"{name!r} {count}" for name, count in counts.items())
        raise InputError(f"expected {what} of the same length under every name, got {lengths}")
    return arrays


def nonnegative_errors(values: Mapping[str, npt.ArrayLike]) -> dict[str, FloatArray]:
    """Check every (n,) array of errors of a mapping; a negative number is refused."""
    arrays = finite_arrays(values, "errors")
    for name, array in arrays.items():
        if array.min() < 0:
            raise InputError(
                f"expected errors of {name!r} of zero or more, got {array.min():g} as number {array.argmin() + 1}"
            )
    return arrays
