"""Information of candidates about the terms: from poses and artefacts to a design problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState
from truearm.readings import Lengths
from truearm.typing import FloatArray, IntArray
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.exchange import DesignProblem, moment_matrix, project_out, stack_factors

SEAT_STD_MM = 1e4
"""Prior standard deviation of an unknown position of a seat. A wider one would cost digits."""


def tip_jacobian(
    perturbed_chain: PerturbedChain, state: ArmState, coefficients: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Tips and their derivatives by the coefficients of all terms.

    Parameters
    ----------
    perturbed_chain : PerturbedChain
        Chain and terms.
    state : ArmState
        n poses.
    coefficients : (p,) array, optional
        Point of linearisation; zeros by default.

    Returns
    -------
    tips : (n, 3) array
        [mm].
    jacobian : (n, 3, p) array
        [mm per unit of the coefficients].
    """
    p = perturbed_chain.n_coefficients
    x = np.zeros(p) if coefficients is None else coefficients
    tips, jacobian = np.empty((len(state), 3)), np.empty((len(state), 3, p))
    for rows, some, columns in perturbed_chain.derivatives(state, x):
        tips[rows] = some.T
        jacobian[rows] = columns.transpose(2, 1, 0)
    return tips, jacobian


def design_problem(
    perturbed_chain: PerturbedChain,
    candidates: Candidates,
    state: ArmState,
    volume: ArmState,
    *,
    prior_precision: FloatArray,
    noise_mm: float,
    length_u_mm: float = 0.0,
    scale: bool = False,
) -> DesignProblem:
    """Pose the problem of which candidates to measure for the smallest uncertainty in a volume, up to a rigid motion.

    A tracker measures the tip itself. A seat gives the tip relative to the unknown position of the seat, a bar also the
    distance of its two seats. The position of a seat is eliminated if all its readings belong to one candidate; else it
    adds three parameters after those of the terms. The length of a bar between two such seats is then part of the
    prior, else of the candidate.

    There is one bar with one certificate at all its places: its length is the last parameter. Plans with many places
    therefore do not determine the scale better than the certificate does.

    Parameters
    ----------
    perturbed_chain : PerturbedChain
        Chain and terms, with p coefficients.
    candidates : Candidates
    state : ArmState
        At the readings of the candidates: ``ArmState(chain, candidates.angles)``, or with temperatures and the like.
    volume : ArmState
        At poses of the later use of the arm.
    prior_precision : (p, p) array
        Of the coefficients: the diagonal of inverse prior variances, or the inverse of a posterior covariance.
    noise_mm : float
        Standard deviation of a coordinate of a reading: reference, contact, and effects without a term.
    length_u_mm : float
        Standard uncertainty of a bar's length; it also varies by `Lengths.default_u_place_mm` from place to place.
    scale : bool
        Whether the uncertainty in the volume is evaluated up to a scale too.

    Raises
    ------
    InputError
        If the state is not of the candidates, or noise or uncertainty are not positive numbers.
    """
    _check_problem(candidates, state, noise_mm, length_u_mm)
    tips, jacobian = tip_jacobian(perturbed_chain, state)
    tips_there, jacobian_there = tip_jacobian(perturbed_chain, volume)
    n_seats, seat = _seats(candidates)
    bars, bar = _bars(candidates, seat, tips), candidates.length_mm is not None
    shared = _shared_seats(candidates, n_seats, seat, bars)
    p, q = jacobian.shape[2], 3 * len(shared) + bar
    column = {number: p + 3 * place for place, number in enumerate(sorted(shared))}
    by_noise = jacobian / noise_mm
    factors = [
        _factor(candidates.readings([place]), seat, by_noise, noise_mm, column, bars, p + q)
        for place in range(len(candidates))
    ]
    prior = _with_seats(prior_precision, p + q, column, bars, length_u_mm if bar else None)
    target = np.zeros((p + q, p + q))
    target[:p, :p] = moment_matrix(jacobian_there, tips_there, scale=scale)
    return DesignProblem(stack_factors(factors), prior, target)


def _with_seats(
    prior_precision: FloatArray,
    size: int,
    column: Mapping[int, int],
    bars: Sequence[tuple[int, int, FloatArray]],
    length_u_mm: float | None,
) -> FloatArray:
    """Precision of terms, shared seats from their `column` on and, last, the length of the bar, by which they are."""
    p = len(prior_precision)
    prior = np.diag(np.full(size, SEAT_STD_MM**-2.0))
    prior[:p, :p] = prior_precision
    if length_u_mm is not None:
        prior[-1, -1] = length_u_mm**-2.0
    for one, other, along in bars:
        if one in column:
            row = np.zeros(size)
            row[column[one] :][:3], row[column[other] :][:3], row[-1] = -along, along, -1 / Lengths.default_u_place_mm
            prior += np.outer(row, row)
    return prior


def _check_problem(candidates: Candidates, state: ArmState, noise_mm: float, length_u_mm: float) -> None:
    if len(state) != len(candidates.angles):
        raise InputError(f"expected a state of {len(candidates.angles)} readings, got {len(state)}")
    if not (np.isfinite(noise_mm) and noise_mm > 0):
        raise InputError(f"expected a positive noise of a reading in mm, got {noise_mm}")
    if candidates.length_mm is not None and not (np.isfinite(length_u_mm) and length_u_mm > 0):
        raise InputError(f"expected a positive uncertainty of the bar's length in mm, got {length_u_mm}")


def _shared_seats(
    candidates: Candidates, n_seats: int, seat: IntArray, bars: Sequence[tuple[int, int, FloatArray]]
) -> set[int]:
    """Seats whose places several candidates determine together."""
    shared = {number for number in range(n_seats) if len(np.unique(candidates.candidate[seat == number])) > 1}
    # A bar with one shared seat: the length determines the other seat too.
    return shared | {end for one, other, _ in bars if one in shared or other in shared for end in (one, other)}


def _factor(
    rows: IntArray,
    seat: IntArray,
    jacobian: FloatArray,
    noise_mm: float,
    column: dict[int, int],
    bars: list[tuple[int, int, FloatArray]],
    n_parameters: int,
) -> FloatArray:
    """Information of a candidate's readings `rows`, (k, n_parameters), without the positions of its own seats.

    `jacobian` (m, 3, p) is over the noise; `column` has the parameters of the seats that candidates share.
    """
    own = [number for number in dict.fromkeys(seat[rows].tolist()) if number >= 0 and number not in column]
    lengths = [bar for bar in bars if bar[0] in own and bar[1] in own]
    J = np.zeros((3 * len(rows) + len(lengths), n_parameters))
    B = np.zeros((len(J), 3 * len(own)))
    J[: 3 * len(rows), : jacobian.shape[2]] = jacobian[rows].reshape(3 * len(rows), -1)
    for reading, number in enumerate(seat[rows].tolist()):
        if number >= 0:
            part = J[:, column[number] :] if number in column else B[:, 3 * own.index(number) :]
            part[3 * reading :][:3, :3] = -np.eye(3) / noise_mm
    for at, (one, other, along) in zip(range(3 * len(rows), len(J)), lengths, strict=True):
        B[at, 3 * own.index(one) :][:3], B[at, 3 * own.index(other) :][:3] = -along, along
        J[at, -1] = -1 / Lengths.default_u_place_mm
    return project_out(J, B)


def _seats(candidates: Candidates) -> tuple[int, IntArray]:
    """Number of seats, and the seat of each reading, -1 if it is in none."""
    if candidates.seat is None:
        return 0, np.full(len(candidates.angles), -1)
    names, seat = np.unique(candidates.seat, return_inverse=True)
    return len(names), seat.astype(np.intp)


def _bars(candidates: Candidates, seat: IntArray, tips: FloatArray) -> list[tuple[int, int, FloatArray]]:
    """Both seats of every place of a bar, and the direction from one to the other over the place's uncertainty."""
    if candidates.length_mm is None:
        return []
    assert candidates.place is not None  # a bar has places
    found = []
    for place in np.unique(candidates.place):
        here = candidates.place == place
        ends = np.unique(seat[here]).tolist()
        if len(ends) == 2:
            along = np.subtract(*(tips[here & (seat == end)].mean(axis=0) for end in ends[::-1]))
            found.append((ends[0], ends[1], along / (np.linalg.norm(along) * Lengths.default_u_place_mm)))
    return found
