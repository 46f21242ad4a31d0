"""Errors stated are those of all readings held out, and of two models the one that predicts worse loses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from truearm.arm import load_arm
from truearm.identification.estimation.residual_variance import NONE_HELD_OUT, HeldOutReadings
from truearm.identification.judgement.held_out_errors import exceeds, selected, trimmed_mean
from truearm.models import KinematicModel, NominalModel
from truearm.models.selection import worse_than_nominal
from truearm.readings import Session

ARM = load_arm("gao2017")


def few(arm, rng, n, *, noise=1e-3, names=("",)):
    """Readings of an arm with joint offsets of a mrad, with a noise far below what they leave open."""
    angles = arm.working + 0.8 * rng.uniform(-1, 1, (n, arm.n_joints))
    tips = arm.chain.tip_in_base(angles + 1e-3 * rng.standard_normal(arm.n_joints))
    tips = np.repeat(tips, len(names), axis=0) + noise * rng.standard_normal((n * len(names), 3))
    named = {"tip": np.tile(names, n)} if len(names) > 1 else {}
    return Session(np.repeat(angles, len(names), axis=0), tips, **named)


@pytest.mark.parametrize("n", [5, pytest.param(8, marks=pytest.mark.weekly)])
def test_where_an_arm_passes_through_its_readings_each_is_predicted_by_one_identified_without_it(rng, n):
    """To a fifth: an arm of the same terms, which are not chosen again without the reading."""
    readings = few(ARM, rng, n)
    model = KinematicModel(ARM).fit_readings(readings)
    assert model.held_out_.rows.tolist() == list(range(n))
    assert model.held_out_errors_.n == n
    without = KinematicModel(ARM).fit_readings(readings.rows(np.arange(1, n)))
    expected = np.linalg.norm(without.predict(readings.angles[:1]) - readings.points[0])
    assert model.held_out_.errors_mm[0] == pytest.approx(expected, rel=0.2)


def test_markers_of_one_pose_are_held_out_together_by_every_model(rng):
    readings = few(ARM, rng, 6, noise=0.02, names=("A", "B"))
    for kind in (NominalModel, KinematicModel):
        held_out = kind(ARM).fit_readings(readings).held_out_
        assert held_out.rows.tolist() == list(range(12))
        assert len(np.unique(held_out.group)) == 6


@pytest.mark.parametrize("n", [4, 6, 9, 40])
def test_of_few_groups_a_standard_error_is_students(n, rng):
    """The mean lies within it with a probability of 68 %, whatever the number of groups."""
    others = 1 + rng.uniform(0, 1, n)
    difference = rng.normal(0, 1, n)
    trimmed = int(0.1 * n)
    limit = stats.t.ppf(stats.norm.cdf(1.0), n - 2 * trimmed - 1) * trimmed_mean(difference)[1]
    centred = difference - trimmed_mean(difference)[0]
    assert exceeds(others + centred + 1.001 * limit, others)
    assert not exceeds(others + centred + 0.999 * limit, others)


@pytest.mark.parametrize(("n", "kept"), [(9, "richer"), (10, "simpler")])
def test_a_tie_goes_to_the_simpler_model_and_of_few_groups_to_the_better_one(n, kept):
    """The richer model is 1 % better on average, where the differences scatter by ten times that."""
    differences = np.linspace(-0.1, 0.1, n) + 0.01
    errors = {"simpler": 1 + differences, "richer": np.ones(n), "worst": np.full(n, 2.0)}
    assert selected(errors, len(errors["richer"])) == (kept, "richer")
    assert selected({"simpler": errors["richer"] * 1.0005, "richer": errors["richer"]}, 1) == ("simpler", "richer")


def test_a_gain_of_a_thousandth_is_none(rng):
    others = rng.uniform(1, 2, 20)
    assert not exceeds(others * (1 + 1e-4), others)
    assert not exceeds(np.array([5.0]), np.array([1.0]))  # of one group nothing is known
    assert not exceeds(others, others)


def held_out(errors, rows=None):
    rows = np.arange(len(errors)) if rows is None else np.array(rows)
    deviations = np.column_stack([errors, np.zeros((len(errors), 2))])
    return HeldOutReadings(rows, rows, deviations, np.tile(np.eye(3), (len(rows), 1, 1)), np.ones(len(rows)))


def test_a_model_that_takes_readings_for_gross_errors_does_not_skip_them(rng):
    """They count in the comparison; the errors that are stated are those of the others."""
    nominal = SimpleNamespace(held_out_=held_out(rng.uniform(1, 1.2, 20)), held_out_gross_=NONE_HELD_OUT)
    small, large = np.full(10, 0.9), np.full(10, 9.0)
    kept, gross = held_out(small, range(10)), held_out(large, range(10, 20))
    model = SimpleNamespace(held_out_=kept, held_out_gross_=gross)
    own, drawn = worse_than_nominal(model, nominal)
    assert own == pytest.approx(0.9)
    assert drawn == pytest.approx(nominal.held_out_.errors_mm[:10].mean())
    better = SimpleNamespace(held_out_=held_out(np.full(20, 0.9)), held_out_gross_=NONE_HELD_OUT)
    assert worse_than_nominal(better, nominal) is None
    unknown = SimpleNamespace(held_out_=NONE_HELD_OUT, held_out_gross_=NONE_HELD_OUT)
    assert worse_than_nominal(unknown, nominal) is None


def test_an_error_of_the_reading_itself_cancels(rng):
    """At any size the difference of two models is at most the distance between their predictions."""
    predicted = rng.normal(0, 0.1, (2, 20, 3))
    wrong = rng.normal(0, 1, (20, 3)) * np.logspace(-1, 3, 20)[:, None]
    one, other = (replace(held_out(np.zeros(20)), deviations=each + wrong) for each in predicted)
    apart = np.linalg.norm(predicted[0] - predicted[1], axis=1)
    assert (np.abs(one.errors_mm - other.errors_mm) <= apart + 1e-9).all()
