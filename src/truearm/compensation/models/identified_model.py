"""Models whose arm is a chain of small motions, identified by `truearm.identification.estimation`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from truearm.compensation.models.compensator import MIN_ROWS, Compensator
from truearm.compensation.models.reading_references import references_of, state_of
from truearm.identification.estimation.cross_validation import birge_ratio, cross_validate_by_group
from truearm.identification.estimation.propagation import direction_effects, half_tip_difference
from truearm.identification.estimation.residual_variance import (
    VarianceFunction,
    conformal_residual_variance,
    fit_variance_function,
)
from truearm.identification.terms import ArmState, Constant, SkippedTerm, Term
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session
from truearm.typing import FloatArray, IntArray

# Readings in one seat, as many as there are, are held out in so many parts.
PARTS_OF_A_SEAT = 5


class IdentifiedModel(Compensator):
    """Base of the models that say with which terms the arm moves, and leave the rest to identification.

    Attributes
    ----------
    fit_ : IdentificationResult
        The identified chain and terms.
    excluded_terms_ : tuple of SkippedTerm
        Terms that the readings could not show, and why.
    held_out_ : HeldOutReadings
        The training readings as an arm sees them that was identified without their position or seat.
    residual_std_ : float
        Standard deviation of a coordinate that the model cannot explain [mm]: root mean square over the joint space.
    variance_function_ : VarianceFunction
        What share of its square readings at other angles have.
    birge_ratio_ : float
        By how much standard deviations of the first posterior are to be raised, by the readings held out of it (see
        `truearm.identification.estimation.cross_validation`).
    temperature_degC_, temperature_variance_K2_ : float or None
        Mean temperature of the training readings [degC], and its variance.
    columns_, column_variances_ : dict of str to float
        Means of their further columns, and variances.
    refit_reading_ids_ : (k,) array
        Marks of the readings from which base and tip were identified anew (`truearm.compensation.models.refit`); none by `fit`.
    """

    # Whether its terms are those of the nominal arm, which every model has beside its own.
    _is_nominal: ClassVar[bool] = False

    @abstractmethod
    def _terms(self, state: ArmState) -> tuple[list[Term], list[SkippedTerm]]:
        """The terms offered, with the free parts `free_`, and those that the readings cannot show."""

    def _identify(
        self,
        readings: Session,
        lengths: Lengths | None,
        progress: Callable[[int, str], None],
    ) -> None:
        self.temperature_degC_ = None if readings.temperature_degC is None else float(readings.temperature_degC.mean())
        self.temperature_variance_K2_ = (
            None if readings.temperature_degC is None else float(readings.temperature_degC.var())
        )
        self.columns_ = {name: float(values.mean()) for name, values in readings.columns.items()}
        self.column_variances_ = {name: float(values.var()) for name, values in readings.columns.items()}
        self.refit_reading_ids_ = np.zeros(0)
        progress(0, "terms")
        state = state_of(self.arm_, readings)
        terms, left_out = self._terms(state)
        if not readings.has_point.any():
            terms = [term for term in terms if not _places_the_frame(term)]
        references = references_of(readings, lengths)
        self.fit_ = (
            self.nominal_ if self._is_nominal else self._identify_terms(readings, state, terms, references, progress)
        )
        self.excluded_terms_ = tuple(left_out)
        self.held_out_ = cross_validate_by_group(
            self.fit_, state, references, cross_validation_groups(readings, self.session_frames_)
        )
        self._size_unexplained(readings.angles)
        self.birge_ratio_ = birge_ratio(self.fit_.references, self.held_out_.rows, self.residual_std_)

    def _size_unexplained(self, angles: FloatArray) -> None:
        noise_variance = self.fit_.references[0].noise_std ** 2
        held_out = self.held_out_.select_informative(self._own_variance(len(angles))[self.held_out_.rows])
        if len(held_out.rows) >= MIN_ROWS:
            self.variance_function_ = fit_variance_function(held_out, angles)
            share = self.variance_function_.share(angles[held_out.rows])
            variance = conformal_residual_variance(replace(held_out, freedom=share * held_out.freedom))
            if len(held_out.rows) < len(self.held_out_.rows):  # few may be left, and those the best known
                variance = max(variance, noise_variance)
        else:
            self.variance_function_ = VarianceFunction.flat(angles.shape[1])
            variance = noise_variance
        self.residual_std_ = float(np.sqrt(variance))

    def _own_variance(self, n: int) -> FloatArray:
        """(n,) variance of a coordinate by noise and reference, of readings with points and those in seats [mm^2]."""
        own = np.zeros(n)
        for part in reversed(self.fit_.references):  # points come first, and judge where there are both
            if part.kind in ("point", "seat"):
                own[part.rows] = part.noise_std**2 + (part.std**2).mean(axis=0)
        return own

    def state(self, readings: Session) -> ArmState:
        """State of the arm at readings, as far as the model knows what it does.

        Where they have no temperature or load it is that of the training readings on average; where they have no
        directions of movement, half way between the two. `unstated_input_covariances` tells what that leaves open.
        """
        return state_of(
            self.arm_,
            self._with_known_sessions(readings),
            temperature_degC=self.temperature_degC_,
            columns=self.columns_,
            direction=0.0,
        )

    def _tips(self, readings: Session) -> FloatArray:
        return self.fit_.tips(self.state(readings))

    def _covariance_parts(self, readings: Session) -> tuple[FloatArray, FloatArray]:
        of_parameters = self.fit_.tip_covariance(self.state(readings))
        unexplained = self.residual_std_**2 * self.variance_function_.share(readings.angles)
        return of_parameters, sum(
            self.unstated_input_covariances(readings).values(), unexplained[:, None, None] * np.eye(3)
        )

    def unstated_input_covariances(self, readings: Session) -> dict[str, FloatArray]:
        """Give what the terms depend on and readings do not state, and how uncertain that makes the tips.

        Temperature and further columns are known by their means and variances at the training readings, directions of
        movement are one or the other.

        Returns
        -------
        dict of str to (n, 3, 3) array
            By name the covariance of tips [mm^2], to first order.
        """
        state, fit = self.state(readings), self.fit_
        effects = {"directions of movement": direction_effects(fit, state)}
        if readings.temperature_degC is None and state.temperature_degC is not None:
            std = np.sqrt(self.temperature_variance_K2_ or 0.0)
            low, high = (replace(state, temperature_degC=state.temperature_degC + way * std) for way in (-1, 1))
            effects["temperature"] = half_tip_difference(fit, low, high)[None]
        for name in self.columns_.keys() - readings.columns.keys():
            values, std = state.columns[name], np.sqrt(self.column_variances_[name])
            low, high = (replace(state, columns={**state.columns, name: values + way * std}) for way in (-1, 1))
            effects[name] = half_tip_difference(fit, low, high)[None]
        return {
            name: np.einsum("kni,knj->nij", effect, effect) for name, effect in sorted(effects.items()) if effect.any()
        }

    def _check_references(self, readings: Session, lengths: Lengths | None) -> int:
        return len(np.unique(np.concatenate([reference.rows for reference in references_of(readings, lengths)])))


def _places_the_frame(term: Term) -> bool:
    """Whether a constant only says where the arm's frame is: its base, and zero and height of joint 1.

    Seats and lengths tell how points lie to one another. The frame is then the arm's own, with the axis and zero of
    joint 1 as drawn (L. J. Everett, T.-W. Hsu, "The theory of kinematic parameter identification for industrial
    robots", J. Dyn. Sys. Meas. Control 110 (1988) 96, on what a choice of frames leaves to identify).
    """
    along_own_axis = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return isinstance(term.basis, Constant) and (
        term.place == 0 or (term.place == 1 and term.direction in along_own_axis)
    )


def cross_validation_groups(readings: Session, sessions: Iterable[str] = ()) -> IntArray:
    """(n,) numbers of the groups that a fair test keeps together.

    A reading's group is its position; where it names none, its seat; else it is its own. What would put all readings
    into one group counts for nothing, nor does what would put all points of one of `sessions` into one, those that have
    a frame of their own: nothing else would tell it. Readings of a single seat are parted in `PARTS_OF_A_SEAT`, as they
    follow each other.
    """
    n = len(readings)
    group = np.arange(n)
    in_one_frame = [(readings.session == name) & readings.has_point for name in sessions]
    for start, names in ((n, readings.seat), (2 * n, readings.position)):
        if names is not None:
            named = np.where(names != "", start + np.unique(names, return_inverse=True)[1], group)
            for rows in (np.ones(n, dtype=bool), *in_one_frame):
                if len(np.unique(named[rows])) == 1:
                    named[rows] = group[rows]
            group = named
    if readings.seat is not None and not readings.has_point.any():
        seats, counts = np.unique(readings.seat[readings.seat != ""], return_counts=True)
        if (counts > 1).sum() == 1 and (readings.position is None or len(np.unique(readings.position)) == 1):
            held = np.flatnonzero(readings.seat == seats[np.argmax(counts)])
            group[held] = 3 * n + np.arange(len(held)) * PARTS_OF_A_SEAT // len(held)
    return np.unique(group, return_inverse=True)[1].astype(np.intp)
