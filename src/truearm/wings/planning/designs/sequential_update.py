"""The estimate of an arm while it is measured: after each reading, a step of Gauss and Newton from the estimate before.

With P the prior precision of the m parameters x about x_0, J the derivatives of the tips and r the residuals of all
readings at the estimate, and s the noise of a coordinate, a step solves

    A dx = J^T r / s^2 - P (x - x_0),        A = P + J^T J / s^2,

and ``A^-1`` is the covariance. One step from the estimate before is what an extended Kalman filter does; here all
readings are linearised at the newest estimate, so that the first ones, which were far from it, do no harm (iterated
filter: B. M. Bell, F. W. Cathey, IEEE Trans. Automatic Control 38 (1993) 294), and one can be taken back.

Parameters after those of the terms are the base in the frame of the points, and the position of each seat; their priors
are so wide that they say nothing. The noise follows from the residuals of each step, with the prior's noise as one of
`NOISE_WORTH` coordinates (D. J. C. MacKay, Neural Computation 4 (1992) 415, eq. 4.10):

    s^2 = (k s_0^2 + r^T r) / (k + N - m + tr P A^-1).

Readings that the prior knows already place the base and the seats, and say no more of the terms: their derivatives by
the terms are projected onto those by base and seats, which leaves nothing where these are eliminated. An error of the
terms then moves the base as it did when the prior was identified. Where the noise is estimated, they are part of P.

A further reading is added to the sums ``J^T J`` and ``J^T r`` of the others, at the point where these were linearised,
as long as the estimate is near it (`NEAR_STEP`). That takes a time that does not grow with their number: of n readings
each moves the estimate by a share of its uncertainty that falls as one over the root of n.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log, sqrt
from typing import NamedTuple, Self

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_factor, cho_solve

from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.alignment import align
from truearm.identification.terms import ArmState
from truearm.readings import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, NameArray
from truearm.wings.planning.designs.exchange import DesignProblem
from truearm.wings.planning.designs.information import SEAT_STD_MM, tip_jacobian
from truearm.wings.planning.designs.prior import Prior, held_readings

NOISE_WORTH = 10.0
MOST_STEPS = 5
# The last step moves the parameters by less, as a share of their uncertainty, and the noise, as a share of itself.
SETTLED_STEP, SETTLED_NOISE = 0.01, 0.05
# A point of linearisation serves further readings as long as they move the parameters by less, as the same share.
NEAR_STEP = 0.1


class CoordinateSums(NamedTuple):
    """Sums over k coordinates of readings, of their derivatives J (k, m) and residuals r (k,) [mm].

    Attributes
    ----------
    normal : (m, m) array
        ``J^T J``.
    gradient : (m,) array
        ``J^T r``.
    square : float
        ``r^T r``.
    n : int
    """

    normal: FloatArray
    gradient: FloatArray
    square: float
    n: int

    @classmethod
    def of(cls, residuals: FloatArray, J: FloatArray) -> Self:
        """Those of residuals (n, 3) and derivatives (n, 3, m)."""
        rows, r = J.reshape(-1, J.shape[2]), residuals.ravel()
        return cls(rows.T @ rows, rows.T @ r, float(r @ r), len(r))

    def padded(self, m: int) -> Self:
        """With further parameters, on which these residuals do not depend."""
        more = m - len(self.gradient)
        return self._replace(normal=np.pad(self.normal, (0, more)), gradient=np.pad(self.gradient, (0, more)))

    def plus(self, other: CoordinateSums) -> CoordinateSums:
        """With those of other readings."""
        gradient, square = self.gradient + other.gradient, self.square + other.square
        return CoordinateSums(self.normal + other.normal, gradient, square, self.n + other.n)


@dataclass(frozen=True, eq=False)
class LinearisedReadings:
    """Readings at one point of the parameters, and the prior of these.

    Attributes
    ----------
    n_terms : int
        Number of coefficients of the prior, which are the first of the m parameters.
    parameters, mean : (m,) array
        Of the point, and of the prior.
    precision : (m, m) array
        Of the prior.
    old, new : CoordinateSums
        Of the readings that the prior of the terms knows already, and of the others.
    """

    n_terms: int
    parameters: FloatArray
    mean: FloatArray
    precision: FloatArray
    old: CoordinateSums
    new: CoordinateSums

    def step(self, noise_mm: float, prior_noise_mm: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """The step from the point, precision and covariance of the parameters, and the noise that is left [mm]."""
        w, placing = noise_mm**-2, slice(self.n_terms, None)
        B = _by_placing(w * self.old.normal, self.precision, self.n_terms)
        known = self.precision + w * B.T @ self.old.normal[placing, placing] @ B
        A = known + w * self.new.normal
        factor = _factor(A)
        gradient = B.T @ self.old.gradient[placing] + self.new.gradient
        pull = w * gradient - self.precision @ (self.parameters - self.mean)
        C, step = cho_solve(factor, np.eye(len(A))), cho_solve(factor, pull)
        left = max(self.new.square + float(step @ (self.new.normal @ step - 2 * self.new.gradient)), 0.0)
        n_free = max(self.new.n - len(A) + float(np.vdot(known, C)), 0.0)
        return step, A, C, sqrt((NOISE_WORTH * prior_noise_mm**2 + left) / (NOISE_WORTH + n_free))

    def with_reading(self, residual: FloatArray, J: FloatArray, place: FloatArray) -> LinearisedReadings:
        """The same with the residual (1, 3) and the derivatives (1, 3, m) of a reading, perhaps in a new seat.

        The position of that, (3,) or empty, is then the last of the parameters.
        """
        m = J.shape[2]
        return replace(
            self,
            parameters=np.append(self.parameters, place),
            mean=np.pad(self.mean, (0, len(place))),
            precision=_with_wide(self.precision, m),
            old=self.old.padded(m),
            new=self.new.padded(m).plus(CoordinateSums.of(residual, J)),
        )


@dataclass(frozen=True, eq=False)
class Estimate:
    """What readings say of an arm, with its prior.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        The arm in the frame of the points, if there are any, with the motions of its base after the p terms of the
        prior.
    seats : tuple of str
    parameters : (m,) array
        Coefficients of all terms; then x, y and z of each seat [mm].
    precision, covariance : (m, m) array
        Of the parameters, one the inverse of the other.
    noise_mm : float
        Standard deviation of a coordinate of a reading.
    linearisation : LinearisedReadings, optional
        Of the readings; None before there are any.
    """

    perturbed_chain: PerturbedChain
    seats: tuple[str, ...]
    parameters: FloatArray
    precision: FloatArray
    covariance: FloatArray
    noise_mm: float
    linearisation: LinearisedReadings | None = None

    @classmethod
    def before_readings(cls, prior: Prior) -> Estimate:
        """What the prior says; with a free base (`Prior.with_frame`) where points will be measured."""
        return cls(prior.perturbed_chain, (), _mean(prior), prior.precision, prior.covariance, prior.noise_mm)

    def residuals(self, readings: Session, state: ArmState) -> tuple[FloatArray, FloatArray]:
        """Residuals (k, 3) of further readings [mm], and their covariances (k, 3, 3).

        Of those of n readings with a point or in a seat of the estimate: others have none.
        """
        seat, held = held_readings(readings)
        tested = np.flatnonzero(readings.has_point | (held & np.isin(seat, self.seats)))
        if not len(tested):
            return np.empty((0, 3)), np.empty((0, 3, 3))
        readings, state = readings.rows(tested), state.rows(tested)
        r, J = _linearised(self.perturbed_chain, self._coefficients, self.seat_points, readings, state)
        return r, J @ self.covariance @ J.transpose(0, 2, 1) + self.noise_mm**2 * np.eye(3)

    def design(self, state: ArmState, seat: NameArray | None, target: FloatArray) -> DesignProblem:
        """The problem of which poses to measure next.

        Parameters
        ----------
        state : ArmState
            At n poses.
        seat : (n,) array of str, optional
            The seat that each is in, empty where nothing says where the tip is; None: points are measured.
        target : (p, p) array
            As of `DesignProblem`, by the p coefficients of the prior.
        """
        _, J = tip_jacobian(self.perturbed_chain, state, self._coefficients)
        names = self.seats
        if seat is not None:
            J[seat == ""] = 0.0
            names = tuple(dict.fromkeys([*names, *seat[seat != ""].tolist()]))
        J = _with_seats(J, np.full(len(state), "") if seat is None else seat, names)
        of_all = np.zeros((J.shape[2], J.shape[2]))
        of_all[: len(target), : len(target)] = target
        return DesignProblem(J / self.noise_mm, _with_wide(self.precision, J.shape[2]), of_all)

    def variance(self, target: FloatArray) -> float:
        """``trace(M C)`` with the target M (p, p) by the p coefficients of the prior [mm^2]."""
        p = len(target)
        return float(np.vdot(target, self.covariance[:p, :p]))

    @property
    def _coefficients(self) -> FloatArray:
        return self.parameters[: self.perturbed_chain.n_coefficients]

    @property
    def seat_points(self) -> dict[str, FloatArray]:
        """Position (3,) of each seat, in the frame of the perturbed chain [mm]."""
        places = self.parameters[self.perturbed_chain.n_coefficients :].reshape(-1, 3)
        return dict(zip(self.seats, places, strict=True))


@one_blas_thread()
def updated_estimate(
    prior: Prior, readings: Session, state: ArmState, before: Estimate, *, n_in_prior: int = 0
) -> Estimate:
    """The estimate from the readings with a point, and those in a seat.

    Parameters
    ----------
    prior : Prior
        Of the arm, without a frame.
    readings : Session
        All of them, of one set-up; some with a point or in a seat.
    state : ArmState
        At the readings.
    before : Estimate
        From some of them, or none: where the steps start.
    n_in_prior : int
        Number of readings, from the first, that the prior of the terms knows already: these place the base and the
        seats, and say no more of the terms.

    Raises
    ------
    InputError
        If the readings are so far from any arm that its matrices lose their definiteness to rounding.
    """
    seat, held = held_readings(readings)
    used = np.flatnonzero(readings.has_point | held)
    n_in_prior = int((used < n_in_prior).sum())
    readings, state, seat, held = readings.rows(used), state.rows(used), seat[used], held[used]
    names = tuple(dict.fromkeys(seat[held].tolist()))
    n_terms = prior.perturbed_chain.n_coefficients
    terms, noise_mm = before.parameters[:n_terms], before.noise_mm
    for _ in range(MOST_STEPS):
        placed = _placed(prior, terms, readings, state)
        n = placed.perturbed_chain.n_coefficients
        coefficients = np.pad(terms, (0, n - n_terms))
        tips = placed.perturbed_chain.tips(state, coefficients)
        places = {name: tips[held & (seat == name)].mean(axis=0) for name in names}
        x = np.concatenate([coefficients, *places.values()])
        P, mean = _with_wide(placed.precision, len(x)), np.pad(_mean(prior), (0, len(x) - n_terms))
        r, J = _linearised(placed.perturbed_chain, coefficients, places, readings, state)
        old, new = (
            CoordinateSums.of(r[:n_in_prior], J[:n_in_prior]),
            CoordinateSums.of(r[n_in_prior:], J[n_in_prior:]),
        )
        at = LinearisedReadings(n_terms, x, mean, P, old, new)
        was_mm, (step, A, C, noise_mm) = noise_mm, at.step(noise_mm, prior.noise_mm)
        x, terms = x + step, x[:n_terms] + step[:n_terms]
        if step @ A @ step < SETTLED_STEP**2 * len(x) and abs(log(noise_mm / was_mm)) < SETTLED_NOISE:
            break
    return Estimate(placed.perturbed_chain, names, x, A, C, noise_mm, at)


@one_blas_thread()
def with_reading(prior: Prior, reading: Session, state: ArmState, before: Estimate) -> Estimate | None:
    """The estimate with one more reading, by the sums of the others; None where these must be linearised again.

    Parameters
    ----------
    prior, before
        As of `updated_estimate`.
    reading : Session
        One reading that the prior does not know.
    state : ArmState
        At it.
    """
    (seat,), (held,) = held_readings(reading)
    if not (held or reading.has_point.any()):
        return before
    chain, at, names = before.perturbed_chain, before.linearisation, before.seats
    n = chain.n_coefficients
    has_frame = n > prior.perturbed_chain.n_coefficients
    if at is None or not (held or has_frame):
        return None
    place = np.empty(0)
    if held and seat not in names:
        names, place = (*names, str(seat)), chain.tips(state, at.parameters[:n])[0]
    x = np.append(at.parameters, place)
    r, J = _linearised(chain, x[:n], dict(zip(names, x[n:].reshape(-1, 3), strict=True)), reading, state)
    at = at.with_reading(r, J, place)
    *_, with_it_mm = at.step(before.noise_mm, prior.noise_mm)
    step, A, C, noise_mm = at.step(with_it_mm, prior.noise_mm)
    is_near = step @ A @ step < NEAR_STEP**2 * len(x) and abs(log(noise_mm / with_it_mm)) < SETTLED_NOISE
    return Estimate(chain, names, x + step, A, C, noise_mm, at) if is_near else None


def _mean(prior: Prior) -> FloatArray:
    return np.zeros(prior.perturbed_chain.n_coefficients) if prior.mean is None else prior.mean


def _placed(prior: Prior, terms: FloatArray, readings: Session, state: ArmState) -> Prior:
    """The prior with a free base, which stands where it fits the points best; without points as it is."""
    seen = readings.has_point
    if readings.points is None or not seen.any():
        return prior
    T = align(prior.perturbed_chain.tips(state.rows(seen), terms), readings.points[seen])
    framed = prior.with_frame()
    return replace(framed, perturbed_chain=framed.perturbed_chain.in_frame(T))


def _by_placing(normal: FloatArray, precision: FloatArray, n_terms: int) -> FloatArray:
    """What takes derivatives by base and seats to derivatives by all, those by the terms projected onto them.

    Of readings of the normal matrix (m, m): (m - n_terms, m).
    """
    placing, terms = slice(n_terms, None), slice(n_terms)
    factor = _factor(normal[placing, placing] + precision[placing, placing])
    return np.hstack([cho_solve(factor, normal[placing, terms]), np.eye(len(normal) - n_terms)])


def _linearised(
    perturbed_chain: PerturbedChain,
    coefficients: FloatArray,
    places: Mapping[str, FloatArray],
    readings: Session,
    state: ArmState,
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, 3) and derivatives (n, 3, m) of readings with points, or in seats at `places` (3,)."""
    seat, held = held_readings(readings)
    tips, J = tip_jacobian(perturbed_chain, state, coefficients)
    measured = np.array(readings.points) if readings.points is not None else np.empty_like(tips)
    for row in np.flatnonzero(held):
        measured[row] = places[seat[row]]
    return measured - tips, _with_seats(J, np.where(held, seat, ""), tuple(places))


def _with_seats(J: FloatArray, seat: NameArray, names: tuple[str, ...]) -> FloatArray:
    """Derivatives (n, 3, m) of the tips from their seats, where they are in one, by the seats' positions too."""
    out = np.concatenate([J, np.zeros((*J.shape[:2], 3 * len(names)))], axis=2)
    for number, name in enumerate(names):
        first = J.shape[2] + 3 * number
        out[seat == name, :, first : first + 3] = -np.eye(3)
    return out


def _with_wide(precision: FloatArray, m: int) -> FloatArray:
    """A precision (m, m) that says nothing of the last parameters, positions of seats."""
    out = np.diag(np.full(m, SEAT_STD_MM**-2.0))
    out[: len(precision), : len(precision)] = precision
    return out


def _factor(information: FloatArray) -> tuple[FloatArray, bool]:
    try:
        factor: tuple[FloatArray, bool] = cho_factor(information, lower=True)
    except LinAlgError:
        raise InputError("the readings leave no estimate", hint="check the unit of their points") from None
    return factor
