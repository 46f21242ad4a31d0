"""What candidates tell of the terms: from poses and artefacts to a design problem."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.identify.problem import Moved
from truearm.plan.candidates import Candidates
from truearm.plan.exchange import DesignProblem, eliminated, mean_square, stacked
from truearm.terms.state import ArmState

FloatArray = npt.NDArray[np.float64]

SEAT_STD_MM = 1e4
"""Prior of a seat's point: nothing is known of it. A wider one would cost digits and tell no less."""


def tip_jacobian(
    moved: Moved, state: ArmState, coefficients: npt.ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Tips and their derivatives by the coefficients of all terms.

    Parameters
    ----------
    moved : Moved
        Chain and terms.
    state : ArmState
        n poses.
    coefficients : (p,) array, optional
        Where; zeros, the arm as drawn, by default.

    Returns
    -------
    tips : (n, 3) array
        [mm].
    jacobian : (n, 3, p) array
        [mm per unit of the coefficients].
    """
    p = moved.n_coefficients
    x = np.zeros(p) if coefficients is None else np.asarray(coefficients, dtype=float)
    if x.shape != (p,) or not np.isfinite(x).all():
        raise InputError(f"expected {p} finite coefficients, one for each of the terms', got shape {x.shape}")
    tips, jacobian = np.empty((len(state), 3)), np.empty((len(state), 3, p))
    for rows, some, columns in moved.derivatives(state, x):
        tips[rows] = some.T
        jacobian[rows] = columns.transpose(2, 1, 0)
    return tips, jacobian


def design_problem(
    moved: Moved,
    candidates: Candidates,
    state: ArmState,
    volume: ArmState,
    *,
    prior_precision: npt.ArrayLike,
    noise_mm: float,
    length_u_mm: float = 0.0,
    coefficients: npt.ArrayLike | None = None,
) -> DesignProblem:
    """The problem of which candidates to measure, for the least uncertainty in a volume up to a rigid motion.

    Under a tracker a reading tells the tip. In a seat it tells the tip from the unknown point of the seat, and a bar
    tells the distance of its two seats besides. A seat's point is eliminated where all its readings belong to one
    candidate; where they are spread over several it becomes three more parameters, after those of the terms.

    Parameters
    ----------
    moved : Moved
        Chain and terms, with p coefficients.
    candidates : Candidates
    state : ArmState
        At the readings of the candidates: ``ArmState(chain, candidates.angles)``, or with temperatures and the like.
    volume : ArmState
        At poses as the arm is to be used.
    prior_precision : (p, p) array
        Of the coefficients: the diagonal of inverse prior variances, or the inverse of the covariance found so far.
    noise_mm : float
        Standard deviation of a coordinate of a reading, by the reference, by the touch, and by what no term explains.
    length_u_mm : float
        Standard uncertainty of a bar's length.
    coefficients : (p,) array, optional
        As in `tip_jacobian`.

    Raises
    ------
    InputError
        If sizes do not fit, or noise or uncertainty are not positive numbers.
    """
    if len(state) != len(candidates.angles):
        raise InputError(f"expected a state of {len(candidates.angles)} readings, got {len(state)}")
    if not (np.isfinite(noise_mm) and noise_mm > 0):
        raise InputError(f"expected the positive noise of a reading in mm, got {noise_mm}")
    bar = candidates.length_mm is not None
    if bar and not (np.isfinite(length_u_mm) and length_u_mm > 0):
        raise InputError(f"expected the positive uncertainty of the bar's length in mm, got {length_u_mm}")
    _, jacobian = tip_jacobian(moved, state, coefficients)
    tips_there, jacobian_there = tip_jacobian(moved, volume, coefficients)
    seats, seat = _seats(candidates)
    shared = [number for number in range(seats) if len(np.unique(candidates.candidate[seat == number])) > 1]
    p, q = jacobian.shape[2], 3 * len(shared)
    column = np.full(max(seats, 1), -1)
    column[shared] = np.arange(len(shared))
    factors = []
    for place in range(len(candidates)):
        rows = candidates.readings([place])
        by_terms, by_seats = jacobian[rows] / noise_mm, np.zeros((len(rows), 3, q))
        own = [number for number in dict.fromkeys(seat[rows].tolist()) if number >= 0 and column[number] < 0]
        nuisance = np.zeros((len(rows), 3, 3 * len(own)))
        for reading, number in enumerate(seat[rows]):
            if number in own:
                nuisance[reading, :, 3 * own.index(number) :][:, :3] = -np.eye(3) / noise_mm
            elif number >= 0:
                by_seats[reading, :, 3 * column[number] :][:, :3] = -np.eye(3) / noise_mm
        J = np.concatenate([by_terms, by_seats], axis=2).reshape(-1, p + q)
        B = nuisance.reshape(len(J), -1)
        if bar:
            assert candidates.seat_points is not None  # a bar has seats
            along = candidates.seat_points[rows[-1]] - candidates.seat_points[rows[0]]
            along = along / (np.linalg.norm(along) * length_u_mm)
            J = np.concatenate([J, np.zeros((1, p + q))])
            B = np.concatenate([B, np.concatenate([-along, along])[None]])
        factors.append(eliminated(J, B))
    precision = np.asarray(prior_precision, dtype=float)
    if precision.shape != (p, p):
        raise InputError(f"expected a prior precision of shape {(p, p)}, got {precision.shape}")
    prior, target = np.diag(np.full(p + q, SEAT_STD_MM**-2.0)), np.zeros((p + q, p + q))
    prior[:p, :p] = precision
    target[:p, :p] = mean_square(jacobian_there, tips_there)
    return DesignProblem(stacked(factors), prior, target)


def _seats(candidates: Candidates) -> tuple[int, npt.NDArray[np.intp]]:
    """How many seats there are, and the number of each reading's, -1 where it is in none."""
    if candidates.seat is None:
        return 0, np.full(len(candidates.angles), -1)
    names, seat = np.unique(candidates.seat, return_inverse=True)
    return len(names), seat.astype(np.intp)
