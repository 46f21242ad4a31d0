"""Readings as an arm identified without their group sees them: the closed form against identifying it without."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_jacobian import plain_jacobian
from truearm.arm import load_arm
from truearm.identification.estimation.covariance_root import CovarianceRoot
from truearm.identification.estimation.identification import identify, initial_problem
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.judgement import cross_validation
from truearm.identification.judgement.cross_validation import (
    cross_validate_by_group,
    cross_validate_regions,
    group_batches,
)
from truearm.identification.references.orientations import Orientations
from truearm.identification.references.references import Length, Points, Seats, seats_of
from truearm.identification.terms import ArmState, constants
from truearm.identification.terms.basis import Harmonics
from truearm.identification.terms.catalogue import tool_rotation
from truearm.identification.terms.term import Term
from truearm.solve.linear_algebra import covariance_factor
from truearm.wings.planning.designs.sampling import seat

NOISE = 0.02  # mm


@pytest.fixture(scope="module")
def drawn():
    """A `gao2017` a little off, 60 readings with points and 40 in four seats, and terms whose priors stay."""
    rng = np.random.default_rng(5)
    arm = load_arm("gao2017")
    chain = arm.chain.with_motions(np.array([1e-3] * 3 + [0.5] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    poses = seat(replace(arm, chain=chain), 40, seed=3, seats=4)
    angles = np.concatenate([arm.working + 0.8 * rng.uniform(-1, 1, (60, 6)), poses.angles])
    angles[60:] += rng.normal(0, 1e-5, (40, 6))  # 0.01 mm
    points = chain.tip_in_base(angles[:60]) + rng.normal(0, NOISE, (60, 3))
    terms = [replace(term, learn=False) for term in constants(arm.chain, free=("tip",), angle_std=1e-3, length_std=0.5)]
    return arm, angles, points, poses.seat, terms


def identified(drawn, rows, *, std=None) -> IdentificationResult:
    """The arm from some of the readings; no weights, so that all is least squares."""
    arm, angles, _, _, terms = drawn
    return identify(
        arm.chain, ArmState(arm.chain, angles[rows]), terms, references_of(drawn, rows, std=std), robust=False
    )


def references_of(drawn, rows, *, std=None):
    _, _, points, names, _ = drawn
    seen, held = np.flatnonzero(rows < 60), np.flatnonzero(rows >= 60)
    references = [Points(seen, points[rows[seen]], None if std is None else std[rows[seen]])] if len(seen) else []
    if len(held):
        references.append(seats_of(held, names[rows[held] - 60]))
    return references


@pytest.fixture
def known_noise(monkeypatch):
    """The noise is known: what is estimated with a group differs from that without it."""
    monkeypatch.setattr("truearm.identification.estimation.rounds.paule_mandel_variance", lambda *_, **__: NOISE**2)


def test_an_identification_can_be_resumed(drawn):
    """By its parameters, where the problem has the same residuals, and by its weights."""
    rows = np.arange(100)
    fit = identified(drawn, rows)
    problem, _ = initial_problem(fit.perturbed_chain, ArmState(drawn[0].chain, drawn[1]), references_of(drawn, rows))
    for part, residuals in zip(fit.references, problem.residuals(fit.parameters), strict=True):
        np.testing.assert_array_equal(part.residuals, residuals)
        # Whitened: one, less what parameters take up of it, a twentieth of points and a quarter of seats.
        assert 0.6 < np.mean((part.weights * part.residuals) ** 2) < 1
        # Residuals of a reading that is trusted by a quarter count half.
        np.testing.assert_allclose(
            replace(part, robust_weight=part.robust_weight / 4).weights, part.weights / 2, rtol=1e-15
        )


@pytest.mark.usefixtures("known_noise")
@pytest.mark.parametrize("per_group", [1, 6, 30])
@pytest.mark.parametrize("with_std", [False, True])
def test_held_out_points_equal_those_of_an_arm_identified_without_them(per_group, with_std, drawn):
    """To a hundredth of the noise, which is what the arm's bent coordinates leave of a linear law."""
    arm, angles, points, *_ = drawn
    std = np.linspace(0.005, 0.03, 60)[:, None] * [1.0, 1, 2] if with_std else None
    rows = np.arange(60)
    group = rows // per_group
    fit = identified(drawn, rows, std=std)
    found = cross_validate_by_group(fit, ArmState(arm.chain, angles[rows]), references_of(drawn, rows, std=std), group)
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
def test_held_out_seats_scatter_about_their_own_mean(drawn):
    arm, angles, _, names, _ = drawn
    rows = np.arange(100)
    group = np.concatenate([np.arange(60), 60 + np.unique(names, return_inverse=True)[1]])
    fit = identified(drawn, rows)
    found = cross_validate_by_group(fit, ArmState(arm.chain, angles), references_of(drawn, rows), group)
    assert sorted(found.rows.tolist()) == rows.tolist()
    for key in np.unique(group[60:]):
        out = group == key
        without = identified(drawn, rows[~out])
        tips = without.tips(ArmState(arm.chain, angles[out]))
        here = np.flatnonzero(found.group == key)
        here = here[np.argsort(found.rows[here])]
        np.testing.assert_allclose(found.deviations[here], tips - tips.mean(axis=0), atol=0.01 * NOISE)
        np.testing.assert_allclose(found.freedom[here], 1 - 1 / out.sum())


@pytest.fixture(scope="module")
def everything(drawn):
    """40 of the points, with orientations of the flange, and all seats, in pairs a known length apart."""
    arm, angles, points, names, terms = drawn
    rng = np.random.default_rng(6)
    rows = np.r_[:40, 60:100]
    chain = identified(drawn, np.arange(100)).chain  # as good as the true one
    true = Rotation.from_matrix(chain.pose(angles[:40]).R_base_tip)
    seen = (true * Rotation.from_rotvec(rng.normal(0, NOISE / 1000, (40, 3)))).as_matrix()
    places = {str(name): chain.tip_in_base(angles[60:][names == name]).mean(axis=0) for name in np.unique(names)}
    a, b, c, d = places
    lengths = [
        (one, other, float(np.linalg.norm(places[one] - places[other])), 0.005) for one, other in ((a, b), (c, d))
    ]

    def references(kept):
        """Of readings `kept`, numbered among themselves; lengths whose seats are both there."""
        pointed, held = np.flatnonzero(kept < 40), np.flatnonzero(kept >= 40)
        seat = names[kept[held] - 40]
        between = [length for length in lengths if np.isin(length[:2], seat).all()]
        return [
            Points(pointed, points[kept[pointed]]),
            Orientations(pointed, seen[kept[pointed]]),
            seats_of(held, seat, between),
        ]

    return arm, angles[rows], names, [*terms, *tool_rotation(arm.chain)], references


def dense_covariance(fit, state, references, noise=NOISE):
    """Of coefficients and unknowns, by the inverse of the dense matrix at the minimum, under a noise of readings."""
    problem, _ = initial_problem(fit.perturbed_chain, state, references)
    x = np.concatenate([fit.coefficients, *(list(part.unknowns.values()) for part in fit.references)])
    J = np.concatenate([(by / noise).reshape(len(x), -1) for by in plain_jacobian(problem, x)], axis=1)
    gram = J @ J.T + problem.constraints(x).dense()
    p = len(fit.coefficients)
    gram[np.arange(p), np.arange(p)] += fit.prior_std**-2
    size = np.sqrt(gram.diagonal())
    return np.linalg.inv(gram / np.outer(size, size)) / np.outer(size, size), problem, x


@pytest.mark.usefixtures("known_noise")
@pytest.mark.parametrize("case", ["pose by pose", "a seat", "both seats of a pair", "half of every seat, and poses"])
def test_held_out_references_of_all_kinds_equal_those_of_an_arm_identified_without_them(case, everything):
    """Deviations to a hundredth of the noise, covariances to a hundredth of the largest."""
    arm, angles, names, terms, references = everything
    everyone = np.arange(80)
    number = np.unique(names, return_inverse=True)[1]
    group = {
        "pose by pose": np.arange(80),
        "a seat": np.r_[np.arange(40), 40 + number],
        "both seats of a pair": np.r_[np.arange(40), 40 + number // 2],
        "half of every seat, and poses": everyone % 2,
    }[case]
    state = ArmState(arm.chain, angles)
    fit = identify(arm.chain, state, terms, references(everyone), robust=False)
    found = cross_validate_by_group(fit, state, references(everyone), group)
    assert sorted(found.rows.tolist()) == everyone.tolist()
    for key in {"pose by pose": [3, 60], "a seat": [5, 41], "both seats of a pair": [40]}.get(case, [0, 1]):
        out = group == key
        kept = np.flatnonzero(~out)
        there = ArmState(arm.chain, angles[kept])
        without = identify(arm.chain, there, terms, references(kept), robust=False)
        covariance, problem, x = dense_covariance(without, there, references(kept))
        tips = without.tips(state)
        by = np.concatenate(
            [columns for _, _, columns in without.perturbed_chain.derivatives(state, without.coefficients)], axis=2
        )
        here = np.flatnonzero(found.group == key)
        here = here[np.argsort(found.rows[here])]
        deviations, spread, freedom = [], [], []
        for row in np.flatnonzero(out):
            J = np.zeros((3, len(x)))
            J[:, : len(by)] = by[..., row].T
            if row < 40:
                known, share = references(everyone)[0].points[row], 1.0
            elif names[row - 40] in problem.references[-1].names:
                start = problem.unknowns_of(2).start + 3 * problem.references[-1].names.index(names[row - 40])
                known, share = x[start : start + 3], 1.0
                J[:, start : start + 3] = -np.eye(3)
            else:
                mates = 40 + np.flatnonzero(names == names[row - 40])
                known, share = tips[mates].mean(axis=0), 1 - 1 / len(mates)
                J[:, : len(by)] -= by[..., mates].mean(axis=2).T
            deviations.append(tips[row] - known)
            spread.append(J @ covariance @ J.T)
            freedom.append(share)
        np.testing.assert_allclose(found.deviations[here], deviations, atol=0.01 * NOISE)
        np.testing.assert_allclose(found.covariance[here], spread, atol=0.01 * np.abs(spread).max())
        np.testing.assert_allclose(found.freedom[here], freedom, atol=1e-6)


def test_an_artefact_in_several_places_is_held_out_as_in_dense_algebra(drawn):
    """Two pairs of seats, one bar's length apart: S of all parameters, the bar's length among them, written out."""
    arm, angles, _, names, terms = drawn
    state = ArmState(arm.chain, angles[60:])
    unique, number = np.unique(names, return_inverse=True)
    lengths = tuple(Length(a, a + 1, 300.0, 0.01, "bar", 0.005) for a in (0, 2))
    references = [Seats(np.arange(40), number, tuple(map(str, unique)), lengths)]
    fit = identify(arm.chain, state, terms, references)
    (part,) = fit.references
    covariance, problem, x = dense_covariance(
        fit, state, references, noise=1 / np.sqrt(part.robust_weight) * part.noise_std
    )
    (J,) = plain_jacobian(problem, x)
    group = np.arange(40) % 3
    found = cross_validate_by_group(fit, state, references, group)
    assert sorted(found.rows.tolist()) == list(range(40))
    for key in range(3):
        rows = np.flatnonzero(group == key)
        w = np.tile(np.sqrt(part.robust_weight[rows]) / part.noise_std, 3)
        A = J[..., rows].reshape(len(x), -1) * w
        S = A.T @ covariance @ A
        residuals = np.linalg.solve(np.eye(len(S)) - S, w * part.residuals[:, rows].ravel()) / w
        spread = (S @ np.linalg.inv(np.eye(len(S)) - S) / np.outer(w, w)).reshape(3, len(rows), 3, len(rows))
        here = np.flatnonzero(found.group == key)
        here = here[np.argsort(found.rows[here])]
        np.testing.assert_allclose(
            found.deviations[here].T, residuals.reshape(3, -1), atol=1e-6 * np.abs(residuals).max()
        )
        expected = np.einsum("imjm->mij", spread)
        np.testing.assert_allclose(found.covariance[here], expected, atol=1e-6 * expected.max())


def test_a_seat_of_one_reading_shows_nothing(drawn):
    arm, angles, *_ = drawn
    rows = np.r_[0:60, 60:65, 70]  # five in one seat, one in another
    fit = identified(drawn, rows)
    state, references = ArmState(arm.chain, angles[rows]), references_of(drawn, rows)
    found = cross_validate_by_group(fit, state, references, np.r_[0:60, [60] * 5, 61])
    assert sorted(found.rows.tolist()) == list(range(65))
    alone = cross_validate_by_group(fit, state, references, np.arange(66))
    assert sorted(alone.rows.tolist()) == list(range(65))


def test_a_reading_with_point_and_seat_is_judged_by_the_point_alone(drawn):
    arm, angles, points, names, terms = drawn
    pointed = Points(np.arange(62), np.concatenate([points, arm.chain.tip_in_base(angles[60:62])]))
    references = [pointed, seats_of(np.arange(60, 100), names)]
    state = ArmState(arm.chain, angles)
    fit = identify(arm.chain, state, terms, references)
    for group in (np.arange(100), np.arange(100) // 20):
        found = cross_validate_by_group(fit, state, references, group)
        assert sorted(found.rows.tolist()) == list(range(100))
        assert (found.freedom[found.rows < 62] == 1).all()


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_pieces_of_any_size_are_the_same(chunk, drawn, monkeypatch):
    arm, angles, _, names, _ = drawn
    fit = identified(drawn, np.arange(100))
    state = ArmState(arm.chain, angles)
    group = np.concatenate([np.arange(60) // 30, 1 + np.unique(names, return_inverse=True)[1]])
    references = references_of(drawn, np.arange(100))
    whole = cross_validate_by_group(fit, state, references, group)
    monkeypatch.setattr(cross_validation, "MOST_READINGS", chunk)
    found = cross_validate_by_group(fit, state, references, group)
    for part in ("rows", "group", "deviations", "covariance", "freedom"):
        np.testing.assert_allclose(getattr(found, part), getattr(whole, part), atol=1e-9)


@pytest.mark.parametrize("n_groups", [2, 9, 60])
def test_stacked_groups_are_the_same_as_one_by_one(n_groups, drawn, monkeypatch):
    arm, angles, *_ = drawn
    fit, state = identified(drawn, np.arange(60)), ArmState(arm.chain, angles[:60])
    group = np.random.default_rng(1).integers(0, n_groups, 60)
    references = references_of(drawn, np.arange(60))
    stacked = cross_validate_by_group(fit, state, references, group)

    def one_by_one(self, batch, group):
        for members in batch.members():
            yield from self._without(self._group(members), partial(self._pieces, members), group)

    monkeypatch.setattr(cross_validation._Minimum, "_without_stacked", one_by_one)
    plain = cross_validate_by_group(fit, state, references, group)
    for part in ("rows", "group", "deviations", "covariance", "freedom"):
        # [mm, mm^2]: rounding of inverses of which the largest is 1 / LEAST_FREEDOM
        np.testing.assert_allclose(getattr(stacked, part), getattr(plain, part), atol=1e-9)


def test_in_single_precision_deviations_are_the_same_to_1e_4_of_their_standard_deviations(drawn, monkeypatch):
    """Of many harmonics and readings; where rounding might be more, single precision is not used."""
    (arm, *_), rng, orders = drawn, np.random.default_rng(2), tuple(range(1, 15))
    angles = arm.working + rng.uniform(-2, 2, (200, 6))
    points = arm.chain.tip_in_base(angles + 1e-3 * np.sin(3 * angles)) + rng.normal(0, NOISE, (200, 3))
    waves = [Term("w", joint, (0, 0, 0, 0, 0, 1), Harmonics(joint, orders), "waves", 1e-4, False) for joint in (2, 3)]
    terms = [*constants(arm.chain, free=("tip",), angle_std=1e-2, length_std=3.0), *waves]
    state, references = ArmState(arm.chain, angles), [Points(np.arange(200), points)]
    fit = identify(arm.chain, state, terms, references)
    singles = []
    times = CovarianceRoot.times

    def spied(self, along_sites, values):
        singles.append(along_sites.dtype == np.float32)
        return times(self, along_sites, values)

    monkeypatch.setattr(CovarianceRoot, "times", spied)

    def found(most_rounded):
        monkeypatch.setattr(cross_validation, "MOST_ROUNDED", most_rounded)
        singles.clear()
        return cross_validate_by_group(fit, state, references, np.arange(200) // 10), any(singles)

    (single, is_single), (double, is_not) = found(cross_validation.MOST_ROUNDED), found(0.0)
    assert (is_single, is_not) == (True, False)
    std = np.sqrt(double.covariance.diagonal(axis1=1, axis2=2) + fit.references[0].noise_std ** 2)
    np.testing.assert_allclose(single.deviations / std, double.deviations / std, rtol=0, atol=1e-4)
    np.testing.assert_allclose(single.covariance, double.covariance, rtol=0, atol=1e-4 * double.covariance.max())
    assert (single.deviations != double.deviations).any()


@pytest.mark.parametrize("chunk", [5, 1024])
def test_regions_by_normal_equations_are_the_same_as_by_derivatives(chunk, drawn, monkeypatch):
    """Of regions that overlap; the second has a direction that no other reading determines."""
    rows = np.arange(60)
    fit, state = identified(drawn, rows), ArmState(drawn[0].chain, drawn[1][:60])
    regions = [rows < 40, rows >= 2, rows % 2 == 0]

    def found(most):
        return cross_validate_regions(fit, state, references_of(drawn, rows), regions, most)

    whole = found(60)
    monkeypatch.setattr(cross_validation, "MOST_READINGS", chunk)
    by_equations = found(60)
    for one, expected in zip(by_equations, whole, strict=True):
        assert (one.rows == expected.rows).all()
        for name in ("deviations", "covariance"):
            mine, theirs = getattr(one, name), getattr(expected, name)
            np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-6 * np.abs(theirs).max())
    for some, every, region in zip(found(7), by_equations, regions, strict=True):
        assert len(some.rows) == 7
        assert region[some.rows].all()
        np.testing.assert_allclose(some.deviations, every.deviations[np.isin(every.rows, some.rows)], rtol=1e-9)


def test_groups_and_regions_share_a_minimum_only_of_the_same_readings(drawn, monkeypatch):
    """Whatever was asked for before, and in whichever memory: to rounding."""
    rows, regions = np.arange(40), [np.arange(40) < 25]
    fit, state = identified(drawn, rows), ArmState(drawn[0].chain, drawn[1][:40])
    references = references_of(drawn, rows)
    (alone,) = cross_validate_regions(fit, state, references, regions, 40)
    by_group = cross_validate_by_group(fit, state, references, rows // 6)
    (after,) = cross_validate_regions(fit, state, references, regions, 40)
    np.testing.assert_array_equal(after.deviations, alone.deviations)
    elsewhere = ArmState(drawn[0].chain, drawn[1][:40] + 0.1)
    assert (cross_validate_by_group(fit, elsewhere, references, rows // 6).covariance != by_group.covariance).all()
    monkeypatch.setattr(cross_validation, "MOST_SPREAD", 0)
    plain = cross_validate_by_group(fit, state, references_of(drawn, rows), rows // 6)
    np.testing.assert_allclose(by_group.deviations, plain.deviations, rtol=0, atol=1e-9 * NOISE)


def test_a_step_short_of_the_minimum_readings_held_out_are_the_same(drawn, rng):
    """A tenth of the uncertainty short, along all coefficients; two thirds of the readings are held out at once.

    Without the step that remains, deviations of the region were off by a fifth of a standard deviation.
    """
    rows = np.arange(60)
    fit, references = identified(drawn, rows), references_of(drawn, rows)
    state = ArmState(drawn[0].chain, drawn[1][:60])
    off = fit.coefficients + 0.1 * covariance_factor(fit.covariance).T @ rng.normal(size=len(fit.coefficients))
    problem, _ = initial_problem(fit.perturbed_chain, state, references)
    (part,) = fit.references
    (residuals,) = problem.residuals(off)
    (change,) = problem.changes(off, fit.coefficients - off, [residuals])
    short = replace(fit, coefficients=off, references=(replace(part, residuals=residuals, to_minimum=change),))
    by_group = [cross_validate_by_group(of, state, references, rows // 6) for of in (fit, short)]
    of_region = [cross_validate_regions(of, state, references, [rows >= 20], 60)[0] for of in (fit, short)]
    for one, other in (by_group, of_region):
        std = np.sqrt(one.covariance.diagonal(axis1=1, axis2=2) + NOISE**2)
        assert (np.abs(other.deviations - one.deviations) < 0.02 * std).all()


def test_nothing_to_leave_out_is_an_empty_record(drawn):
    arm, angles, *_ = drawn
    rows = np.r_[0:10, 60:62]
    fit = identified(drawn, rows)
    seats_only = replace(fit, references=fit.references[1:])
    state = ArmState(arm.chain, angles[rows])
    found = cross_validate_by_group(seats_only, state, references_of(drawn, rows)[1:], np.zeros(12, dtype=int))
    assert sorted(found.rows.tolist()) == [10, 11]
    lone = replace(seats_only, references=(replace(seats_only.references[0], kind="sphere"),))
    found = cross_validate_by_group(lone, state, references_of(drawn, rows)[1:], np.arange(12))
    assert [len(getattr(found, part)) for part in ("rows", "group", "deviations", "covariance", "freedom")] == [0] * 5


@pytest.mark.parametrize("size", [1, 3])
def test_an_arm_without_terms_has_the_same_deviations(size, drawn):
    arm, angles, points, *_ = drawn
    state = ArmState(arm.chain, angles[:60])
    fit = identify(arm.chain, state, [], [Points(np.arange(60), points)])
    found = cross_validate_by_group(fit, state, [Points(np.arange(60), points)], np.arange(60) // size)
    np.testing.assert_allclose(found.deviations, arm.chain.tip_in_base(angles[:60]) - points, atol=1e-9)
    assert not found.covariance.any()


def test_a_pose_that_alone_determines_a_direction_has_a_large_error(rng):
    """Joint 6 moved in one reading only: without it, nobody knows where its zero is."""
    arm = load_arm("gao2017")
    angles = arm.working + 0.5 * rng.uniform(-1, 1, (30, 6))
    angles[:, 5] = angles[0, 5]
    angles[11, 5] += 2.0
    terms = constants(arm.chain, free=("tip",), angle_std=3e-2, length_std=3.0)
    truth = arm.chain.with_motions(np.array([1e-2] * 3 + [1] * 3) * rng.normal(size=(arm.chain.n_places, 6)))
    state = ArmState(arm.chain, angles)
    points = Points(np.arange(30), truth.tip_in_base(angles))
    fit = identify(arm.chain, state, terms, [points])
    found = cross_validate_by_group(fit, state, [points], np.arange(30))
    assert np.argmax(np.linalg.eigvalsh(found.covariance)[:, -1]) == 11


def test_the_root_of_a_covariance_is_one_singular_or_not(rng):
    half = rng.normal(size=(6, 4)) * [1e-6, 1, 1e6, 1]
    for covariance in (half.T @ half, half @ half.T, np.zeros((3, 3)), np.zeros((0, 0))):
        root = covariance_factor(covariance)
        scale = np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
        np.testing.assert_allclose(root.T @ root, covariance, atol=1e-9 * scale.max(initial=0))


def test_batches_have_about_as_many_places_as_readings():
    """One large group beside many small ones: no batch has more than `chunk` places, but for one of one group."""
    group = np.r_[np.arange(700), np.full(300, 700), np.full(1100, 701)]
    reference = SimpleNamespace(rows=np.arange(len(group)))
    batches = list(group_batches([reference], group, 1024))
    assert sorted(np.concatenate([batch.row for batch in batches]).tolist()) == list(range(len(group)))
    for batch in batches:
        assert batch.n_groups * batch.largest(0) <= 1024 or batch.n_groups == 1
