"""Readings as an arm identified without their group sees them: the closed form against identifying it without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load
from truearm.identify import leave_out
from truearm.identify.identification import Identified, identify
from truearm.identify.leave_out import leave_groups_out, root_of
from truearm.identify.references import Points, seats_of
from truearm.poses.seat import seat
from truearm.terms import ArmState, constants

NOISE = 0.02  # mm


@pytest.fixture(scope="module")
def drawn():
    """A `gao2017` a little off, 60 readings with points and 40 in four seats, and terms whose priors stay."""
    rng = np.random.default_rng(5)
    arm = load("gao2017")
    chain = arm.chain.with_motions(np.array([1e-3] * 3 + [0.5] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    poses = seat(replace(arm, chain=chain), 40, seed=3, seats=4)
    angles = np.concatenate([arm.working + 0.8 * rng.uniform(-1, 1, (60, 6)), poses.angles])
    angles[60:] += rng.normal(0, 1e-5, (40, 6))  # 0.01 mm
    points = chain.tip_in_base(angles[:60]) + rng.normal(0, NOISE, (60, 3))
    terms = [replace(term, learn=False) for term in constants(arm.chain, free=("tip",), angle_std=1e-3, length_std=0.5)]
    return arm, angles, points, poses.seat, terms


def identified(drawn, rows, *, std=None, seats=True) -> Identified:
    """The arm from some of the readings; no weights, so that all is least squares."""
    arm, angles, points, names, terms = drawn
    seen, held = np.flatnonzero(rows < 60), np.flatnonzero(rows >= 60)
    references = [Points(seen, points[rows[seen]], None if std is None else std[rows[seen]])] if len(seen) else []
    if seats and len(held):
        references.append(seats_of(held, names[rows[held] - 60]))
    return identify(arm.chain, ArmState(arm.chain, angles[rows]), terms, references, robust=False)


@pytest.fixture
def known_noise(monkeypatch):
    """The noise is known: what is estimated with a group differs from that without it."""
    monkeypatch.setattr("truearm.identify.identification.unexplained_variance", lambda *_, **__: NOISE**2)


@pytest.mark.usefixtures("known_noise")
@pytest.mark.parametrize("per_group", [1, 6, 30])
@pytest.mark.parametrize("with_std", [False, True])
def test_points_left_out_are_those_of_an_arm_identified_without_them(per_group, with_std, drawn):
    """To a hundredth of the noise, which is what the arm's bent coordinates leave of a linear law."""
    arm, angles, points, *_ = drawn
    std = np.linspace(0.005, 0.03, 60)[:, None] * [1.0, 1, 2] if with_std else None
    rows = np.arange(60)
    group = rows // per_group
    fit = identified(drawn, rows, std=std)
    found = leave_groups_out(fit, ArmState(arm.chain, angles[rows]), group)
    assert sorted(found.rows.tolist()) == rows.tolist()
    np.testing.assert_array_equal(found.group, group[found.rows])
    assert (found.freedom == 1).all()
    for key in np.unique(group)[:: max(1, 30 // per_group)]:
        out = group == key
        without = identified(drawn, rows[~out], std=std)
        state = ArmState(arm.chain, angles[rows[out]])
        here = np.flatnonzero(found.group == key)
        here = here[np.argsort(found.rows[here])]
        residuals = np.linalg.norm(fit.references[0].residuals[:, out], axis=0)
        deviations = without.tips(state) - points[rows[out]]
        np.testing.assert_allclose(found.deviations[here], deviations, atol=0.01 * NOISE)
        assert np.linalg.norm(deviations, axis=1).mean() > residuals.mean()
        expected = without.tip_covariance(state)
        if with_std:
            expected += std[rows[out]][:, :, None] ** 2 * np.eye(3)
        np.testing.assert_allclose(found.covariance[here], expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.usefixtures("known_noise")
def test_seats_left_out_scatter_about_their_own_mean(drawn):
    arm, angles, _, names, _ = drawn
    rows = np.arange(100)
    group = np.concatenate([np.arange(60), 60 + np.unique(names, return_inverse=True)[1]])
    fit = identified(drawn, rows)
    found = leave_groups_out(fit, ArmState(arm.chain, angles), group)
    assert sorted(found.rows.tolist()) == rows.tolist()
    for key in np.unique(group[60:]):
        out = group == key
        without = identified(drawn, rows[~out])
        tips = without.tips(ArmState(arm.chain, angles[out]))
        here = np.flatnonzero(found.group == key)
        here = here[np.argsort(found.rows[here])]
        np.testing.assert_allclose(found.deviations[here], tips - tips.mean(axis=0), atol=0.01 * NOISE)
        np.testing.assert_allclose(found.freedom[here], 1 - 1 / out.sum())


def test_a_seat_of_one_reading_shows_nothing(drawn):
    arm, angles, *_ = drawn
    rows = np.r_[0:60, 60:65, 70]  # five in one seat, one in another
    fit = identified(drawn, rows)
    found = leave_groups_out(fit, ArmState(arm.chain, angles[rows]), np.r_[0:60, [60] * 5, 61])
    assert sorted(found.rows.tolist()) == list(range(65))
    alone = leave_groups_out(fit, ArmState(arm.chain, angles[rows]), np.arange(66))
    assert sorted(alone.rows.tolist()) == list(range(60))


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_pieces_of_any_size_are_the_same(chunk, drawn, monkeypatch):
    arm, angles, _, names, _ = drawn
    fit = identified(drawn, np.arange(100))
    state = ArmState(arm.chain, angles)
    group = np.concatenate([np.arange(60) // 4, 60 + np.unique(names, return_inverse=True)[1]])
    whole = leave_groups_out(fit, state, group)
    monkeypatch.setattr(leave_out, "CHUNK", chunk)
    found = leave_groups_out(fit, state, group)
    for part in ("rows", "group", "deviations", "covariance", "freedom"):
        np.testing.assert_allclose(getattr(found, part), getattr(whole, part), atol=1e-9)


def test_nothing_to_leave_out_is_an_empty_record(drawn):
    arm, angles, *_ = drawn
    rows = np.r_[0:10, 60:62]
    fit = identified(drawn, rows)
    seats_only = replace(fit, references=fit.references[1:])
    found = leave_groups_out(seats_only, ArmState(arm.chain, angles[rows]), np.arange(12))
    assert [len(getattr(found, part)) for part in ("rows", "group", "deviations", "covariance", "freedom")] == [0] * 5


def test_an_arm_without_terms_deviates_as_it_did(drawn):
    arm, angles, points, *_ = drawn
    state = ArmState(arm.chain, angles[:60])
    fit = identify(arm.chain, state, [], [Points(np.arange(60), points)])
    found = leave_groups_out(fit, state, np.arange(60))
    np.testing.assert_allclose(found.deviations, arm.chain.tip_in_base(angles[:60]) - points, atol=1e-9)
    assert not found.covariance.any()


def test_a_pose_that_alone_tells_something_has_a_large_error(rng):
    """Joint 6 moved in one reading only: without it, nobody knows where its zero is."""
    arm = load("gao2017")
    angles = arm.working + 0.5 * rng.uniform(-1, 1, (30, 6))
    angles[:, 5] = angles[0, 5]
    angles[11, 5] += 2.0
    terms = constants(arm.chain, free=("tip",), angle_std=3e-2, length_std=3.0)
    truth = arm.chain.with_motions(np.array([1e-2] * 3 + [1] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    state = ArmState(arm.chain, angles)
    fit = identify(arm.chain, state, terms, [Points(np.arange(30), truth.tip_in_base(angles))])
    found = leave_groups_out(fit, state, np.arange(30))
    assert np.argmax(np.linalg.eigvalsh(found.covariance)[:, -1]) == 11


def test_the_root_of_a_covariance_is_one_singular_or_not(rng):
    half = rng.normal(size=(6, 4)) * [1e-6, 1, 1e6, 1]
    for covariance in (half.T @ half, half @ half.T, np.zeros((3, 3)), np.zeros((0, 0))):
        root = root_of(covariance)
        scale = np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
        np.testing.assert_allclose(root.T @ root, covariance, atol=1e-9 * scale.max(initial=0))
