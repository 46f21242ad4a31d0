"""Types of the arrays in all signatures; their shapes and units stand in the docstrings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
NameArray = npt.NDArray[np.str_]
