"""One ball at several places is one distance: its certificate counts once, however often it is put down."""

from __future__ import annotations

import numpy as np
import pytest

from mixed_session import reached, scale_std, unit
from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.surfaces import EQUAL_SHARE, Radius, Spheres, spheres_of
from truearm.identification.terms import ArmState, constants

DISTANCE_MM, U_MM = 28.0, 0.0005


def balls_touched(n_places: int, rng: np.random.Generator) -> tuple[ArmState, np.ndarray]:
    """An arm off its drawing, 108 touches all over a ball at some places, with a noise of 2 um or so."""
    arm = load_arm("gao2017")
    terms = constants(arm.chain)
    wrong = [rng.normal(0, 3e-4 if max(map(abs, term.direction[:3])) else 0.1) for term in terms]  # rad, mm
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(np.array(wrong))
    middle = arm.chain.tip_in_base(arm.working[None])[0]
    names = np.repeat([f"place {i}" for i in range(n_places)], 108 // n_places)
    centres = middle + rng.uniform([-250, -200, -50], [0, 0, 100], (n_places, 3))
    points = np.repeat(centres, 108 // n_places, axis=0) + DISTANCE_MM * unit(rng.normal(size=(len(names), 3)))
    angles = reached(arm, chain, points, rng)
    return ArmState(arm.chain, angles + rng.normal(0, 3e-6, angles.shape)), names


@pytest.mark.parametrize("n_places", [1, 3, 9])
def test_the_scale_is_never_known_better_than_the_ball(n_places):
    """Nor much worse; places whose distances differ in a digit have certificates of their own and average."""
    state, names = balls_touched(n_places, np.random.default_rng(4))
    terms, places, rows = constants(state.chain, free=("tip",)), np.unique(names), np.arange(len(names))
    one = spheres_of(rows, names, [(str(name), DISTANCE_MM, U_MM) for name in places])
    found = identify(state.chain, state, terms, [one], robust=False)
    # The noise of the touches, 0.2 um on the mean of all, adds a tenth.
    assert U_MM / DISTANCE_MM * (1 - 1e-6) < scale_std(found, state) < 1.3 * U_MM / DISTANCE_MM
    if n_places == 9:
        own = spheres_of(rows, names, [(str(name), DISTANCE_MM + 1e-6 * i, U_MM) for i, name in enumerate(places)])
        assert scale_std(identify(state.chain, state, terms, [own], robust=False), state) < 0.75 * U_MM / DISTANCE_MM


def test_a_shared_radius_is_the_mean_of_its_places():
    """Two places 10 and 30 um larger than an unknown of 28.01 mm, of which 28 mm is stated; the third is its own."""
    radii = (Radius(0, 28.0, 0.02), Radius(1, 25.0, 0.01), Radius(2, 28.0, 0.02))
    touched = np.repeat(np.arange(3), 4)
    reference = Spheres(np.arange(12), touched, ("a", "b", "c"), radii)
    assert reference.unknowns[12:] == ("effective radius of spheres of 28.0 mm, u 0.02 mm [mm]",)
    x = np.zeros(13)
    x[[3, 7, 11, 12]] = 28.02, 25.004, 28.04, 28.01
    constraints = reference.constraints(x)
    assert constraints.residuals == pytest.approx([0.01, 0.004, 0.03, 0.01])
    assert constraints.std == pytest.approx([EQUAL_SHARE * 0.02, 0.01, EQUAL_SHARE * 0.02, 0.02])
    step = np.random.default_rng(0).normal(size=13)
    quotient = reference.constraints(x + step).residuals - constraints.residuals
    np.testing.assert_allclose(constraints.by_unknown @ step, quotient, atol=1e-12)  # linear
