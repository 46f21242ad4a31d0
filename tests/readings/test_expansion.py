"""Lengths as warm as their readings: hand-solved cases."""

from __future__ import annotations

import numpy as np
import pytest

from truearm.readings import Lengths, length_errors
from truearm.readings.expansion import ARTEFACT_U_K, growth_of

SEAT = np.array(["a", "a", "b", "c", "d"])
DEGC = np.array([24.0, 26.0, 25.0, 18.0, 20.0])  # 25 degC on average in a and b, 19 degC in c and d
STEEL = Lengths(["a", "c"], ["b", "d"], [500.0, 200.0], [0.005, 0.002], expansion_per_K=[1.15e-5, 1.15e-5],
                u_expansion_per_K=[1e-6, 1e-6])  # fmt: skip


def test_a_length_is_as_warm_as_the_readings_in_its_seats():
    growth = growth_of(STEEL, SEAT, DEGC)
    assert growth.known.all()
    assert growth.factor == pytest.approx([1 + 1.15e-5 * 5, 1 - 1.15e-5], abs=1e-12)
    assert growth.u_temperature == pytest.approx([1.15e-5 * ARTEFACT_U_K] * 2)
    assert growth.u_expansion == pytest.approx([5e-6, 1e-6])


@pytest.mark.parametrize(
    ("lengths", "degC"),
    [
        (STEEL, None),
        (Lengths(["a"], ["b"], [500.0], [0.005]), DEGC),
        (Lengths(["a"], ["b"], [500.0], [0.005], expansion_per_K=[np.nan], u_expansion_per_K=[np.nan]), DEGC),
    ],
)
def test_what_is_not_known_does_not_grow(lengths, degC):
    growth = growth_of(lengths, SEAT, degC)
    assert not growth.known.any()
    assert (growth.factor == 1).all()
    assert not growth.u_temperature.any()
    assert not growth.u_expansion.any()


def test_errors_of_lengths_are_those_of_lengths_as_warm_as_they_are():
    """500 mm of steel at 25 degC are 500.02875 mm."""
    points = np.array([[0, 0, 0], [0, 0, 0], [500.02875, 0, 0], [0, 0, 0], [0, 200.0, 0]])
    assert length_errors(points, SEAT, STEEL, DEGC) == pytest.approx([0, 0.0023], abs=1e-9)
    assert length_errors(points, SEAT, STEEL) == pytest.approx([0.02875, 0], abs=1e-9)
