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
from truearm.identification.estimation.problem import ABSOLUTE
from truearm.identification.estimation.residual_variance import LEAST_FREEDOM
from truearm.identification.judgement.description_check import VERY_STRONG
from truearm.identification.references.references import Reference
from truearm.identification.terms.catalogue import LENGTHS
from truearm.identification.terms.links import link_vectors
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
from truearm.typing import FloatArray, IntArray

# Scatter of the lengths, in multiples of their prior standard deviation, which the evidence has scaled.
SCATTERS = np.concatenate([[0.0], np.geomspace(1e-6, 1e2, 97)])
# A smaller share of the prior's variance is rounding: the readings show nothing of that direction.
LEAST_LEARNED = 1e-3
# Common scale that an arm may have: a UR10 has 0.0010 (u 0.0006), other real arms less, aluminium in 30 degC 0.00023.
LEAST_SCALE = 1e-3
# It is said from this size and so many standard uncertainties on.
LEAST_SAID, SURE = 2e-4, 3.0


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

    def findings(self, arm: Arm) -> tuple[Finding, ...]:
        """What a person must know of a scale that an arm may have; nothing if it is none by its uncertainty."""
        is_said = abs(self.share) > max(SURE * self.u, LEAST_SAID) and not self.is_contradicted(arm)
        said = f"All {self}: the arm is warm, or the reference (its scale, a stated length) is off."
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
        readings.contradict(problem, hint=hint)
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
