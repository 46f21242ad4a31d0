"""The network model: trainers, restarts, ensembles, their uncertainty, and what it refuses."""

import os
from dataclasses import fields, replace

import numpy as np
import pytest
from sklearn.base import clone
from threadpoolctl import threadpool_limits

from refusals import refuses
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.models import NetworkModel
from truearm.models.network import TRAINERS
from truearm.nets import normal_equations
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import nguyen_widrow
from truearm.nets.training import dividerand
from truearm.readings import Lengths, Session


@pytest.fixture(scope="module")
def arm() -> Arm:
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    return Arm("zigzag", Chain(fixed, np.array([0, 0, 50.0])), joint_names=("shoulder", "elbow", "wrist"))


@pytest.fixture(scope="module")
def readings(arm) -> Session:
    """120 readings within 0.5 rad, 0.1 mm of noise."""
    rng = np.random.default_rng(5)
    angles = rng.uniform(-0.5, 0.5, (120, 3))
    return Session(angles, arm.chain.tip_in_base(angles) + rng.normal(0, 0.1, (120, 3)))


def small(arm, **options) -> NetworkModel:
    return NetworkModel(arm, **{"free": (), "hidden": (5,), "epochs": 12, "seed": 3} | options)


def same_record(one, other) -> bool:
    return all(
        np.array_equal(getattr(one, f.name), getattr(other, f.name), equal_nan=True)
        if f.name != "stop"
        else one.stop == other.stop
        for f in fields(one)
        if f.name != "time"
    )


# Trainers and seeds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trainer", TRAINERS)
def test_one_network_is_trained_on_its_seeds_division_from_its_seeds_start(trainer, arm, readings):
    model = small(arm, trainer=trainer).fit_readings(readings)
    train, aside, _ = dividerand(120, train=0.85, validation=0.15, test=0, seed=3)
    inputs = model.angle_scale_.scale(readings.angles.T)
    targets = model.point_scale_.scale(readings.points.T)
    options = {} if trainer == "trainbr" else {"max_fail": 10}
    weights, record = TRAINERS[trainer](
        FitProblem(model.network_, inputs[:, train], targets[:, train]),
        nguyen_widrow(model.network_, seed=3),
        validation=FitProblem(model.network_, inputs[:, aside], targets[:, aside]),
        epochs=12,
        goal=0.0,
        **options,
    )
    assert len(model.members_) == 1
    np.testing.assert_array_equal(model.members_[0].weights, weights)
    assert same_record(model.record_, record)


def test_every_trainer_learns(arm, readings):
    errors = {name: small(arm, trainer=name).fit_readings(readings).record_.perf for name in TRAINERS}
    for name, perf in errors.items():
        assert perf[-1] < perf[0], name
    # Second-order training is ahead of gradient descent by far.
    assert max(errors[name][-1] for name in ("varpro", "trainlm", "trainbr")) < 0.1 * errors["traingdx"][-1]


def test_goal_and_validation_reach_the_trainer(arm, readings):
    model = small(arm, goal=1e-2).fit_readings(readings)
    assert model.record_.stop == "Performance goal met."
    assert model.record_.perf[-1] <= 1e-2 < model.record_.perf[-2]
    assert np.isnan(small(arm, validation=0.0).fit_readings(readings).record_.vperf).all()


def test_the_best_of_several_starts_is_kept(arm, readings, monkeypatch):
    seen = []

    def spy(training, weights, **options):
        seen.append((weights, *TRAINERS["trainlm"](training, weights, **options)))
        return seen[-1][1:]

    for validation, what in ((0.15, "vperf"), (0.0, "perf")):
        seen.clear()
        monkeypatch.setitem(TRAINERS, "varpro", spy)
        model = small(arm, n_restarts=4, validation=validation).fit_readings(readings)
        errors = [getattr(record, what)[record.best_epoch] for _, _, record in seen]
        best = int(np.argmin(errors))
        assert model.members_[0].start == best
        np.testing.assert_array_equal(model.members_[0].weights, seen[best][1])
        # The first start is that of the seed, the others are their own.
        np.testing.assert_array_equal(seen[0][0], nguyen_widrow(model.network_, seed=3))
        assert len({start.tobytes() for start, _, _ in seen}) == 4


def test_members_start_and_divide_on_their_own(arm, readings):
    alone = small(arm).fit_readings(readings)
    model = small(arm, n_members=3).fit_readings(readings)
    np.testing.assert_array_equal(model.members_[0].weights, alone.members_[0].weights)
    assert len({member.weights.tobytes() for member in model.members_}) == 3
    # Each judged by readings of its own: the start of one is not the start of another on other readings.
    assert len({member.record.vperf[0] for member in model.members_}) == 3
    inputs = model.angle_scale_.scale(readings.angles.T)
    points = [model.point_scale_.unscale(model.network_.outputs(m.weights, inputs)).T for m in model.members_]
    np.testing.assert_array_equal(model.predict(readings.angles), np.mean(points, axis=0))
    off = points - np.mean(points, axis=0)
    scatter = np.einsum("mni,mnj->nij", off, off) / 2
    np.testing.assert_allclose(model.member_scatter(readings.angles), scatter, rtol=1e-9, atol=1e-15)
    assert not alone.member_scatter(readings.angles).any()


def test_a_larger_ensemble_begins_with_the_smaller_one(arm, readings):
    two, three = (small(arm, n_members=n, n_restarts=2).fit_readings(readings) for n in (2, 3))
    for one, other in zip(two.members_, three.members_[:2], strict=True):
        np.testing.assert_array_equal(one.weights, other.weights)
        assert one.start == other.start


def test_the_number_of_threads_changes_nothing(arm, readings, monkeypatch):
    options = {"hidden": (6, 5), "n_members": 2, "n_restarts": 2}
    many = Session(np.tile(readings.angles, (20, 1)), np.tile(readings.points, (20, 1)))  # several chunks
    asked, pool = [], normal_equations._threads
    monkeypatch.setattr(normal_equations, "FLOPS_WORTH_THREADS", 0)
    monkeypatch.setattr(normal_equations, "_threads", lambda n: asked.append(n) or pool(n))
    found = []
    for cores, blas in ((1, 1), (2, 2), (5, 4)):
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid, n=cores: set(range(n)), raising=False)
        with threadpool_limits(blas):
            model = small(arm, epochs=6, **options).fit_readings(many)
        found.append(model)
    assert set(asked) == {1, 2, 5}
    for other in found[1:]:
        for one, two in zip(found[0].members_, other.members_, strict=True):
            np.testing.assert_array_equal(one.weights, two.weights)
            np.testing.assert_array_equal(one.basis_covariance, two.basis_covariance)
        np.testing.assert_array_equal(found[0].residual_covariance_, other.residual_covariance_)


def test_options_are_cloned(arm):
    model = small(arm, n_members=4, n_restarts=2, trainer="traingdx")
    again = clone(model).get_params(deep=False)
    assert {k: v for k, v in again.items() if k != "arm"} == {
        k: v for k, v in model.get_params(deep=False).items() if k != "arm"
    }


# Uncertainty ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("validation", "trainer"),
    [
        (0.2, "trainbr"),
        (0.0, "varpro"),
        *(pytest.param(*one, marks=pytest.mark.weekly) for one in ((0.0, "trainbr"), (0.2, "varpro"))),
    ],
)
def test_an_ensembles_uncertainty_is_that_of_new_readings_and_grows_where_there_were_none(
    validation, trainer, arm, rng
):
    """Within a factor of two among the readings; half a box beyond them of four, of eight where weights are damped.

    There the uncertainty of one network is too small by a factor of 6 to 70.
    """
    angles, among = rng.uniform(-0.5, 0.5, (150, 3)), rng.uniform(-0.45, 0.45, (300, 3))
    beyond = rng.choice([-1.0, 1.0], (300, 3)) * rng.uniform(0.7, 0.8, (300, 3))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 1, (150, 3))
    model = small(arm, hidden=(8,), validation=validation, trainer=trainer, epochs=60, n_members=4).fit(angles, points)
    for where, most in ((among, 2), (beyond, 4 if trainer == "varpro" else 8)):
        predicted, covariance = model.predict(where, return_cov=True)
        errors = predicted - arm.chain.tip_in_base(where) - rng.normal(0, 1, (300, 3))
        whitened = errors**2 / np.diagonal(covariance, axis1=1, axis2=2)
        assert 1 / most < np.sqrt(whitened.mean()) < most
    inside, outside = (np.median(np.trace(model.member_scatter(q), axis1=1, axis2=2)) for q in (among, beyond))
    assert outside > 25 * inside


def test_the_parts_of_the_covariance_add_up(arm, readings):
    model = small(arm, n_members=3).fit_readings(readings)
    _, covariance = model.predict(readings.angles, return_cov=True)
    left = covariance - model.member_scatter(readings.angles)
    # What is left over is one shape everywhere, grown by a leverage of zero or more.
    growth = left[:, 0, 0] / model.residual_covariance_[0, 0]
    assert (growth > 1).all()
    np.testing.assert_allclose(left, growth[:, None, None] * model.residual_covariance_, rtol=1e-6, atol=1e-12)


def test_a_handful_of_readings_still_gives_a_covariance(arm, readings):
    """Two readings set aside do not tell directions apart: one variance for all."""
    model = small(arm, hidden=(1,), epochs=5).fit_readings(readings.rows(slice(0, 12)))
    covariance = model.residual_covariance_
    np.testing.assert_allclose(covariance, covariance[0, 0] * np.eye(3), rtol=0, atol=1e-12)
    assert covariance[0, 0] > 0


# Interrupts ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit])
def test_an_interrupted_fit_writes_nothing(kind, arm, readings, tmp_path, monkeypatch):
    def stop(done, note):
        if done == 7:
            raise kind

    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind):
        small(arm, n_members=2).fit_readings(readings, progress=stop)
    assert list(tmp_path.iterdir()) == []


# Progress and refusals -----------------------------------------------------------------------------------------------


def test_progress_tells_errors_in_mm(arm, readings):
    told = []
    model = small(arm).fit_readings(readings, progress=lambda done, note: told.append((done, note)))
    assert [done for done, _ in told] == list(range(13))
    scale = np.sqrt(np.mean(model.point_scale_.half_range**2))
    for (done, note), perf, vperf, mu in zip(
        told, model.record_.perf, model.record_.vperf, model.record_.mu, strict=True
    ):
        rms, validation = scale * np.sqrt(perf), scale * np.sqrt(vperf)
        assert note == f"epoch {done}, rms error {rms:.3g} mm, validation {validation:.3g} mm, mu {mu:.0e}"
    told.clear()
    small(arm, n_members=2, trainer="traingd", validation=0.0).fit_readings(
        readings, progress=lambda done, note: told.append((done, note))
    )
    assert [done for done, _ in told] == [*range(13), *range(12, 25)]
    assert told[15][1].startswith("training 2/2, epoch 2, rms error ")
    assert told[15][1].endswith(" mm")  # no damping, nothing set aside


def test_what_does_not_move_is_named(arm, readings):
    still = readings.angles.copy()
    still[:, 1] = 0.25
    with pytest.raises(InputError, match="joint elbow is at 0.25 rad in all 120 readings.*Try: "):
        small(arm).fit_readings(Session(still, readings.points))
    flat = readings.points.copy()
    flat[:, 2] = -3.5
    with pytest.raises(InputError, match="the coordinate z is -3.5 mm in all 120 readings.*Try: "):
        small(arm).fit_readings(Session(readings.angles, flat))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(value, arm, readings):
    for column in ("angles", "points"):
        arrays = {"angles": readings.angles.copy(), "points": readings.points.copy()}
        arrays[column][17, 1] = value
        # A point of which only some coordinates are missing is said apart.
        what = "x, y and z or none of them" if column == "points" and np.isnan(value) else "finite numbers"
        refuses(f"expected {what} in {column}, got ", lambda arrays=arrays: small(arm).fit_readings(Session(**arrays)))
        with pytest.raises(ValueError, match="NaN|infinity"):
            small(arm).fit(arrays["angles"], arrays["points"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_members": 0}, "n_members as a whole number of 1 or more, got 0"),
        ({"n_restarts": 1.5}, "n_restarts as a whole number of 1 or more, got 1.5"),
        ({"epochs": 0}, "epochs as a whole number of 1 or more, got 0"),
        ({"max_fail": "6"}, "max_fail as a whole number of 1 or more, got '6'"),
        ({"seed": -1}, "seed as a whole number of 0 or more, got -1"),
        ({"validation": 1.0}, "validation.*below 1, got 1.0"),
        ({"validation": float("nan")}, "validation.*got nan"),
        ({"validation": 0.999}, "no samples remain to train on"),
        ({"goal": float("inf")}, "goal.*got inf"),
        ({"trainer": "adam"}, "a trainer among .*'traingdx'"),
        ({"hidden": ()}, "one or more hidden layers"),
        ({"hidden": (5, 0)}, "one or more hidden layers"),
        ({"activation": "relu"}, "unknown activation 'relu'"),
    ],
    ids=str,
)
def test_options_out_of_range_are_refused(options, message, arm, readings):
    refuses(message, small(arm, **options).fit_readings, readings)


def test_more_weights_than_coordinates_need_readings_set_aside_or_trainbr(arm, readings):
    few = readings.rows(slice(0, 20))
    for trainer in ("varpro", "traingd"):
        with pytest.raises(InputError, match="60 coordinates for 73 weights.*Try: use validation data"):
            small(arm, hidden=(10,), validation=0.0, trainer=trainer).fit_readings(few)
    small(arm, hidden=(10,), validation=0.0, trainer="trainbr").fit_readings(few)
    small(arm, hidden=(10,)).fit_readings(few)


def test_lengths_tell_a_network_nothing_and_are_refused(arm, readings):
    held = replace(readings, seat=np.array(["A", "B"] * 60))
    lengths = Lengths(np.array(["A"]), np.array(["B"]), np.array([100.0]), np.array([0.01]))
    refuses("learns from points only, and lengths", small(arm).fit_readings, held, lengths=lengths)
