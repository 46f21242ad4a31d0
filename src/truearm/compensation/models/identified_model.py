"""The identified models: nominal, kinematic, physical. They differ in the terms that they offer to identification."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar, Self, TypeAlias

import numpy as np

from truearm.arm.arm import Arm
from truearm.compensation.models.compensator import MIN_ROWS, Compensator, no_progress
from truearm.errors import InputError
from truearm.identification.estimation.expected_error import expected_square_error
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.propagation import direction_effects, half_tip_difference
from truearm.identification.estimation.reference_scale import response_to_point_errors, with_shared_error
from truearm.identification.estimation.residual_variance import (
    LEAST_FREEDOM,
    HeldOutReadings,
    VarianceFunction,
    conformal_residual_variance,
    few_readings_factor,
    fit_variance_function,
)
from truearm.identification.judgement.cross_validation import IN_LENGTH, birge_ratio, cross_validate_by_group
from truearm.identification.judgement.cross_validation_groups import (
    cross_validation_groups,
    is_in_one_place,
    joint_space_regions,
)
from truearm.identification.judgement.day_to_day import day_to_day_terms, on_another_day
from truearm.identification.judgement.expansion_prior import (
    at_mean_temperature,
    with_material_prior,
    with_unlearned_terms,
)
from truearm.identification.judgement.gross_errors import (
    LEAST_READINGS,
    excluded_readings,
    has_gross_errors,
    identify_without_gross_errors,
    median_distance,
    nearer_half,
    own_variance,
)
from truearm.identification.judgement.held_out_errors import NONE_HELD_OUT, HeldOutErrors, select_determined
from truearm.identification.judgement.residual_process import ResidualProcess, add_residual_process, with_unspanned
from truearm.identification.judgement.tails import ellipsoid_factor, tail_freedom
from truearm.identification.planning.sampling import uniform
from truearm.identification.references.reading_references import references_of, state_of
from truearm.identification.references.references import Reference
from truearm.identification.references.session_frames import places_the_frame
from truearm.identification.references.training_data import TrainingData
from truearm.identification.terms import ArmState, Constant, InSession, SkippedTerm, Term, candidate_terms, constants
from truearm.identification.terms.basis import HIGHEST_ORDER, Temperature
from truearm.identification.terms.catalogue import HIGHEST_ORDER_OFFERED, JOINT_COMPLIANCE, unlearned_terms
from truearm.readings.lengths import Lengths
from truearm.readings.reference_uncertainty import scale_errors
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Share of the error at held-out readings of one place that all terms together may leave: with three quarters of its
# variance explained, little remains that could be different elsewhere.
MAX_SHARE_LEFT = 0.5
# Share of the expected squared error over the workspace that the compliance of joints must not exceed: a gain of a few
# per cent is within what this estimate is good for.
MAX_EXPECTED_SHARE = 0.9
# Poses drawn within the limits of the joints for the expected error over the workspace.
WORKSPACE_POSES = 200
# Share of the median distance of the nominal arm below which that of a fit to the nearer half shows that gross errors
# drew the arm to themselves.
MAX_TRIMMED_SHARE = 0.5
# Fits of weighted points after the first: the noise changes by some per cent in the first of them.
WEIGHT_ROUNDS = 2
# Standard uncertainty of a point that states none [mm]: a session states one of every point, or of none.
LEAST_STD_MM = 1e-6

# Weights (n,) of the readings to start from, and an arm if one is known.
Start: TypeAlias = tuple[FloatArray, IdentificationResult | None]


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
    held_out_distances_ : HeldOutReadings
        Likewise distances, where `held_out_` are points or seats; empty where it is of distances itself.
    held_out_errors_ : HeldOutErrors or None
        Their errors in short; None where no readings could be held out.
    residual_std_ : float
        Standard deviation of a coordinate that the model does not explain [mm]: root mean square over the joint space.
    variance_function_ : VarianceFunction
        Share of its square at other angles.
    birge_ratio_ : float
        Factor by which standard deviations of the posterior are raised, from the readings held out (see
        `truearm.identification.judgement.cross_validation`).
    tail_freedom_ : float
        Degrees of freedom of the tails of the held-out deviations (`truearm.identification.judgement.tails`); infinite
        where they are too few, and of models from older files.
    residual_process_ : ResidualProcess or None
        What is known of the residual process; None where the model has none, and had none before a transfer.
    refit_reading_ids_ : (k,) array
        Identifiers of the readings from which base and tip were re-identified (`refit`); none by `fit`.
    """

    fit_: IdentificationResult
    excluded_terms_: tuple[SkippedTerm, ...]
    held_out_errors_: HeldOutErrors | None
    residual_std_: float
    variance_function_: VarianceFunction
    birge_ratio_: float
    tail_freedom_: float = float("inf")
    refit_reading_ids_: FloatArray
    residual_process_: ResidualProcess | None = None

    held_out_distances_ = NONE_HELD_OUT
    # Whether its terms are those of the nominal arm, which every model has beside its own.
    _is_nominal: ClassVar[bool] = False

    @abstractmethod
    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        """The terms offered, with the free parts `free_`, and those that the readings cannot show."""

    def _fit(self, data: TrainingData, simpler: Compensator | None, progress: Callable[[int, str], None]) -> None:
        # Lengths are those at the mean temperature of the readings; `_with_unlearned` takes them to 20 degC.
        data = data._replace(state=at_mean_temperature(data.state))
        self.refit_reading_ids_, self.residual_process_ = np.zeros(0), None
        progress(0, "terms")
        if self._is_nominal:
            self.fit_, self.excluded_terms_ = self.nominal_, ()
            held_out = self._cross_validate(data, self.fit_)
        else:
            terms, excluded = self._terms(data.state)
            terms += day_to_day_terms(self.arm_.chain, self.session_frames_)
            self.excluded_terms_ = tuple(excluded)
            self.fit_, held_out = self._identify_offered(data, terms, self._start(data, simpler), progress)
        is_excluded = np.isin(held_out.rows, excluded_readings(self.fit_))
        self.held_out_ = held_out.select(~is_excluded)
        if held_out.n_coordinates > 1 and any(part.kind == "distance" for part in data.references):
            found = self._cross_validate(data, self.fit_, IN_LENGTH)
            self.held_out_distances_ = select_determined(found, self.fit_.references)
        self._estimate_residual_variance(data.session.angles)
        self.birge_ratio_ = birge_ratio(self.fit_.references, self.held_out_.rows, self.residual_std_)
        self.held_out_ = select_determined(self.held_out_, self.fit_.references)
        self.held_out_errors_ = HeldOutErrors.of(self.held_out_, n_excluded=int(is_excluded.sum()))
        errors = scale_errors(data.session, is_frame_free="base" in self.free_)
        scale = response_to_point_errors(self.fit_, data.state, errors)
        widened = self._widen_for_few_readings(data.references)
        if not self._is_nominal:
            self.fit_ = on_another_day(self.fit_)
        state = state_of(self.arm_, data.session)
        self.fit_ = with_shared_error(self._with_unlearned(self.fit_, state, widened), scale)

    def _with_unlearned(self, fit: IdentificationResult, state: ArmState, widened: float) -> IdentificationResult:
        """The result at true temperatures, with what the readings left open of the terms of this model."""
        del state, widened
        return fit

    def _identify_offered(
        self, data: TrainingData, terms: list[Term], start: Start, progress: Callable[[int, str], None]
    ) -> tuple[IdentificationResult, HeldOutReadings]:
        """Identify the terms offered; a model may try fewer."""
        return self._identify_without_gross_errors(data, terms, *start, progress)

    def _widen_for_few_readings(self, references: Sequence[Reference]) -> float:
        """Allow for a noise that few residuals determine only roughly; the factor of the covariance."""
        factor = few_readings_factor(self.fit_.residual_freedom(references))
        self.residual_std_ *= float(np.sqrt(factor))
        self.fit_ = replace(self.fit_, covariance=factor * self.fit_.covariance)
        return factor

    def _fit_nominal(self, data: TrainingData) -> IdentificationResult:
        nominal = super()._fit_nominal(data)
        if not self.robust:
            return nominal
        terms = constants(self.arm_.chain, free=self.free_, angle_std=0.0, length_std=0.0)
        weights = nearer_half(nominal, len(data.session))
        trimmed = nominal
        if not weights.all():
            trimmed = self._identify_terms(data, terms, data.references, reading_weights=weights)
        if median_distance(trimmed) < MAX_TRIMMED_SHARE * median_distance(nominal):
            weights = nearer_half(trimmed, len(data.session))
        elif has_gross_errors(nominal, self._cross_validate(data, nominal)):
            weights = np.ones(len(data.session))
        else:
            return nominal
        return self._identify_without_gross_errors(data, terms, weights)[0]

    def _start(self, data: TrainingData, simpler: Compensator | None) -> Start:
        """(n,) weights to start from: 0 for the gross errors of simpler models, which may come back. And an arm."""
        weights = np.ones(len(data.session))
        weights[excluded_readings(self.nominal_)] = 0.0
        if isinstance(simpler, IdentifiedModel):
            weights[excluded_readings(simpler.fit_)] = 0.0
        return weights, None

    def _identify_without_gross_errors(
        self,
        data: TrainingData,
        terms: list[Term],
        weights: FloatArray,
        start: IdentificationResult | None = None,
        progress: Callable[[int, str], None] | None = None,
    ) -> tuple[IdentificationResult, HeldOutReadings]:
        if not data.session.has_point.any():
            terms = [term for term in terms if not places_the_frame(term)]
        if not self.robust:
            fit = self._identify_terms(data, terms, data.references, progress, start=start)
            return fit, self._cross_validate(data, fit)

        def identify(weights: FloatArray) -> IdentificationResult:
            return self._identify_terms(data, terms, data.references, progress, weights, start)

        return identify_without_gross_errors(identify, partial(self._cross_validate, data), weights)

    def _cross_validate(
        self, data: TrainingData, fit: IdentificationResult, kinds: Sequence[str] | None = None
    ) -> HeldOutReadings:
        if is_in_one_place(data.session, data.state):
            groups = joint_space_regions(data.session.angles, data.state.chain)
        else:
            groups = cross_validation_groups(data.session, self.session_frames_)
        held_out = cross_validate_by_group(fit, data.state, data.references, groups, kinds)
        return with_unspanned(held_out, fit, data.state)

    def _estimate_residual_variance(self, angles: FloatArray) -> None:
        references = self.fit_.references
        noise_variance = references[0].noise_std ** 2
        held_out = self.held_out_.select_informative(own_variance(references, self.held_out_.rows))
        self.tail_freedom_ = float("inf")
        if len(held_out.rows) >= MIN_ROWS:
            self.variance_function_ = fit_variance_function(held_out, angles)
            share = self.variance_function_.share(angles[held_out.rows])
            scaled = replace(held_out, freedom=share * held_out.freedom)
            # Of few readings all may lie within the uncertainty of the parameters, which itself rests on the noise.
            variance = max(conformal_residual_variance(scaled), noise_variance)
            if len(held_out.rows) >= LEAST_READINGS:
                self.tail_freedom_ = tail_freedom(scaled, variance)
        else:
            self.variance_function_ = VarianceFunction.flat(angles.shape[1])
            variance = noise_variance
        self.residual_std_ = float(np.sqrt(variance))

    def ellipsoid_factor(self, level: float) -> float:
        """See `Compensator.ellipsoid_factor`: beyond 95 % as much larger as the held-out readings scatter farther."""
        return ellipsoid_factor(level, freedom=self.tail_freedom_)

    def _fit_weighted(self, readings: Session, weight: FloatArray) -> Self:
        """Learn from weighted points: some fits, as a point's variance is its own plus that of the noise.

        With weights w of which the largest is 1, a point states the variance ``s^2 (1/w - 1)``, where s^2 is the
        weighted mean square ``mean(w r^2)`` of the residuals before. With noise of s^2 the sum is ``s^2 / w``.
        """
        rows = np.flatnonzero(weight > 0)
        readings, excess = readings.rows(rows), weight.max(initial=0.0) / weight[rows] - 1
        self.fit_readings(readings)
        for _ in range(WEIGHT_ROUNDS if excess.any() else 0):
            used = self.fit_.references[0].robust_weight > 0
            noise = np.sqrt((self.fit_.references[0].residuals ** 2 / (1 + excess))[:, used].mean())
            std = np.maximum(noise * np.sqrt(excess), LEAST_STD_MM)
            # Checked before: these uncertainties are stated by no person, and may exceed the scatter by far.
            data = self._prepare(self.arm_, replace(readings, point_std=np.repeat(std[:, None], 3, axis=1)))
            self.nominal_ = self._fit_nominal(data)
            self._fit(data, None, no_progress)
        return self

    def state(self, readings: Session) -> ArmState:
        """State of the arm at readings, as far as the model's terms depend on it.

        Temperatures and loads that the readings do not state are the mean of the training; directions of movement are
        half way between the two. `unstated_input_covariances` has the uncertainty of that.
        """
        temperature = self.training_.temperature_degC
        return state_of(
            self.arm_,
            self._with_known_sessions(readings),
            temperature_degC=None if temperature is None else temperature.mean,
            columns={name: known.mean for name, known in self.training_.columns.items()},
            direction=0.0,
        )

    def _has_thermal_terms(self) -> bool:
        return any(isinstance(term.basis, Temperature) for term in self.fit_.perturbed_chain.terms)

    def _tips(self, readings: Session) -> FloatArray:
        return self.fit_.tips(self.state(readings))

    def _covariance_parts(self, readings: Session) -> tuple[FloatArray, FloatArray]:
        state = self.state(readings)
        of_parameters = self.fit_.tip_covariance(state)
        unexplained = self.residual_std_**2 * self.variance_function_.share(readings.angles)
        return of_parameters, sum(
            self._unstated_input_covariances(readings, state).values(), unexplained[:, None, None] * np.eye(3)
        )

    def _shared_displacements(self, readings: Session) -> FloatArray:
        return self.fit_.tip_displacements(self.state(readings))

    @one_blas_thread()
    def unstated_input_covariances(self, readings: Session) -> dict[str, FloatArray]:
        """Tip covariance from inputs of the terms that the readings do not state.

        Temperature and further columns have their mean and variance in training; directions of movement are one or the
        other.

        Returns
        -------
        dict of str to (n, 3, 3) array
            By input the covariance of tips [mm^2], to first order.
        """
        return self._unstated_input_covariances(readings, self.state(readings))

    def _unstated_input_covariances(self, readings: Session, state: ArmState) -> dict[str, FloatArray]:
        fit, training = self.fit_, self.training_
        effects = {"directions of movement": direction_effects(fit, state)}
        if readings.temperature_degC is None and training.temperature_degC is not None:
            assert state.temperature_degC is not None  # the mean in training
            std = training.temperature_degC.std
            low, high = (state.at_temperature(state.temperature_degC + sign * std) for sign in (-1, 1))
            effects["temperature"] = half_tip_difference(fit, low, high)[None]
        for name in training.columns.keys() - readings.columns.keys():
            values, std = state.columns[name], training.columns[name].std
            low, high = (replace(state, columns={**state.columns, name: values + sign * std}) for sign in (-1, 1))
            effects[name] = half_tip_difference(fit, low, high)[None]
        return {
            name: np.einsum("kni,knj->nij", effect, effect) for name, effect in sorted(effects.items()) if effect.any()
        }

    def _check_references(self, readings: Session, lengths: Lengths | None) -> int:
        return len(np.unique(np.concatenate([reference.rows for reference in references_of(readings, lengths)])))


def _typical_error(held_out: HeldOutReadings) -> float:
    """Median error [mm], which gross errors hardly change."""
    return float(np.median(held_out.errors_mm)) if len(held_out.rows) else float("inf")


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

    _is_nominal: ClassVar[bool] = True

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip")) -> None:
        self.arm = arm
        self.free = free

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return constants(state.chain, free=self.free_, angle_std=0.0, length_std=0.0), []


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

    def __init__(self, arm: Arm, *, free: tuple[str, ...] = ("base", "tip"), robust: bool = True) -> None:
        self.arm = arm
        self.free = free
        self.robust = robust

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return constants(state.chain, free=self.free_), []


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

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40).session
    >>> model = ta.PhysicalModel(ta.load_arm("ur10"), highest=2).fit_readings(session)
    >>> model.predict_readings(session).shape
    (40, 3)
    """

    kind: ClassVar[str] = "physical"

    def __init__(
        self,
        arm: Arm,
        *,
        free: tuple[str, ...] = ("base", "tip"),
        highest: int = HIGHEST_ORDER_OFFERED,
        residual: bool = True,
        robust: bool = True,
    ) -> None:
        self.arm = arm
        self.free = free
        self.highest = highest
        self.residual = residual
        self.robust = robust

    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        return candidate_terms(state, free=self.free_, highest=int(self.highest))

    def _identify_offered(
        self, data: TrainingData, terms: list[Term], start: Start, progress: Callable[[int, str], None]
    ) -> tuple[IdentificationResult, HeldOutReadings]:
        """All terms; from readings of one place those that are likely to hold elsewhere.

        What a term explains in one place need not be its own: harmonics, wobble and bending share it in a way that fits
        nowhere else. All are kept if they explain most of the error there. Otherwise the compliance of joints is tried
        alone: it has few coefficients, and is the same everywhere (A. Klimchik, B. Furet, S. Caro, A. Pashkevich,
        "Identification of the manipulator stiffness model parameters in industrial environment", Mech. Mach. Theory 90
        (2015) 1). It is kept if the expected error over the whole workspace is smaller with it.
        """
        everything = super()._identify_offered(data, terms, start, progress)
        rigid_terms = [term for term in terms if isinstance(term.basis, Constant | InSession | Temperature)]
        if everything[0].residual_freedom(data.references) < LEAST_FREEDOM:
            # The terms pass through the readings: neither their sizes nor the noise mean anything.
            self.excluded_terms_ += (SkippedTerm("terms that depend on the pose", "there are too few readings"),)
            return super()._identify_offered(data, rigid_terms, start, progress)
        if not is_in_one_place(data.session, data.state):
            if self.residual:
                everything, self.residual_process_ = add_residual_process(
                    everything, data, self.session_frames_, partial(self._cross_validate, data), robust=self.robust
                )
            return everything
        elastic_terms = [*rigid_terms, *(term for term in terms if term.group == JOINT_COMPLIANCE)]
        rigid = super()._identify_offered(data, rigid_terms, start, progress)
        if _typical_error(everything[1]) <= MAX_SHARE_LEFT * _typical_error(rigid[1]):
            return everything
        elastic = super()._identify_offered(data, elastic_terms, start, progress)
        poses = uniform(self.arm_, WORKSPACE_POSES, seed=0, slides=self.training_.angle_ranges)
        state = at_mean_temperature(self.state(Session(poses.angles)))
        least = MAX_EXPECTED_SHARE * expected_square_error(rigid[0], state)
        is_better = expected_square_error(elastic[0], state) < least
        what = "terms other than joint compliance" if is_better else "terms that depend on the pose"
        self.excluded_terms_ += (SkippedTerm(what, "readings of one place do not show whether they hold elsewhere"),)
        return elastic if is_better else rigid

    def _start(self, data: TrainingData, simpler: Compensator | None) -> Start:
        """From the arm's constants alone: with all terms, some gross errors could explain each other."""
        weights, _ = super()._start(data, simpler)
        if not self.robust or isinstance(simpler, KinematicModel):
            return weights, None
        rigid, _ = self._identify_without_gross_errors(data, constants(data.state.chain, free=self.free_), weights)
        weights[excluded_readings(rigid)] = 0.0
        return weights, rigid

    def _with_unlearned(self, fit: IdentificationResult, state: ArmState, widened: float) -> IdentificationResult:
        if state.temperature_degC is not None:
            fit = with_material_prior(fit, state.temperature_degC, widened=widened)
        return with_unlearned_terms(fit, unlearned_terms(state))

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.highest, int | np.integer) and 1 <= self.highest <= HIGHEST_ORDER):
            raise InputError(f"expected a highest order from 1 to {HIGHEST_ORDER}, got {self.highest!r}")
        if not isinstance(self.residual, bool | np.bool_):
            raise InputError(f"expected residual as true or false, got {self.residual!r:.60}")
