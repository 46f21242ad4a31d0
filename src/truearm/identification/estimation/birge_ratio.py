"""The Birge ratio: by how much residuals are larger than those a posterior was found with, and it too sure.

R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev. 40 (1932) 207: uncertainties are
multiplied by the ratio of what residuals show to what they were taken to be, where it is above one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truearm.identification.estimation.identification import ReferenceFit
from truearm.identification.estimation.residual_variance import FLOOR_MM2
from truearm.typing import IntArray


def birge_ratio(references: Sequence[ReferenceFit], rows: IntArray, unexplained_std: float) -> float:
    """Give by how much the standard deviations of a posterior are to be raised.

    It was found with the variance ``std^2 + noise^2`` of each residual, stated and found. Readings held out
    show ``std^2 + unexplained^2``. The mean ratio over the residuals that were judged is that of the variances.

    Parameters
    ----------
    references : sequence of ReferenceFit
        Of the identification.
    rows : (m,) int array
        Readings that were held out: judged by their points, in seats where they have none.
    unexplained_std : float
        What these show [mm].

    Returns
    -------
    float
        1 or more.
    """
    ratios = []
    pointed = np.zeros(0, dtype=np.intp)
    for kind in ("point", "seat"):
        for reference in (reference for reference in references if reference.kind == kind):
            judged = np.isin(reference.rows, rows) & ~np.isin(reference.rows, pointed)
            if judged.any():
                stated = reference.std[:, judged].ravel() ** 2 + FLOOR_MM2
                ratios.append((stated + unexplained_std**2) / (stated + reference.noise_std**2))
            pointed = reference.rows
    return max(1.0, float(np.sqrt(np.concatenate(ratios).mean()))) if ratios else 1.0
