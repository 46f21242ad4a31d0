"""Readings of a warmer or colder room are said to be just that."""

from types import SimpleNamespace

import numpy as np
import pytest

from truearm.models.training_conditions import InputRange
from truearm.verbs.inputs import describe_outside


@pytest.mark.parametrize(
    ("known", "degC", "said"),
    [
        (InputRange(20.0, 0.1, 19.5, 20.5), [20.0, 22.5, 24.5], "2 of 3 readings are 2.0 to 4.0 K warmer than the tr"),
        (InputRange(20.0, 0.1, 19.5, 20.5), [17.5, 23.5], "2 of 2 readings are 3.0 K warmer or 2.0 K colder than the"),
        (None, [23.0], "1 of 1 reading is 3.0 K warmer than 20 degC; the training states no temperature; all else"),
    ],
)
def test_only_the_temperature_is_outside(known, degC, said):
    degC = np.array(degC)
    outside = {"temperature": np.abs(degC - 20.0) > 1.5}
    training, session = SimpleNamespace(temperature_degC=known), SimpleNamespace(temperature_degC=degC)
    assert describe_outside(outside, training, session).startswith(said)
    outside["J2"] = ~outside["temperature"]
    assert " outside the trained range (temperature" in describe_outside(outside, training, session)
