"""Models whose arm is a chain of small motions, identified by `truearm.identify`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.identify.alignment import placed_roughly
from truearm.identify.calibration import HeldOut, unexplained_variance_of
from truearm.identify.identification import Identified, identify
from truearm.models.compensator import MIN_ROWS, Compensator
from truearm.models.relations import references_of, state_of
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Readings
from truearm.terms import ArmState, LeftOut, Term

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class IdentifiedModel(Compensator):
    """Base of the models that say with which terms the arm moves, and leave the rest to identification.

    Attributes
    ----------
    fit_ : Identified
        The identified chain and terms.
    left_out_ : tuple of LeftOut
        Terms that the readings could not show, and why.
    held_out_ : HeldOut or None
        The training readings as models saw them that did not learn from them; None with fewer than two groups.
    unexplained_std_ : float
        Standard deviation of a coordinate that the model cannot explain [mm].
    temperature_degC_ : float or None
        Mean temperature of the training readings [degC].
    columns_ : dict of str to float
        Means of their further columns.
    """

    folds: int = 5

    @abstractmethod
    def _terms(self, state: ArmState) -> tuple[list[Term], list[LeftOut]]:
        """The terms offered, with the free parts `free_`, and those that the readings cannot show."""

    def _identify(
        self,
        readings: Readings,
        lengths: Lengths | None,
        progress: Callable[[int, str], None],
        checkpoint: Path | None,
    ) -> None:
        del checkpoint  # it is there in seconds
        self.temperature_degC_ = None if readings.temperature_degC is None else float(readings.temperature_degC.mean())
        self.columns_ = {name: float(values.mean()) for name, values in readings.columns.items()}
        parts = folds_of(readings, self.folds)
        steps = len(parts) + 1
        progress(0, "all readings")
        self.fit_, left_out = self._fitted(readings, lengths, lambda _, note: progress(0, note))
        self.left_out_ = tuple(left_out)
        found = []
        for number, (rows, group) in enumerate(parts, 1):
            said = f"held out, part {number} of {steps - 1}"
            progress(number, said)
            kept = np.setdiff1d(np.arange(len(readings)), rows)
            fit, _ = self._fitted(readings.rows(kept), lengths, _silent)
            found.append(self._held_out(fit, readings, rows, group))
        self.held_out_ = _joined(found)
        explained = self.fit_.references[0].noise_std ** 2
        variance = explained if self.held_out_ is None else unexplained_variance_of(self.held_out_)
        self.unexplained_std_ = float(np.sqrt(variance))
        progress(steps, f"unexplained: {self.unexplained_std_:.4f} mm")

    def _fitted(
        self, readings: Readings, lengths: Lengths | None, progress: Callable[[int, str], None]
    ) -> tuple[Identified, list[LeftOut]]:
        state = state_of(self.arm_, readings)
        terms, left_out = self._terms(state)
        chain = placed_roughly(self.arm_.chain, readings, self.free_)
        references = references_of(readings, lengths)
        return identify(chain, state, terms, references, robust=self.robust, progress=progress), left_out

    def _held_out(self, fit: Identified, readings: Readings, rows: IntArray, group: IntArray) -> HeldOut:
        """How a model sees readings it did not learn from."""
        part = readings.rows(rows)
        state = self._state(part)
        tips = fit.tips(state)
        seen = part.has_point
        deviations, freedom = np.zeros((len(rows), 3)), np.zeros(len(rows))
        covariance = fit.tip_covariance(state)
        if seen.any():
            assert part.points is not None
            deviations[seen] = tips[seen] - part.points[seen]
            freedom[seen] = 1.0
            if part.point_std is not None:
                covariance[seen] += part.point_std[seen][:, :, None] ** 2 * np.eye(3)
        if part.seat is not None:
            for name in np.unique(part.seat[~seen & (part.seat != "")]):
                held = np.flatnonzero((part.seat == name) & ~seen)
                if len(held) > 1:
                    deviations[held] = tips[held] - tips[held].mean(axis=0)
                    freedom[held] = 1 - 1 / len(held)
                    covariance[held] = _about_mean(fit, state.rows(held))
        judged = np.flatnonzero(freedom > 0)
        return HeldOut(rows[judged], group[judged], deviations[judged], covariance[judged], freedom[judged])

    def _state(self, readings: Readings) -> ArmState:
        return state_of(self.arm_, readings, temperature_degC=self.temperature_degC_, columns=self.columns_)

    def _tips(self, readings: Readings) -> FloatArray:
        return self.fit_.tips(self._state(readings))

    def _covariance_parts(self, readings: Readings) -> tuple[FloatArray, FloatArray]:
        of_parameters = self.fit_.tip_covariance(self._state(readings))
        return of_parameters, np.broadcast_to(self.unexplained_std_**2 * np.eye(3), of_parameters.shape)

    def _check_references(self, readings: Readings) -> None:
        references_of(readings, None)

    def _check_options(self) -> None:
        super()._check_options()
        if not (isinstance(self.folds, int | np.integer) and (self.folds == 0 or self.folds >= 2)):
            raise InputError(f"expected folds of 2 or more, or 0 for no readings held out, got {self.folds!r}")


def folds_of(readings: Readings, n: int) -> list[tuple[IntArray, IntArray]]:
    """Parts of the readings to hold out in turn, (rows, group of each); neighbours stay together.

    Groups are positions, where the readings name two or more; else seats, for readings in seats; else single readings.
    """
    if n < 2:
        return []
    group = np.arange(len(readings))
    for names in (readings.position, readings.seat):
        if names is not None and len(np.unique(names)) > 1:
            group = np.unique(names, return_inverse=True)[1]
            break
    n_groups = int(group.max()) + 1
    n = min(n, n_groups)
    dealt = np.random.default_rng(0).permutation(n_groups) % n
    parts = [np.flatnonzero(dealt[group] == part) for part in range(n)]
    if n < 2 or max(len(rows) for rows in parts) > len(readings) - MIN_ROWS:
        return []
    return [(rows, group[rows]) for rows in parts]


def _about_mean(fit: Identified, state: ArmState) -> FloatArray:
    """(n, 3, 3) covariance of tips about their own mean, by that of the coefficients [mm^2]."""
    columns = np.concatenate([by for _, _, by in fit.moved.derivatives(state, fit.coefficients)], axis=2)
    columns -= columns.mean(axis=2, keepdims=True)
    spread = (fit.covariance @ columns.reshape(len(columns), 3 * columns.shape[2])).reshape(columns.shape)
    return np.asarray(np.einsum("pin,pjn->nij", columns, spread))


def _joined(parts: list[HeldOut]) -> HeldOut | None:
    if sum(len(part.rows) for part in parts) < MIN_ROWS:
        return None
    names = ("rows", "group", "deviations", "covariance", "freedom")
    return HeldOut(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _silent(done: int, note: str) -> None:
    """Tell nobody."""
