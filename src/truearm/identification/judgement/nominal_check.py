"""Whether readings contradict the nominal arm: a wrong sign, unit, order or quarter turn of the joints is refused.

The error of the nominal arm, with base and tip fitted, is compared with the one that errors of its constants usually
cause, a prior predictive check (G. E. P. Box, "Sampling and Bayes' inference in scientific modelling and robustness",
J. R. Stat. Soc. A 143 (1980) 383). With the normal equations G of all parameters, those of the constants without what
the free ones (f) absorb are ``S = G - G_f G_ff^-1 G_f^T``, and the expected sum of squared residuals is
``sum_i S_ii s_i^2`` by the constants' prior standard deviations s.

What exceeds it is unusual, and not yet contradicted. The constants are identified, and what they leave is separated
into noise and structure (`truearm.identification.judgement.structure`). Readings are refused if a mistake in the arm
file or in the readings explains them very strongly better than the identified constants (`description_check`), if
structure remains that neither the weight of the arm nor anything else explains, or if no credible constants explain
them. Noise and zeros are said, and fitted.

The limits are evidence, `python -m benchmarks imperfect_readings wrong-arms` and `judgement contradicted`:
real arms and virtual ones, and each of them with every single wrong sign, exchanged pair of joints, zero off by a
quarter turn and other unit.

Constants of the identified arm beside the drawing show zeros of joints that are off, and what no right drawing has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from truearm.acceptance import contradict
from truearm.arm.arm import COLUMNS, Arm, table_changes
from truearm.arm.nearest_table import drawn_convention, drawn_table, nearest_table
from truearm.errors import InputError
from truearm.findings import Finding, format_mm
from truearm.identification.estimation.identification import initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.linearisation import eliminate_unknowns, linearised
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.description_check import (
    MAX_NOISE,
    VERY_STRONG,
    DescriptionCheck,
    Explanation,
    check_description,
    likelier_arm,
)
from truearm.identification.judgement.joint_gains import common_gain, gains_asked
from truearm.identification.judgement.length_scale import (
    AxisScale,
    LengthScale,
    reference_scale_variance,
    refuse_wrong_scale,
)
from truearm.identification.judgement.outliers import constraint_residuals
from truearm.identification.judgement.structure import UNKNOWN, Remaining, remaining
from truearm.identification.references.distances import is_offset
from truearm.identification.references.orientations import LEVER_MM
from truearm.identification.references.reading_references import without_sizes
from truearm.identification.references.reference_table import ReferenceTable
from truearm.identification.references.references import Reference
from truearm.identification.terms import ArmState, Term
from truearm.readings.checks import remedy_of_unit
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measurements
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Largest changes of constants that are credible. A zero that is off by more than an eighth of a turn is nearer to
# another zero. Other angles: 7 degrees, forty times as much as usual. Lengths: 5 % of the reach, as of links that are
# a tenth too long; what explains a zero that is off by a quarter turn are lengths of 8 % or more. The zero of a slide
# is a length that no drawing states: a column that was homed 100 mm off, on an arm of 500 mm.
MAX_ZERO, MAX_ANGLE, MAX_LENGTH, MAX_SLIDE_ZERO = np.radians(45.0), np.radians(7.0), 0.05, 0.2
# Columns of the table that are angles.
ANGLES = ("theta", "alpha", "beta")
# Standard uncertainties by which a constant must exceed that: noise leaves lengths open.
SURE = 3.0
# Smaller shares of what is credible are rounding.
NO_DIFFERENCE = 1e-9
# Standard uncertainties of a difference quotient.
STEP = 1e-3
# Zeros that are off by more are named: six times what is usual [rad; of sliding joints mm].
NAMED_ZERO, NAMED_SLIDE_ZERO = np.radians(1.0), 3.0


@dataclass(frozen=True)
class IdentifiedConstants:
    """By how much the constants of an identified arm differ from the drawing.

    Attributes
    ----------
    zeros : dict of str to (float, float)
        What is to be added to the zeros of joints, with its standard uncertainty [rad; of sliding joints mm], of those
        that are off by `NAMED_ZERO` (`NAMED_SLIDE_ZERO`) or more, and by more than `SURE` standard uncertainties.
    slides : tuple of str
        The sliding joints.
    largest : str
        The constant that differs most, compared with what is credible, and by how much; empty if none does.
    share : float
        Its size over the largest credible one.
    are_zeros : bool
        Whether all that are larger than credible are zeros of turning joints: horns or encoders mounted otherwise.
    every_zero : tuple of float
        What is to be added to the zeros of all joints, certain or not [rad; of sliding joints mm].
    """

    zeros: dict[str, tuple[float, float]]
    largest: str
    share: float
    slides: tuple[str, ...] = ()
    are_zeros: bool = False
    every_zero: tuple[float, ...] = ()

    @property
    def are_credible(self) -> bool:
        """Whether an arm that is described rightly can differ so."""
        return self.share <= 1

    @classmethod
    def of(cls, fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> Self:
        """Compare an identified arm with the nominal one."""
        names = [(name, joint) for name in COLUMNS for joint in arm.joint_names]
        try:
            changes, std = _changes(fit, arm, free)
        except InputError as error:
            return cls({}, error.problem, np.inf)
        slides, n = arm.chain.is_prismatic, arm.n_joints
        zeros = np.where(slides, COLUMNS.index("d"), COLUMNS.index("theta")) * n + np.arange(n)
        most = np.array([MAX_ANGLE if name in ANGLES else MAX_LENGTH * arm.chain.reach for name, _ in names])
        most[zeros] = np.where(slides, MAX_SLIDE_ZERO * arm.chain.reach, MAX_ZERO)
        shares = np.abs(changes) / (most + SURE * std)
        worst = int(shares.argmax())
        name, joint = names[worst]
        value = float(changes[worst])
        size = f"{np.degrees(value):+.3g} deg" if name in ANGLES else f"{value:+.3g} mm"
        largest, share = f"{name} of {joint} {size}", float(shares[worst])
        others = shares.copy()
        others[zeros[~slides]] = 0.0
        are_zeros = share > 1 >= others.max()
        for place, off in _displacements(fit, arm, free).items():
            if (of_place := off / (MAX_LENGTH * arm.chain.reach)) > share:
                largest, share = f"the {place}, which is stated to be known, {off:.3g} mm", of_place
                are_zeros = False
        if share < NO_DIFFERENCE:
            largest = ""
        least = np.maximum(np.where(slides, NAMED_SLIDE_ZERO, NAMED_ZERO), SURE * std[zeros])
        named = {
            arm.joint_names[i]: (float(changes[zeros[i]]), float(std[zeros[i]]))
            for i in np.flatnonzero(np.abs(changes[zeros]) >= least).tolist()
        }
        sliding = tuple(arm.joint_names[i] for i in np.flatnonzero(slides).tolist())
        return cls(named, largest, share, sliding, are_zeros, tuple(changes[zeros].tolist()))

    def __str__(self) -> str:
        if not self.largest:
            return "They are those of the arm file."
        if not self.zeros:
            return f"The largest difference is {self.largest}: correct the arm file if it is wrong there."
        return (
            f"Zeros of joints are off, add {self.added_zeros}; `truearm fit ... --apply my-arm.toml` writes a new "
            "arm file with them."
        )

    @property
    def added_zeros(self) -> str:
        """What is to be added to the zeros, in words."""
        turning = ", ".join(
            f"{j} {_with_u(np.degrees(zero), 'deg')}" for j, zero in self.zeros.items() if j not in self.slides
        )
        sliding = ", ".join(f"{j} {_with_u(zero, 'mm')}" for j, zero in self.zeros.items() if j in self.slides)
        of = [f"to their {name}: {zeros}" for name, zeros in (("theta", turning), ("d", sliding)) if zeros]
        return " and ".join(of)


def _with_u(stated: Sequence[float] | FloatArray, unit: str) -> str:
    """A zero with its standard uncertainty, where that is seen."""
    zero, u = stated
    return f"{zero:+.3g} {unit}" + (f" (u {u:.1g})" if u > 0.01 * abs(zero) else "")


def _changes(fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Changes of the table's constants, column by column, and their standard uncertainties, to first order."""

    def changes(coefficients: FloatArray) -> FloatArray:
        chain = fit.perturbed_chain.with_constants(coefficients)
        return np.concatenate(list(table_changes(chain, arm, free=free).values()))

    found = changes(fit.coefficients)
    variances, vectors = np.linalg.eigh(fit.covariance)
    along = (vectors * np.sqrt(np.maximum(variances, 0.0))).T
    squares = [np.zeros(len(found)), *((changes(fit.coefficients + STEP * one) - found) ** 2 for one in along)]
    return found, np.sqrt(np.sum(squares, axis=0)) / STEP


def _displacements(fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> dict[str, float]:
    """By how much the base and the tip are displaced that are not free [mm]."""
    convention = drawn_convention(arm.chain)
    found, drawn = nearest_table(fit.chain, arm.chain, convention=convention, free=free), arm.chain
    off = {"base": found.base[:3, 3] - drawn_table(drawn, convention).base[:3, 3]}
    off["tip"] = found.tip_in_flange - drawn.tip_in_flange
    return {place: float(np.linalg.norm(one)) for place, one in off.items() if place not in free}


# The error is the one that three of four readings do not exceed: gross errors hardly change it.
QUANTILE = 0.75
# Multiple of the usual error above which the arm's constants must explain it. Real arms have 0.1 to 0.9, kits whose
# constants err by 2 mm and 5 mrad up to 2.0; a wrong sign, order or zero that moves the tip has 2.2 or more.
MAX_RATIO = 2.0
# Multiple of the usual error that structure may have, which identified constants leave. Arms have up to 0.1, with noise
# of 10 mm too; printed ones with backlash and soft links 0.25 to 0.45, a wrong sign or order that moves the tip 5.6 and
# more (`python -m benchmarks judgement printed contradicted`).
MAX_STRUCTURE = 2.0
# Share of the root mean square distance of the points from their mean that noise may have: it counts where they are
# close together. In a cube of 220 mm points in the order of other readings have 0.79 to 0.87 of it, a camera of 10 mm a
# coordinate 0.11 to 0.15, and one of 20 mm 0.20 to 0.28 (ur10 and gao2017, 28 poses).
MAX_NOISE_SHARE = 0.5
# The error of three of four readings over the root mean square distance that constants leave, up to which noise alone
# makes it: Gaussian noise has 1.17.
MOST_BY_NOISE = 1.4
# Root mean square noise that orientations may have [rad]: a small marker far from a camera has a third of it, and
# orientations of other poses, in another unit or order, have 2.
MAX_TURN_NOISE = 0.5
# Share of the reach by which the nominal arm may miss readings of another session on average, with base and tip where
# they were: ten times what the kinematic model expects of its constants (3 mrad, 3 mm) stays below.
MAX_NOMINAL_ERROR = 0.05
# Smaller eigenvalues of the free parameters, relative to the largest, are rounding: no readings determine them.
LEAST_EIGENVALUE = 1e-9
# Share by which a stated length or distance may differ from that of the nominal arm. Real arms are within a hundredth
# of their nominal lengths; radii in place of distances, other units and other seats are not.
MAX_SIZE_ERROR = 0.05


@dataclass(frozen=True)
class NominalCheck:
    """How far the nominal arm misses its readings, and how far nominal arms usually do.

    Attributes
    ----------
    error_mm : float
        Distance from the references that three of four readings do not exceed, with the free parts fitted [mm].
    usual_mm : float
        Root mean square distance that errors of the arm's constants usually cause [mm]; at least the nominal error
        that the arm file states. It includes the stated uncertainty of the references, and is infinite where the free
        parts absorb every error of the constants: then nothing can be judged.
    identified : IdentifiedConstants or None
        The arm's constants as the readings show them; None where that is not needed.
    left : Remaining
        What these constants leave; of a model in a new set-up what the model leaves.
    most_noise_mm : float
        Noise above which the readings say nothing of the arm [mm].
    description : DescriptionCheck or None
        What else could explain it; None where that is not needed, or there are too few points and seats.
    of_turns : NominalCheck or None
        Of the orientations, at a distance of `LEVER_MM`, which are judged apart from points: they have a noise of their
        own. None without any.
    length_scale : LengthScale or None
        By what share all identified lengths differ from the drawing alike; None where that is not needed.
    other_arm : Explanation or None
        An arm with a similar name whose drawing explains the readings far better.
    axis_scale : AxisScale or None
        By what share one axis of the reference is longer than the others; None without points in one frame.
    common_gain : float or None
        By what share all joints turn further than stated, where they do so alike.
    """

    error_mm: float
    usual_mm: float
    identified: IdentifiedConstants | None = None
    left: Remaining = UNKNOWN
    most_noise_mm: float = np.inf
    description: DescriptionCheck | None = None
    of_turns: NominalCheck | None = None
    length_scale: LengthScale | None = None
    other_arm: Explanation | None = None
    axis_scale: AxisScale | None = None
    common_gain: float | None = None

    @property
    def shows_zeros(self) -> bool:
        """Whether zeros are off, and no mistake is known that explains it."""
        return self.identified is not None and bool(self.identified.zeros) and not self.is_mistaken

    @property
    def scale_beside_zeros(self) -> LengthScale | None:
        """The scale of the lengths, where zeros are off: identified together with them, lengths take a part of them."""
        return self.length_scale if self.shows_zeros else None

    def about(
        self, fit: IdentificationResult, arm: Arm, references: Sequence[Reference], table: ReferenceTable | None
    ) -> Self:
        """The check with its scale and mistakes judged about an arm with other zeros, from its identified constants."""
        check = replace(self, length_scale=_length_scale(fit, references))
        found = None if table is None else check_description(arm, table, fit.chain)
        return check if found is None or not found.findings else replace(check, description=found)

    @property
    def ratio(self) -> float:
        """The error in multiples of the usual one."""
        return self.error_mm / self.usual_mm if self.usual_mm > 0 else np.inf if self.error_mm > 0 else 0.0

    @property
    def is_usual(self) -> bool:
        """Whether the nominal arm misses by no more than nominal arms do."""
        return bool(self.ratio <= MAX_RATIO)

    @property
    def sagging(self) -> Explanation | None:
        """That joints yield under the weight of the arm, where that leaves no more than arms do; else None."""
        found = None if self.description is None else self.description.sagging
        return found if found is not None and found.is_plausible else None

    @property
    def is_plausible(self) -> bool:
        """Whether the readings can be of this arm: it is usual, or constants and noise, or weight, explain the rest."""
        if self.of_turns is not None and not self.of_turns.is_plausible:
            return False
        if self.is_usual or self.sagging is not None:
            return True
        return self.leaves_noise and not self.is_mistaken and (self.identified is None or self.identified.are_credible)

    @property
    def leaves_noise(self) -> bool:
        """Whether the identified constants leave no more than noise."""
        left = self.left
        has_structure = left.structure_mm > MAX_STRUCTURE * self.usual_mm and left.log_odds >= VERY_STRONG
        return left.noise_mm <= self.most_noise_mm and not has_structure

    @property
    def far_zeros(self) -> str | None:
        """What is to be added to zeros that are further off than credible, where that explains the readings."""
        found = self.identified
        is_shown = found is not None and found.are_zeros and self.leaves_noise and not self.is_mistaken
        return f"add {found.added_zeros} ({self.left.distance_mm:.2g} mm remain)" if found and is_shown else None

    @property
    def beside_mistakes(self) -> str | None:
        """What explains the readings where no mistake of the list does, in words."""
        if self.common_gain is not None:
            return (
                f"All joints turn by {1 + self.common_gain:.3f} times their stated angles: check their unit or factor"
            )
        return None if self.far_zeros is None else f"Zeros of joints are off: {self.far_zeros}"

    @property
    def is_mistaken(self) -> bool:
        """Whether a mistake in the arm file or in the readings explains them better."""
        return self.description is not None and bool(self.description.findings)

    def findings(self) -> tuple[Finding, ...]:
        """What a person must know of a plausible arm."""
        if (other := self.other_arm) is not None:
            said = (
                f"By these readings {other}: they miss its drawing by {format_mm(other.error_mm)}, that of the arm "
                f"stated by {format_mm(self.error_mm)}. If so, fit again with its name (--arm)."
            )
            return (Finding("nominal arm", said, {"error_mm": self.error_mm, "other_error_mm": other.error_mm}),)
        if self.is_usual or self.identified is None or not self.is_plausible:  # an acceptance says so itself
            return ()
        misses = (
            f"The nominal arm misses the readings by {self.error_mm:.3g} mm, {self.ratio:.1f} times as much as nominal "
            "arms usually do"
        )
        if self.sagging is not None:
            misses += f": its {self.sagging}, and {self.sagging.error_mm:.2g} mm remain (--model physical)."
        elif not self.identified.zeros and self.error_mm <= MOST_BY_NOISE * self.left.distance_mm:
            return ()  # it is noise, which the readings' scatter says
        else:
            misses += f"; with its constants identified {self.left.distance_mm:.2g} mm remain. {self.identified}"
        return (Finding("nominal arm", misses, {"error_mm": self.error_mm, "usual_mm": self.usual_mm}),)

    @property
    def doubt(self) -> str:
        """What whoever uses a model must know of its nominal arm, in a sentence; empty if nothing."""
        if self.other_arm is not None:
            return f"By the training readings {self.other_arm}: fit again with its name (--arm)."
        misses = f"{self.error_mm:.3g} mm, {self.ratio:.1f} times as much as nominal arms usually do"
        return f"The nominal arm misses the training readings by {misses}; fit says why." if self.findings() else ""


UNCHECKED = NominalCheck(float("nan"), float("nan"))


def check_nominal_arm(
    arm: Arm,
    nominal: IdentificationResult,
    state: ArmState,
    references: Sequence[Reference],
    constants: Sequence[Term],
    identify: Callable[[Sequence[Term]], IdentificationResult],
    table: ReferenceTable | None,
    free: tuple[str, ...],
) -> NominalCheck:
    """Compare the error of a nominal arm with the usual one; where it is larger, say what explains it.

    Parameters
    ----------
    arm : Arm
    nominal : IdentificationResult
        Its free parts identified from the readings.
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Without known lengths.
    constants : sequence of Term
        All constants of the arm, with those of the free parts.
    identify : callable
        Returns the arm with terms identified from the same references. Called only where the error is unusual.
    table : ReferenceTable or None
        The readings, in the form in which mistakes in their description are looked for.
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown.
    """
    (placed, points), (turned, turns) = (_of_kind(nominal, references, turns=one) for one in (False, True))
    check = NominalCheck(typical_error(placed), usual_nominal_error(arm, placed, state, points, constants))
    if table is not None:
        check = replace(check, other_arm=likelier_arm(arm, table))
    if turns:
        usual = usual_nominal_error(arm, turned, state, turns, constants)
        of_turns = NominalCheck(typical_error(turned), usual, most_noise_mm=MAX_TURN_NOISE * LEVER_MM)
        check = replace(check, of_turns=of_turns)
    if check.is_usual and (check.of_turns is None or check.of_turns.is_usual):
        return check
    fit = identify(constants)
    if gains := gains_asked(fit, state, references, constants):
        constants = [*constants, *gains]
        fit = identify(constants)
    if check.of_turns is not None:
        left = left_by(_of_kind(fit, references, turns=True)[0], state, turns, constants)
        check = replace(check, of_turns=replace(check.of_turns, left=left))
    if check.is_usual:
        return check
    left = left_by(_of_kind(fit, references, turns=False)[0], state, points, constants)
    # What a joint does of which the angle is not read looks like noise.
    hidden = not np.ptp(state.angles, axis=0).all()
    return replace(
        check,
        identified=IdentifiedConstants.of(fit, arm, free),
        left=left,
        most_noise_mm=MAX_RATIO * check.usual_mm if hidden else most_noise(placed, state, arm.chain.reach),
        description=None if table is None else check_description(arm, table, fit.chain),
        length_scale=_length_scale(fit, references),
        common_gain=common_gain(fit),
    )


def _length_scale(fit: IdentificationResult, references: Sequence[Reference]) -> LengthScale | None:
    variance = reference_scale_variance(fit, references)
    return LengthScale.of(fit, fit.residual_freedom(references), reference_variance=variance)


def _of_kind(
    fit: IdentificationResult, references: Sequence[Reference], *, turns: bool
) -> tuple[IdentificationResult, list[Reference]]:
    """The references that are orientations, or all others, and the result with its residuals from them alone."""
    which = [i for i, one in enumerate(references) if (one.kind == "orientation") == turns]
    return replace(fit, references=tuple(fit.references[i] for i in which)), [references[i] for i in which]


def most_noise(nominal: IdentificationResult, state: ArmState, reach: float) -> float:
    """Noise above which readings say nothing of an arm of a reach, by the nominal tips of those with points [mm].

    A root mean square distance: of lengths, which are one coordinate of three, as much less.
    """
    rows = np.concatenate(
        [np.zeros(0, np.intp), *(one.rows for one in nominal.references if one.kind in ("point", "pose"))]
    )
    spread = float(np.sqrt(nominal.tips(state)[rows].var(axis=0).sum())) if len(rows) else np.inf
    n_coordinates = max((len(one.residuals) for one in nominal.references), default=3)
    return min(MAX_NOISE * reach, MAX_NOISE_SHARE * spread) * float(np.sqrt(min(n_coordinates, 3) / 3))


def left_by(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], absorbed: Sequence[Term]
) -> Remaining:
    """What an arm leaves; readings that scatter more and have lost their weight count as noise. See `remaining`."""
    left = remaining(fit, state, references, absorbed)
    whole = typical_error(fit) / MOST_BY_NOISE
    return left._replace(noise_mm=max(left.noise_mm, float(np.sqrt(max(whole**2 - left.structure_mm**2, 0.0)))))


def usual_nominal_error(
    arm: Arm, nominal: IdentificationResult, state: ArmState, references: Sequence[Reference], constants: Sequence[Term]
) -> float:
    """Root mean square distance that errors of the arm's constants usually cause, or its file states [mm].

    See `NominalCheck.usual_mm`. Parameters are those of `check_nominal_arm`.
    """
    if not references:
        return np.inf
    free = {term.name for term in nominal.perturbed_chain.terms}
    usual = usual_error(nominal, state, references, [term for term in constants if term.name not in free])
    if usual == 0:
        return np.inf
    squares = np.concatenate([(one.std**2).sum(axis=0) for one in nominal.references])
    stated = float(np.median(squares)) if len(squares) else 0.0
    return float(np.hypot(max(usual, arm.nominal_error_mm), np.sqrt(stated)))


def typical_error(fit: IdentificationResult) -> float:
    """Distance from the references that three of four readings do not exceed [mm]; zero without references."""
    distances = np.concatenate([np.zeros(0), *(np.linalg.norm(one.residuals, axis=0) for one in fit.references)])
    return float(np.quantile(distances, QUANTILE)) if len(distances) else 0.0


def refuse_implausible(check: NominalCheck, arm: Arm, readings: Measurements) -> None:
    """Refuse readings that no arm of these nominal kinematics can have made.

    Parameters
    ----------
    check : NominalCheck
    arm : Arm
    readings : Session

    Raises
    ------
    InputError
        With the mistakes that are likely.
    """
    if check.is_plausible:
        if check.scale_beside_zeros is not None:
            refuse_wrong_scale(check.scale_beside_zeros, arm, readings, None)
        return
    if (turns := check.of_turns) is not None and not turns.is_plausible:
        error, usual = (np.degrees(size / LEVER_MM) for size in (turns.error_mm, turns.usual_mm))
        readings.contradict(
            f"the orientations differ from those of the nominal arm {arm.name!r} by {error:.3g} deg at one reading of "
            f"four, where those of arms like it differ by {usual:.2g} deg",
            column="quat_w",
            hint="check their unit (--orientation-unit of import), the order of their numbers (quaternions: w first), "
            "and that they are of the flange in the frame of the reference; if the marker was mounted again, name its "
            f"mountings in the column session or tip; the points agree with the arm to {check.error_mm:.2g} mm"
            if check.is_usual and check.error_mm > 0
            else "check the arm first: its points or seats do not agree either",
        )
        return
    if check.length_scale is not None and check.length_scale.is_contradicted(arm) and not check.is_mistaken:
        refuse_wrong_scale(check.length_scale, arm, readings, None)
        return
    if (zeros := check.far_zeros) is not None:
        readings.contradict(
            f"the nominal arm {arm.name!r} misses its references by {check.error_mm:.4g} mm at one reading of four, "
            f"where arms like it miss by {check.usual_mm:.2g} mm: a zero is off by more than {np.degrees(MAX_ZERO):g} "
            "deg, and its other constants are right",
            hint=f"in the arm file, {zeros}; or shift the angles (truearm import --zero): a servo horn or an encoder "
            "is mounted otherwise than drawn",
        )
        return
    why, remedy = "", None if check.description is None else check.description.remedy(readings.file)
    if check.identified is not None:
        why = f"; with its constants identified {check.left} remain"
        why += f", and the largest is {largest}" if (largest := check.identified.largest) else ""
    of_unit = remedy_of_unit(readings, arm.chain.tip_in_base(readings.angles))  # a tip fitted to them would be in it
    still = [f"J{joint + 1}" for joint in np.flatnonzero(np.ptp(readings.angles, axis=0) == 0).tolist()]
    readings.contradict(
        f"the nominal arm {arm.name!r} misses its references by {check.error_mm:.4g} mm at one reading of four, where "
        f"arms like it miss by {check.usual_mm:.2g} mm{why}: the readings are of another arm, or the arm is described "
        "wrongly",
        hint=(f"{remedy}; or " if remedy else "")
        + (f"{' and '.join(still)} did not move by the readings: check that column; or " if still else "")
        + (f"{of_unit}; or " if of_unit else "")
        + "check the arm, the units, signs, order and zeros of the angles, the unit of the points, and --free; if the "
        f"arm is as inaccurate as that, add the line nominal_error_mm = {check.error_mm:.2g} to its arm file, above "
        "the first table; of an arm in the catalogue, truearm arms NAME --out my-arm.toml writes a file to change",
    )


def usual_error(
    fit: IdentificationResult, state: ArmState, references: Sequence[Reference], constants: Sequence[Term]
) -> float:
    """Root mean square distance of a nominal arm from its references that errors of its constants usually cause.

    Parameters
    ----------
    fit : IdentificationResult
        Of the free terms: base, tip, and others that every fit has.
    state : ArmState
        Of the readings.
    references : sequence of Reference
        Without known lengths.
    constants : sequence of Term
        The constants of the nominal arm, with their prior standard deviations.

    Returns
    -------
    float
        [mm]; zero if the free terms absorb all that errors of the constants cause, as those of an arm with one joint.
    """
    free = fit.perturbed_chain.terms
    chain = PerturbedChain(fit.chain, (*free, *constants))
    problem, unknowns = initial_problem(chain, state, references)
    x = np.concatenate([np.zeros(chain.n_coefficients), unknowns])
    with one_blas_thread():
        parts, whole = linearised(problem, x, [np.ones((one.n_residuals, len(one.rows))) for one in references])
        G = eliminate_unknowns(parts, whole, x).gram
        n_free = sum(term.n_coefficients for term in free)
        is_constant = np.zeros(len(G), dtype=bool)
        is_constant[n_free : chain.n_coefficients] = True
        G_ff, G_cf = G[np.ix_(~is_constant, ~is_constant)], G[np.ix_(is_constant, ~is_constant)]
        # Lengths and angles in one matrix: scaled to a unit diagonal.
        scale = 1 / np.sqrt(np.maximum(G_ff.diagonal(), np.finfo(float).tiny))
        inverse = np.linalg.pinv(scale[:, None] * G_ff * scale, rcond=LEAST_EIGENVALUE, hermitian=True)
        absorbed = np.einsum("if,fg,ig->i", G_cf * scale, inverse, G_cf * scale)
    std = np.concatenate([np.zeros(0), *(term.prior_stds for term in constants)])
    whole_squares = G.diagonal()[is_constant]
    remains = whole_squares - absorbed
    squares = np.where(remains > LEAST_EIGENVALUE * whole_squares, remains, 0.0) * std**2
    return float(np.sqrt(squares.sum() / sum(len(one.rows) for one in references)))


def check_sizes(
    readings: Measurements,
    lengths: Lengths | None,
    references: Sequence[Reference],
    fit_nominal: Callable[[Sequence[Reference]], IdentificationResult],
    state: ArmState,
) -> None:
    """Check that known lengths and distances are about those of the nominal arm.

    Points show when an arm is described wrongly. Seats and surfaces agree with an arm of any size: a length in another
    unit would scale the arm, and nothing else would show it.

    Parameters
    ----------
    readings : Session
    lengths : Lengths, optional
    references : sequence of Reference
        Of both.
    fit_nominal : callable
        Returns the nominal arm with base and tip identified from references.
    state : ArmState
        Of the readings.

    Raises
    ------
    InputError
        If a length differs from that of the nominal arm, identified without lengths, by more than a share of
        `MAX_SIZE_ERROR` and three standard deviations.
    """
    bare = [without_sizes(reference) for reference in references]
    if all(one is reference for one, reference in zip(bare, references, strict=True)):
        return
    residuals = constraint_residuals(fit_nominal(bare), state, bare, references)
    assert residuals is not None  # some references state a length
    drawn, stated = residuals.values.T
    most = MAX_SIZE_ERROR * stated + 3 * np.sqrt(residuals.covariance.diagonal() + residuals.std**2)
    most[[is_offset(name) for name in residuals.names]] = np.inf  # no size of the arm
    excess = np.abs(residuals.residuals) / most
    worst = int(np.argmax(excess))
    if excess[worst] > 1:
        of_sphere = residuals.names[worst].startswith("distance")
        refused = InputError(
            f"expected a {residuals.names[worst]} of about {drawn[worst]:.4g} mm, as the nominal arm has, "
            f"got {stated[worst]:.6g} mm",
            file=readings.file if of_sphere or lengths is None else lengths.file,
            column="sphere_distance_mm" if of_sphere else "length_mm",
            hint="check that it is (D + d) / 2 of sphere and ball, not a radius; its unit; the arm"
            if of_sphere
            else "check the unit of the length, the names of its two seats, the arm",
        )
        contradict(refused)
