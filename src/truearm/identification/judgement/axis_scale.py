"""The scale of one axis of the reference, apart from the others: the depth of a stereo camera, a column with a factor.

Small motions of an arm explain such points nearly as well as a good model does, those held out of the same region too,
and the arm is then as wrong along that axis. Its constants alone do not: the residuals r of the nominal arm have the
covariance ``s^2 I + J P J'`` with the prior P of the constants, and of joints that yield under the weight of the arm.
Beside the free base and tip, and the scale of slides (a lead screw, a rail), the points may differ by a share of one
coordinate. The restricted likelihood (D. A.
Harville, Biometrika 61 (1974) 383) of each axis, with the noise s that suits it best, is compared with that of none.
The limits are evidence, `python -m benchmarks imperfect_readings axes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.description_check import VERY_STRONG, sagging_angles, without_free
from truearm.identification.references.references import Points, Reference
from truearm.identification.terms import ArmState, Term
from truearm.readings.readings import Measurements
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Readings that are judged, evenly spaced: what a scale does is seen in a few.
SAMPLE = 500
# Prior standard deviation of the share.
SHARE_STD = 0.01
# Standard deviations of the noise that are tried [mm].
NOISE_MM = np.geomspace(1e-4, 1e3, 141)
# Share of the noise's variance that an axis must explain.
LEAST_EXPLAINED = 0.5
# It is refused from this size on, that of no real reference, and said from a smaller one.
LEAST_REFUSED, LEAST_SAID = 1e-3, 2e-4


@dataclass(frozen=True)
class AxisScale:
    """By what share the points of a reference are longer along one axis than along the others, by the arm.

    Attributes
    ----------
    axis : str
        ``"x"``, ``"y"`` or ``"z"`` of the reference.
    share, u : float
        The share [1], positive where they are longer, and its standard uncertainty.
    noise_mm, noise_without_mm : float
        Standard deviation of a coordinate that the arm's constants and weight leave, with that share and without [mm].
    log_odds : float
        Logarithm of the odds of this share against none.
    """

    axis: str
    share: float
    u: float
    noise_mm: float
    noise_without_mm: float
    log_odds: float

    @property
    def is_clear(self) -> bool:
        """Whether it is very strongly likelier than none, and explains most of what constants leave."""
        explained = 1 - (self.noise_mm / self.noise_without_mm) ** 2
        return self.log_odds >= VERY_STRONG and explained >= LEAST_EXPLAINED

    def findings(self) -> tuple[Finding, ...]:
        """What a person must know of a scale that a reference may have."""
        is_said = self.is_clear and LEAST_SAID < abs(self.share) <= LEAST_REFUSED
        numbers = {"share": self.share, "u": self.u}
        return (Finding("axis scale", f"By these readings {self}: check its scale.", numbers),) if is_said else ()

    def __str__(self) -> str:
        longer = "longer" if self.share > 0 else "shorter"
        return (
            f"the points are {100 * abs(self.share):.2f} % {longer} along {self.axis} than along the other axes "
            f"(u {100 * self.u:.1g} %; with that {self.noise_mm:.2g} mm of a coordinate remain, without "
            f"{self.noise_without_mm:.2g} mm)"
        )


def refuse_axis(scale: AxisScale | None, readings: Measurements) -> None:
    """Refuse readings of which one axis has a scale of its own.

    Raises
    ------
    InputError
        With the scale by the arm.
    """
    if scale is not None and scale.is_clear and abs(scale.share) > LEAST_REFUSED:
        readings.contradict(
            f"by these readings {scale}: no arm makes them so",
            column=f"{scale.axis}_mm",
            hint=f"check the scale of that axis, which divided by {1 + scale.share:.4f} fits the arm: the depth of a "
            "stereo camera, a unit or a factor of that column alone",
        )


@one_blas_thread()
def axis_scale(
    nominal: IdentificationResult, state: ArmState, references: Sequence[Reference], constants: Sequence[Term]
) -> AxisScale | None:
    """The likeliest scale of one axis; None without points. Solved poses have common errors of their own.

    Parameters
    ----------
    nominal : IdentificationResult
        The nominal arm with its free parts identified from the references.
    state : ArmState
        Of the readings.
    references : sequence of Reference
    constants : sequence of Term
        The constants of the nominal arm, with their prior standard deviations.
    """
    for points, found in zip(references, nominal.references, strict=True):
        kept = np.flatnonzero(found.robust_weight > 0)
        if isinstance(points, Points) and len(kept):
            kept = kept[np.unique(np.linspace(0, len(kept) - 1, SAMPLE).astype(np.intp))]
            rows = found.rows[kept]
            parts = _derivatives(nominal, state.rows(rows), constants)
            return likeliest_axis(-found.residuals[:, kept].T, points.points[kept], *parts)
    return None


def _derivatives(
    nominal: IdentificationResult, state: ArmState, constants: Sequence[Term]
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, 3, k) of tips by what is free, and by what is uncertain, in prior standard deviations [mm]."""
    free = nominal.perturbed_chain.terms
    names = {term.name for term in free}
    others = [term for term in constants if term.name not in names]
    chain = PerturbedChain(nominal.chain, (*free, *others))
    by = np.concatenate([by for _, _, by in chain.derivatives(state, np.zeros(chain.n_coefficients))], axis=2)
    n_free = sum(term.n_coefficients for term in free)
    std = np.concatenate([term.prior_stds for term in others])
    by_joint = nominal.chain.tip_derivatives(state.angles).motion_jacobian[:, 1:-1].transpose(0, 2, 3, 1)
    by_weight = by_joint[:, 2] * sagging_angles(state.chain, state.angles, state.gravity_in_base)[:, None]
    slides = state.chain.is_prismatic
    travel = state.joint_angles - state.joint_angles.mean(axis=0)
    by_slide = (by_joint[:, 5] * travel[:, None])[..., slides]
    free_parts = np.concatenate([by[:n_free].transpose(2, 1, 0), by_slide], axis=2)
    return free_parts, np.concatenate([(by[n_free:] * std[:, None, None]).transpose(2, 1, 0), by_weight], axis=2)


def likeliest_axis(
    residuals: FloatArray, points: FloatArray, by_free: FloatArray, by_uncertain: FloatArray
) -> AxisScale | None:
    """The likeliest scale of one axis by residuals (n, 3) of points (n, 3) [mm]; None of too few.

    Parameters
    ----------
    residuals, points : (n, 3) array
        Points less tips, and points [mm].
    by_free : (n, 3, p) array
        Derivatives of the tips by what is free.
    by_uncertain : (n, 3, k) array
        Derivatives by what is uncertain, times prior standard deviations [mm].
    """
    rows = residuals.size
    along = np.zeros((*points.shape, 3))
    tips = points - residuals  # those of a right scale
    along[:, range(3), range(3)] = tips - tips.mean(axis=0)
    data = np.column_stack([residuals.reshape(rows), along.reshape(rows, 3)])
    n, data, uncertain = without_free(by_free.reshape(rows, -1), data, by_uncertain.reshape(rows, -1))
    U, s, _ = np.linalg.svd(uncertain, full_matrices=False)
    if n <= len(s):
        return None
    # Products of the residuals and the axes (4, 4) by the inverse covariance, for each noise.
    noise, inside = NOISE_MM**2, U.T @ data
    rest = data.T @ data - inside.T @ inside
    variances = noise[:, None] + s**2
    products = np.einsum("ka,sk,kb->sab", inside, 1 / variances, inside) + rest / noise[:, None, None]
    without = -0.5 * (np.log(variances).sum(axis=1) + (n - len(s)) * np.log(noise) + products[:, 0, 0])
    known = products[:, range(1, 4), range(1, 4)] + SHARE_STD**-2
    shares = products[:, 0, 1:] / known
    with_axis = without[:, None] + 0.5 * (shares**2 * known - np.log(known * SHARE_STD**2))
    best, axis = np.unravel_index(np.argmax(with_axis), with_axis.shape)
    return AxisScale(
        "xyz"[axis],
        float(shares[best, axis]),
        float(known[best, axis] ** -0.5),
        float(NOISE_MM[best]),
        float(NOISE_MM[np.argmax(without)]),
        float(with_axis[best, axis] - without.max()),
    )
