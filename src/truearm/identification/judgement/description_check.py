"""Which mistake in the description of an arm, or of its readings, explains what the readings say.

Every interpretation (`truearm.arm.description_mistakes`) is a hypothesis. Base and tip are free in all of them, and the
constants of the arm may err as their prior says, so that the residuals r of an interpretation have the covariance
``s^2 I + J P J'``. Hypotheses are compared by the restricted likelihood of that, of the contrasts that base and tip do
not affect (D. A. Harville, "Bayesian inference for variance components using only error contrasts", Biometrika 61
(1974) 383), each with the noise s that suits it best, and by a prior: every mistake of the list is as likely as any
other, so that each change that is assumed costs the logarithm of their number. Two hypotheses differ where the
odds are very strong by R. E. Kass and A. E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90 (1995) 773: twice their
logarithm is 10 or more. A mistake is named if it also explains most of the squared distance of readings held out (leave
one out, by the leverage of base and tip), and better than joints that yield under the weight of the arm, which is no
mistake and is tried beside them. A refusal of readings that contradict the nominal arm names the mistake
(`explaining`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.description_mistakes import OTHER_ARM, Interpretation, Mistake, likely_mistakes, other_arms
from truearm.arm.nearest_table import nearest_table
from truearm.arm.rigid_motions import cross_matrix
from truearm.errors import InputError
from truearm.identification.judgement.description_fits import DescriptionFits, fit_descriptions, length_rows
from truearm.identification.references.reference_table import ReferenceTable, reference_table
from truearm.identification.terms.catalogue import ANGLE_STD, LENGTH_STD, TYPICAL_REACH_MM, relative_size
from truearm.identification.terms.links import STANDARD_GRAVITY_IN_BASE, gravity_torques, uniform_links
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Logarithm of the odds from which one hypothesis is better than another.
VERY_STRONG = 5.0
# The error of an interpretation is the one that three of four readings do not exceed.
QUANTILE = 0.75
# Multiple of the usual error of an arm up to which an interpretation is plausible (see `nominal_check.MAX_RATIO`).
MAX_RATIO = 2.0
# Interpretations whose likelihood is computed, those with the least residuals.
MOST_JUDGED = 24
# Readings by which all pairs of mistakes are screened, and pairs that are then fitted to all.
SCREENING_READINGS, MOST_PAIRS = 20, 60
# Standard deviations of the noise that are tried [mm]; no arm repeats better than the least.
NOISE_MM = np.geomspace(1e-3, 1e4, 71)
# Arms reach about a metre, most of them within this factor: whether the arm or the points have the wrong unit.
REACH_FACTOR = 3.0
# Distance within which the tip is where it is stated, on an arm of usual size [mm]; some do not state it at all.
TIP_MM = 30.0
# Prior standard deviations of the constants of an arm that is unlike its drawing, as multiples of the usual ones: of
# directions of axes and lengths, and of zeros (1.7 and 10 degrees). The readings choose.
WIDE_OTHERS, WIDE_ZEROS = (1.0, 5.0), (10.0, 58.0)
# Multiple of what the arm leaves with its constants identified that a mistake may leave where noise is large.
MAX_TO_IDENTIFIED = 1.5
# Share of the reach that noise may have. The poorest camera has 0.06 (10 mm a coordinate on an arm of 300 mm); points
# of other poses, in the order of other readings, have 0.2 or more if they are spread over the workspace.
MAX_NOISE = 0.1
# Share of the squared distance that a mistake explains which leaves more than that: a reversed sign beside zeros that
# are off by 10 degrees 0.93 or more; of points at random what draws all tips together, as of a joint that stands still
# in another unit, explains up to 0.85.
LEAST_BESIDE_OTHERS = 0.9
# Share of the squared distance of readings held out that a mistake explains at least.
LEAST_EXPLAINED = 0.5
# The same where it is another arm, of which nothing but the name need be wrong: it misses by less than half. Odds say
# little of two arms that both miss by no more than arms do.
LEAST_OF_OTHER_ARM = 0.75
# What is no mistake: the prior standard deviation of the angle by which the joint with the largest torque yields, root
# mean square over the readings [rad]. Robots have up to 3e-3, printed arms more.
SAGGING, SAG_STD = "joints yield under the weight of the arm", 5e-3
# Joints that move by less show neither their sign nor their unit nor what they contain [rad, or mm].
LEAST_TURN, LEAST_TRAVEL = np.radians(1.0), 1.0
# Mistakes that a hint names.
MOST_NAMED = 3


@dataclass(frozen=True)
class Explanation:
    """An interpretation of the arm file and the readings, and how well it explains them.

    Attributes
    ----------
    mistakes : tuple of str
        What would be wrong; empty for the arm and the readings as stated.
    error_mm : float
        Distance from the references that three of four readings do not exceed, with base and tip fitted [mm].
    usual_mm : float
        Root mean square distance that errors of the constants usually cause [mm].
    log_odds : float
        Logarithm of the odds against the arm and the readings as stated.
    explained : float
        Share of the squared distances as stated, of readings held out, that it explains.
    """

    mistakes: tuple[str, ...]
    error_mm: float
    usual_mm: float
    log_odds: float
    explained: float = 0.0

    @property
    def is_plausible(self) -> bool:
        """Whether the arm would miss by no more than arms do."""
        return self.error_mm <= MAX_RATIO * self.usual_mm

    @property
    def is_usual(self) -> bool:
        """Whether the arm misses by no more than errors of its constants usually cause."""
        return self.error_mm <= self.usual_mm

    @property
    def is_clear(self) -> bool:
        """Whether it is very strongly likelier than the arm as stated, and explains most of its error."""
        return self.log_odds >= VERY_STRONG and self.explained >= LEAST_EXPLAINED

    def __str__(self) -> str:
        return " and ".join(self.mistakes) or "as stated"


@dataclass(frozen=True)
class DescriptionCheck:
    """What explains the readings of an arm.

    Attributes
    ----------
    stated : Explanation
        The arm and the readings as stated.
    findings : tuple of Explanation
        Mistakes that explain the readings and that these readings do not tell apart, the likeliest first; empty if
        nothing explains them clearly better than the arm as stated.
    others : tuple of Explanation
        The next likely interpretations, which do not explain them as well.
    n_readings, n_tried : int
        Readings compared, and interpretations tried.
    has_points : bool
        Whether points are compared; else seats.
    sagging : Explanation or None
        That joints yield under the weight of the arm, where that explains the readings and no mistake does.
    """

    stated: Explanation
    findings: tuple[Explanation, ...]
    others: tuple[Explanation, ...]
    n_readings: int
    n_tried: int
    has_points: bool
    sagging: Explanation | None = None

    def remedy(self, file: Path | None) -> str | None:
        """The mistakes that explain the readings, as a remedy; None if there are none."""
        if not self.findings:
            return None
        found = ", or ".join(str(one) for one in self.findings[:MOST_NAMED])
        return (
            f"put this right: {found} ({self.findings[0].error_mm:.2g} mm remain; `truearm arms` with your arm "
            f"file and --session {file or 'session.csv'} says more, and "
            "`truearm docs describe-your-arm` where each is put right)"
        )


class _Hypothesis(NamedTuple):
    """An interpretation; with `wide` its constants were identified, and are those of an arm unlike its drawing.

    With `sags` its joints yield under the weight of the arm.
    """

    mistakes: tuple[Mistake, ...]
    interpretation: Interpretation
    wide: bool = False
    sags: bool = False


@one_blas_thread()
def check_description(arm: Arm, table: ReferenceTable, identified: Chain | None = None) -> DescriptionCheck:
    """Find what a person got wrong: one mistake, or two if no single one explains the readings.

    Parameters
    ----------
    arm : Arm
    table : ReferenceTable
        What the readings refer to.
    identified : Chain, optional
        With the constants that explain the readings best. A mistake must then be a better explanation than an arm that
        is described rightly and differs from its drawing by these constants: joint zeros that are off by degrees.
    """
    least, stated = np.where(arm.chain.is_prismatic, LEAST_TRAVEL, LEAST_TURN), Interpretation.stated(arm)

    def moves(joint: int, one: Interpretation) -> bool:
        return bool(np.ptp(one.angles(table.angles)[:, joint]) >= least[joint])

    nearest = _nearest_arm(arm, table)
    mistakes = [
        one
        for one in likely_mistakes(
            arm,
            has_points=table.has_points,
            has_lengths=bool(len(table.lengths)),
            base_is_known="base" not in table.free,
        )
        if (one.subject != "rows" or len(table.points or table.seats) > 1)
        and (one.subject != OTHER_ARM or (nearest is not None and one.description == nearest.description))
        # In a wrong unit a joint may only look still.
        and (one.shown_by is None or any(moves(one.shown_by, each) for each in (stated, one.mend(stated))))
    ]
    as_stated = _Hypothesis((), stated)
    single = [_Hypothesis((one,), one.mend(stated)) for one in mistakes]
    judged = _judged([as_stated, *single], table, len(mistakes))
    rivals: list[Explanation] = []
    if not judged[0].is_usual:
        rivals += _judged([as_stated, as_stated._replace(sags=True)], table, len(mistakes))[1:]
        if identified is not None:
            rivals += _as_identified(arm, stated, identified, table, len(mistakes))
    most_noise_mm = MAX_NOISE * arm.chain.reach
    check = _decided(judged, table, 1 + len(single), rivals, most_noise_mm)
    if check.findings or check.stated.is_plausible:
        return check
    pairs = _screened_pairs(mistakes, stated, table)
    judged += [one for one in _judged([as_stated, *pairs], table, len(mistakes)) if one.mistakes]
    return _decided(judged, table, 1 + len(single) + len(pairs), rivals, most_noise_mm)


@one_blas_thread()
def likelier_arm(arm: Arm, table: ReferenceTable) -> Explanation | None:
    """An arm of the catalogue with a similar name, which explains readings far better than the one that is stated.

    Arms that are nearly alike miss each other's readings by no more than their constants may err.
    """
    stated, nearest = Interpretation.stated(arm), _nearest_arm(arm, table)
    if nearest is None:
        return None
    other = _judged([_Hypothesis((), stated), _Hypothesis((nearest,), nearest.mend(stated))], table, 2)[1]
    return other if other.explained >= LEAST_OF_OTHER_ARM else None


def _nearest_arm(arm: Arm, table: ReferenceTable) -> Mistake | None:
    """Of the arms with similar names the one that leaves the least residuals."""
    others = other_arms(arm)
    if not others:
        return None
    interpretations = [one.mend(Interpretation.stated(arm)) for one in others]
    return others[int(fit_descriptions(table, interpretations).scores(table, interpretations).argmin())]


def _as_identified(
    arm: Arm, stated: Interpretation, chain: Chain, table: ReferenceTable, n_mistakes: int
) -> list[Explanation]:
    """The arm as stated with its identified constants; none if its axes are not those of the drawing."""
    try:
        nearest = nearest_table(chain, arm.chain, convention=stated.table.convention, free=table.free)
    except InputError:
        return []
    wide = _Hypothesis((), replace(stated, table=nearest), wide=True)
    return _judged([_Hypothesis((), stated), wide], table, n_mistakes)[1:]


def _screened_pairs(mistakes: Sequence[Mistake], stated: Interpretation, table: ReferenceTable) -> list[_Hypothesis]:
    """The pairs of mistakes that leave the least residuals at some of the readings."""
    pairs = [
        _Hypothesis((one, two), two.mend(one.mend(stated)))
        for one, two in combinations(mistakes, 2)
        if one.subject != two.subject
    ]
    few = table.of_readings(SCREENING_READINGS)
    interpretations = [pair.interpretation for pair in pairs]
    scores = fit_descriptions(few, interpretations).scores(few, interpretations)
    return [pairs[i] for i in np.argsort(scores, kind="stable")[:MOST_PAIRS].tolist()]


def _judged(hypotheses: Sequence[_Hypothesis], table: ReferenceTable, n_mistakes: int) -> list[Explanation]:
    """Explanations by the first hypothesis, which is the arm as stated, and by the best of the others."""
    interpretations = [one.interpretation for one in hypotheses]
    fits = fit_descriptions(table, interpretations)
    scores = fits.scores(table, interpretations)
    order = [0, *(1 + np.argsort(scores[1:], kind="stable"))[:MOST_JUDGED].tolist()]
    found = []
    for i in order:
        one = hypotheses[i]
        off = constants_between(interpretations[0], interpretations[i]) if one.wide else None
        log_likelihood, usual, left = _likelihood(table, fits, i, one, off)
        log_prior = -(len(one.mistakes) + one.wide + one.sags) * np.log(n_mistakes)
        error = float(np.quantile(np.linalg.norm(fits.residuals[i], axis=1), QUANTILE))
        names = (SAGGING,) if one.sags else tuple(mistake.description for mistake in one.mistakes)
        found.append(Explanation(names, error, usual, log_likelihood + log_prior, left))
    stated = found[0]
    for k, one in enumerate(found):
        share = one.explained / max(stated.explained, np.finfo(float).tiny)
        one = replace(one, log_odds=one.log_odds - stated.log_odds, explained=1 - share)
        if one.mistakes == (SAGGING,):  # the fits of base and tip, and errors of constants, have no weight in them
            one = replace(one, error_mm=one.error_mm * float(np.sqrt(share)), usual_mm=stated.usual_mm)
        found[k] = one
    return found


def _decided(
    judged: Sequence[Explanation],
    table: ReferenceTable,
    n_tried: int,
    rivals: Sequence[Explanation],
    most_noise_mm: float,
) -> DescriptionCheck:
    stated, others = judged[0], sorted(judged[1:], key=lambda one: -one.log_odds)
    findings: list[Explanation] = []
    if others and not stated.is_usual and _explains(others[0], rivals, most_noise_mm):
        likely = [one for one in others if one.log_odds > others[0].log_odds - VERY_STRONG]
        findings = [one for one in likely if one.explained >= LEAST_EXPLAINED]
    rest = [one for one in others if one not in findings]
    sagging = [one for one in rivals if one.mistakes == (SAGGING,) and one.is_clear and not findings]
    return DescriptionCheck(
        stated, tuple(findings), tuple(rest), len(table.angles), n_tried, table.has_points, next(iter(sagging), None)
    )


def _explains(best: Explanation, rivals: Sequence[Explanation], most_noise_mm: float) -> bool:
    """Whether a mistake is very strongly the better explanation, also than constants that were identified or weight."""
    if not best.is_clear or best.log_odds - max((one.log_odds for one in rivals), default=0.0) < VERY_STRONG:
        return False
    identified = [one for one in rivals if not one.mistakes]
    may_leave_that = best.error_mm <= most_noise_mm or best.explained >= LEAST_BESIDE_OTHERS
    return best.is_plausible or (
        may_leave_that and any(best.error_mm <= MAX_TO_IDENTIFIED * one.error_mm for one in identified)
    )


def constants_between(stated: Interpretation, identified: Interpretation) -> FloatArray:
    """(6 n_joints,) small motions [rad, mm] by which the fixed motions after the joints of two tables differ."""
    motions = identified.table.chain().fixed[1:] @ np.linalg.inv(stated.table.chain().fixed[1:])
    turns = Rotation.from_matrix(motions[:, :3, :3]).as_rotvec()
    return np.concatenate([turns, motions[:, :3, 3]], axis=1).ravel()


def _likelihood(
    table: ReferenceTable, fits: DescriptionFits, i: int, hypothesis: _Hypothesis, off: FloatArray | None = None
) -> tuple[float, float, float]:
    """Logarithm of the restricted likelihood of a hypothesis, the usual error of such an arm [mm], and what it leaves.

    What it leaves is the mean square distance of readings held out, in the stated unit or relative to the movement.
    With the constants `off` (6 n_joints,) by which the table differs from the drawing, the likelihood is that of the
    drawing with wide priors, linearised at the table (the approximation of Laplace).
    """
    one = hypothesis.interpretation
    stated = one.table.chain()
    chain = stated.with_tip(fits.tip_in_flange[i])
    jacobian = chain.tip_derivatives(one.angles(table.angles)).motion_jacobian
    kept = fits.kept[i]
    m, n = len(jacobian), one.table.prismatic.size
    length_std = LENGTH_STD * relative_size(stated)
    std = np.tile(np.repeat([ANGLE_STD, length_std], 3), n)
    by_constant = jacobian[:, 1:-1].reshape(m, 6 * n, 3).transpose(0, 2, 1) * std
    n_sagging = n if hypothesis.sags else 0
    if n_sagging:
        by_weight = jacobian[:, 1:-1, 2].transpose(0, 2, 1) * sagging_angles(stated, one.angles(table.angles))[:, None]
        by_constant = np.concatenate([by_constant, by_weight], axis=2)
    by_tip = jacobian[:, -1, 3:].transpose(0, 2, 1)
    free = [by_tip] if "tip" in table.free else []
    residuals = fits.residuals[i]
    if table.has_points:
        if "base" in table.free:
            free += [-cross_matrix(fits.points_in_base[i]), np.broadcast_to(np.eye(3), (m, 3, 3))]
        parts = (residuals, np.concatenate([np.zeros((m, 3, 0)), *free], axis=2), by_constant)
        r, X, K = (part[kept].reshape(3 * kept.sum(), -1) for part in parts)
        n_absorbed, scale = 0, one.point_factor
    else:
        r, X, K, n_absorbed = _in_seats(table, fits, i, one, by_constant, by_tip)
        scale = float(fits.movement[i])
    at_drawing, widths = r[:, 0], [np.ones(6 * n + n_sagging)]
    if off is not None:
        at_drawing = at_drawing - K @ (off / std)
        widths = [np.tile([w, w, zero, w, w, w], n) for w, zero in product(WIDE_OTHERS, WIDE_ZEROS)]
    log_likelihood, usual = max(
        restricted_likelihood(at_drawing, X, K * width, n_absorbed=n_absorbed, scale=scale) for width in widths
    )
    fitted = np.concatenate([X, K[:, 6 * n :]], axis=1)
    left = _left_held_out(r[:, 0], fitted, int(kept.sum())) / scale**2
    return log_likelihood + _log_prior_of_size(stated, chain), usual * float(np.sqrt(3)), left


def sagging_angles(
    chain: Chain, angles: FloatArray, gravity_in_base: npt.ArrayLike = STANDARD_GRAVITY_IN_BASE
) -> FloatArray:
    """(m, n_joints) angles by which joints of one compliance yield under uniform links [rad].

    The joint that yields most has the root mean square `SAG_STD`.
    """
    links = uniform_links(chain, kg_per_m=1.0)
    torque = gravity_torques(chain, angles, links, gravity_in_base=gravity_in_base)[:, :, 2]
    torque = np.where(chain.is_prismatic, 0.0, torque)
    return np.asarray(SAG_STD * torque / max(float(np.sqrt((torque**2).mean(axis=0).max())), np.finfo(float).tiny))


def _left_held_out(residuals: FloatArray, derivatives: FloatArray, m: int) -> float:
    """Mean square distance of m readings, the first 3 m residuals (n,), each held out of a linear fit [mm^2]."""
    U, s, _ = np.linalg.svd(derivatives, full_matrices=False)
    U = U[:, s > 1e-9 * s.max(initial=0.0)]
    own = U[: 3 * m].reshape(m, 3, U.shape[1])
    left = (residuals - U @ (U.T @ residuals))[: 3 * m].reshape(m, 3, 1)
    others = (1 + 1e-9) * np.eye(3) - own @ own.transpose(0, 2, 1)  # singular where only it tells a direction
    return float((np.linalg.solve(others, left) ** 2).sum() / m)


def _log_prior_of_size(stated: Chain, fitted: Chain) -> float:
    """Logarithm of the prior of an arm's reach, log-normal, and of the tip about the stated one, a Cauchy density."""
    reach = np.log(max(stated.reach, 1e-9) / TYPICAL_REACH_MM) / np.log(REACH_FACTOR)
    off = np.linalg.norm(fitted.tip_in_flange - stated.tip_in_flange) / (TIP_MM * relative_size(stated))
    return float(-0.5 * reach**2 - 2 * np.log1p(off**2))


def _in_seats(
    table: ReferenceTable,
    fits: DescriptionFits,
    i: int,
    one: Interpretation,
    by_constant: FloatArray,
    by_tip: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Residuals of kept readings from the means of their seats and of lengths, with their derivatives.

    The last is the number of coordinates of seats, which the means absorb.
    """
    kept = fits.kept[i]
    seat = table.seats[one.shift]
    same = (seat[:, None] == seat[None]) & kept
    mean = same / np.maximum(same.sum(axis=1, keepdims=True), 1)
    free = by_tip if "tip" in table.free else by_tip[..., :0]
    means = [np.einsum("mn,nij->mij", mean, part) for part in (free, by_constant)]
    rows = 3 * int(kept.sum())
    r = fits.residuals[i][kept].reshape(rows, 1)
    X, K = ((part - at)[kept].reshape(rows, -1) for part, at in zip((free, by_constant), means, strict=True))
    n_absorbed = 3 * len(np.unique(seat[kept]))
    for columns in (0, 1):
        of_lengths = length_rows(table, [one], seat[None], fits.points_in_base[i : i + 1], means[columns][None])
        if of_lengths is None:
            return r, X, K, n_absorbed
        if columns:
            K = np.concatenate([K, of_lengths[1][0]])
        else:
            r, X = np.concatenate([r, of_lengths[0].T]), np.concatenate([X, of_lengths[1][0]])
    return r, X, K, n_absorbed


def restricted_likelihood(
    residuals: FloatArray, free: FloatArray, tolerances: FloatArray, *, n_absorbed: int = 0, scale: float = 1.0
) -> tuple[float, float]:
    """Logarithm of the restricted likelihood of residuals, at the noise that makes it largest.

    Parameters
    ----------
    residuals : (n,) array
        [mm].
    free : (n, p) array
        Derivatives by parameters of which nothing is known.
    tolerances : (n, k) array
        Derivatives by parameters with a prior, times their prior standard deviations [mm].
    n_absorbed : int
        Contrasts that are lost already, as of means that were subtracted.
    scale : float
        Residual by the stated unit of what was measured: the likelihood is that of the numbers stated.

    Returns
    -------
    log_likelihood : float
        Without the constant that depends on the number of contrasts only.
    usual : float
        Root mean square residual that the parameters with a prior cause [mm].
    """
    n, r, K = without_free(free, residuals, tolerances)
    n -= n_absorbed
    U, s, _ = np.linalg.svd(K, full_matrices=False)
    U, s = U[:, :n], s[:n]
    c = U.T @ r
    rest = max(float(r @ r - c @ c), 0.0)
    noise = NOISE_MM[:, None] ** 2
    variance = noise + s**2
    of_tolerances = (np.log(variance) + c**2 / variance).sum(axis=1)
    of_noise = (n - len(s)) * np.log(noise[:, 0]) + rest / noise[:, 0]
    best = float((-0.5 * (of_tolerances + of_noise)).max())
    return best + n * float(np.log(max(scale, 1e-12))), float(np.sqrt((s**2).sum() / max(len(residuals), 1)))


def without_free(free: FloatArray, *columns: FloatArray) -> tuple[int, FloatArray, FloatArray]:
    """Number of contrasts that free parameters (n, p) do not affect, and columns (n, k) without what they explain."""
    # By pivots: what is left of a dependent column is rounding, in the way of those that follow.
    Q, R, _ = qr(free, mode="economic", pivoting=True)
    weights = np.abs(R.diagonal())
    Q = Q[:, weights > 1e-9 * weights.max(initial=0.0)]
    first, second = (one - Q @ (Q.T @ one) for one in columns)
    return len(free) - Q.shape[1], first, second


@contextmanager
def explaining(arm: Arm, table: ReferenceTable | None, file: Path | None) -> Iterator[None]:
    """Add what explains the readings to the hint of an `InputError` that is raised inside.

    Parameters
    ----------
    arm : Arm
        The nominal one.
    table : ReferenceTable or None
        Of the readings.
    file : Path or None
        Theirs.
    """
    try:
        yield
    except InputError as error:
        explained = _explained(arm, table, file)
        if explained is None:
            raise
        raise error.with_hint(f"{explained}; or {error.hint}" if error.hint else explained) from None


def explain_readings(arm: Arm, readings: Session) -> str | None:
    """Which mistake in the arm file or the readings explains them, as a remedy; None if there is none to tell.

    See `check_description`.
    """
    return _explained(arm, reference_table(readings), readings.file)


def _explained(arm: Arm, table: ReferenceTable | None, file: Path | None) -> str | None:
    return None if table is None else check_description(arm, table).remedy(file)
