"""Lengths between seats count as long as they are at the readings' temperature, where their expansion is known."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.identification.references.reading_references import references_of
from truearm.models import KinematicModel
from truearm.readings import Lengths, length_errors

STEEL, U_STEEL = 1.15e-5, 1e-6  # 1/K
DEGC = 26.0
GROWTH = 1 + STEEL * (DEGC - 20)


@pytest.fixture
def warm(real, rng):
    """Readings at 26 degC, and the lengths between their seats as a certificate for 20 degC has them."""
    readings, there = real.held(rng), real.lengths()
    readings = replace(readings, temperature_degC=np.full(len(readings), DEGC))
    both = {"expansion_per_K": np.full(2, STEEL), "u_expansion_per_K": np.full(2, U_STEEL)}
    return readings, there, replace(there, length_mm=there.length_mm / GROWTH, **both)


def test_a_warm_length_is_that_length_where_it_stands(warm, real):
    """The same numbers as of one who reckons the growth himself, GUM H.1.3."""
    readings, *both = warm
    there, certified = (lengths.within(["S1", "S2"]) for lengths in both)
    u_grown = there.length_mm / GROWTH * np.hypot(STEEL * 0.5, 6 * U_STEEL)
    by_hand = replace(there, u_mm=np.hypot(there.u_mm, u_grown) * GROWTH)
    found = KinematicModel(real.arm).fit_readings(readings, lengths=certified)
    expected = KinematicModel(real.arm).fit_readings(readings, lengths=by_hand)
    poses = real.in_seats
    np.testing.assert_allclose(found.predict(poses), expected.predict(poses), atol=1e-5)  # mm; u differs by 1e-4 of it


def test_without_their_expansion_the_arm_comes_out_too_small(warm, real):
    """By 69 um per metre; with it lengths are found to their uncertainty."""
    readings, there, certified = warm
    bare = Lengths(certified.seat_a, certified.seat_b, certified.length_mm, certified.u_mm)
    off = {}
    for name, known in (("known", certified), ("not known", bare)):
        model = KinematicModel(real.arm).fit_readings(readings, lengths=known)
        errors = length_errors(model.predict_readings(readings), readings.seat, there)
        off[name] = (errors / there.length_mm).mean()
    assert off["not known"] - off["known"] == pytest.approx(1 / GROWTH - 1, rel=0.05)


def test_one_bar_in_many_places_has_one_thermometer_and_one_material(warm):
    readings, _, certified = warm
    cooler = replace(readings, temperature_degC=np.where(readings.seat == "S3", 21.0, DEGC))
    bar = replace(certified, length_mm=np.full(2, 300.0), artefact=np.full(2, "bar"), u_place_mm=np.full(2, 0.002))
    (held,) = references_of(cooler, bar)
    first, second = held.lengths
    assert first.growth == pytest.approx(GROWTH, abs=1e-12)
    assert second.growth == pytest.approx(1 + STEEL * 3.5, abs=1e-12)
    u = max(np.hypot(STEEL * 0.5, 6 * U_STEEL), np.hypot(STEEL * np.hypot(0.5, 2.5), 3.5 * U_STEEL))
    assert first.growth_std == second.growth_std == pytest.approx(u)
    assert first.material == second.material == "lengths of 1.15e-05 per K"
    assert (first.std_mm, first.place_std_mm) == (second.std_mm, second.place_std_mm) == (0.005, 0.002)
