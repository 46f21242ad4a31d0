"""Links that lag behind the thermometer while the air drifts: the temperatures they had, and what readings say of each.

Readings taken one after the other are a clock. A link with a time constant of tau readings has, in air of temperature
T, the temperature L of ``tau L' = T - L`` (first order; J. P. Holman, "Heat Transfer", 10th ed., 2010, section 4-2),
and starts a session settled. In air that warms by 6 K while an arm is read 200 times, links of 20 minutes warm by a
third of that. What training shows as growth by the thermometer is then a fraction of the expansion.

The readings themselves tell the time constants apart, as slow links bend the growth over the session. With the whitened
residuals r at the minimum, derivatives J of the other coefficients x, with prior precision P, and U of the growth by
one kelvin, the growth c by a history L of temperatures is seen with

    information  U_L^T M U_L,  right side  -U_L^T M y,   M = I - J H^-1 J^T,  H = J^T J + P,  y = r - J x - U_T c_T,

where U_L is U times ``L - mean(L)``; the other coefficients follow by ``-H^-1 J^T U_L c``. Each history is a hypothesis
of the mixture in `truearm.identification.judgement.expansion_prior`, which weighs it by its evidence.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.thermal import link_temperatures
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray, IntArray, NameArray

# Time constants of links that are tried, in readings: links follow the air within 5 to 20 minutes, and arms are read
# every five seconds by hand and every minute by a robot that stops for a laser tracker.
TIME_CONSTANTS = np.geomspace(5.0, 240.0, 12)
# The time constants of the links of an arm differ by half of their mean either way (presets of virtual arms: a uniform
# distribution), so that links share a history up to this.
FASTEST, SLOWEST = 0.5, 1.5
# A thermometer that jumps by more from one reading to the next [K] was not read in between: links have settled since.
SETTLED_STEP_K = 1.0


class LinkHistory(NamedTuple):
    """Temperatures that the links may have had in training, and what the readings say of the growth if they had them.

    Attributes
    ----------
    information : (n_links, n_links) array
        Of the growth [K^2].
    right : (n_links,) array
        The information times the growth of greatest likelihood [K].
    gain : (n_others, n_links) array
        Change of the other coefficients by growth.
    mean_degC : float
        Mean temperature of the links.
    share : float
        By how much they changed, of what the thermometer says.
    slack : float
        Relative standard deviation of that share from link to link.
    """

    information: FloatArray
    right: FloatArray
    gain: FloatArray
    mean_degC: float
    share: float = 1.0
    slack: float = 0.0


def lagging_temperatures(
    temperature_degC: FloatArray, time_constants: FloatArray, session: NameArray | None = None
) -> FloatArray:
    """(n, k) temperatures of links with k time constants, in readings, at the temperatures (n,) of the air [degC].

    Links have settled where a session begins, and where the thermometer jumps.
    """
    starts = np.abs(np.diff(temperature_degC)) > SETTLED_STEP_K
    if session is not None:
        starts |= session[1:] != session[:-1]
    pieces = np.split(temperature_degC, np.flatnonzero(starts) + 1)
    return np.concatenate([link_temperatures(piece, time_constants, interval_s=1.0) for piece in pieces])


def most_lag_K(temperature_degC: FloatArray, session: NameArray | None = None) -> float:
    """By how much the slowest links may be behind the thermometer, root mean square over the readings [K]."""
    slowest = lagging_temperatures(temperature_degC, TIME_CONSTANTS[-1:], session)
    spread = float(temperature_degC.std())
    return (1 - float(_shares(temperature_degC, slowest)[0])) * spread if spread else 0.0


def link_histories(fit: IdentificationResult, state: ArmState, grows: IntArray, others: IntArray) -> list[LinkHistory]:
    """A history for each of the `TIME_CONSTANTS`, and one of links that are as warm as the thermometer says.

    Parameters
    ----------
    fit : IdentificationResult
        With thermal terms, by points alone, at its minimum.
    state : ArmState
        Of its readings, with their true temperatures.
    grows, others : int arrays
        The coefficients of the thermal terms and all others.
    """
    degC = state.temperature_degC
    assert degC is not None
    temperatures = np.column_stack([degC, lagging_temperatures(degC, TIME_CONSTANTS, state.session)])
    gram, right = _normal_equations(fit, state, grows, others, temperatures - temperatures.mean(axis=0))
    n, links = len(others), len(grows)
    precision = gram[:n, :n] + np.diag(fit.prior_std[others] ** -2.0)
    along = np.linalg.solve(precision, np.column_stack([gram[:n, n:], right[:n]]))
    reduced = gram[n:, n:] - gram[n:, :n] @ along[:, :-1]
    left = gram[n:, :n] @ along[:, -1] - right[n:]
    slacks = [0.0, *(_slack(degC, tau, state.session) for tau in TIME_CONSTANTS)]
    found = []
    for i, (slack, mean) in enumerate(zip(slacks, temperatures.mean(axis=0).tolist(), strict=True)):
        own = slice(links * i, links * (i + 1))
        found.append(LinkHistory(reduced[own, own], left[own], np.asarray(-along[:, own]), mean, slack=slack))
    return found


def _normal_equations(
    fit: IdentificationResult, state: ArmState, grows: IntArray, others: IntArray, kelvin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gram matrix and right side, by the other coefficients and by the growth with temperatures (n, k) about a mean.

    The first of these are those by which the arm was identified.
    """
    points = fit.references[0]
    n, links = len(others), len(grows)
    gram = np.zeros((n + links * kelvin.shape[1],) * 2)
    right = np.zeros(len(gram))
    rows_of_all = state.rows(points.rows)
    one_kelvin = replace(rows_of_all, temperature_degC=np.full(len(points.rows), REFERENCE_DEGC + 1))
    for rows, _, columns in fit.perturbed_chain.derivatives(one_kelvin, fit.coefficients):
        warmer = kelvin[points.rows[rows]]
        by_growth = columns[grows] * warmer.T[:, None, None]
        design = np.concatenate([columns[others], *by_growth]) * points.weights[:, rows]
        design = design.reshape(len(design), -1)
        left = (points.residuals * points.weights)[:, rows].ravel()
        left = left - design[:n].T @ fit.coefficients[others] - design[n : n + links].T @ fit.coefficients[grows]
        gram += design @ design.T
        right += design @ left
    return gram, right


def _shares(degC: FloatArray, links_degC: FloatArray) -> FloatArray:
    """(k,) how much links at temperatures (n, k) changed, of what the thermometer says: slopes of a regression."""
    above = degC - degC.mean()
    return np.asarray(above @ links_degC / (above @ above))


def _slack(degC: FloatArray, tau: float, session: NameArray | None) -> float:
    """Relative standard deviation of the share of links whose time constants are distributed about tau."""
    fast, mean, slow = _shares(degC, lagging_temperatures(degC, tau * np.array([FASTEST, 1.0, SLOWEST]), session))
    return float((fast - slow) / (np.sqrt(12) * mean))
