"""Temperatures that no room has are asked for by every verb: they are degrees Fahrenheit."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses

pytestmark = pytest.mark.usefixtures("undrawn")

N = 30


def at(session, degC):
    return replace(session, temperature_degC=np.full(len(session), degC))


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=N, seed=1).session


@pytest.fixture(scope="module")
def model(session):
    return ta.fit("ur10", session, model="nominal").model


VERBS = {
    "fit": lambda model, session, tmp, **options: ta.fit("ur10", session, model="nominal", **options),
    "evaluate": lambda model, session, tmp, **options: ta.evaluate(model, session, **options),
    "predict": lambda model, session, tmp, **options: ta.predict(model, session, **options),
    "refit": lambda model, session, tmp, **options: ta.refit(model, session, **options),
    "report": lambda model, session, tmp, **options: ta.report(model, session, tmp / "page.html", **options),
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("degC", [pytest.param(45.0, marks=pytest.mark.weekly), 68.0])
def test_fahrenheit_is_asked_for_and_may_be_accepted(model, session, tmp_path, verb, degC):
    warm = at(session, degC)
    caught = refuses(f"below 45 degC, got {degC:g} degC", VERBS[verb], model, warm, tmp_path)
    assert f"{degC:g} degrees Fahrenheit are {(degC - 32) / 1.8:.1f} degC" in caught.hint
    assert "--accept" in caught.hint
    assert "Accepted (a climate chamber)" in str(VERBS[verb](model, warm, tmp_path, accept="a climate chamber"))


@pytest.mark.parametrize("verb", VERBS)
def test_a_hot_hall_and_a_cold_one_are_not_asked_about(model, session, tmp_path, verb):
    for degC in (-5.0, 44.0):
        VERBS[verb](model, at(session, degC), tmp_path)
