"""Lengths as warm as their readings: hand-solved cases."""

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.readings import Lengths, length_errors
from truearm.readings.thermal_expansion import (
    UNSTATED_U_K,
    ThermalExpansion,
    at_measured_temperature,
    thermal_expansion_of,
)

SEAT = np.array(["a", "a", "b", "c", "d"])
DEGC = np.array([24.0, 26.0, 27.0, 18.0, 20.0])  # 25 degC in a, 27 in b; 18 in c, 20 in d
STEEL = Lengths(["a", "c"], ["b", "d"], [500.0, 200.0], [0.005, 0.002], expansion_per_K=[1.15e-5, 1.15e-5],
                u_expansion_per_K=[1e-6, 1e-6])  # fmt: skip


def test_a_length_is_as_warm_as_its_two_seats():
    """26 and 19 degC on average, both ends a kelvin from that, however many readings each has."""
    growth = thermal_expansion_of(STEEL, SEAT, DEGC)
    assert growth.known.all()
    assert growth.factor == pytest.approx([1 + 1.15e-5 * 6, 1 - 1.15e-5], abs=1e-12)
    assert growth.u_temperature == pytest.approx([1.15e-5 * np.hypot(ThermalExpansion.artefact_u_K, 1.0)] * 2)
    assert growth.u_expansion == pytest.approx([6e-6, 1e-6])
    assert growth.u == pytest.approx(np.hypot(growth.u_temperature, growth.u_expansion))


@pytest.mark.parametrize(
    "lengths",
    [
        Lengths(["a"], ["b"], [500.0], [0.005]),
        Lengths(["a"], ["b"], [500.0], [0.005], expansion_per_K=[np.nan], u_expansion_per_K=[np.nan]),
    ],
)
@pytest.mark.parametrize("degC", [None, DEGC])
def test_what_has_no_expansion_does_not_grow(lengths, degC):
    growth = thermal_expansion_of(lengths, SEAT, degC)
    assert not growth.known.any()
    assert (growth.factor == 1).all()
    assert not growth.u.any()


def test_without_a_temperature_a_length_is_less_sure_than_with_one():
    growth = thermal_expansion_of(STEEL, SEAT, None)
    assert not growth.known.any()
    assert (growth.factor == 1).all()
    assert growth.u == pytest.approx([1.15e-5 * UNSTATED_U_K] * 2)
    assert (growth.u > ThermalExpansion.at(STEEL, 20.0).u).all()


@pytest.mark.parametrize("degC", [293.15, 68.0, -5.0])
def test_temperatures_on_another_scale_are_refused(degC):
    with pytest.raises(InputError, match="expected the readings in its seats at 0 to 45 degC, got") as caught:
        thermal_expansion_of(STEEL, SEAT, np.full(5, degC))
    assert "not in K" in caught.value.hint
    bare = Lengths(["a"], ["b"], [500.0], [0.005])
    assert (
        thermal_expansion_of(bare, SEAT, np.full(5, degC)).factor == 1
    ).all()  # it is no temperature of the bar then


def test_lengths_as_they_are_are_longer_and_less_sure():
    """500 mm of steel at 26 degC are 500.0345 mm."""
    points = np.array([[0, 0, 0], [0, 0, 0], [500.0345, 0, 0], [0, 0, 0], [0, 200.0, 0]])
    there = at_measured_temperature(STEEL, SEAT, DEGC)
    assert there.length_mm == pytest.approx([500.0345, 199.9977], abs=1e-9)
    assert there.u_mm[0] == pytest.approx(np.linalg.norm([0.005, 500 * 1.15e-5 * np.hypot(0.5, 1), 500 * 6e-6]))
    assert length_errors(points, SEAT, there) == pytest.approx([0, 0.0023], abs=1e-9)
