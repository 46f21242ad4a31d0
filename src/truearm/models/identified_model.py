"""The identified models: nominal, kinematic, physical. They differ in the terms that they offer to identification."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.propagation import half_tip_difference
from truearm.identification.estimation.residual_variance import VarianceFunction
from truearm.identification.identify import (
    Found,
    Identification,
    Progress,
    Unexplained,
    identify_nominal,
    identify_offered,
    identify_physical,
    place_without_gross_errors,
)
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.judgement.length_scale import SURE_OF_KITS, LengthScale, refuse_wrong_scale
from truearm.identification.judgement.repeating_residuals import UNKNOWN_SHARE
from truearm.identification.judgement.residual_process import ResidualProcess
from truearm.identification.references.prepared_readings import PreparedReadings, tip_motions
from truearm.identification.terms import (
    HIGHEST_ORDER,
    HIGHEST_ORDER_OFFERED,
    ArmState,
    Expression,
    SkippedTerm,
    Temperature,
    Term,
    check_parts,
    constants,
)
from truearm.models.arm_check import check_readings_of
from truearm.models.compensator import CheckedReadings, Compensator, ReadingsLike, no_progress
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

DIRECTIONS, ROUNDED = "directions of movement", "rounding of the angles"
JUDGED_LATE = ("residual_std_", "variance_function_", "repeating_share_", "hysteresis_")
# Fits of weighted points after the first: the noise changes by some per cent in the first of them.
WEIGHT_ROUNDS = 2
# Standard uncertainty of a point that states none [mm]: a session states one of every point, or of none.
LEAST_STD_MM = 1e-6


class _Late:
    """An attribute that `IdentifiedModel.judged` sets once it is asked for: only a model that is kept needs it."""

    def __init__(self, default: object) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, model: IdentifiedModel | None, owner: type) -> object:
        if model is not None and self._name in vars(model.judged()):
            return vars(model)[self._name]
        if self._default is None:
            raise AttributeError(f"{owner.__name__} has no {self._name}: it is not fitted")
        return self._default


def late(default: object = None) -> Any:
    """Such an attribute, with its value in a model from an older file."""
    return _Late(default)


class IdentifiedModel(Compensator):
    """Base of the models that offer terms and leave the rest to identification.

    Attributes
    ----------
    fit_ : IdentificationResult
        The identified chain and terms. Of a model read from a file, its references have the residuals of outliers only.
    excluded_terms_ : tuple of SkippedTerm
        Terms that the readings could not show, and why.
    held_out_ : HeldOutReadings
        The training readings as predicted by an arm that was identified without their position or seat; gross errors,
        which took no part in the identification, are not among them. Empty after a transfer and after reading a file.
    held_out_gross_ : HeldOutReadings
        The gross errors, predicted in the same way.
    held_out_distances_ : HeldOutReadings
        Likewise distances, where `held_out_` are points or seats; empty where it is of distances itself.
    held_out_errors_ : HeldOutErrors or None
        Their errors in short; None where no readings could be held out.
    residual_std_ : float
        Standard deviation of a coordinate of one reading that the model does not explain [mm]: root mean square over
        the joint space.
    variance_function_ : VarianceFunction
        Share of its square at other angles.
    birge_ratio_ : float
        Factor by which standard deviations of the posterior are raised, from the readings held out (see
        `truearm.identification.judgement.cross_validation`).
    tail_freedom_ : float
        Degrees of freedom of the tails of the held-out deviations (`truearm.identification.judgement.gross_errors`);
        infinite where they are too few, and of models from older files.
    residual_process_ : ResidualProcess or None
        What is known of the residual process; None where the model has none, and had none before a transfer.
    length_scale_ : LengthScale or None
        By what share all lengths of the arm differ from the drawing alike; None where the readings determine none, and
        after reading a file.
    hysteresis_ : (2, n_joints) array
        Mean and standard deviation of what each joint turns, or slides, by the direction of its last movement and the
        model does not correct [rad or mm] (`truearm.identification.judgement.repeating_residuals`); empty of older
        files.
    type_prior_ : str
        Which arms the prior of its type was learned from; empty without a type prior, and of models from older files.
    refit_reading_ids_ : (k,) array
        Empty; of older files identifiers of the readings of a refit, which `training_` knows now.
    """

    fit_: IdentificationResult
    excluded_terms_: tuple[SkippedTerm, ...]
    held_out_errors_: HeldOutErrors | None
    residual_std_: float = late()
    variance_function_: VarianceFunction = late()
    birge_ratio_: float
    tail_freedom_: float = float("inf")
    refit_reading_ids_: FloatArray
    residual_process_: ResidualProcess | None = None
    length_scale_: LengthScale | None = None
    hysteresis_: FloatArray = late(np.zeros((2, 0)))
    repeating_share_: float = late(UNKNOWN_SHARE)
    type_prior_: str = ""

    terms: Sequence[Term] = ()

    def _place(self, readings: PreparedReadings) -> Found:
        return place_without_gross_errors(readings)

    @abstractmethod
    def _identify(
        self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress
    ) -> Identification:
        """What the readings say of the arm, by the terms of this model."""

    def _fit(self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress) -> None:
        self._check_sessions(readings)
        progress(0, "choosing terms")
        found = self._identify(readings, placed, simpler, progress)
        self.fit_, self._by_readings, self.excluded_terms_ = found.fit, found.by_readings, found.excluded_terms
        self.held_out_, self.held_out_gross_ = found.held_out, found.held_out_gross
        self.held_out_distances_ = found.held_out_distances
        self.held_out_errors_, self.birge_ratio_ = found.held_out_errors, found.birge_ratio
        self.tail_freedom_, self._unexplained = found.tail_freedom, found.unexplained
        self.findings_ = found.findings
        for name in JUDGED_LATE:  # of an earlier fit
            vars(self).pop(name, None)
        self.residual_process_, self.refit_reading_ids_ = found.residual_process, np.zeros(0)
        self.type_prior_ = "" if readings.prior is None else str(readings.prior)
        self.length_scale_, before = found.length_scale, to_identified(simpler)
        if (scale := self.nominal_check_.scale_beside_zeros) is not None:
            others = [one for one in found.findings if one.what != "length scale"]
            self.length_scale_, self.findings_ = scale, (*others, *scale.findings(readings.arm, SURE_OF_KITS))
        is_judged = before is not None and before.length_scale_ is not None
        # A nominal arm that misses by more than arms do was refused, or accepted, with its scale.
        if self.length_scale_ is not None and not is_judged and self.nominal_check_.is_plausible:
            refuse_wrong_scale(self.length_scale_, readings.arm, readings.measured, readings.lengths)

    def with_nominal_growth(self, function: VarianceFunction, residual_std_mm: float) -> VarianceFunction:
        """A variance function that grows to the variance of the nominal arm, far outside the trained range."""
        if function.beyond is None or not residual_std_mm > 0:
            return function
        share = max((self.nominal_.references[0].noise_std / residual_std_mm) ** 2 - 1, 0.0)
        return replace(function, beyond=replace(function.beyond, nominal=share))

    def judged(self) -> Self:
        """See `Compensator`."""
        if (unexplained := vars(self).pop("_unexplained", None)) is not None:
            found: Unexplained = unexplained()
            function = self.with_nominal_growth(found.variance_function, found.residual_std_mm)
            self.residual_std_, self.variance_function_ = found.residual_std_mm, function
            self.repeating_share_, self.hysteresis_ = found.repeating_share, found.hysteresis
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Without what works out the rest, which no other process needs."""
        return {name: value for name, value in vars(self.judged()).items() if name != "_by_readings"}

    @property
    def by_readings(self) -> IdentificationResult:
        """See `Identification`, of a model that was just fitted."""
        return self._by_readings

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.terms, Sequence) and all(isinstance(term, Term) for term in self.terms)):
            raise InputError(f"expected a sequence of terms, got {self.terms!r:.60}", hint="docs/terms.md shows one")
        for term in self.terms:
            term.check_place(self.arm.chain)
        check_parts(term.basis for term in self.terms)

    def _check_sessions(self, readings: PreparedReadings) -> None:
        """Refuse terms of a session in whose frame the model predicts: 1 in the training, 0 in every prediction.

        And of one, or of a tip, that no reading has.
        """
        named = [] if readings.state.session is None else np.unique(readings.state.session).tolist()
        refused = {Expression.session(name) for name in list(readings.frames)[:1] or named if name}
        known = {"session": named, "tip": list(readings.tips)}
        for term in self.terms:
            for function in term.basis.expressions() or ():
                for one in sorted(function.inputs, key=str):
                    if one.operation in known and one.arguments[0] not in known[one.operation]:
                        raise InputError(
                            f"term {term.name[:60]!r}: expected a {one.operation} of the readings "
                            f"({', '.join(map(str, known[one.operation]))[:60] or 'they name none'}), "
                            f"got {one.arguments[0][:60]!r}"
                        )
                if found := refused & function.inputs:
                    raise InputError(
                        f"term {term.name[:60]!r}: expected a further session, got {min(map(str, found))[:60]!r}, in "
                        "whose frame the model predicts: its function is zero there",
                        hint="name the further sessions, or use a column",
                    )

    def _known(self, placed: Found, simpler: Compensator | None) -> list[IdentificationResult]:
        """Arms that were identified from the same readings before."""
        before = to_identified(simpler)
        return [placed.fit] if before is None else [placed.fit, before.fit_]

    def facts(self) -> dict[str, Any]:
        """See `Compensator.facts`."""
        return {"residual_std_mm": self.residual_std_}

    @property
    def is_refitted(self) -> bool:
        """Whether it was transferred to a new set-up."""
        known = self.training_.known
        return bool(len(self.refit_reading_ids_) or (known is not None and known.n_refit))

    @property
    def n_effective_(self) -> float:
        """Coefficients that the readings determine."""
        return sum(group.effective for group in self.fit_.groups)

    def _fit_weighted(self, readings: Session, weight: FloatArray) -> Self:
        """Learn from weighted points: some fits, as a point's variance is its own plus that of the noise.

        With weights w of which the largest is 1, a point states the variance ``s^2 (1/w - 1)``, where s^2 is the
        weighted mean square ``mean(w r^2)`` of the residuals before. With noise of s^2 the sum is ``s^2 / w``.
        """
        rows = np.flatnonzero(weight > 0)
        readings, excess = readings.rows(rows), weight.max(initial=0.0) / weight[rows] - 1
        check_readings_of(self._checked_arm(), readings)
        self.learn(self.prepare(readings))
        for _ in range(WEIGHT_ROUNDS if excess.any() else 0):
            used = self.fit_.references[0].robust_weight > 0
            noise = np.sqrt((self.fit_.references[0].residuals ** 2 / (1 + excess))[:, used].mean())
            std = np.maximum(noise * np.sqrt(excess), LEAST_STD_MM)
            # Checked before: these uncertainties are stated by no person, and may exceed the scatter by far.
            data = self.prepare(replace(readings, point_std=np.repeat(std[:, None], 3, axis=1)))
            self._set_conditions(data)
            placed = self._place(data)
            self.nominal_ = placed.fit
            self._fit(data, placed, None, no_progress)
            self._keep_rounding(data)
        return self.judged()

    def _has_thermal_terms(self) -> bool:
        return any(isinstance(term.basis, Temperature) for term in self.fit_.perturbed_chain.terms)

    def _tips(self, state: ArmState) -> FloatArray:
        return self.fit_.tips(state)

    def _covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, FloatArray]:
        return self._tips_and_covariance_parts(at)[1]

    def _tips_and_covariance_parts(self, at: CheckedReadings) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        share = self.variance_function_.share(at.session.angles) * self.share_of_mean(at.session)
        unexplained = self.residual_std_**2 * share
        tips, of_parameters, of_directions = self.fit_.uncertain_tips(at.state)
        effects = {DIRECTIONS: of_directions, **self._unstated_input_effects(at)}
        unstated = _covariances_of(effects).values()
        return tips, (of_parameters, sum(unstated, unexplained[:, None, None] * np.eye(3)))

    def _shared_displacements(self, at: CheckedReadings) -> FloatArray:
        return self.fit_.tip_displacements(at.state)

    @one_blas_thread()
    def unstated_input_covariances(self, readings: ReadingsLike) -> dict[str, FloatArray]:
        """Tip covariance from inputs of the terms that the readings do not state, and from angles that are rounded.

        Temperature and further columns have their mean and variance in training; directions of movement are one or the
        other.

        Returns
        -------
        dict of str to (n, 3, 3) array
            By input the covariance of tips [mm^2], to first order.
        """
        at = self.checked(readings)
        return _covariances_of({DIRECTIONS: self.fit_.direction_effects(at.state), **self._unstated_input_effects(at)})

    def condition_displacements(self, readings: ReadingsLike) -> FloatArray:
        """Errors of predicted points from conditions: growth beyond the trained temperatures, inputs not stated.

        Returns
        -------
        (k, n, 3) array
            Displacements of the points by k independent causes of variance one, each the same at all readings [mm];
            directions of movement and rounding, which change from reading to reading, are not among them.
        """
        at = self.checked(readings)
        shared = (effect for name, effect in self._unstated_input_effects(at).items() if name != ROUNDED)
        return np.concatenate([self._expansion_displacements(at.session), *shared])

    def _unstated_input_effects(self, at: CheckedReadings) -> dict[str, FloatArray]:
        """By input but directions (k, n, 3) displacements by k independent causes of variance one [mm]."""
        fit, training, readings, state = self.fit_, self.training_, at.session, at.state
        effects: dict[str, FloatArray] = {}
        if fit.perturbed_chain.input_bases(state):
            if readings.temperature_degC is None and training.temperature_degC is not None:
                assert state.temperature_degC is not None  # the mean in training
                std = training.temperature_degC.std
                low, high = (state.at_temperature(state.temperature_degC + sign * std) for sign in (-1, 1))
                effects["temperature"] = half_tip_difference(fit, low, high)[None]
            for name in sorted(training.columns.keys() - readings.columns.keys()):
                values, std = state.columns[name], training.columns[name].std
                low, high = (replace(state, columns={**state.columns, name: values + sign * std}) for sign in (-1, 1))
                effects[name] = half_tip_difference(fit, low, high)[None]
        if (rounded := training.is_rounded(state.angles)).any():
            assert training.angle_std is not None
            effects[ROUNDED] = rounded[:, None] * tip_motions(fit.chain, state.angles, training.angle_std)
        return effects


def _covariances_of(effects: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """By input (n, 3, 3) of displacements (k, n, 3); without inputs that move no tip."""
    return {name: np.einsum("kni,knj->nij", effect, effect) for name, effect in sorted(effects.items()) if effect.any()}


def to_identified(model: object) -> IdentifiedModel | None:
    """The model itself, if terms alone describe the arm; None of a model with networks."""
    return model if isinstance(model, IdentifiedModel) else None


def require_identified(
    model: Compensator, why_not: str, *, hint: str, file: str | Path | None = None
) -> IdentifiedModel:
    """The model itself, if terms alone describe the arm.

    Raises
    ------
    InputError
        Of a model with networks: what is asked needs terms.
    """
    if isinstance(model, IdentifiedModel):
        return model
    raise InputError(why_not, file=file, hint=hint)


class NominalModel(IdentifiedModel):
    """The nominal kinematics; only base and tip are identified, as far as they are free.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` (place of the arm in the reference's frame) and ``"tip"`` (place of the tip on the flange)
        are unknown. With none, points are in the arm's base frame and the tip is nominal.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=20).session
    >>> model = ta.NominalModel(ta.load_arm("ur10")).fit(session.angles, session.points)
    >>> model.predict(session.angles).shape
    (20, 3)
    """

    kind: ClassVar[str] = "nominal"

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip")) -> None:
        self.arm = arm
        self.free = free

    def _identify(
        self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress
    ) -> Identification:
        del simpler, progress
        return identify_nominal(readings, placed)


class KinematicModel(IdentifiedModel):
    """The arm's true constants: six small motions after every joint, the base and the tip.

    More constants than any minimal parametrisation; combinations that are not identifiable stay near the nominal arm by
    a Gaussian prior, whose scales evidence determines. No list of fixed parameters is needed, and near-parallel axes
    need no special form.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown; the others have the prior of any constant of the arm.
    robust : bool
        Whether outliers have a smaller weight, for the nominal arm to compare with too.
    terms : sequence of Term
        Of the user's own (docs/terms.md), offered beside the constants.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40).session
    >>> model = ta.KinematicModel(ta.load_arm("ur10")).fit(session.angles, session.points)
    >>> points, covariances = model.predict(session.angles, return_cov=True)
    >>> points.shape, covariances.shape
    ((40, 3), (40, 3, 3))
    """

    kind: ClassVar[str] = "kinematic"

    def __init__(
        self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip"), robust: bool = True, terms: Sequence[Term] = ()
    ) -> None:
        self.arm = arm
        self.free = free
        self.robust = robust
        self.terms = terms

    def _identify(
        self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress
    ) -> Identification:
        terms = [*constants(readings.state.chain, free=readings.free), *self.terms]
        return identify_offered(readings, terms, (), self._known(placed, simpler), progress)


class PhysicalModel(IdentifiedModel):
    """The arm with every term that its readings can determine; evidence selects terms and their scales.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown; the others have the prior of any constant of the arm.
    highest : int
        Highest order of the harmonics offered about a joint's own axis.
    residual : bool
        Whether a residual process is offered (`truearm.identification.judgement.residual_process`).
    robust : bool
        Whether outliers have a smaller weight, for the nominal arm to compare with too.
    terms : sequence of Term
        Of the user's own (docs/terms.md), offered beside those of the catalogue.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40).session
    >>> model = ta.PhysicalModel(ta.load_arm("ur10"), highest=2).fit_readings(session)
    >>> model.predict_readings(session).shape
    (40, 3)
    """

    kind: ClassVar[str] = "physical"
    outside_note: ClassVar[str] = "; the uncertainty there is {u} mm"

    def __init__(
        self,
        arm: Arm,
        *,
        free: tuple[str, ...] = ("base", "tip"),
        highest: int = HIGHEST_ORDER_OFFERED,
        residual: bool = True,
        robust: bool = True,
        terms: Sequence[Term] = (),
    ) -> None:
        self.arm = arm
        self.free = free
        self.highest = highest
        self.residual = residual
        self.robust = robust
        self.terms = terms

    def _identify(
        self, readings: PreparedReadings, placed: Found, simpler: Compensator | None, progress: Progress
    ) -> Identification:
        return identify_physical(
            readings,
            self._known(placed, simpler),
            highest=int(self.highest),
            residual=bool(self.residual),
            further=self.terms,
            has_constants=simpler is not None and simpler.kind == "kinematic",
            progress=progress,
        )

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.highest, int | np.integer) and 1 <= self.highest <= HIGHEST_ORDER):
            raise InputError(f"expected a highest order from 1 to {HIGHEST_ORDER}, got {self.highest!r}")
        if not isinstance(self.residual, bool | np.bool_):
            raise InputError(f"expected residual as true or false, got {self.residual!r:.60}")
