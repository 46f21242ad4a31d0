"""The scale that all lengths of an identified arm have in common: whether the reference, not the arm, is that long.

A bar typed 505 mm for 500, points of a tracker times 1.005, a board of larger squares: an arm that is larger by that
share explains the readings without a residual, whatever the reference. What shows it are the arm's other constants:
no workshop makes every length 1 % too long and each right to 0.01 % beside the others.

The lengths that the readings determine are ``s a + e``: a are the nominal ones, s is their common scale and e, of
standard deviation t, what the arm's lengths differ by one by one. With the readings' own information D of them (the
posterior without its prior), in its eigenvectors, the estimates z have the variance ``1/D + t^2``; s is their
generalised least squares estimate, and t maximises the restricted likelihood (D. A. Harville, J. Am. Stat. Assoc. 72
(1977) 320). So u contains what lengths of such an arm scatter by: an arm of plastic may be 3 % too long.

Seats and surfaces without a known length show no scale. With known lengths it hangs on the places of their ends, and
errors of the arm that its constants do not explain are not averaged at one place: each end is as uncertain as the
residuals, so that a length of 50 mm shows little of an arm of a metre.

The scale of one axis of the reference, apart from the others: the depth of a stereo camera, a column with a factor.

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
from math import ceil, floor, log10
from typing import Self

import numpy as np

from truearm.acceptance import contradict
from truearm.arm.arm import Arm
from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.problem import ABSOLUTE
from truearm.identification.estimation.residual_variance import LEAST_FREEDOM
from truearm.identification.judgement.description_check import VERY_STRONG, sagging_angles, without_free
from truearm.identification.references.references import Points, Reference
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.catalogue import LENGTHS
from truearm.identification.terms.links import link_vectors
from truearm.readings.checks import remedy_of_unit
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray, IntArray

# Scatter of the lengths, in multiples of their prior standard deviation, which the evidence has scaled.
SCATTERS = np.concatenate([[0.0], np.geomspace(1e-6, 1e2, 97)])
# A smaller share of the prior's variance is rounding: the readings show nothing of that direction.
LEAST_LEARNED = 1e-3
# Common scale that an arm may have: a UR10 has 0.0010 (u 0.0006), other real arms less, aluminium in 30 degC 0.00023.
LEAST_SCALE = 1e-3
# Known lengths that are more uncertain, as a share, are none: of a tape a metre is known to 0.001.
LOOSE_LENGTH = 3e-3
# It is said from this size and so many standard uncertainties on.
LEAST_SAID, SURE = 2e-4, 3.0
# Of an arm whose zeros are off: it is a kit of few lengths, of which the scatter is known roughly.
SURE_OF_KITS = 5.0


@dataclass(frozen=True)
class LengthScale:
    """By what share all lengths of an arm differ from the drawing alike.

    Attributes
    ----------
    share, u : float
        The share [1], positive where they are longer, and its standard uncertainty, with the scatter of the lengths.
    scatter_mm : float
        Standard deviation of one length about the common scale [mm].
    log_odds : float
        Logarithm of the odds of a common scale against lengths that differ from the drawing one by one.
    """

    share: float
    u: float
    scatter_mm: float
    log_odds: float

    @classmethod
    def of(
        cls, fit: IdentificationResult, freedom: float, widened: float = 1.0, *, reference_variance: float = 0.0
    ) -> Self | None:
        """Estimate the common scale of an identified arm; None where the readings determine no lengths.

        Parameters
        ----------
        fit : IdentificationResult
            With its constants.
        freedom : float
            Its residual freedom: an arm that passes through its readings shows no uncertainty.
        widened : float
            Factor by which the covariance of the readings is too small.
        reference_variance : float
            Of the scale of the reference [1], from `reference_scale_variance`.
        """
        known, nominal = _nominal_lengths(fit)
        if not len(known) or freedom < LEAST_FREEDOM or np.isinf(reference_variance):
            return None
        prior = fit.prior_std[known]
        # In multiples of the prior standard deviation: the mean of them is the unit of the scatter. Of the covariance
        # itself, not of its inverse, whose rounding is that of the lengths known best.
        variances, vectors = np.linalg.eigh(fit.covariance[np.ix_(known, known)] / np.outer(prior, prior))
        learned = 1 - variances
        counts = learned > LEAST_LEARNED
        learned, variances, vectors = learned[counts], variances[counts], vectors[:, counts]
        information = learned / np.maximum(variances, np.finfo(float).eps)
        found = vectors.T @ (fit.coefficients[known] / prior) / learned
        along = vectors.T @ (nominal / prior)
        if not along.any():
            return None
        weights = 1 / (widened / information[:, None] + SCATTERS**2)
        precisions = along**2 @ weights
        shares = (along * found) @ weights / precisions
        precisions = 1 / (1 / precisions + reference_variance)
        one_by_one = 0.5 * (np.log(weights).sum(axis=0) - found**2 @ weights)
        alike = one_by_one + 0.5 * (shares**2 * precisions - np.log(precisions))
        best = int(np.argmax(alike))
        share = float(shares[best])
        # Before the readings a common scale is anywhere up to its size, of either sign; readings that show less of it
        # than that leave the odds as they were.
        u, size = precisions[best] ** -0.5, max(abs(share), LEAST_SCALE)
        occam = min(float(np.log(np.sqrt(2 * np.pi) * u / (2 * size))), 0.0)
        log_odds = float(one_by_one[best] - one_by_one.max() + 0.5 * (share / u) ** 2) + occam
        return cls(share, float(u), float(SCATTERS[best] * prior.mean()), log_odds)

    def is_contradicted(self, arm: Arm) -> bool:
        """Whether an arm cannot have it: it is more than drawings are wrong by, and than lengths scatter by."""
        least = max(LEAST_SCALE, arm.nominal_error_mm / arm.chain.reach)
        return abs(self.share) > least and self.log_odds >= VERY_STRONG

    def findings(self, arm: Arm, sure: float = SURE) -> tuple[Finding, ...]:
        """What a person must know of a scale that an arm may have; nothing if it is none by its uncertainty."""
        is_said = abs(self.share) > max(sure * self.u, LEAST_SAID) and not self.is_contradicted(arm)
        why = "the arm is warm, or" if abs(self.share) <= LEAST_SCALE else "the drawing or"
        said = (
            f"All {self}: {why} the reference (its scale, a stated length) is off. If it is the reference, the "
            "uncertainty lacks it: state u_scale_ppm."
        )
        return (Finding("length scale", said, {"share": self.share, "u": self.u}),) if is_said else ()

    def __str__(self) -> str:
        percent, u = (f"{100 * value:.{_decimals(100 * self.u)}f} %" for value in (abs(self.share), self.u))
        return f"lengths of the arm are {percent} {'longer' if self.share > 0 else 'shorter'} than drawn (u {u})"


def reference_scale_variance(fit: IdentificationResult, references: Sequence[Reference]) -> float:
    """Variance of the scale that references have [1]: zero for points and distances, infinite without known lengths.

    Of lengths and radii that of the longest: its ends are each as uncertain as one residual, and other lengths at the
    same places have the same errors.
    """
    if any(reference.kind in ABSOLUTE for reference in references):
        return 0.0
    variances = []
    for reference, found in zip(references, fit.references, strict=True):
        known = reference.constraints(np.array(list(found.unknowns.values())))
        if known is not None:
            noise = found.noise_std**2 + float(np.mean(found.std**2))
            variances.append(2 * noise / float(known.values[:, 1].max()) ** 2)
    return min(variances, default=float("inf"))


def refuse_wrong_scale(scale: LengthScale, arm: Arm, readings: Measurements, lengths: Lengths | None) -> None:
    """Refuse readings whose reference is too long or too short: by them every length of the arm is.

    Raises
    ------
    InputError
        With what the lengths, or the points, are by the drawing.
    """
    if not scale.is_contradicted(arm):
        return
    size, most = 1 + scale.share, 1.2 * abs(scale.share) * arm.chain.reach
    digit = 10.0 ** floor(log10(most))
    problem = (
        f"by these readings all {scale}, and beside that they differ by {scale.scatter_mm:.2g} mm: no arm is made so: "
        "the reference is off, or they are of another arm"
    )
    drawing = (
        f"or whether the arm is another one; if its drawing is as inaccurate as that, add the line "
        f"nominal_error_mm = {ceil(most / digit) * digit:g} to the arm file, above the first table"
    )
    if lengths is None or readings.has_point.any():
        hint = f"check the scale and the unit of the reference (divided by {size:.4f} it fits the drawing), {drawing}"
        of_unit = remedy_of_unit(readings, arm.chain.tip_in_base(readings.angles))
        readings.contradict(problem, hint=of_unit or hint)
    elif (loose := lengths.u_mm / lengths.length_mm).max() > LOOSE_LENGTH:
        row = int(loose.argmax())
        u_mm = float(lengths.u_mm[row])
        problem = f"u_mm = {u_mm:g} is {100 * loose[row]:.2g} % of the length: it shows no size of the arm"
        hint = f"state u_mm in mm: {u_mm:g} um are {u_mm / 1000:g} mm"
        contradict(lengths.error(problem, row, column="u_mm", hint=hint))
    else:
        stated = float(lengths.length_mm[0])
        hint = f"check the length: {stated:g} mm are {stated / size:.{_decimals(scale.u * stated)}f} mm by the drawing"
        contradict(lengths.error(problem, 0, column="length_mm", hint=f"{hint}; {drawing}"))


def _nominal_lengths(fit: IdentificationResult) -> tuple[IntArray, FloatArray]:
    """Coefficients of the lengths that readings determine, and by what a unit of scale changes each [mm]."""
    chain = fit.perturbed_chain
    vectors = np.zeros((chain.chain.n_places, 3))
    vectors[:-1], vectors[-1] = link_vectors(chain.chain), chain.chain.tip_in_flange
    vectors[-2] = chain.chain.fixed[-1, :3, 3]  # without the tip, which has a place of its own
    of = [(columns[0], term) for term, columns in zip(chain.terms, chain.columns, strict=True) if term.group == LENGTHS]
    nominal = [float(vectors[term.place] @ term.direction[3:]) for _, term in of]
    return np.array([column for column, _ in of], dtype=np.intp), np.array(nominal)


def _decimals(u: float) -> int:
    """Decimals of a value that show two digits of its standard uncertainty: two or three."""
    return min(max(1 - floor(log10(u)), 2), 3)


# Readings that are judged, evenly spaced: what a scale does is seen in a few.
SAMPLE = 500
# Prior standard deviation of the share.
SHARE_STD = 0.01
# Standard deviations of the noise that are tried [mm].
NOISE_MM = np.geomspace(1e-4, 1e3, 141)
# Share of the noise's variance that an axis must explain, unless the logarithm of its odds is as large as that: beside
# a camera of 1 mm, 1 % explains 0.28 at odds of 55. Of right readings it is 14, of a printed arm with zeros unseen 22.
LEAST_EXPLAINED, CERTAIN = 0.5, 40.0
# It is refused from this size on, that of no real reference, and said from a smaller one (`LEAST_SAID`).
LEAST_REFUSED = 1e-3


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
        """Whether it is very strongly likelier than none, and explains most of what constants leave or is certain."""
        explained = 1 - (self.noise_mm / self.noise_without_mm) ** 2
        return self.log_odds >= (VERY_STRONG if explained >= LEAST_EXPLAINED else CERTAIN)

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
