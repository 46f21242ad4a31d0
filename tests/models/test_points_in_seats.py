"""A reading in a seat that an instrument saw says both: the touch repeats where the instrument does not."""

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import constants
from truearm.models import KinematicModel
from truearm.readings import Lengths, Session

SEEN_MM, TOUCHED_MM = 0.2, 0.005


@pytest.fixture(scope="module")
def held():
    """An arm off its drawing in five seats of ten poses each: its chain, readings with points, places of the seats."""
    rng = np.random.default_rng(2)
    arm = load_arm("gao2017")
    terms = constants(arm.chain, free=("tip",))
    off = [rng.normal(0, 1e-3 if max(map(abs, term.direction[:3])) else 0.3) for term in terms]  # rad, mm
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(np.array(off))
    places = chain.tip_in_base(arm.working + 0.4 * rng.uniform(-1, 1, (5, 6)))
    angles, seat = [], []
    for name, place in zip("ABCDE", places, strict=True):
        start = arm.working + 0.8 * rng.uniform(-1, 1, (20, 6))
        found = solve_inverse_kinematics(chain, place + rng.normal(0, TOUCHED_MM, (20, 3)), start=start)
        angles.append(found.angles[found.reached][:10])
        seat += [name] * 10
    angles = np.concatenate(angles)
    points = chain.tip_in_base(angles) + rng.normal(0, SEEN_MM, (50, 3))
    return chain, Session(angles, points, seat=np.array(seat)), places


def miss(model, chain):
    """Root mean square distance from the truth about the working pose [mm]."""
    elsewhere = model.arm.working + 0.5 * np.random.default_rng(3).uniform(-1, 1, (200, 6))
    return np.sqrt(((model.predict(elsewhere) - chain.tip_in_base(elsewhere)) ** 2).sum(axis=1).mean())


def fitted(readings, lengths=None):
    return KinematicModel(load_arm("gao2017"), free=("tip",)).fit_readings(readings, lengths=lengths)


def test_seats_make_up_for_an_instrument_that_scatters(held):
    chain, readings, _ = held
    both, seen = fitted(readings), fitted(Session(readings.angles, readings.points))
    assert miss(both, chain) < 0.7 * miss(seen, chain)
    noise = {reference.kind: reference.noise_std for reference in both.fit_.references}
    # of 150 residuals less some 30 parameters: 10 % is two standard deviations
    assert noise == pytest.approx({"point": SEEN_MM, "seat": TOUCHED_MM}, rel=0.25)


def test_a_length_between_such_seats_counts(held):
    """It holds the seats to 0.002 mm; the instrument alone knows them to 0.2 / sqrt(10)."""
    _, readings, places = held
    length = float(np.linalg.norm(places[1] - places[0]))
    found = fitted(readings, Lengths(["A"], ["B"], [length], [0.002]))
    seats = next(reference.unknowns for reference in found.fit_.references if reference.kind == "seat")
    a, b = (np.array([seats[f"{axis} of seat {name} [mm]"] for axis in "xyz"]) for name in "AB")
    assert np.linalg.norm(a - b) == pytest.approx(length, abs=0.006)


def test_points_of_a_seat_tie_its_other_readings_to_the_instruments_frame(held):
    """Seats without a point say where the base is only up to a motion; one point in each of three seats says it."""
    chain, readings, _ = held
    points = np.full((50, 3), np.nan)
    for first in (0, 10, 20):
        points[first : first + 2] = chain.tip_in_base(readings.angles[first : first + 2])
    points += [100.0, 0, 0]
    found = KinematicModel(load_arm("gao2017")).fit_readings(Session(readings.angles, points, seat=readings.seat))
    seen = found.predict(readings.angles) - chain.tip_in_base(readings.angles) - [100.0, 0, 0]
    assert np.abs(seen).max() < 0.1
