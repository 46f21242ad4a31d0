"""One artefact in several places is one length: its certificate counts once, however often it is put down."""

from __future__ import annotations

import numpy as np
import pytest

from mixed_session import reached, scale_std, unit
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Length, Seats, seats_of
from truearm.identification.terms import ArmState, constants

BAR_MM, U_MM = 200.0, 0.002
CERTIFICATE = (BAR_MM, U_MM, "bar", 1e-4)


def bars_read(n_places: int, rng: np.random.Generator) -> tuple[ArmState, np.ndarray, list[tuple[str, str]]]:
    """An arm off its drawing, in both seats of a bar at some places, six readings each with a noise of 2 um or so."""
    arm = load_arm("gao2017")
    terms = constants(arm.chain)
    wrong = [rng.normal(0, 3e-4 if max(map(abs, term.direction[:3])) else 0.1) for term in terms]  # rad, mm
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(np.array(wrong))
    middle = arm.chain.tip_in_base(arm.working[None])[0]
    points, seats = [], []
    for place in range(n_places):
        at = middle + rng.uniform([-250, -200, -50], [0, 0, 100])
        points += [at, at + BAR_MM * unit(rng.normal(size=(1, 3)))[0]]
        seats.append((f"{place}a", f"{place}b"))
    angles = reached(arm, chain, np.repeat(points, 6, axis=0), rng)
    state = ArmState(arm.chain, angles + rng.normal(0, 3e-6, angles.shape))
    return state, np.repeat([name for pair in seats for name in pair], 6), seats


@pytest.mark.parametrize("n_places", [1, 4, 8])
def test_the_scale_is_never_known_better_than_the_bar(n_places):
    """And hardly worse from four places on: twelve readings a place of 2 um leave 0.4 um beside the bar's 2 um."""
    state, names, ends = bars_read(n_places, np.random.default_rng(4))
    terms = constants(state.chain, free=("tip",))
    seats = seats_of(np.arange(len(names)), names, [(a, b, *CERTIFICATE) for a, b in ends])
    found = identify(state.chain, state, terms, [seats], robust=False)
    assert scale_std(found, state) >= U_MM / BAR_MM * (1 - 1e-6)
    if n_places > 1:
        assert scale_std(found, state) < 1.1 * U_MM / BAR_MM
        apart = seats_of(np.arange(len(names)), names, [(a, b, BAR_MM, U_MM) for a, b in ends])
        by_many = identify(state.chain, state, terms, [apart], robust=False)
        # Bars of their own average their errors.
        assert scale_std(by_many, state) < 1.4 * U_MM / BAR_MM / np.sqrt(n_places)
    found_length = found.references[0].unknowns["length of artefact bar [mm]"]
    assert found_length == pytest.approx(BAR_MM, abs=U_MM / 10)  # nothing else tells it


def test_an_artefacts_length_is_the_mean_of_its_places():
    """Two places 10 and 30 um longer than an unknown of 200.01 mm, of which 200 mm is stated."""
    lengths = (Length(0, 1, *CERTIFICATE), Length(2, 3, *CERTIFICATE))
    reference = Seats(np.arange(4), np.arange(4), tuple("abcd"), lengths)
    assert reference.unknowns[12:] == ("length of artefact bar [mm]",)
    x = np.array([0, 0, 0, 200.02, 0, 0, 0, 9, 0, 0, 209.04, 0, 200.01])
    constraints = reference.constraints(x)
    assert constraints.residuals == pytest.approx([0.01, 0.03, 0.01], rel=1e-3)
    assert constraints.std.tolist() == [1e-4, 1e-4, U_MM]


def test_an_artefact_in_one_place_is_a_length_with_both_uncertainties():
    """Marginal over the unknown length, found by Schur's complement."""
    shared = Seats(np.arange(2), np.arange(2), ("a", "b"), (Length(0, 1, BAR_MM, 0.03, "bar", 0.04),))
    alone = Seats(np.arange(2), np.arange(2), ("a", "b"), (Length(0, 1, BAR_MM, 0.03, "", 0.04),))
    x = np.array([0, 0, 0, 120, 160, 0, BAR_MM])
    found, plain = shared.constraints(x), alone.constraints(x[:6])
    assert plain.std == pytest.approx([0.05])
    by = found.by_unknown / found.std[:, None]
    gram = by.T @ by
    marginal = gram[:6, :6] - np.outer(gram[:6, 6], gram[:6, 6]) / gram[6, 6]
    expected = np.outer(plain.by_unknown[0], plain.by_unknown[0]) / 0.05**2
    np.testing.assert_allclose(marginal, expected, atol=1e-9 * expected.max())


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ((201.0, U_MM, "bar", 1e-4), "several"),
        ((BAR_MM, 0.003, "bar", 1e-4), "several"),
        ((BAR_MM, U_MM, "bar", 0.0), "from place to place"),
        ((BAR_MM, U_MM, "", -1.0), "from place to place"),
    ],
)
def test_contradictory_lengths_of_an_artefact_are_refused(second, message):
    with pytest.raises(InputError, match=message):
        seats_of(np.arange(4), np.array(list("abcd")), [("a", "b", *CERTIFICATE), ("c", "d", *second)])


@pytest.mark.parametrize("name", ["", "bar", "bar {}"])
def test_the_scale_is_never_known_better_than_the_growth_of_the_material(name):
    """Of bars of their own, of one bar in eight places, of a plate with a name for each length: 10 um per metre."""
    state, names, ends = bars_read(8, np.random.default_rng(4))
    terms = constants(state.chain, free=("tip",))
    stated = [(a, b, BAR_MM, 1e-4, name.format(i), 1e-4, 1.0, "steel", 1e-5) for i, (a, b) in enumerate(ends)]
    found = identify(state.chain, state, terms, [seats_of(np.arange(len(names)), names, stated)], robust=False)
    assert 1e-5 * (1 - 1e-6) <= scale_std(found, state) < 1.1e-5
    error = found.references[0].unknowns["error of the expansion of steel [mm/m]"]
    assert error == pytest.approx(0.0, abs=1e-3)  # a tenth of its uncertainty: nothing else tells it


@pytest.mark.parametrize(("artefact", "certified"), [("bar", 200.01), ("", BAR_MM)])
@pytest.mark.parametrize("error_mm_per_m", [0.0, 0.05])
def test_a_warm_place_is_longer_than_the_certificate(artefact, certified, error_mm_per_m):
    """Seats 200.04 mm apart, and lengths grown by a ten thousandth and an error of what."""
    length = Length(0, 1, BAR_MM, U_MM, artefact, 1e-4, 1.0001, "steel", 2e-5)
    reference = Seats(np.arange(2), np.arange(2), ("a", "b"), (length,))
    assert reference.unknowns[-1] == "error of the expansion of steel [mm/m]"
    x = np.array([0, 0, 0, 0, 200.04, 0, *([certified] if artefact else []), error_mm_per_m])
    constraints = reference.constraints(x)
    there = certified * (1.0001 + 1e-3 * error_mm_per_m)
    expected = [200.04 - there, *([certified - BAR_MM] if artefact else []), error_mm_per_m]
    assert constraints.residuals == pytest.approx(expected, rel=3e-4, abs=1e-12)
    assert constraints.std[-1] == pytest.approx(0.02)  # mm/m
    for i in range(len(x)):  # products of unknowns are at most of the fourth order, which a thousandth hardly sees
        step = 1e-3 * np.eye(len(x))[i]
        quotient = (reference.constraints(x + step).residuals - reference.constraints(x - step).residuals) / 2e-3
        np.testing.assert_allclose(constraints.by_unknown[:, i], quotient, atol=1e-8)


@pytest.mark.parametrize(
    ("growth", "message"),
    [
        ((0.0, "", 0.0), "positive expansion factor"),
        ((1.0, "steel", 0.0), "uncertainty of the expansion"),
        ((1.0, "", 1e-5), "uncertainty of the expansion"),
        ((1.0, "steel", 2e-5), "several"),
    ],
)
def test_contradictory_expansions_of_a_material_are_refused(growth, message):
    lengths = (Length(0, 1, *CERTIFICATE, 1.0, "steel", 1e-5), Length(1, 2, *CERTIFICATE, *growth))
    with pytest.raises(InputError, match=message):
        Seats(np.arange(3), np.arange(3), tuple("abc"), lengths)
