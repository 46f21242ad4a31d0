"""The uncertainty a model states at readings, put together, and the readings that belie it."""

import re
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.arm.catalogue import load_arm
from truearm.models import KinematicModel, NominalModel
from truearm.models.refit import refit
from truearm.models.uncertainty import UncertaintyBudget, uncertainty_budget, what_limits, why_most_are_outliers
from truearm.readings import Session
from truearm.wings.planning.designs.sampling import box, seat
from truearm.wings.planning.virtual import PRESETS, VirtualArm

ARM = load_arm("gao2017")


@pytest.fixture(scope="module")
def virtual():
    return VirtualArm.draw(ARM, PRESETS["shop"], seed=3)


@pytest.fixture(scope="module")
def model(virtual):
    return KinematicModel(ARM, free=()).fit_readings(virtual.measure(box(ARM, 150, seed=1).angles, seed=1).readings)


@pytest.fixture(scope="module")
def others(virtual):
    return virtual.measure(box(ARM, 300, seed=2).angles, seed=2).readings


def test_the_parts_add_up(model, others):
    budget, _ = uncertainty_budget(model, others)
    assert budget.combined_mm == pytest.approx(np.hypot(budget.of_parameters_mm, budget.unexplained_mm))
    share = model.variance_function_.share(others.angles)
    assert budget.unexplained_mm == pytest.approx(model.residual_std_ * np.sqrt(share.mean()))
    assert budget.combined_mm < budget.largest_mm
    assert budget.expanded_mm == 2 * budget.combined_mm
    assert budget.ellipsoid_mm == pytest.approx(2.7955 * budget.combined_mm, rel=1e-4)  # the root of chi^2, 3 d.o.f.
    covariance = model.predict_readings(others, return_cov=True)[1]
    assert budget.combined_mm**2 == pytest.approx(np.trace(covariance, axis1=1, axis2=2).mean() / 3)
    assert not budget.is_relative


def test_it_counts_the_points_that_lie_in_their_ellipsoids(model, others):
    budget, far = uncertainty_budget(model, others)
    assert budget.n_points == 300
    points, covariance = model.predict_readings(others, return_cov=True)
    inside = 0
    for predicted, measured, spread, std in zip(points, others.points, covariance, others.point_std, strict=True):
        off = predicted - measured
        inside += off @ np.linalg.inv(spread + np.diag(std**2)) @ off < UncertaintyBudget.ellipsoid_factor**2
    assert budget.n_covered == inside
    assert budget.n_covered / 300 > 0.9
    assert far == ()


def test_uncertainties_that_the_references_of_the_test_share_count(model, others):
    """A common one counts as each point's own would; the scale is about the origin, as the frame is kept."""
    shifted = replace(others, points=others.points + np.random.default_rng(4).normal(0, 0.05, (300, 3)))
    stated = replace(shifted, u_common_mm=np.full(300, 0.05))
    own = replace(shifted, point_std=np.hypot(others.point_std, 0.05))
    budget, far = uncertainty_budget(model, stated)
    assert budget.n_covered > uncertainty_budget(model, shifted)[0].n_covered
    assert (budget, far) == uncertainty_budget(model, own)
    larger = replace(others, points=others.points * (1 + 300e-6))
    assert uncertainty_budget(model, larger)[0].n_covered < 200
    budget, far = uncertainty_budget(model, replace(larger, u_scale_ppm=np.full(300, 300.0)))
    assert budget.n_covered > 280
    assert far == ()


def test_a_reading_far_off_is_found_with_its_row(model, others):
    points = others.points.copy()
    points[[7, 40]] += [[0.0, 0.5, 0.0], [2.0, 0.0, 0.0]]
    budget, far = uncertainty_budget(model, Session(others.angles, points))
    assert [one.row for one in far] == [40, 7]
    assert far[0].error_mm == pytest.approx(2.0, abs=0.2)
    assert far[0].normalized_residual == pytest.approx(far[0].error_mm / np.sqrt(3) / budget.combined_mm, rel=0.2)


def test_an_arm_known_from_seats_alone_is_judged_in_a_fitted_frame(virtual, others):
    taken = seat(ARM, 60, seed=1)
    held = virtual.measure(
        taken.angles, seed=1, seat=taken.seat, seat_points=taken.seat_points, reference=False
    ).readings
    from_seats = KinematicModel(ARM).fit_readings(held)
    budget, far = uncertainty_budget(from_seats, held)
    assert budget.is_relative
    assert (budget.n_points, budget.n_covered, far) == (0, 0, ())
    in_base = np.trace(from_seats.covariance_parts(held)[0], axis1=1, axis2=2).mean() / 3
    assert budget.of_parameters_mm < np.sqrt(in_base)
    # Against points, what is stated is in the frame of the points.
    assert not uncertainty_budget(from_seats, others)[0].is_relative


def test_a_model_without_terms_has_a_budget_too(virtual, others):
    budget, _ = uncertainty_budget(NominalModel(ARM, free=()).fit_readings(others), others)
    assert budget.of_parameters_mm == 0.0
    assert budget.combined_mm == pytest.approx(budget.unexplained_mm)


def test_what_limits_is_the_largest_of_three_parts_that_add_up(model, others):
    budget = replace(uncertainty_budget(model, others)[0], of_parameters_mm=0.5)
    camera = replace(others, point_std=np.full((300, 3), 1.0))
    instrument, parameters = np.sqrt(8 / np.pi) * np.array([1.0, 0.5])
    (found,) = what_limits(budget, camera, 2.0, model)
    assert found.sentence.startswith("The instrument limits you: the instrument makes 1.6 mm of the mean error")
    parts = [found.numbers[f"{name}_mm"] for name in ("instrument", "number_of_readings", "arm")]
    assert parts[:2] == pytest.approx([instrument, parameters])
    assert np.linalg.norm(parts) == pytest.approx(2.0)
    assert found.numbers["with_more_readings_mm"] == pytest.approx(np.sqrt(4.0 - 0.75 * parameters**2))
    assert "training readings (150)" in found.sentence
    # What the parts leave is of the arm where it repeats at like poses.
    for share, who in ((0.9, "The arm, or else an"), (0.1, "An instrument that is less certain than stated, or else")):
        other = copy(model)
        other.repeating_share_ = share
        said = str(next(what_limits(budget, camera, 5.0, other)))
        assert said.startswith(who)
        assert ", limits you: the instrument makes 1.6 mm" in said
    few = replace(budget, of_parameters_mm=2.0)
    assert "number of readings limits you" in str(next(what_limits(few, camera, 3.6, model)))
    # A laser tracker shows the arm's errors, and a reference of unstated uncertainty no part of its own.
    assert not list(what_limits(budget, replace(camera, point_std=np.full((300, 3), 0.05)), 2.0, model))
    assert not list(what_limits(budget, replace(camera, point_std=None), 2.0, model))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda points: Rotation.from_rotvec([0, 2e-3, 0]).apply(points) + [1, 0, 2], "One motion of the base"),
        (lambda points: 1.01 * points, r"differ by \+1\.\d\d% from the model's: check its scale"),
        (lambda points: points * [1, 1, 1.01], "No motion of the base explains them: a zero or the tip"),
        (lambda points: points + 2.0 * np.random.default_rng(1).standard_normal(points.shape), "more than stated"),
    ],
    ids=["moved", "too long", "bent", "noise"],
)
def test_what_makes_most_readings_outliers_is_named(model, others, changed, said):
    wrong = replace(others, points=changed(others.points))
    budget, far = uncertainty_budget(model, wrong)
    (found,) = why_most_are_outliers(budget, wrong, model.predict_readings(wrong), len(far))
    assert found.sentence.startswith(f"{len(far)} of 300 readings are outliers. ")
    assert re.search(said, found.sentence)
    assert found.sentence in ta.evaluate(model, wrong).remarks
    assert not list(why_most_are_outliers(budget, wrong, model.predict_readings(wrong), 150))


def test_parts_that_exceed_the_errors_seen_are_not_called_their_limit(model, others):
    """Of a mean error of 0.068 mm an instrument cannot make 1.6 mm; a little more than all of it is chance."""
    budget = uncertainty_budget(model, others)[0]
    camera = replace(others, point_std=np.full((300, 3), 1.0))
    (found,) = what_limits(budget, camera, 0.068, model)
    assert found.what == "stated uncertainty"
    assert "instrument, 1.0 mm a coordinate, exceeds the errors seen: state it smaller" in found.sentence
    assert found.sentence.endswith("a mean error of 1.6 mm, this one shows 0.068 mm.")
    (found,) = what_limits(budget, camera, 1.55, model)
    parts = [found.numbers[f"{name}_mm"] for name in ("instrument", "number_of_readings", "arm")]
    assert np.linalg.norm(parts) == pytest.approx(1.55)
    # Noise along one axis: its mean length is that of the errors seen, not smaller.
    along = replace(others, point_std=np.tile([1.0, 1e-3, 1e-3], (300, 1)))
    (found,) = what_limits(budget, along, np.sqrt(2 / np.pi), model)
    assert found.what == "what limits"
    # Uncertain parameters may exceed them too, which says nothing of the instrument.
    assert not list(what_limits(replace(budget, of_parameters_mm=3.0), camera, 2.0, model))


def test_nothing_limits_training_readings_and_a_refit_has_its_own_number(virtual, model, others):
    camera = replace(others, point_std=np.full((300, 3), 1.0))
    budget = uncertainty_budget(model, others)[0]
    trained = virtual.measure(box(ARM, 150, seed=1).angles, seed=1).readings
    mixed = Session(
        np.concatenate([trained.angles, others.angles]),
        np.concatenate([trained.points, others.points]),
        point_std=np.ones((450, 3)),
    )
    for readings in (replace(trained, point_std=np.ones((150, 3))), mixed):
        assert not list(what_limits(budget, readings, 2.0, model))
        assert not list(what_limits(budget, readings, 0.1, model))
    moved = virtual.measure(box(ARM, 20, seed=5).angles, seed=5).readings
    refitted = refit(KinematicModel(ARM).fit_readings(trained), moved)
    (found,) = what_limits(budget, camera, 2.0, refitted)
    assert "the number of refit readings (20)" in found.sentence
    assert "; 80 readings would give" in found.sentence


def test_the_errors_of_a_camera_are_those_that_a_perfect_arm_would_show(rng):
    """Errors of a known arm under noise: the mean length of what is stated."""
    noise = rng.normal(0, 0.7, (20000, 3))
    assert np.linalg.norm(noise, axis=1).mean() == pytest.approx(np.sqrt(8 / np.pi) * 0.7, rel=0.01)  # 20,000 draws
