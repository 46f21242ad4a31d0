"""Inputs of a network that describes what the constants of an arm leave over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.errors import InputError
from truearm.findings import Finding
from truearm.models.training_conditions import LEAST_TURN, TrainingConditions
from truearm.nets.perceptron import MinMaxScaler
from truearm.typing import BoolArray, FloatArray, IntArray

# An input with a smaller range does not vary [rad of an angle, its cosine or sine; mm].
LEAST_RANGE = 1e-6
# A temperature with a smaller share of its variance between consecutive readings follows their order: a network would
# learn when a reading was measured. Virtual warming arms have 0.0003 to 0.002 in 100 to 200 readings; in a random order
# it is 1, to two over the root of the number.
LEAST_SHARE_BETWEEN = 0.5


@dataclass(frozen=True, eq=False)
class ResidualInputs:
    """Cosine and sine of every angle, displacements, and the temperature, scaled to [-1, 1] over the training.

    The errors of a revolute joint repeat after a full turn; cosine and sine do too, angles do not. A joint that hardly
    moved in training is no input. Nor is a temperature that changed by less than thermometers differ, or one that
    follows the order of the readings (`follows_order`): it is a clock.

    Attributes
    ----------
    is_prismatic : (n_joints,) bool array
    kept : (k,) int array
        Which numbers of `_candidates` are inputs.
    scale : MinMaxScaler
        Of these.
    """

    is_prismatic: BoolArray
    kept: IntArray
    scale: MinMaxScaler

    @classmethod
    def of(cls, angles: FloatArray, temperature_degC: FloatArray | None, is_prismatic: BoolArray) -> Self:
        """Inputs of training readings.

        Parameters
        ----------
        angles : (n, n_joints) array
            [rad, or mm].
        temperature_degC : (n,) array or None
        is_prismatic : (n_joints,) bool array

        Raises
        ------
        InputError
            If no joint moved.
        """
        if not moves(angles, is_prismatic):
            raise InputError(
                "no joint moves by more than 1 degree in these readings: a network has nothing to learn from",
                hint="measure different poses",
            )
        of_joints = _of_joints(angles, is_prismatic)
        varies = (
            temperature_degC is not None
            and bool(np.ptp(temperature_degC) > TrainingConditions.temperature_tolerance_K)
            and not follows_order(temperature_degC)
        )
        candidates = _candidates(angles, temperature_degC, is_prismatic)
        kept = np.flatnonzero(np.append(of_joints, varies))
        return cls(is_prismatic, kept.astype(np.intp), MinMaxScaler.of(candidates[kept], what="input"))

    @property
    def n_inputs(self) -> int:
        """Number of inputs of the network."""
        return len(self.kept)

    @property
    def has_temperature(self) -> bool:
        """Whether the temperature is an input."""
        n_angles, n_slides = int((~self.is_prismatic).sum()), int(self.is_prismatic.sum())
        return bool((self.kept == 2 * n_angles + n_slides).any())

    def scaled(self, angles: FloatArray, temperature_degC: FloatArray | None) -> FloatArray:
        """(n_inputs, n) inputs of readings with angles (n, n_joints) [rad, or mm] and temperatures (n,)."""
        return self.scale.scale(_candidates(angles, temperature_degC, self.is_prismatic)[self.kept])


def follows_order(temperature_degC: FloatArray) -> bool:
    """Whether temperatures (n,) in the order of the readings are a smooth function of it.

    By the mean square of their successive differences over twice their variance: J. von Neumann, "Distribution of the
    ratio of the mean square successive difference to the variance", Ann. Math. Stat. 12 (1941) 367.
    """
    between = float((np.diff(temperature_degC) ** 2).mean())
    return between < 2 * LEAST_SHARE_BETWEEN * float(np.var(temperature_degC))


def clock(temperature_degC: FloatArray) -> tuple[Finding, ...]:
    """That temperatures are no input of networks, as they follow the order of the readings; else nothing."""
    said = "The temperature follows the order of the readings: networks would learn it as a clock. It is no input of "
    return (Finding("temperature order", f"{said}theirs."),) if follows_order(temperature_degC) else ()


def moves(angles: FloatArray, is_prismatic: BoolArray) -> bool:
    """Whether a joint moves enough in readings with angles (n, n_joints) [rad, or mm] to be an input."""
    return bool(_of_joints(angles, is_prismatic).any())


def _of_joints(angles: FloatArray, is_prismatic: BoolArray) -> BoolArray:
    """Which of the `_candidates` of the joints vary."""
    moved = np.ptp(angles, axis=0) > np.where(is_prismatic, LEAST_RANGE, LEAST_TURN)
    of_moved = np.concatenate([moved[~is_prismatic], moved[~is_prismatic], moved[is_prismatic]])
    return np.asarray(of_moved & (np.ptp(_candidates(angles, None, is_prismatic)[:-1], axis=1) > LEAST_RANGE))


def _candidates(angles: FloatArray, temperature_degC: FloatArray | None, is_prismatic: BoolArray) -> FloatArray:
    """All numbers that may be inputs, in rows: cosines, sines, displacements, temperature."""
    turns = angles[:, ~is_prismatic].T
    temperature = np.zeros(len(angles)) if temperature_degC is None else temperature_degC
    return np.vstack([np.cos(turns), np.sin(turns), angles[:, is_prismatic].T, temperature])
