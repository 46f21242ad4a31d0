"""What an arm leaves is separated into noise and structure: planted sizes of both are found."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.structure import Remaining, contrasts, remaining
from truearm.identification.references.reading_references import references_of, roughly_aligned_chain, state_of
from truearm.identification.terms import candidate_terms, constants
from truearm.readings import Session

ARM = replace(load_arm("ur5"), lower=None, upper=None)


def left(noise_mm: float, wrong: float = 0.0, *, gross: int = 0, n: int = 100) -> Remaining:
    """Of an arm whose J4 turns by a sine of its angle more than it says, read with noise."""
    rng = np.random.default_rng(3)
    angles = rng.uniform(-2.5, 2.5, (n, 6))
    true = angles + np.outer(wrong * np.sin(angles[:, 3]), np.arange(6) == 3)
    points = ARM.chain.tip_in_base(true) + noise_mm * rng.standard_normal((n, 3))
    points[:gross] += 200.0
    session = Session(angles, points)
    every, state, references = constants(ARM.chain), state_of(ARM, session), references_of(session, None)
    fit = identify(roughly_aligned_chain(ARM, session, ("base", "tip")), state, every, references)
    return remaining(fit, state, references, every)


@pytest.mark.parametrize("noise_mm", [0.01, 1.0, 10.0])
def test_noise_of_any_size_is_noise(noise_mm):
    found = left(noise_mm)
    assert found.noise_mm == pytest.approx(noise_mm * np.sqrt(3), rel=0.15)  # 300 residuals and 30 constants: 4 %; 3 s
    assert found.log_odds < 3


def test_what_the_pose_decides_is_structure():
    """The tip is 139 mm off the axis of J4 (0.0947 and some): 0.05 sin q4 moves it by some 5 mm."""
    found = left(1.0, 0.05)
    assert found.log_odds > 20
    assert 1.5 < found.structure_mm < 10
    # 300 residuals, 30 constants, and 200 directions of structure: the two share what they cannot tell apart.
    assert found.noise_mm == pytest.approx(np.sqrt(3), rel=0.4)


def test_gross_errors_are_no_structure():
    assert left(1.0, gross=5).structure_mm < 1.0


def test_a_gross_error_takes_its_contrasts_along():
    """Of 20 readings 30 contrasts remain, fewer than there are directions: the largest of these count."""
    assert left(1.0, 0.05, n=20, gross=1).distance_mm < 12  # 16 with contrasts of the gross error


def test_contrasts_of_an_arm_with_many_terms_are_those_by_the_derivatives_of_all():
    """Squares to 1e-9 and their number, by the columns of the constants, one of which the arm lacks."""
    rng = np.random.default_rng(3)
    angles = rng.uniform(-2.5, 2.5, (60, 6))
    points = ARM.chain.tip_in_base(angles + 1e-3 * np.sin(3 * angles)) + 0.01 * rng.standard_normal((60, 3))
    session = Session(angles, points)
    every, state, references = constants(ARM.chain), state_of(ARM, session), references_of(session, None)
    offered, _ = candidate_terms(state, free=("base", "tip"), highest=4)
    lacking = [term for term in offered if term != every[8]]
    fit = identify(roughly_aligned_chain(ARM, session, ("base", "tip")), state, lacking, references)
    found = contrasts(fit, state, references, every, [])
    chain = fit.perturbed_chain
    whole = PerturbedChain(chain.chain, (*chain.terms, *(term for term in every if term not in chain.terms)))
    x = np.concatenate([fit.coefficients, np.zeros(whole.n_coefficients - len(fit.coefficients))])
    ((_, tips, columns),) = whole.derivatives(state, x)
    is_absorbed = np.repeat([term in every for term in whole.terms], [term.n_coefficients for term in whole.terms])
    weight = np.sqrt(fit.references[0].robust_weight)
    J, r = (columns[is_absorbed] * weight).reshape(is_absorbed.sum(), -1).T, ((points.T - tips) * weight).ravel()
    J = J / np.sqrt((J**2).sum(axis=0))
    taken, _, rank, _ = np.linalg.lstsq(J, r, rcond=1e-5)
    assert found.squares == pytest.approx(float(((r - J @ taken) ** 2).sum()), rel=1e-9)
    assert found.freedom == round(3 * (weight**2).sum()) - rank
