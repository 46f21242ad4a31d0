"""What groups of terms do: sizes of their motions, and how far the tip moves by them."""

import numpy as np
import pytest
from test_problem import random_chain, random_state

from truearm.identification.estimation.identification_result import IdentificationResult, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import Constant, Term, constants
from truearm.identification.terms.catalogue import own_axis, wobble
from truearm.wings.reports.term_effects import effects


def identified(chain, terms, coefficients, *, pruned=()) -> IdentificationResult:
    perturbed_chain = PerturbedChain(chain, tuple(terms))
    m = perturbed_chain.n_coefficients
    names = dict.fromkeys(term.group for term in terms)
    groups = [
        TermGroupResult(name, sum(t.n_coefficients for t in terms if t.group == name), 1.5, 1.0) for name in names
    ] + [TermGroupResult(name, 7, 0.0, 0.0) for name in pruned]
    return IdentificationResult(perturbed_chain, coefficients, np.eye(m), np.ones(m), tuple(groups), (), True, 1)


def of_group(found, name):
    return next(effect for effect in found if effect.group == name)


def test_a_rotation_a_shift_and_their_mixture_have_their_sizes(rng):
    """By hand: constants of 3 and 4 mrad on two axes are 5/sqrt(2) rms; a skew direction turns and shifts at once."""
    chain = random_chain(rng)
    terms = [
        Term("x", 1, (1, 0, 0, 0, 0, 0), Constant(), "turns", 1e-3),
        Term("y", 2, (0, 1, 0, 0, 0, 0), Constant(), "turns", 1e-3),
        Term("skew", 3, (0, 0, 1, 0, 3, 4), Constant(), "skew", 1e-3),
    ]
    found = effects(identified(chain, terms, np.array([3e-3, -4e-3, 2e-3])), random_state(chain, 7, rng))
    assert of_group(found, "turns").rotation_rad == pytest.approx(5e-3 / np.sqrt(2))
    assert of_group(found, "turns").shift_mm is None
    assert of_group(found, "skew").rotation_rad == pytest.approx(2e-3)
    assert of_group(found, "skew").shift_mm == pytest.approx(1e-2)
    assert (of_group(found, "turns").offered, of_group(found, "turns").determined) == (2, 1.5)


def test_the_tip_moves_by_the_difference_of_tips_with_and_without_the_group(rng):
    """Finite motions of 1e-6 rad, mm against first order: they agree to a part in a million."""
    chain = random_chain(rng)
    terms = [*own_axis(chain, 2, highest=4), *wobble(chain, 3)]
    fit = identified(chain, terms, rng.normal(0, 1e-6, sum(term.n_coefficients for term in terms)))
    state = random_state(chain, 1500, rng)  # more than a piece
    start = 0
    rms: dict[str, np.ndarray] = {}
    for term in terms:
        alone = np.zeros_like(fit.coefficients)
        alone[start : start + term.n_coefficients] = fit.coefficients[start : start + term.n_coefficients]
        start += term.n_coefficients
        moved = fit.perturbed_chain.tips(state, alone) - fit.perturbed_chain.tips(state, 0 * alone)
        rms[term.group] = rms.get(term.group, 0) + moved
    for effect in effects(fit, state):
        expected = np.sqrt((rms[effect.group] ** 2).sum(axis=1).mean())
        assert effect.tip_mm == pytest.approx(expected, rel=1e-4)


def test_effects_that_a_free_base_and_tip_compensate_do_not_count(rng):
    """A constant shift of the base by another name is no error where the base is free, and is one where it is not."""
    chain = random_chain(rng)
    shift = Term("table", 0, (0, 0, 0, 0.6, 0, 0.8), Constant(), "table", 1.0)
    state = random_state(chain, 50, rng)
    bound = effects(identified(chain, [shift], np.array([0.5])), state)
    assert of_group(bound, "table").tip_mm == pytest.approx(0.5)
    free = constants(chain, free=("base", "tip"), angle_std=0.0, length_std=0.0)
    found = effects(identified(chain, [*free, shift], np.append(np.zeros(9), 0.5)), state)
    assert of_group(found, "table").tip_mm < 1e-5
    for part in ("base", "tip"):
        effect = of_group(found, part)
        assert (effect.rotation_rad, effect.shift_mm, effect.tip_mm) == (None, None, None)


def test_a_group_that_was_given_up_has_no_size(rng):
    chain = random_chain(rng)
    fit = identified(chain, wobble(chain, 1), np.ones(20) * 1e-5, pruned=("bending",))
    gone = of_group(effects(fit, random_state(chain, 5, rng)), "bending")
    assert (gone.offered, gone.determined) == (7, 0.0)
    assert (gone.rotation_rad, gone.shift_mm, gone.tip_mm) == (None, None, None)


def test_a_nominal_arm_has_no_terms(rng):
    """All groups were given up."""
    chain = random_chain(rng)
    fit = identified(chain, [], np.zeros(0), pruned=("bending", "tip"))
    assert [effect.tip_mm for effect in effects(fit, random_state(chain, 5, rng))] == [None, None]
