"""A physical model's residual process: when it is kept, whose it is, what a transfer and a file make of it."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification import identify
from truearm.identification.judgement.residual_process import (
    GROUP,
    OF_ARM,
    OF_SESSION,
    OF_SESSIONS,
    process_columns,
    without_process,
)
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.kernel import InducedProcess
from truearm.models import PhysicalModel
from truearm.models.model_file import check_model, load_model
from truearm.models.refit import refit
from truearm.readings import Session
from truearm.verbs.fit import fit
from truearm.wings.exports.export import export
from truearm.wings.exports.formats import json_model
from truearm.wings.importing import datasets
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution

NOISE = 0.05  # mm
TURN = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix()
SHIFT = np.array([900.0, -300.0, 200.0])  # mm


@pytest.fixture(scope="module")
def arm():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [200, 0, 150]
    return Arm("bent", Chain(fixed, np.array([0, 0, 120.0])), title="Three turn", source="made for a test")


def readings(arm, n, rng, *, bend=0.0, is_elsewhere=False, **more):
    """Points with noise and, with `bend` [mm], a smooth error over all joints that no term describes."""
    angles = rng.uniform(-1.2, 1.2, (n, 3))
    total = angles.sum(axis=1)
    waves = np.stack([np.sin(2 * total), np.cos(2 * total), np.sin(2 * angles[:, 0] - 3 * angles[:, 2])], axis=1)
    points = arm.chain.tip_in_base(angles) + bend * waves + rng.normal(0, NOISE, (n, 3))
    return Session(angles, points @ TURN.T + SHIFT if is_elsewhere else points, **more)


def physical(arm, **options):
    return PhysicalModel(arm, highest=2, **options)


@pytest.fixture(scope="module")
def fitted(arm):
    """With and without the process, from the same readings of a bent arm."""
    session = readings(arm, 120, np.random.default_rng(1), bend=0.3)
    return physical(arm).fit_readings(session), physical(arm, residual=False).fit_readings(session)


@pytest.fixture(scope="module")
def test_readings(arm):
    return readings(arm, 200, np.random.default_rng(2), bend=0.3)


def mean_error(model, session):
    return np.linalg.norm(model.predict_readings(session) - session.points, axis=1).mean()


def coverage(model, session):
    points, covariance = model.predict_readings(session, return_cov=True)
    off = points - session.points
    return (np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off) < 7.81).mean()


def test_an_error_that_no_term_describes_is_learned(fitted, test_readings):
    model, plain = fitted
    process = model.residual_process_
    assert process.belongs_to == OF_SESSION
    assert process.is_kept
    assert process.improvement_mm > process.standard_error_mm > 0
    assert plain.residual_process_ is None
    # Of 0.3 mm along each axis more than half goes; the noise is 0.08 mm long.
    assert mean_error(model, test_readings) < 0.6 * mean_error(plain, test_readings)
    assert coverage(model, test_readings) > 0.9
    assert "belongs to this session so far" in str(process)


def in_place_of_terms(model):
    return any("in their place" in term.reason for term in model.excluded_terms_)


def test_it_takes_the_place_of_terms_that_depend_on_the_pose(fitted, arm, test_readings, monkeypatch):
    model, _ = fitted
    assert in_place_of_terms(model)
    assert all(isinstance(term.basis, Constant | InducedProcess) for term in model.fit_.perturbed_chain.terms)
    monkeypatch.setattr("truearm.identification.identify.MAX_SHARE_LEFT", np.inf)  # as if the terms explained enough
    beside = physical(arm).fit_readings(readings(arm, 120, np.random.default_rng(1), bend=0.3))
    assert not in_place_of_terms(beside)
    assert mean_error(model, test_readings) < mean_error(beside, test_readings) + 0.01 * NOISE


@pytest.mark.parametrize("bend", [0.3, pytest.param(0.0, marks=pytest.mark.weekly)])
def test_stretches_of_many_readings_show_what_all_of_them_show(arm, test_readings, monkeypatch, bend):
    """It is tried in a quarter of the readings, and either in all of them or not at all: the model is the same."""
    monkeypatch.setattr("truearm.identification.identify.MAX_SHARE_LEFT", 0.0)  # it is tried in place of all terms
    session = readings(arm, 720, np.random.default_rng(1), bend=bend)
    plain = physical(arm).fit_readings(session)
    monkeypatch.setattr("truearm.identification.references.prepared_readings.STRETCHES", (6, 30))
    tried = []
    judge = identify._may_replace
    monkeypatch.setattr(identify, "_may_replace", lambda *given: tried.append(judge(*given)) or tried[-1])
    model = physical(arm).fit_readings(session)
    assert tried == [bend > 0]
    assert in_place_of_terms(model) == in_place_of_terms(plain) == (bend > 0)
    np.testing.assert_array_equal(model.predict_readings(test_readings), plain.predict_readings(test_readings))


def test_stretches_have_the_prior_of_the_type_that_was_set_after_they_were_prepared(arm, monkeypatch):
    class Asked(Exception):
        pass

    def estimate(some, *_):
        raise Asked(some.prior)

    monkeypatch.setattr("truearm.identification.references.prepared_readings.STRETCHES", (6, 30))
    monkeypatch.setattr(identify, "_weights_without", lambda *_: np.ones(720))
    monkeypatch.setattr(identify, "estimate_without_gross_errors", estimate)
    prepared = physical(arm).prepare(readings(arm, 720, np.random.default_rng(1)))
    with pytest.raises(Asked, match="of the type"):
        identify._may_replace(replace(prepared, prior="of the type"), [], SimpleNamespace(fit=None), None)


@pytest.mark.parametrize("size", [2e-4, pytest.param(8e-4, marks=pytest.mark.weekly)])
def test_terms_that_are_the_cause_stay(arm, size, monkeypatch):
    rng = np.random.default_rng(4)
    angles = rng.uniform(-1.2, 1.2, (150, 3))
    true = angles + size * np.stack([np.sin(2 * angles[:, 0]), np.cos(angles[:, 1]), np.cos(2 * angles[:, 2])], axis=1)
    session = Session(angles, arm.chain.tip_in_base(true) + rng.normal(0, NOISE, (150, 3)))
    # Whatever share of the error they explain: it is tried, and they predict better.
    monkeypatch.setattr("truearm.identification.identify.MAX_SHARE_LEFT", 0.0)
    model = physical(arm).fit_readings(session)
    assert not in_place_of_terms(model)
    assert any("angle error" in term.name for term in model.fit_.perturbed_chain.terms)


def test_a_cable_driven_arm_is_predicted_better_with_a_process_beside_its_constants():
    if datasets.find_local("wam") is None:
        pytest.skip("the data set wam is not at hand (TRUEARM_DATA or ../shared/datasets)")
    train, test = datasets.load_readings("wam").split(by="row", hold_out=0.3, seed=0)
    model = PhysicalModel(load_arm("wam")).fit_readings(train)
    assert in_place_of_terms(model)
    # 2.02 mm by constants, 1.79 with a Gaussian process on what they leave, 1.67 with one beside them
    assert mean_error(model, test) < 1.75
    assert coverage(model, test) > 0.9


def test_far_from_the_readings_it_fades_to_the_arm_without_it_and_says_so(arm, fitted):
    model, _ = fitted
    fit = model.fit_
    std = fit.prior_std[process_columns(fit)][0]
    state = model.state(Session(np.array([[3.0, -2.9, 3.1]])))
    unspanned = fit.unspanned_covariance(state)[0]
    assert np.linalg.eigvalsh(unspanned)[0] > 0.5 * std**2
    assert np.trace(fit.tip_covariance(state)[0]) > np.trace(unspanned)


def test_noise_alone_and_few_readings_bring_none(arm):
    for n, bend in ((120, 0.0), (50, 0.0), (24, 0.3)):
        session = readings(arm, n, np.random.default_rng(n), bend=bend)
        model, plain = physical(arm).fit_readings(session), physical(arm, residual=False).fit_readings(session)
        if model.residual_process_ is None:
            np.testing.assert_array_equal(model.predict(session.angles), plain.predict(session.angles))
        else:
            test = readings(arm, 100, np.random.default_rng(9), bend=bend)
            assert mean_error(model, test) <= mean_error(plain, test)


def test_a_transfer_keeps_what_the_new_readings_show_and_leaves_the_rest_behind(arm, fitted):
    model, plain = fitted
    for bend, is_kept in ((0.3, True), (0.0, False)):
        rng = np.random.default_rng(3)
        new, test = (readings(arm, n, rng, bend=bend, is_elsewhere=True) for n in (25, 100))
        moved = refit(model, new)
        assert moved.residual_process_.is_kept == is_kept
        assert process_columns(moved.fit_).any() == is_kept
        assert moved.residual_process_.belongs_to == (OF_ARM if is_kept else OF_SESSION)
        # As good as the arm without the process or better: it may have drawn other terms a little.
        assert mean_error(moved, test) < (0.7 if is_kept else 1.2) * mean_error(refit(plain, new), test)
        assert ("left behind" in str(moved.residual_process_)) != is_kept
    assert model.residual_process_.belongs_to == OF_SESSION  # it stays as it was


def test_without_a_free_base_the_set_up_is_the_same_and_the_process_stays(arm, fitted):
    model, _ = fitted
    moved = refit(model, readings(arm, 12, np.random.default_rng(4), bend=0.3), free=("tip",))
    assert moved.residual_process_ == replace(model.residual_process_, is_judged=False)
    assert process_columns(moved.fit_).any()
    assert "not judged in this transfer" in str(moved.residual_process_)
    assert moved.residual_process_.after_transfer(1.0, 0.1).is_judged


@pytest.mark.parametrize("is_common", [True, False])
def test_several_sessions_show_whose_it_is(arm, is_common):
    rng = np.random.default_rng(5)
    parts = [
        readings(arm, 110, rng, bend=0.3, session=np.full(110, "first")),
        readings(arm, 110, rng, bend=0.3 if is_common else -0.3, is_elsewhere=True, session=np.full(110, "second")),
    ]
    session = Session(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("angles", "points")),
        session=np.concatenate([part.session for part in parts]),
    )
    process = physical(arm).fit_readings(session).residual_process_
    if is_common:
        assert process.belongs_to == OF_ARM
        assert "belongs to the arm" in str(process)
    else:
        assert process is None


def test_sessions_too_small_to_be_held_out_leave_open_whose_it_is(arm):
    session = readings(arm, 100, np.random.default_rng(6), bend=0.3, session=np.array(["one"] * 90 + ["two"] * 10))
    process = PhysicalModel(arm, highest=1).fit_readings(session).residual_process_
    assert process.belongs_to == OF_SESSIONS
    assert "was not tested" in str(process)
    assert not process.after_transfer(0.0, 0.1).is_kept


def test_drawn_arms_scatter_as_the_model_states_far_from_its_readings(fitted):
    model = copy.copy(fitted[0])
    far = np.random.default_rng(0).uniform(-3, 3, (10, 3))
    # Terms without uncertainty and no residual errors, which other tests know.
    model.fit_ = replace(model.fit_, covariance=np.zeros_like(model.fit_.covariance))
    drawn = PosteriorDistribution(model, repeatability_mm=model.residual_std_)
    errors = np.array([drawn.draw(k).systematic(far) for k in range(200)])
    stated = np.trace(model.fit_.tip_covariance(model.state(Session(far))), axis1=1, axis2=2)
    found = (errors**2).sum(axis=2).mean(axis=0) / model.birge_ratio_**2
    # 200 arms of three components: a variance at one of ten poses is off by some 6 %.
    assert np.median(found / stated) == pytest.approx(1.0, abs=0.15)


def test_the_automatic_choice_may_be_made_without_the_process(arm, monkeypatch):
    def stop(*_, **options):
        raise InputError(f"residual {options['residual']}")

    session = readings(arm, 20, np.random.default_rng(1))
    monkeypatch.setattr("truearm.verbs.fit.select_model", stop)
    refuses("residual False", fit, arm, session, residual=False)
    refuses("belong to one model", fit, arm, session, hidden=(3,))


def test_the_directions_of_a_process_share_one_remainder(fitted, monkeypatch):
    model, _ = fitted
    calls = []
    remainder = InducedProcess.remainder
    monkeypatch.setattr(InducedProcess, "remainder", lambda self, state: calls.append(0) or remainder(self, state))
    model.predict(np.zeros((1, 3)), return_cov=True)
    assert len(calls) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda model, basis: {"residual_process_": None},
        lambda model, basis: {"residual_process_": replace(model.residual_process_, is_kept=False)},
        lambda model, basis: {"residual_process_": replace(model.residual_process_, n_points=7)},
        lambda model, basis: {"residual_process_": replace(model.residual_process_, length_scales=(9.0, 9.0, 9.0))},
        lambda model, basis: {"fit_": _with_basis(model.fit_, replace(basis, sliding=(1,)))},
    ],
)
def test_a_record_of_another_process_than_that_of_the_terms_is_refused(fitted, change):
    model = copy.copy(fitted[0])
    check_model(model)
    basis = model.fit_.processes[0][0].basis
    vars(model).update(change(model, basis))
    refuses("process", check_model, model)


def _with_basis(fit, basis):
    terms = tuple(replace(term, basis=basis) if term.group == GROUP else term for term in fit.perturbed_chain.terms)
    return replace(fit, perturbed_chain=replace(fit.perturbed_chain, terms=terms))


def test_the_arm_without_its_process_is_the_posterior_given_that_it_is_zero(fitted):
    model, _ = fitted
    fit, without = model.fit_, without_process(model.fit_)
    drop = process_columns(fit)
    precision = np.linalg.inv(fit.covariance)
    # Conditioning takes the block of the precision: the other way to the same covariance.
    np.testing.assert_allclose(without.covariance @ precision[np.ix_(~drop, ~drop)], np.eye((~drop).sum()), atol=1e-4)
    assert without_process(without) is without


def test_a_file_brings_it_back(fitted, test_readings, tmp_path):
    model, _ = fitted
    model.save(tmp_path / "bent.truearm")
    again = load_model(tmp_path / "bent.truearm")
    assert again.residual_process_ == model.residual_process_
    for a, b in zip(
        again.predict_readings(test_readings, return_cov=True),
        model.predict_readings(test_readings, return_cov=True),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "change",
    [
        {"belongs_to": "nobody"},
        {"n_points": 0},
        {"length_scales": (1.0,)},
        {"length_scales": (1.0, 0.0, 1.0)},
        {"rms_mm": -1.0},
        {"standard_error_mm": -1.0},
        {"residual_std_without_mm": float("inf")},
        {"evidence": float("nan")},
    ],
)
def test_impossible_numbers_of_a_file_are_refused(fitted, change):
    refuses("residual process", replace(fitted[0].residual_process_, **change).check, 3)


def test_the_option_is_checked(arm):
    with pytest.raises(InputError, match="residual as true or false"):
        PhysicalModel(arm, residual="yes").fit_readings(readings(arm, 20, np.random.default_rng(0)))


def test_json_has_the_process_and_source_code_says_how_to_do_without(fitted, tmp_path):
    model, _ = fitted
    export(model, tmp_path / "bent.json")
    joints = np.array([[0.3, -0.4, 0.9], [2.9, 2.0, -3.0]])
    # The document has all digits of the numbers.
    np.testing.assert_allclose(json_model.tips(tmp_path / "bent.json", joints), model.predict(joints), atol=1e-9)
    assert "--no-residual-process" in str(refuses("residual process", export, model, tmp_path / "bent.c").hint)
    assert not (tmp_path / "bent.c").exists()
