"""A sign that readings do not show is said, and the uncertainty contains both; one that they show changes nothing."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import truearm as ta
from truearm.identification.judgement import joint_signs
from truearm.identification.judgement.joint_signs import GROUP, LEAST_ODDS, _is_surely_less
from truearm.identification.judgement.structure import Contrasts


@cache
def simulated(strategy: str, *, seed: int = 1, arm_seed: int = 4, poses: int = 40) -> ta.Session:
    """Of a UR10, whose tip is within 1 mm of the axis of J6."""
    return ta.simulate("ur10", poses=poses, seed=seed, arm_seed=arm_seed, strategy=strategy).session


def reversed_j6(session: ta.Session) -> ta.Session:
    return replace(session, angles=session.angles * [1, 1, 1, 1, 1, -1])


@cache
def fitted(*, is_reversed: bool, strategy: str = "box", arm_seed: int = 4) -> ta.FitResult:
    training = simulated(strategy, arm_seed=arm_seed)
    return ta.fit("ur10", reversed_j6(training) if is_reversed else training, model="kinematic")


def signs(model) -> list[str]:
    return [term.name for term in model.fit_.perturbed_chain.terms if term.group == GROUP]


def normalized_error(model, test: ta.Session) -> float:
    """Root mean square error of a coordinate in standard uncertainties."""
    predicted = ta.predict(model, test)
    return float(np.sqrt(((predicted.points - test.points) ** 2).sum() / (predicted.u_mm**2).sum()))


def test_a_reversed_joint_whose_axis_meets_the_tip_is_said():
    [said] = [remark for remark in fitted(is_reversed=True).remarks if "J6" in remark]
    assert "J6 seems to turn the other way (odds 1000 to 1)" in said
    assert "a tip farther from its axis" in said


def test_harmonics_that_take_a_reversed_joint_up_do_not_hide_it():
    """The physical model leaves half of what the constants leave, and says it all the same; not of a right joint."""
    training = ta.simulate("ur10", poses=100, strategy="measuring", preset="research", seed=2).session
    for session, n in ((reversed_j6(training), 1), (training, 0)):
        model = ta.PhysicalModel(ta.load_arm("ur10")).fit_readings(session)
        assert len([one for one in model.findings_ if "J6 seems to turn the other way" in str(one)]) == n


def test_the_uncertainty_contains_both_signs_where_no_readings_are():
    """Trained in a box and used anywhere: without the other sign the error is 2.1 times the uncertainty."""
    test = reversed_j6(simulated("uniform", seed=2, poses=200))
    model = fitted(is_reversed=True).model
    assert signs(model)
    assert normalized_error(model, test) < 1.3  # the right sign has 1.27


def test_two_sessions_have_both_signs_likewise():
    """The motions of their days are not in the model; the change of each constant stays with its own."""
    session = replace(reversed_j6(simulated("box")), session=np.repeat(["A", "B"], 20))
    model = ta.fit("ur10", session, model="kinematic").model
    one_day = fitted(is_reversed=True).model
    test = reversed_j6(simulated("uniform", seed=2, poses=100))
    assert signs(model)
    assert np.median(ta.predict(model, test).u_mm) < 2 * np.median(ta.predict(one_day, test).u_mm)
    assert normalized_error(model, test) < 1.3


def test_both_signs_agree_where_the_readings_are():
    """The constants take the other sign up there, so that it adds as much as noise does, and not its 0.3 mm."""
    test = simulated("box", seed=2, poses=100)
    of_right = ta.predict(fitted(is_reversed=False).model, test).u_mm
    of_both = ta.predict(fitted(is_reversed=True).model, reversed_j6(test)).u_mm
    assert np.median(of_right) < np.median(of_both) < 2 * np.median(of_right)  # 0.008 and 0.012 mm


@pytest.mark.parametrize("arm_seed", [3, pytest.param(5, marks=pytest.mark.weekly)])
def test_the_odds_of_a_sign_are_those_of_the_other_the_other_way_round(arm_seed):
    stds = []
    for is_reversed in (False, True):
        terms = fitted(is_reversed=is_reversed, arm_seed=arm_seed).model.fit_.perturbed_chain.terms
        stds += [term.prior_std for term in terms if term.group == GROUP][:1] or [0.0]
    assert sum(std**2 for std in stds) == pytest.approx(1, abs=0.02)  # of the linearisation


def test_a_sign_that_is_shown_changes_nothing():
    """Readings of the whole workspace show it; so does a tip of 50 mm beside the axis."""
    assert not signs(fitted(is_reversed=False, strategy="uniform").model)
    session = simulated("box")
    beside = ta.load_arm("ur10").chain.pose(session.angles).R_base_tip[:, :, 1]
    assert not signs(ta.fit("ur10", replace(session, points=session.points + 50 * beside), model="kinematic").model)


@pytest.mark.parametrize(("strategy", "is_reversed", "n_fewer"), [("uniform", False, 1), ("box", True, 0)])
def test_the_squares_of_the_stated_sign_are_enough_where_the_other_leaves_clearly_more(
    strategy, is_reversed, n_fewer, monkeypatch
):
    training = simulated(strategy, poses=60)  # 180 coordinates, of which 30 constants leave more than 100
    training = reversed_j6(training) if is_reversed else training
    linearised, contrasts = [], joint_signs.contrasts
    monkeypatch.setattr(joint_signs, "contrasts", lambda *given: linearised.append(given) or contrasts(*given))

    def stds() -> list[float]:
        linearised.clear()
        terms = ta.fit("ur10", training, model="kinematic").model.fit_.perturbed_chain.terms
        return [term.prior_std for term in terms if term.group == GROUP]

    of_bound, n_by_bound = stds(), len(linearised)
    monkeypatch.setattr(joint_signs, "_is_surely_less", lambda *_: False)
    assert stds() == of_bound
    assert len(of_bound) == 2 * is_reversed
    assert n_by_bound == len(linearised) - n_fewer


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.weekly)])
def test_seats_without_a_length_make_no_false_sign(seed):
    """The size that is held there counts in the sum of squares: the other sign explained less than nothing."""
    session = ta.simulate("measuring7", poses=48, seed=seed, strategy="seat", seats=4, reference=False).session
    assert not [remark for remark in ta.fit("measuring7", session, model="kinematic").remarks if "other way" in remark]


def test_a_sign_is_surely_less_probable_only_if_constants_may_take_up_contrasts_of_the_stated_one_alone():
    """As where its axes are parallel: with 150 contrasts for 180 it leaves more variance by a tenth less squares."""
    nothing, squares = (np.zeros((0, 0)), np.zeros(0)), 180 * 0.01
    point = SimpleNamespace(kind="point", robust_weight=np.ones(60), residuals=np.full((3, 60), 0.1))
    other = Contrasts(*nothing, squares=1.1 * squares, freedom=180, n_readings=60.0)
    assert squares / 150 > other.squares / other.freedom
    assert not _is_surely_less(SimpleNamespace(references=[point]), other, 30, LEAST_ODDS)
