"""Readings that lie far from where an identified arm expects them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.identify.identification import Identified

# A reading that counts less than this has a residual of twice the length from which weights fall.
LEAST_TRUST = 0.5


@dataclass(frozen=True)
class Outlier:
    """A reading far off.

    Attributes
    ----------
    row : int
        Among the readings it was identified from, counted from 0.
    kind : str
        Of its reference.
    error_mm : float
        Length of its residual [mm].
    times : float
        That length over the root mean square that the noise makes expected.
    """

    row: int
    kind: str
    error_mm: float
    times: float


def outliers(fit: Identified) -> list[Outlier]:
    """Readings whose robust weight is below one half, the farthest first."""
    found = []
    for reference in fit.references:
        if reference.residuals.shape[1] == 0:
            continue
        variance = reference.std**2 + reference.noise_std**2
        length = np.linalg.norm(reference.residuals, axis=0)
        times = np.sqrt((reference.residuals**2 / variance).mean(axis=0))
        found += [
            Outlier(int(reference.rows[i]), reference.kind, float(length[i]), float(times[i]))
            for i in np.flatnonzero(reference.trust < LEAST_TRUST)
        ]
    return sorted(found, key=lambda outlier: -outlier.times)
