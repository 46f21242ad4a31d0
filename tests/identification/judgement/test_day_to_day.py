"""What changes from day to day: its covariance, and its size from several sessions."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.propagation import relative_covariance
from truearm.identification.judgement.day_to_day import (
    BASE_SHIFT_SHARE,
    COMPONENTS,
    GROUP,
    SHIFT_SHARE,
    TILT_STD,
    day_to_day_terms,
    on_another_day,
)
from truearm.identification.terms import Constant, InSession, Temperature
from truearm.identification.terms.catalogue import base_terms
from truearm.models import KinematicModel, NominalModel, PhysicalModel, load_model
from truearm.readings import Session
from truearm.solve.linear_algebra import unit_diagonal
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset


@pytest.fixture(scope="module")
def arm():
    return load_arm("gao2017")


def days(arm, *, size: float, n_days: int, n: int = 60, seed: int = 0) -> Session:
    """Readings of several sessions in one frame, with joints that tilt anew in each by `size` usual days."""
    rng = np.random.default_rng(seed)
    angles = measuring_poses(arm, n * n_days, seed=seed).angles
    points = np.empty((n * n_days, 3))
    for day in range(n_days):
        motions = np.zeros((arm.chain.n_places, 6))
        stds = [TILT_STD if c < 3 else SHIFT_SHARE * arm.chain.reach for c in COMPONENTS]
        motions[1:-1, list(COMPONENTS)] = size * np.array(stds) * rng.standard_normal((arm.n_joints, 4))
        rows = slice(day * n, (day + 1) * n)
        points[rows] = arm.chain.with_motions(motions).tip_in_base(angles[rows])
    points += 0.002 * rng.standard_normal(points.shape)
    return Session(angles, points, session=np.repeat([f"day {i}" for i in range(n_days)], n))


def added_variances(fit):
    return (on_another_day(fit).covariance - fit.covariance).diagonal()


def test_one_session_has_nothing_to_compare(arm):
    assert day_to_day_terms(arm.chain, []) == []
    assert day_to_day_terms(arm.chain, ["Monday"]) == []
    assert len(day_to_day_terms(arm.chain, ["Monday", "Friday"])) == 2 * arm.n_joints * len(COMPONENTS)


def test_readings_of_one_day_state_the_days_of_reading_and_of_use(arm):
    """To the variance of a tilt or a shift twice that of a day, of the free base too; nothing to the others."""
    readings = replace(days(arm, size=1.0, n_days=1), session=None)
    fit = KinematicModel(arm).fit_readings(readings).fit_
    added = added_variances(fit)
    for term, columns in zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True):
        component = int(np.argmax(term.direction))
        std = TILT_STD if component < 3 else SHIFT_SHARE * arm.chain.reach
        moves = isinstance(term.basis, Constant) and 1 <= term.place <= arm.n_joints and component in COMPONENTS
        if is_base := isinstance(term.basis, Constant) and term.place == 0:
            std = TILT_STD if component < 3 else BASE_SHIFT_SHARE * arm.chain.reach
        assert added[columns] == pytest.approx(2 * std**2 if moves or is_base else 0.0, rel=1e-6, abs=1e-22)


def test_a_base_that_settles_is_within_the_uncertainty_and_moves_no_length(arm):
    """Every tip is uncertain by the base's shift of both days at least; tips relative to each other are not by it."""
    model = KinematicModel(arm).fit_readings(replace(days(arm, size=0.0, n_days=1), session=None))
    state = model.checked(replace(days(arm, size=0.0, n_days=1, n=20, seed=3), session=None)).state
    later = on_another_day(model.fit_)
    added = later.tip_covariance(state) - model.fit_.tip_covariance(state)
    assert np.linalg.eigvalsh(added).min() > 2 * (BASE_SHIFT_SHARE * arm.chain.reach) ** 2
    of_base = np.where(later.columns_of(lambda term: term in base_terms(arm.chain)), added_variances(model.fit_), 0.0)
    alone = replace(later, covariance=np.diag(of_base))
    assert np.abs(relative_covariance(alone, state)).max() < 1e-9 * np.abs(alone.tip_covariance(state)).max()


def test_several_sessions_show_the_size_of_a_day(arm):
    """The common scale follows the planted one: 24 motions of each of four days determine it to a factor of two."""
    for size in (1.0, 8.0):
        model = KinematicModel(arm).fit_readings(days(arm, size=size, n_days=4))
        (scale,) = (group.scale for group in model.fit_.groups if group.name == GROUP)
        assert size / 2 < scale < 2 * size


def test_the_nominal_model_has_no_days(arm):
    model = NominalModel(arm).fit_readings(days(arm, size=1.0, n_days=2))
    assert all(group.name != GROUP for group in model.fit_.groups)


def test_a_model_of_several_days_predicts_another_one_and_is_read_again(arm, tmp_path):
    readings = days(arm, size=8.0, n_days=3)
    model = KinematicModel(arm).fit_readings(readings)
    model.save(tmp_path / "model.truearm")
    read = load_model(tmp_path / "model.truearm")
    points, covariance = model.predict(readings.angles[:5], return_cov=True)
    again, covariance_again = read.predict(readings.angles[:5], return_cov=True)
    np.testing.assert_array_equal(again, points)
    np.testing.assert_array_equal(covariance_again, covariance)
    assert not any(isinstance(term.basis, InSession) and term.place for term in read.fit_.perturbed_chain.terms)


def test_days_of_changing_temperature_leave_a_covariance(arm):
    """What growth does to the constants was taken off without the days' motions, which left variances below zero."""
    session = VirtualArm.draw(arm, load_preset("shop"), seed=1).measure(measuring_poses(arm, 60, seed=1).angles, seed=1)
    readings = replace(session.readings, session=np.repeat(["Monday", "Friday"], 30))
    fit = PhysicalModel(arm, highest=4).fit_readings(readings).fit_
    assert any(isinstance(term.basis, Temperature) for term in fit.perturbed_chain.terms)
    assert all(term.group != GROUP for term in fit.perturbed_chain.terms)
    unit, _ = unit_diagonal(fit.covariance)
    assert np.linalg.eigvalsh(unit).min() > -1e-9  # of rounding


def test_sessions_that_show_no_difference_leave_the_usual_one(arm):
    """Noise of 0.5 mm hides a day of 2 um: not seen is not none."""
    readings = days(arm, size=0.0, n_days=2)
    noisy = replace(readings, points=readings.points + 0.5 * np.random.default_rng(5).standard_normal((120, 3)))
    fit = KinematicModel(arm).fit_readings(noisy).fit_
    hidden = replace(fit, groups=tuple(replace(group, scale=0.0) for group in fit.groups))
    assert added_variances(hidden).max() >= 2 * TILT_STD**2 * 0.99


def test_very_few_readings_leave_the_constants_alone(arm):
    """Twelve readings have 36 coordinates; terms that pass through all of them would state a noise of nothing."""
    session = VirtualArm.draw(arm, load_preset("shop"), seed=1).measure(measuring_poses(arm, 12, seed=1).angles, seed=1)
    model = PhysicalModel(arm, highest=4).fit_readings(session.readings)
    assert any(term.reason == "there are too few readings" for term in model.excluded_terms_)
    assert model.residual_std_ > 5e-4  # mm
