"""A length or distance that no arm of this drawing can have is refused, as it would make one of another size."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.nominal_check import MAX_SIZE_ERROR
from truearm.identification.terms import constants
from truearm.models import KinematicModel, NominalModel
from truearm.readings import Lengths, Session

DISTANCE_MM = 28.0
PAIRS = [("A", "B"), ("C", "A"), ("B", "C")]


@pytest.fixture(scope="module")
def taken():
    """An arm off its drawing by some tenths of a millimetre, in three seats and all over a sphere; their places."""
    rng = np.random.default_rng(6)
    arm = load_arm("gao2017")
    terms = constants(arm.chain, free=("tip",))
    off = [rng.normal(0, 5e-4 if max(map(abs, term.direction[:3])) else 0.2) for term in terms]  # rad, mm
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(np.array(off))
    places = chain.tip_in_base(arm.working + 0.4 * rng.uniform(-1, 1, (4, 6)))
    away = rng.normal(size=(30, 3))
    away *= DISTANCE_MM / np.linalg.norm(away, axis=1, keepdims=True)
    angles = []
    for targets in (*(np.tile(place, (30, 1)) for place in places[:3]), places[3] + away):
        found = solve_inverse_kinematics(chain, targets, start=arm.working + 0.6 * rng.uniform(-1, 1, (30, 6)))
        angles.append(found.angles[found.reached][:12])
        assert len(angles[-1]) == 12
    return np.concatenate(angles), places


def in_seats(taken, scale):
    """Readings in the seats, and the lengths between them times some numbers."""
    angles, places = taken
    apart = [float(np.linalg.norm(places["ABC".index(b)] - places["ABC".index(a)])) for a, b in PAIRS]
    a, b = zip(*PAIRS, strict=True)
    lengths = Lengths(np.array(a), np.array(b), np.array(apart) * scale, np.full(3, 0.002))
    return Session(angles[:36], seat=np.repeat(list("ABC"), 12)), lengths


def on_sphere(taken, distance):
    return Session(taken[0][36:], sphere=np.full(12, "S"), sphere_distance=np.tile([distance, 0.001], (12, 1)))


@pytest.mark.parametrize(
    ("kind", "scale"),
    [
        *((NominalModel, 1 - 3 * MAX_SIZE_ERROR), (NominalModel, 25.4), (NominalModel, 1e-3)),
        pytest.param(KinematicModel, 1 + 3 * MAX_SIZE_ERROR, marks=pytest.mark.weekly),
    ],
)
def test_lengths_of_another_size_are_refused(kind, scale, taken):
    readings, lengths = in_seats(taken, scale)
    with pytest.raises(
        InputError, match=r"expected a length between seats . and . of about .* mm, as the nominal arm has"
    ) as caught:
        kind(load_arm("gao2017")).fit_readings(readings, lengths=lengths)
    assert caught.value.column == "length_mm"
    assert "unit" in caught.value.hint


def test_one_wrong_length_is_named(taken):
    readings, lengths = in_seats(taken, np.array([1.0, 1.0, 1.4]))
    with pytest.raises(InputError, match="expected a length between seats B and C"):
        NominalModel(load_arm("gao2017")).fit_readings(readings, lengths=lengths)


@pytest.mark.parametrize("distance", [25.0, 56.0, 1.1])
def test_another_distance_of_a_sphere_is_refused(distance, taken):
    """The radius of a sphere of 50 mm and a ball of 6 mm; their diameters together; another unit."""
    with pytest.raises(InputError, match="expected a distance of sphere S of about 27") as caught:
        NominalModel(load_arm("gao2017")).fit_readings(on_sphere(taken, distance))
    assert caught.value.column == "sphere_distance_mm"
    assert "not a radius" in caught.value.hint


def test_what_the_arm_has_is_taken(taken):
    """Within the arm's own errors, and far from them where the statement is as uncertain; it then weighs little."""

    def found_in(readings, lengths=None):
        (reference,) = NominalModel(load_arm("gao2017")).fit_readings(readings, lengths=lengths).fit_.references
        return np.array(list(reference.unknowns.values()))

    def distances(lengths):
        places = found_in(readings, lengths).reshape(3, 3)
        return [np.linalg.norm(places["ABC".index(b)] - places["ABC".index(a)]) for a, b in PAIRS]

    readings, lengths = in_seats(taken, 1.0)
    # The seats are as far apart as is stated, to its uncertainty of 0.002 mm, whatever the size of the arm.
    for known in (lengths, in_seats(taken, 1 + MAX_SIZE_ERROR / 2)[1]):
        np.testing.assert_allclose(distances(known), known.length_mm, rtol=0, atol=0.002)
    # As the arm as drawn has them, which is off by some tenths of a millimetre, not by a fifth of 340 to 705 mm.
    loose = replace(in_seats(taken, 1.2)[1], u_mm=np.full(3, 90.0))
    np.testing.assert_allclose(distances(loose), lengths.length_mm, rtol=0, atol=1.5)
    assert found_in(on_sphere(taken, DISTANCE_MM))[3] == pytest.approx(DISTANCE_MM, abs=0.001)
    loose = replace(on_sphere(taken, 33.0), sphere_distance=np.tile([33.0, 2.0], (12, 1)))
    assert found_in(loose)[3] == pytest.approx(DISTANCE_MM, abs=1.0)


def test_a_wrong_reading_is_not_taken_for_a_wrong_length(taken):
    """One reading in the other seat by name: the average counts it little."""
    readings, lengths = in_seats(taken, 1.0)
    seat = readings.seat.copy()
    seat[3] = "B"
    NominalModel(load_arm("gao2017")).fit_readings(replace(readings, seat=seat), lengths=lengths)
