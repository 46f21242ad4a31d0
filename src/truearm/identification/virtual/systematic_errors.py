"""The systematic errors of one virtual arm: the terms of a preset with drawn coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.virtual.error_model import (
    CAGES,
    GEOMETRY,
    GROWTH,
    ErrorModel,
    component_of,
    error_model,
)
from truearm.identification.virtual.presets import Preset
from truearm.identification.virtual.state import random_stream
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """The errors that belong to one arm, the same in every reading.

    Attributes
    ----------
    model : ErrorModel
        Terms of the errors.
    coefficients : (n_coefficients,) array
        Of all terms [rad or mm per unit of the basis].
    lag_s : (n_joints + 1,) array
        Time constants of the temperatures of the stand and the links [s].
    """

    model: ErrorModel
    coefficients: FloatArray
    lag_s: FloatArray

    def of_group(self, group: str) -> FloatArray:
        """Coefficients of the terms of a group, in their order."""
        selected: FloatArray = self.coefficients[self.model.groups == group]
        return selected

    def scaled(self, factors: Mapping[str, float]) -> SystematicErrors:
        """Multiply the coefficients of groups by factors."""
        coefficients = self.coefficients.copy()
        for group, factor in factors.items():
            coefficients[self.model.groups == group] *= factor
        return replace(self, coefficients=coefficients)

    def in_session(self, temperature_degC: float, cage_phase: FloatArray) -> FloatArray:
        """Coefficients in one session, for basis functions of an arm 1 K above 20 degC with its ball cages at zero.

        The functions are then the same for all arms and sessions. Expansion is proportional to the temperature, and
        ``a cos(q + p) + b sin(q + p) = (a cos p + b sin p) cos q + (b cos p - a sin p) sin q``.

        Parameters
        ----------
        temperature_degC : float
            Of the stand and all links [degC].
        cage_phase : (n_joints,) array
            Of the ball cages [rad].
        """
        coefficients = self.scaled({GROWTH: temperature_degC - REFERENCE_DEGC}).coefficients
        cages = self.model.groups == CAGES
        a, b = coefficients[cages].reshape(-1, 2).T
        phase = cage_phase[[term.place - 1 for term in self.model.terms if term.group == CAGES]]
        cos, sin = np.cos(phase), np.sin(phase)
        coefficients[cages] = np.column_stack([cos * a + sin * b, cos * b - sin * a]).reshape(-1)
        return coefficients

    @property
    def geometry(self) -> FloatArray:
        """Constant motions at every place, (n_places, 6) [rad, mm]."""
        motions = np.zeros((self.model.perturbed_chain.chain.n_places, 6))
        motions[self._places, self._components] = self.of_group(GEOMETRY)
        return motions

    def with_geometry(self, motions: FloatArray) -> SystematicErrors:
        """Replace the geometry by motions (n_places, 6) [rad, mm].

        Raises
        ------
        InputError
            If the preset has no terms for some of them.
        """
        coefficients = self.coefficients.copy()
        coefficients[self.model.groups == GEOMETRY] = motions[self._places, self._components]
        changed = replace(self, coefficients=coefficients)
        if (changed.geometry != motions).any():
            raise InputError("the preset has no terms for some motions of this geometry")
        return changed

    @property
    def _places(self) -> list[int]:
        return [term.place for term in self.model.terms if term.group == GEOMETRY]

    @property
    def _components(self) -> list[int]:
        return [component_of(term) for term in self.model.terms if term.group == GEOMETRY]


def draw_systematic_errors(arm: Arm, preset: Preset, *, seed: int) -> SystematicErrors:
    """Draw an arm's systematic errors.

    Each class of errors has its own stream of random numbers: changing the magnitude of one class leaves the others.
    """
    model = error_model(arm, preset)
    temperature = random_stream("arm", seed, "temperature")
    temperature.standard_normal(arm.n_joints + 1)  # the coefficients of thermal expansion
    return SystematicErrors(model, model.draw(seed), preset.lag_s * temperature.uniform(0.5, 1.5, arm.n_joints + 1))
