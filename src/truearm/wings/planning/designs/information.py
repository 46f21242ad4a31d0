"""Information of candidates about the terms: from poses and artefacts to a design problem.

Observability indices: how well readings determine the parameters, from the singular values of their Jacobian.

The indices depend on the units of the parameters. Here they are those of the *whitened* Jacobian: each row divided by
the standard deviation of its reading's noise, each column multiplied by its parameter's prior standard deviation. It is
dimensionless. With a singular value s the posterior variance of one combination of the parameters is 1 / (1 + s^2) of
the prior variance: below s = 1 the prior dominates. The indices were published for columns in the parameters' own
units; published numbers are comparable only with the same scaling.

====== ==================================== ===========================================================================
index  definition, s1 >= ... >= sL          source
====== ==================================== ===========================================================================
O1     (s1 ... sL)^(1/L) / sqrt(n)          J.-H. Borm, C.-H. Menq, "Determination of optimal measurement configurations
                                            for robot calibration based on observability measure", Int. J. Robotics
                                            Research 10 (1991) 51
O2     sL / s1                              M. R. Driels, U. S. Pathre, "Significance of observation strategy on the
                                            design of robot calibration experiments", J. Robotic Systems 7 (1990) 197
O3     sL                                   A. Nahvi, J. M. Hollerbach, V. Hayward, "Calibration of a parallel robot
                                            using multiple kinematic closed loops", IEEE Int. Conf. Robotics and
                                            Automation 1994, 407
O4     sL^2 / s1                            A. Nahvi, J. M. Hollerbach, "The noise amplification index for optimal pose
                                            selection in robot calibration", IEEE Int. Conf. Robotics and Automation
                                            1996, 647
O5     1 / (1/s1 + ... + 1/sL)              Y. Sun, J. M. Hollerbach, "Observability index selection for robot
                                            calibration", IEEE Int. Conf. Robotics and Automation 2008, 831
====== ==================================== ===========================================================================

Larger is better for each. n is the number of poses. O1 is D-optimality, O3 is E-optimality and O5 is close
to A-optimality, which sums the inverse squares (Sun and Hollerbach).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import ArmState
from truearm.readings import Lengths
from truearm.typing import FloatArray, IntArray
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.exchange import DesignProblem, moment_matrix, project_out, stack_factors

CLEAR_GAP = 1e4
"""Ratio of neighbouring singular values above which the smaller one counts as zero.

Of a combination of parameters that is not identifiable, rounding leaves some 1e-16 of the largest singular value; an
identifiable one, even if poorly determined, is far above.
"""
ROUNDING = 1e-14
"""Share of the largest singular value below which a singular value counts as rounding."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of parameters by readings.

    Attributes
    ----------
    singular_values : (p,) array
        Of the whitened Jacobian, in descending order; zeros if there are fewer rows than parameters.
    rank : int
        Identifiable combinations of the parameters.
    gap : float
        Clearness of the rank: last nonzero over first zero singular value (see `rank_and_gap`), of the Jacobian with
        columns of unit length. At full rank, the largest ratio of neighbours.
    n_poses : int
        Number of poses, for O1.

    Notes
    -----
    The published indices assume that all parameters are identifiable. Here they are those of the `rank` identifiable
    combinations; with rank 0 they are 0.
    """

    singular_values: FloatArray
    rank: int
    gap: float
    n_poses: int

    @property
    def n_parameters(self) -> int:
        """Number of parameters, identifiable or not."""
        return len(self.singular_values)

    @property
    def nonzero(self) -> FloatArray:
        """(rank,) singular values of the identifiable combinations."""
        return self.singular_values[: self.rank]

    @property
    def o1(self) -> float:
        """Root of the product of the singular values, over the square root of the number of poses."""
        return float(np.exp(np.log(self.nonzero).mean()) / np.sqrt(self.n_poses)) if self.rank else 0.0

    @property
    def o2(self) -> float:
        """Inverse condition number."""
        return float(self.nonzero[-1] / self.nonzero[0]) if self.rank else 0.0

    @property
    def o3(self) -> float:
        """Smallest singular value."""
        return float(self.nonzero[-1]) if self.rank else 0.0

    @property
    def o4(self) -> float:
        """Noise amplification index: the smallest singular value times the inverse condition number."""
        return self.o3 * self.o2

    @property
    def o5(self) -> float:
        """Inverse of the sum of the inverse singular values."""
        return float(1 / (1 / self.nonzero).sum()) if self.rank else 0.0


def observability(jacobian: FloatArray, *, n_poses: int) -> Observability:
    """Observability of parameters by readings.

    Parameters
    ----------
    jacobian : (m, p) array
        Whitened: rows over the noise, columns times the parameters' prior standard deviations; without rows for the
        prior, which would make everything identifiable.
    n_poses : int
        Number of poses that the rows come from.
    """
    m, p = jacobian.shape
    # The triangular factor has the same singular values.
    J = np.asarray(np.linalg.qr(jacobian, mode="r")) if m > p else jacobian
    length = np.linalg.norm(J, axis=0)
    rank, gap = rank_and_gap(_singular_values(J / np.where(length > 0, length, 1.0)))
    return Observability(_singular_values(J), rank, gap, n_poses)


def rank_and_gap(values: FloatArray) -> tuple[int, float]:
    """Numerical rank, and the gap that determines it.

    The rank is where neighbouring singular values have the largest ratio; those below `ROUNDING` times the largest
    count as equal to it. If the ratio is less than `CLEAR_GAP`, there is no gap: the rank is then the number of values
    above rounding, and the ratio there shows how unclear it is.

    Parameters
    ----------
    values : (p,) array
        Singular values, in descending order. Use those of a Jacobian with columns of unit length: rounding depends on
        the units of the columns.

    Returns
    -------
    rank : int
    gap : float
        Ratio of the last nonzero to the first zero value; at full rank the largest ratio of neighbours; infinite if all
        are zero.
    """
    if values[0] == 0:
        return 0, np.inf
    above = np.maximum(values, ROUNDING * values[0])
    ratios = above[:-1] / above[1:]
    widest = float(ratios.max(initial=1.0))
    if widest >= CLEAR_GAP:
        return int(ratios.argmax()) + 1, widest
    rank = int((values > ROUNDING * values[0]).sum())
    return rank, widest if rank == len(values) else float(ratios[rank - 1])


def _singular_values(J: FloatArray) -> FloatArray:
    """(p,) singular values, with zeros if there are fewer rows than columns."""
    values = np.zeros(J.shape[1])
    values[: min(J.shape)] = np.linalg.svd(J, compute_uv=False)
    return values


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
