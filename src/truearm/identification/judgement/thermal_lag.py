"""What readings taken in drifting air say of the growth of links: links that lag, and a base or tip that drifts too.

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

The base, the tip or the reference may drift while the room warms, and over the poses of a session that is nearly what
growth does: 0.1 mm in 0.8 K would be 5 times the growth of aluminium. So where the temperature follows the order of the
readings, motions of base and tip along slow functions of time stand beside x: those of a random walk (M. Loeve,
"Probability Theory", vol. 2, 4th ed., 1978, section 37.5), of one of several sizes, each a hypothesis too. x is the arm
at their mean; on another day base and tip are as far from it as they were during the readings, root mean square.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import MOST_NARROW, chunks, moved_chain
from truearm.identification.terms.catalogue import relative_size
from truearm.identification.terms.links import link_temperatures
from truearm.identification.terms.state import ArmState
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
# Amplitudes of drifts of an arm of usual reach [mm], and the half periods of their courses in a session.
DRIFTS_MM = np.array([0.0, 0.01, 0.03, 0.1, 0.3, 1.0])
HALF_PERIODS = np.arange(1, 5)
# The temperature follows the order if these courses explain more than this share of its variance.
FOLLOWING_SHARE = 0.1
N_DRIFTS = 9


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
    drift : (9 n_courses, 1 + n_links) array
        Of base and tip beside it, root mean square over the readings: without growth [mm], and by growth [mm K].
    as_others : (n_others, 9) array
        Change of the other coefficients that moves base and tip by as much [1/mm].
    mean_degC : float
        Mean temperature of the links.
    share : float
        By how much they changed, of what the thermometer says.
    slack : float
        Relative standard deviation of that share from link to link.
    log_evidence : float
        Of the drift of base and tip beside it, before growth.
    """

    information: FloatArray
    right: FloatArray
    gain: FloatArray
    drift: FloatArray
    as_others: FloatArray
    mean_degC: float
    share: float = 1.0
    slack: float = 0.0
    log_evidence: float = 0.0


def lagging_temperatures(
    temperature_degC: FloatArray, time_constants: FloatArray, session: NameArray | None = None, stride: float = 1.0
) -> FloatArray:
    """(n, k) temperatures of links with k time constants, in readings, at the temperatures (n,) of the air [degC].

    Each is `stride` readings after the one before. Links have settled where a session begins, and where the thermometer
    jumps.
    """
    starts = np.abs(np.diff(temperature_degC)) > SETTLED_STEP_K
    if session is not None:
        starts |= session[1:] != session[:-1]
    pieces = np.split(temperature_degC, np.flatnonzero(starts) + 1)
    return np.concatenate([link_temperatures(piece, time_constants, interval_s=stride) for piece in pieces])


def most_lag_K(temperature_degC: FloatArray, session: NameArray | None = None, stride: float = 1.0) -> float:
    """By how much the slowest links may be behind the thermometer, root mean square over the readings [K]."""
    slowest = lagging_temperatures(temperature_degC, TIME_CONSTANTS[-1:], session, stride)
    spread = float(temperature_degC.std())
    return (1 - float(_shares(temperature_degC, slowest)[0])) * spread if spread else 0.0


def link_histories(
    fit: IdentificationResult,
    covariance: FloatArray,
    state: ArmState,
    grows: IntArray,
    others: IntArray,
    time_constants: FloatArray,
) -> list[LinkHistory]:
    """Histories of links that are as warm as the thermometer says, and of each time constant, by the size of a drift.

    Parameters
    ----------
    fit : IdentificationResult
        With thermal terms, by points alone, at its minimum.
    covariance : (n_coefficients, n_coefficients) array
        Of its coefficients, by these readings and its priors alone.
    state : ArmState
        Of its readings, with their true temperatures.
    grows, others : int arrays
        The coefficients of the thermal terms and all others.
    time_constants : (k,) array
        Of links that may lag, in readings.
    """
    degC = state.temperature_degC
    assert degC is not None
    temperatures = np.column_stack([degC, lagging_temperatures(degC, time_constants, state.session, state.stride)])
    courses = drift_courses(len(state), state.session)
    if follows := _explained(degC, courses) > FOLLOWING_SHARE:
        motions = np.column_stack([courses, np.ones(len(courses))])
    else:
        courses = motions = courses[:, :0]
    across, among, right = _products(fit, state, grows, temperatures - temperatures.mean(axis=0), motions)
    m, drifts = len(grows) * temperatures.shape[1], N_DRIFTS * courses.shape[1]
    # By others alone: their covariance where growth is known.
    gain = np.linalg.solve(covariance[np.ix_(grows, grows)], covariance[np.ix_(grows, others)])
    across[grows] = 0.0
    with_growth = covariance @ across
    taken = with_growth[others] - gain.T @ with_growth[grows]
    as_others = taken[:, m + drifts :] if follows else np.zeros((len(others), N_DRIFTS))
    # Of growth, of drift. At the minimum the gradient by the others is that of their prior.
    rest = (among - across[others].T @ taken)[: m + drifts, : m + drifts]
    pulls, gains, links = right[: m + drifts] - rest[:, : len(grows)] @ fit.coefficients[grows], -taken, len(grows)
    slacks = [0.0, *(_slack(state, tau) for tau in time_constants)]
    rms = np.repeat(np.sqrt((courses**2).mean(axis=0)), N_DRIFTS)[:, None]
    found = []
    for size in DRIFTS_MM * relative_size(fit.chain) if follows else [0.0]:
        whitened = size**2 * rest[m:, m:] + np.eye(len(rest) - m)
        drift = size**2 * np.linalg.solve(whitened, np.column_stack([rest[m:, :m], pulls[m:]]))
        reduced, left = rest[:m, :m] - rest[:m, m:] @ drift[:, :-1], rest[:m, m:] @ drift[:, -1] - pulls[:m]
        gain = gains[:, :m] - gains[:, m : m + drifts] @ drift[:, :-1]
        log_evidence = float(pulls[m:] @ drift[:, -1] - np.linalg.slogdet(whitened)[1]) / 2
        for i, (slack, mean) in enumerate(zip(slacks, temperatures.mean(axis=0).tolist(), strict=True)):
            own = slice(links * i, links * (i + 1))
            moved = -rms * np.column_stack([drift[:, -1], drift[:, own]])
            known = reduced[own, own], left[own], gain[:, own], moved, as_others, mean
            found.append(LinkHistory(*known, slack=slack, log_evidence=log_evidence))
    return found


def drift_courses(n: int, session: NameArray | None = None) -> FloatArray:
    """(n, k) slow functions of time in each session, the k-th of an amplitude of 1/k."""
    names = np.zeros(n) if session is None else session
    columns = []
    for name in dict.fromkeys(names.tolist()):
        rows = names == name
        time = (np.arange(rows.sum()) + 0.5) / rows.sum()
        columns.append(np.zeros((n, len(HALF_PERIODS))))
        columns[-1][rows] = np.cos(np.pi * np.outer(time, HALF_PERIODS)) / HALF_PERIODS
    return np.hstack(columns)


def _explained(values: FloatArray, courses: FloatArray) -> float:
    """Share of the variance of values (n,) that courses explain beside a mean for each set of readings."""
    above = values - values.mean()
    left = above - courses @ np.linalg.lstsq(courses, above, rcond=None)[0]
    return 1 - float(left @ left) / float(above @ above)


def _products(
    fit: IdentificationResult, state: ArmState, grows: IntArray, kelvin: FloatArray, courses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Products of growth and drifts with the coefficients, with each other, and with the residuals.

    The first of the temperatures (n, k), about a mean, are those by which the arm was identified. Drifts along courses
    (n, c) are rotations and translations of the base and translations of the tip, each of about a millimetre at the
    tip. The last course is constant: motions of base and tip as a whole. Growth and drifts are a few motions, each
    times functions of time.
    """
    points, arm, x = fit.references[0], fit.perturbed_chain, fit.coefficients
    links, m, whole = len(grows), len(points.rows), points.weights
    one_kelvin = replace(state.rows(points.rows), temperature_degC=np.full(m, REFERENCE_DEGC + 1))
    growths, drifts = np.arange(links), links + np.arange(N_DRIFTS)
    motion = np.concatenate([np.tile(growths, kelvin.shape[1]), np.tile(drifts, courses.shape[1])])
    over_time = np.concatenate([kelvin.T.repeat(links, axis=0), courses.T.repeat(N_DRIFTS, axis=0)])[:, points.rows]
    site_of, row_of = arm.of_coefficient
    wide = [number for number, site in enumerate(arm.sites) if len(site.columns) > MOST_NARROW]
    narrow = np.flatnonzero(~np.isin(site_of, wide))
    across, among, right = np.zeros((len(x), len(motion))), np.zeros((len(motion),) * 2), np.zeros(len(motion))
    for rows in chunks(m):
        weights, in_time, piece = whole[:, rows], over_time[:, rows], one_kelvin.rows(rows)
        values = arm.values(piece)
        by_motion = moved_chain(arm.chain, piece, arm.motions(x, values))[1]
        weighed = arm.along_sites(by_motion) * weights
        grown = weighed[site_of[grows]] * values[row_of[grows]][:, None]
        of_base = [by_motion[0, :3] / (fit.chain.reach or 1.0), by_motion[0, 3:]]
        motions = np.concatenate([grown, *(each * weights for each in (*of_base, by_motion[-1, 3:]))])
        design = (motions[motion] * in_time[:, None]).reshape(len(motion), -1)
        among += design @ design.T
        right += design @ (weights * points.residuals[:, rows]).ravel()
        columns = weighed[site_of[narrow]] * values[row_of[narrow]][:, None]
        across[narrow] += columns.reshape(len(narrow), -1) @ design.T
        for number in wide:  # coordinates are contracted before the functions, which are many
            products = np.einsum("km,dkm->dm", weighed[number], motions)
            across[arm.sites[number].columns] += values[arm.sites[number].rows] @ (products[motion] * in_time).T
    return across, among, right


def _shares(degC: FloatArray, links_degC: FloatArray) -> FloatArray:
    """(k,) how much links at temperatures (n, k) changed, of what the thermometer says: slopes of a regression."""
    above = degC - degC.mean()
    return np.asarray(above @ links_degC / (above @ above))


def _slack(state: ArmState, tau: float) -> float:
    """Relative standard deviation of the share of links whose time constants are distributed about tau."""
    degC, taus = state.temperature_degC, tau * np.array([FASTEST, 1.0, SLOWEST])
    assert degC is not None
    fast, mean, slow = _shares(degC, lagging_temperatures(degC, taus, state.session, state.stride))
    return float((fast - slow) / (np.sqrt(12) * mean))
