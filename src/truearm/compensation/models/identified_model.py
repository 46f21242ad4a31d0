"""The identified models: nominal, kinematic, physical. They differ in the terms that they offer to identification."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.compensation.models.compensator import Compensator, no_progress
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.propagation import direction_effects, half_tip_difference
from truearm.identification.estimation.residual_variance import (
    NONE_HELD_OUT,
    VarianceFunction,
)
from truearm.identification.identify import (
    Identification,
    identify_nominal,
    identify_offered,
    identify_physical,
    place_without_gross_errors,
)
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.judgement.residual_process import ResidualProcess
from truearm.identification.judgement.tails import ellipsoid_factor
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.reading_references import references_of, state_of
from truearm.identification.terms import ArmState, SkippedTerm, Term, constants
from truearm.identification.terms.basis import HIGHEST_ORDER, Temperature
from truearm.identification.terms.catalogue import HIGHEST_ORDER_OFFERED
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Fits of weighted points after the first: the noise changes by some per cent in the first of them.
WEIGHT_ROUNDS = 2
# Standard uncertainty of a point that states none [mm]: a session states one of every point, or of none.
LEAST_STD_MM = 1e-6


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

    terms: Sequence[Term] = ()

    _place = staticmethod(place_without_gross_errors)

    @abstractmethod
    def _identify(
        self, readings: PreparedReadings, simpler: Compensator | None, progress: Callable[[int, str], None]
    ) -> Identification:
        """What the readings say of the arm, by the terms of this model."""

    def _fit(self, data: PreparedReadings, simpler: Compensator | None, progress: Callable[[int, str], None]) -> None:
        progress(0, "terms")
        found = self._identify(data, simpler, progress)
        self.fit_, self.excluded_terms_ = found.fit, found.excluded_terms
        self.held_out_, self.held_out_distances_ = found.held_out, found.held_out_distances
        self.held_out_errors_, self.birge_ratio_ = found.held_out_errors, found.birge_ratio
        self.residual_std_ = found.unexplained.residual_std_mm
        self.variance_function_ = found.unexplained.variance_function
        self.tail_freedom_ = found.unexplained.tail_freedom
        self.residual_process_, self.refit_reading_ids_ = found.residual_process, np.zeros(0)

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.terms, Sequence) and all(isinstance(term, Term) for term in self.terms)):
            raise InputError(f"expected a sequence of terms, got {self.terms!r:.60}", hint="docs/terms.md shows one")
        for term in self.terms:
            term.check_place(self.arm.chain)

    def _known(self, simpler: Compensator | None) -> list[IdentificationResult]:
        """Arms that were identified from the same readings before."""
        return [self.nominal_, *([simpler.fit_] if isinstance(simpler, IdentifiedModel) else [])]

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
            self.nominal_ = self._place(data)
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

    def condition_displacements(self, readings: Session) -> FloatArray:
        """Errors of predicted points from conditions: growth beyond the trained temperatures, inputs not stated.

        Returns
        -------
        (k, n, 3) array
            Displacements of the points by k independent causes of variance one, each the same at all readings [mm];
            directions of movement, which change from reading to reading, are not among them.
        """
        self._check_session(readings)
        effects = self._unstated_input_effects(readings, self.state(readings))
        del effects["directions of movement"]
        return np.concatenate([self._expansion_displacements(readings), *effects.values()])

    def _unstated_input_covariances(self, readings: Session, state: ArmState) -> dict[str, FloatArray]:
        effects = self._unstated_input_effects(readings, state)
        return {
            name: np.einsum("kni,knj->nij", effect, effect) for name, effect in sorted(effects.items()) if effect.any()
        }

    def _unstated_input_effects(self, readings: Session, state: ArmState) -> dict[str, FloatArray]:
        """By input (k, n, 3) displacements by k independent causes of variance one [mm]."""
        fit, training = self.fit_, self.training_
        effects = {"directions of movement": direction_effects(fit, state)}
        if readings.temperature_degC is None and training.temperature_degC is not None:
            assert state.temperature_degC is not None  # the mean in training
            std = training.temperature_degC.std
            low, high = (state.at_temperature(state.temperature_degC + sign * std) for sign in (-1, 1))
            effects["temperature"] = half_tip_difference(fit, low, high)[None]
        for name in sorted(training.columns.keys() - readings.columns.keys()):
            values, std = state.columns[name], training.columns[name].std
            low, high = (replace(state, columns={**state.columns, name: values + sign * std}) for sign in (-1, 1))
            effects[name] = half_tip_difference(fit, low, high)[None]
        return effects

    def _check_references(self, readings: Session, lengths: Lengths | None) -> int:
        return len(np.unique(np.concatenate([reference.rows for reference in references_of(readings, lengths)])))


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
        self, readings: PreparedReadings, simpler: Compensator | None, progress: Callable[[int, str], None]
    ) -> Identification:
        del simpler, progress
        return identify_nominal(readings, self.nominal_)


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
        self,
        arm: Arm,
        *,
        free: tuple[str, ...] = ("base", "tip"),
        robust: bool = True,
        terms: Sequence[Term] = (),
    ) -> None:
        self.arm = arm
        self.free = free
        self.robust = robust
        self.terms = terms

    def _identify(
        self, readings: PreparedReadings, simpler: Compensator | None, progress: Callable[[int, str], None]
    ) -> Identification:
        terms = [*constants(readings.state.chain, free=readings.free), *self.terms]
        return identify_offered(readings, terms, (), self._known(simpler), progress)


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
        self, readings: PreparedReadings, simpler: Compensator | None, progress: Callable[[int, str], None]
    ) -> Identification:
        return identify_physical(
            readings,
            self._known(simpler),
            highest=int(self.highest),
            residual=bool(self.residual),
            further=self.terms,
            has_constants=isinstance(simpler, KinematicModel),
            progress=progress,
        )

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.highest, int | np.integer) and 1 <= self.highest <= HIGHEST_ORDER):
            raise InputError(f"expected a highest order from 1 to {HIGHEST_ORDER}, got {self.highest!r}")
        if not isinstance(self.residual, bool | np.bool_):
            raise InputError(f"expected residual as true or false, got {self.residual!r:.60}")
