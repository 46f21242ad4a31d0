"""Thermal expansion of the links."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray


class Material(NamedTuple):
    """Prior of the thermal expansion of the links of an arm, about zero.

    Attributes
    ----------
    name : str
    common_per_K, own_per_K : float
        Standard deviation of what all links have in common, and of each about it [1/K].
    """

    name: str
    common_per_K: float
    own_per_K: float

    def covariance(self, n_links: int) -> FloatArray:
        """Covariance (n_links, n_links) of the expansion of links [1/K^2]."""
        return self.common_per_K**2 * np.ones((n_links, n_links)) + self.own_per_K**2 * np.eye(n_links)


# Carbon fibre -0.5e-6 to 2e-6/K; steel 11.5e-6/K, aluminium 23e-6/K. Of arms whose material is not known each is half.
MATERIALS = (Material("carbon fibre", 1.5e-6, 1e-6), Material("metal", 17e-6, 6e-6))
UNKNOWN_MATERIAL = Material(
    "unknown",
    float(np.sqrt(np.mean([material.common_per_K**2 for material in MATERIALS]))),
    float(np.sqrt(np.mean([material.own_per_K**2 for material in MATERIALS]))),
)


def link_vectors(chain: Chain) -> FloatArray:
    """Return the links of the chain as vectors in the places where they start.

    Link 0 is the stand, from the base frame's origin to joint 1 along the axes of place 0; link i goes from joint i to
    joint i + 1 along the axes of place i; the last one ends at the tip.

    Returns
    -------
    (n_joints + 1, 3) array
        [mm].
    """
    vectors = chain.fixed[:, :3, 3].copy()
    vectors[0] = chain.fixed[0, :3, :3].T @ vectors[0]  # place 0 is after F0 and has its axes
    vectors[-1] += chain.fixed[-1, :3, :3] @ chain.tip_in_flange
    return vectors


def growth_motions(chain: Chain, temperature_degC: npt.ArrayLike) -> FloatArray:
    """Return the translations of links with unit expansion coefficient: ``(T - 20 degC)`` times the link vector.

    Multiply that of link i by its coefficient [1/K] and apply it at place i.

    Parameters
    ----------
    chain : Chain
        Nominal kinematics.
    temperature_degC : (n,) or (n, n_joints + 1) array
        Temperature of the arm, or of each link [degC].

    Returns
    -------
    (n, n_joints + 1, 3) array
        [mm K].

    Raises
    ------
    InputError
        If the shape of the temperatures does not match.
    """
    temperature = np.asarray(temperature_degC, dtype=float)
    n_links = chain.n_joints + 1
    if temperature.ndim == 1:
        temperature = temperature[:, None]
    if temperature.ndim != 2 or temperature.shape[1] not in (1, n_links):
        raise InputError(f"expected temperatures of shape (n,) or (n, {n_links}), got {temperature.shape}")
    return (temperature - REFERENCE_DEGC)[:, :, None] * link_vectors(chain)


def link_temperatures(air_degC: FloatArray, lag_s: npt.ArrayLike, *, interval_s: float) -> FloatArray:
    """Temperatures that follow the air with first-order lags, starting in equilibrium.

    Parameters
    ----------
    air_degC : (n,) array
        Air at each reading [degC].
    lag_s : (n_links,) array
        Time constants [s]; 0: no lag.
    interval_s : float
        Time between readings [s].

    Returns
    -------
    (n, n_links) array
        [degC].
    """
    out = np.empty((len(air_degC), len(np.asarray(lag_s))))
    for link, lag in enumerate(np.asarray(lag_s, dtype=float)):
        memory = float(np.exp(-interval_s / lag)) if lag > 0 else 0.0
        # T_k - memory T_{k-1} = (1 - memory) air_k, relative to the air at the first reading.
        bands = np.stack([np.ones(len(air_degC)), np.full(len(air_degC), -memory)])
        out[:, link] = air_degC[0] + solve_banded((1, 0), bands, (1 - memory) * (air_degC - air_degC[0]))
    return out
