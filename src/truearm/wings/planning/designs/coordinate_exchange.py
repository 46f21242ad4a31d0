"""A plan whose poses are a short way apart: poses are exchanged for others nearby, one at a time, at a price.

Of a plan that was chosen for its uncertainty alone, a joint turns by a hundred degrees or more from pose to pose. Poses
that inform next to as well are a short way from their neighbours on the path. Every pose in turn is offered to be
exchanged for poses near it, near its neighbours and between them. With ``v = trace(M C)`` (see `exchange`) and the
largest move of a joint on every step, it becomes the pose that lowers

    log v + price * sum over the steps of the largest move of a joint

most. The price of a radian rises while the plan may become more uncertain, and falls when it has become too uncertain;
the path is reordered now and then. The result is the shortest path found within the uncertainty allowed.

Source: exchange of one point of a design at a time within a continuous region: R. K. Meyer, C. J. Nachtsheim, "The
coordinate-exchange algorithm for constructing exact optimal experimental designs", Technometrics 37 (1995) 60. The
price is a Lagrange multiplier.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log, radians

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from truearm.arm import Arm
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray, IntArray
from truearm.wings.planning.designs.candidates import Candidates, NearbyPoses
from truearm.wings.planning.designs.exchange import DesignProblem
from truearm.wings.planning.designs.tour import joint_moves, mean_joint_move, order_of_few_moves

Factors = Callable[[FloatArray], FloatArray]
"""Jacobian of the tip over the noise, (m, 3, p), at joint angles (m, n_joints): p coefficients of the terms."""

MOST_UNCERTAINTY = 1.05
"""Largest uncertainty in the volume, as a multiple of that of the plan that was not shortened."""

ENOUGH_RAD = radians(60.0)
"""A path whose mean move is shorter is not shortened further."""

_ROUNDS = 60
_OFFERS = 16
# Change of log v for a radian of the path at the start, and the largest factor from round to round.
_PRICE, _RISE = 0.008, 1.3
# How fast the price follows the share of the allowed uncertainty that is used, and the share that it aims at.
_GAIN, _AIM = 5.0, 0.95
# Standard deviation of an offered joint angle about its mean, at most and at least: large ones find, small improve.
_SCATTER_RAD, _LEAST_SCATTER_RAD = 1.0, 0.03
# Probability that an offer is next to a neighbour on the path.
_AT_NEIGHBOUR = 0.15
_ORDER_EVERY = 3
# Smallest share of a direction's information that must remain when an update removes a reading, as in `exchange`.
_LEAST_LEFT = 1e-6


def shorten_path(
    arm: Arm,
    poses: Candidates,
    problem: DesignProblem,
    factors: Factors,
    nearby: NearbyPoses,
    *,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Candidates:
    """Exchange poses for others that make the path shorter, at no more than `MOST_UNCERTAINTY`.

    Parameters
    ----------
    arm : Arm
    poses : Candidates
        Each pose a candidate.
    problem : DesignProblem
        Of these poses.
    factors : callable
        The first p columns of the factors of `problem`, at any joint angles.
    nearby : NearbyPoses
        Which poses are allowed.
    seed : int
        Of the poses that are offered.
    progress : callable, optional
        Called with the number of rounds done and the largest number.

    Returns
    -------
    Candidates
        In the order of measurement: the poses of one seat in a row, the seats in their order.
    """
    start = _Path(poses, problem.factors).taken(order_of_few_moves(arm, poses.angles, poses.seat))
    least = problem.variance(range(len(poses)))
    best, path, price, rng = start, start, _PRICE, np.random.default_rng(seed)
    with one_blas_thread():
        for count in range(_ROUNDS):
            if mean_joint_move(arm, best.poses.angles) <= ENOUGH_RAD:
                break
            if progress is not None:
                progress(count, _ROUNDS)
            path = _one_round(arm, path, problem, _offers(arm, path, factors, nearby, rng), price)
            if count % _ORDER_EVERY == _ORDER_EVERY - 1:
                path = path.taken(order_of_few_moves(arm, path.poses.angles, path.poses.seat))
            used = log(squared_uncertainty(problem, path.factors) / least) / (2 * log(MOST_UNCERTAINTY))
            price *= _RISE ** min(max(_GAIN * (_AIM - used), -1.0), 1.0)
            if used <= 1 and _length(arm, path.poses.angles) < _length(arm, best.poses.angles):
                best = path
    return best.poses


def squared_uncertainty(problem: DesignProblem, factors: FloatArray) -> float:
    """``trace(M C)`` with factors (n, k, p) measured instead of those of the problem [mm^2]."""
    return replace(problem, factors=factors).variance(range(len(factors)))


@dataclass(frozen=True, eq=False)
class _Path:
    """Poses in the order of measurement, with their factors (n, k, p)."""

    poses: Candidates
    factors: FloatArray

    def taken(self, rows: IntArray) -> _Path:
        return _Path(self.poses.split_into_poses(rows), self.factors[rows])


def _offers(
    arm: Arm, path: _Path, factors: Factors, nearby: NearbyPoses, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Angles (n, m, n_joints) that n poses may be exchanged for, their factors (n, m, k, p), and which are allowed."""
    wanted = wanted_angles(arm, path.poses.angles, _OFFERS, rng)
    n, m, _ = wanted.shape
    seats = None if path.poses.seat_points is None else np.repeat(path.poses.seat_points, m, axis=0)
    angles, allowed = nearby.find(wanted.reshape(n * m, -1), seats)
    new = np.repeat(path.factors[:, None], m, axis=1)
    by_terms = factors(angles)
    new[..., : by_terms.shape[2]] = by_terms.reshape(n, m, *by_terms.shape[1:])
    # A pose that is alone in its seat informs of nothing, wherever it is.
    informs = np.asarray(path.factors.any(axis=(1, 2)))
    return angles.reshape(n, m, -1), new, allowed.reshape(n, m) & informs[:, None]


def wanted_angles(arm: Arm, angles: FloatArray, m: int, rng: np.random.Generator) -> FloatArray:
    """Draw angles (n, m, n_joints) for each pose of a path: about it, about its neighbours and about those between.

    Joints without limits go the shorter way round. Sliding joints stay, or are where a neighbour's are.
    """
    n, n_joints = angles.shape
    before = np.concatenate([angles[1:2], angles[:-1]])[:, None]
    after = np.concatenate([angles[1:], angles[-2:-1]])[:, None]
    here = angles[:, None]
    between = before + rng.random((n, m, 1)) * _turn(arm, before, after)
    mean = here + rng.random((n, m, 1)) * _turn(arm, here, between)
    which = rng.random((n, m, 1))
    mean = np.where(which < _AT_NEIGHBOUR / 2, before, np.where(which < _AT_NEIGHBOUR, after, mean))
    std = _SCATTER_RAD * (_LEAST_SCATTER_RAD / _SCATTER_RAD) ** rng.random((n, m, 1))
    scatter = std * rng.standard_normal((n, m, n_joints))
    return np.asarray(mean + np.where(arm.chain.is_prismatic, 0.0, scatter))


def _turn(arm: Arm, start: FloatArray, end: FloatArray) -> FloatArray:
    """The way from angles to others, the shorter way round for joints that turn more than once."""
    way = end - start
    whole = (np.diff(arm.limits)[:, 0] >= 4 * np.pi - 1e-9) & ~arm.chain.is_prismatic
    return np.asarray(np.where(whole, (way + np.pi) % (2 * np.pi) - np.pi, way))


def _one_round(
    arm: Arm, path: _Path, problem: DesignProblem, offers: tuple[FloatArray, FloatArray, BoolArray], price: float
) -> _Path:
    """Exchange each pose for the best that it is offered, if that is better."""
    offered_angles, offered_factors, is_allowed = offers
    angles, factors, M = path.poses.angles.copy(), path.factors.copy(), problem.target
    covariance = _inverse(problem.prior_precision, factors)
    for i in range(len(angles)):
        allowed = np.flatnonzero(is_allowed[i])
        if not len(allowed):
            continue
        without = _without(covariance, problem.prior_precision, factors, i)
        choices = np.concatenate([factors[i : i + 1], offered_factors[i, allowed]])
        C_by_choice = choices @ without
        S = C_by_choice @ choices.transpose(0, 2, 1)
        T = C_by_choice @ M @ C_by_choice.transpose(0, 2, 1)
        inner = np.linalg.inv(np.eye(S.shape[1]) + S)
        left = np.vdot(M, without) - np.einsum("iab,iba->i", inner, T)
        moved = np.concatenate([angles[i : i + 1], offered_angles[i, allowed]])
        way = np.zeros(len(moved))
        for neighbour in (i - 1, i + 1):
            if 0 <= neighbour < len(angles):
                way += joint_moves(arm, angles[neighbour], moved)
        chosen = int(np.argmin(np.log(left) + price * way))
        angles[i], factors[i] = moved[chosen], choices[chosen]
        U = C_by_choice[chosen]
        covariance = without - U.T @ inner[chosen] @ U
    return _Path(replace(path.poses, angles=angles), factors)


def _inverse(prior_precision: FloatArray, factors: FloatArray) -> FloatArray:
    """(p, p) covariance with factors (n, k, p) measured."""
    rows = factors.reshape(-1, factors.shape[2])
    information = prior_precision + rows.T @ rows
    return np.asarray(cho_solve(cho_factor(information, lower=True), np.eye(len(information)), check_finite=False))


def _without(covariance: FloatArray, prior_precision: FloatArray, factors: FloatArray, i: int) -> FloatArray:
    """(p, p) covariance without reading i."""
    U = factors[i] @ covariance
    remaining = np.eye(len(U)) - U @ factors[i].T
    if np.linalg.eigvalsh(remaining)[0] < _LEAST_LEFT:
        return _inverse(prior_precision, np.delete(factors, i, axis=0))
    return np.asarray(covariance + U.T @ np.linalg.solve(remaining, U))


def _length(arm: Arm, angles: FloatArray) -> float:
    return float(joint_moves(arm, angles[:-1], angles[1:]).sum())
