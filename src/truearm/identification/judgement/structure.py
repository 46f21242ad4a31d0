"""What an identified arm leaves: noise, which differs from reading to reading, or structure, which the pose decides.

The residuals r of an arm with its constants identified are described by two variance components,
``r = F f + n`` with ``f ~ N(0, t^2 P)`` and ``n ~ N(0, s^2)``: F are the tip's derivatives by small rotations and
translations at the base and at every joint, each times the cosine and the sine of every joint's angle, of prior
variances P. A wrong sign, order, unit, zero or length moves the tip so; noise does not. Both components are
estimated by the restricted likelihood, of the contrasts that the constants of the arm do not affect (D. A. Harville, J.
Am. Stat. Assoc. 72 (1977) 320), so that nothing which the constants took is counted twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearm.identification.estimation.identification import initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns, linearised
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Harmonics, Term
from truearm.identification.terms.catalogue import ANGLE_STD, LENGTH_STD, relative_size
from truearm.solve.linear_algebra import inverse_root
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Variance of the structure over that of the noise, t^2/s^2 with P of unit size [1/mm^2]; 0 is noise alone.
RATIOS = np.concatenate([[0.0], np.geomspace(1e-8, 1e8, 97)])
# Smaller eigenvalues of normal equations with a unit diagonal are rounding: no readings determine them.
LEAST_EIGENVALUE = 1e-9


class Remaining(NamedTuple):
    """What an arm leaves of the distances from its references.

    Attributes
    ----------
    noise_mm, structure_mm : float
        Root mean square distance of a reading that differs from reading to reading, and that its pose decides [mm].
    log_odds : float
        Logarithm of the ratio of the likelihoods with and without structure.
    """

    noise_mm: float
    structure_mm: float
    log_odds: float

    @property
    def distance_mm(self) -> float:
        """Root mean square distance of both [mm]."""
        return float(np.hypot(self.noise_mm, self.structure_mm))

    def __str__(self) -> str:
        return f"{self.structure_mm:.2g} mm that depend on the pose and {self.noise_mm:.2g} mm of noise"


UNKNOWN = Remaining(float("nan"), float("nan"), float("nan"))


def remaining(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], absorbed: Sequence[Term]
) -> Remaining:
    """Separate what an arm leaves into noise and structure.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Those of the identification.
    absorbed : sequence of Term
        What was identified from these readings, with any that the evidence pruned; other terms of the result are known.
    """
    features = pose_features(fit.chain.n_joints, relative_size(fit.chain))
    left = contrasts(fit, state, references, absorbed, features)
    stds = np.concatenate([term.prior_stds for term in features])
    values, vectors = np.linalg.eigh(stds[:, None] * left.gram * stds)
    counts = values > LEAST_EIGENVALUE * values.max(initial=0.0)
    values, vectors = values[counts], vectors[:, counts]
    squares = (vectors.T @ (stds * left.slope)) ** 2 / values
    rest = max(left.squares - squares.sum(), 0.0)
    largest = slice(max(len(values) - left.freedom, 0), None)  # they ascend
    return _components(values[largest], squares[largest], rest, left.freedom, left.n_readings)


class Contrasts(NamedTuple):
    """Residuals of an arm by features, of the contrasts that its constants do not affect.

    Attributes
    ----------
    gram : (n, n) array
        Normal matrix of the features' coefficients.
    slope : (n,) array
        Gradient of half the sum of squares by them, at zero.
    squares : float
        The sum of squares [mm^2].
    freedom : int
        Number of contrasts.
    n_readings : float
        Sum of the weights of the readings.
    """

    gram: FloatArray
    slope: FloatArray
    squares: float
    freedom: int
    n_readings: float


def contrasts(
    fit: IdentificationResult,
    state: ArmState,
    references: Sequence[Reference],
    absorbed: Sequence[Term],
    features: Sequence[Term],
) -> Contrasts:
    """Residuals of an arm by the coefficients of features; other parameters are those of `remaining`."""
    arm, meant = fit.perturbed_chain, (*absorbed, *features)
    own = dict(zip(arm.terms, arm.columns, strict=True))
    taken_up = set(absorbed)
    known = np.where(fit.columns_of(lambda term: term not in taken_up), fit.coefficients, 0.0)
    chain = _BesideKnown(arm.chain, meant, arm, known) if known.any() else PerturbedChain(arm.chain, meant)
    problem, _ = initial_problem(chain, state, references)
    before = [fit.coefficients[own[term]] if term in own else np.zeros(term.n_coefficients) for term in meant]
    unknowns = [value for one in fit.references for value in one.unknowns.values()]
    x = np.concatenate([*before, unknowns])
    # Excluded readings and gross errors say nothing of the pose.
    weights = [np.sqrt(one.robust_weight) * np.ones_like(one.residuals) for one in fit.references]
    n_absorbed, n_features = (sum(term.n_coefficients for term in some) for some in (absorbed, features))
    with one_blas_thread():
        parts, whole = linearised(problem, x, weights)
        reduced = eliminate_unknowns(parts, whole, x)
        gram, slope, rank, gain = _without(reduced.gram, reduced.gradient, n_absorbed)
        gram, slope = gram[:n_features, :n_features], slope[:n_features]
    # A reading counts by its weight, as residual and as reading.
    n = max(round(sum(float(one.sum()) for one in weights)) - rank - round(reduced.n_determined), 0)
    squares = 2 * whole.cost - reduced.gain - gain
    return Contrasts(gram, slope, squares, n, sum(float(one[0].sum()) for one in weights))


@dataclass(frozen=True, eq=False)
class _BesideKnown(PerturbedChain):
    """Terms beside those of an arm whose coefficients are known: a physical model has more than a thousand.

    No derivatives by them are needed: the values end with their motions.
    """

    arm: PerturbedChain
    known: FloatArray

    def values(self, state: ArmState) -> FloatArray:
        """(n_functions + 6 n_places, m) values of the functions, then the known motions."""
        motions = self.arm.motions(self.known, self.arm.values(state))
        wide = np.broadcast_to(motions, (*motions.shape[:2], len(state)))
        return np.concatenate([super().values(state), wide.reshape(-1, len(state))])

    def motions(self, x: FloatArray, values: FloatArray) -> FloatArray:
        """(n_places, 6, m) motions with coefficients `x` and the known ones."""
        own, known = np.split(values, [len(values) - 6 * self.chain.n_places])
        return super().motions(x, own) + known.reshape(-1, 6, values.shape[1])

    def is_constant(self, x: FloatArray) -> bool:  # noqa: ARG002
        """Whether all motions are the same at every reading: the known ones are not."""
        return False


def pose_features(n_joints: int, size: float) -> list[Term]:
    """Small motions at the base and at every joint, each by the cosine and sine of every joint's angle."""
    found = []
    for place in range(n_joints + 1):
        for component in range(6):
            std = ANGLE_STD if component < 3 else LENGTH_STD * size
            direction = tuple(float(component == one) for one in range(6))
            for joint in range(1, n_joints + 1):
                name = f"motion {component} at {place} by J{joint}"
                found.append(Term(name, place, direction, Harmonics(joint, (1,)), "structure", std))
    return found


def _without(gram: FloatArray, gradient: FloatArray, n: int) -> tuple[FloatArray, FloatArray, int, float]:
    """Normal equations without the first n parameters; their rank, and by how much they decrease twice the cost."""
    inner, across = gram[:n, :n], gram[n:, :n]
    root = inverse_root(inner, LEAST_EIGENVALUE)
    along, absorbed = across @ root, root.T @ gradient[:n]
    kept = gram[n:, n:] - along @ along.T, gradient[n:] - along @ absorbed
    return *kept, root.shape[1], float(absorbed @ absorbed)


def _components(values: FloatArray, squares: FloatArray, rest: float, n: int, n_readings: float) -> Remaining:
    """Variance components by the likelihood of n contrasts: some with eigenvalues, the rest without structure."""
    ratios = RATIOS / max(values.mean(), np.finfo(float).tiny) if len(values) else RATIOS[:1]
    shares = 1 + ratios[:, None] * values
    noise = np.maximum((squares / shares).sum(axis=1) + rest, np.finfo(float).tiny) / max(n, 1)
    log_likelihood = -0.5 * (n * np.log(noise) + np.log(shares).sum(axis=1))
    best = int(np.argmax(log_likelihood))
    structure = ratios[best] * noise[best] * values.sum() / n_readings
    return Remaining(
        float(np.sqrt(noise[best] * n / n_readings)),
        float(np.sqrt(structure)),
        float(log_likelihood[best] - log_likelihood[0]),
    )
