"""Poses whose position and orientation err together: derivatives, independence of the residuals, common errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.errors import InputError
from truearm.identification.references.orientations import Poses
from truearm.identification.references.reading_references import references_of
from truearm.readings.pose_errors import PoseErrors


def errors(n: int, seed: int = 1, n_common: int = 2, **others: float) -> PoseErrors:
    rng = np.random.default_rng(seed)
    half = rng.normal(0, 1, (n, 6, 6)) * ([[0.1]] * 3 + [[3e-4]] * 3)
    by_common = rng.normal(0, 1, (n, 6, n_common)) * ([[0.1]] * 3 + [[3e-4]] * 3)
    root = rng.normal(0, 1, (n_common, n_common)) + 2 * np.eye(n_common)
    names = tuple(f"common {k} [1]" for k in range(n_common))
    covariance = half @ half.transpose(0, 2, 1)
    offset = rng.normal(0, 1, n_common)
    return PoseErrors(covariance=covariance, by_common=by_common, common=names, root=root, offset=offset, **others)


def poses(n: int = 5, **others: float) -> tuple[Poses, np.ndarray, np.ndarray]:
    """Poses, and tips and axes (3, n), (3, 3, n) that are some millimetres and degrees from them."""
    rng = np.random.default_rng(7)
    points, R = rng.uniform(-500, 500, (n, 3)), Rotation.random(n, random_state=3)
    axes = (Rotation.from_rotvec(rng.normal(0, 0.3, (n, 3))) * R).as_matrix()
    tips = points + rng.normal(0, 2, (n, 3))
    of = Poses(np.arange(n), points, R.as_matrix(), errors(n, **others))
    return of, tips.T, axes.transpose(1, 2, 0)


def test_derivatives_are_those_of_a_difference_quotient():
    of, tips, axes = poses(lever_mm=300.0, arm_std_mm=0.05)
    x, step = np.array([0.3, -0.2]), 1e-5
    at = of.linearised(tips, x, slice(None), axes)
    for k in range(3):
        one = step * np.eye(3)[k]
        up, down = (of.linearised(tips + s * one[:, None], x, slice(None), axes).residuals for s in (1, -1))
        assert np.allclose(at.by_tip[:, k], (up - down) / (2 * step), rtol=1e-6, atol=1e-6)
        turned = [np.einsum("ab,bcm->acm", Rotation.from_rotvec(s * one).as_matrix(), axes) for s in (1, -1)]
        up, down = (of.linearised(tips, x, slice(None), one_side).residuals for one_side in turned)
        # mm per rad of a lever of 300 mm
        assert np.allclose(at.by_turn[:, k], (up - down) / (2 * step), rtol=1e-6, atol=1e-5)
    for k in range(2):
        one = step * np.eye(2)[k]
        up, down = (of.linearised(tips, x + s * one, slice(None), axes).residuals for s in (1, -1))
        assert np.allclose(at.by_unknown[:, k], (up - down) / (2 * step), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("arm_std_mm", [0.0, 0.2])
def test_residuals_are_independent_with_their_stated_uncertainty(arm_std_mm):
    """Of errors by the instrument and by the arm, whose rotations are its positions over the lever."""
    n, lever = 20_000, 250.0
    one = errors(1, lever_mm=lever, arm_std_mm=arm_std_mm)
    many = replace(one, covariance=np.repeat(one.covariance, n, 0), by_common=np.repeat(one.by_common, n, 0))
    rng = np.random.default_rng(1)
    e = rng.multivariate_normal(np.zeros(6), one.covariance[0], n)
    e += arm_std_mm * rng.standard_normal((n, 6)) / ([1.0] * 3 + [lever] * 3)
    of = Poses(np.arange(n), np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), many)
    axes = Rotation.from_rotvec(e[:, 3:]).as_matrix().transpose(1, 2, 0)
    r = of.linearised(e[:, :3].T, np.zeros(2), slice(None), axes).residuals
    expected = of.std[:, 0] ** 2 + arm_std_mm**2
    seen = np.cov(r) / np.sqrt(np.outer(expected, expected))
    # 20,000 draws know a correlation to 0.007; five of that.
    assert np.abs(seen - np.eye(6)).max() < 0.035


def test_common_errors_have_what_is_known_of_them():
    of, _, _ = poses()
    x = np.array([0.4, 0.1])
    known = of.constraints(x)
    assert np.allclose(known.residuals, of.errors.root @ x + of.errors.offset)
    assert np.array_equal(known.by_unknown, of.errors.root)
    assert of.unknowns == ("common 0 [1]", "common 1 [1]")


def test_points_and_quaternions_of_a_session_with_pose_errors_are_poses():
    n = 6
    session = ta.Session(
        np.zeros((n, 3)),
        points=np.where(np.arange(n)[:, None] == 5, np.nan, np.ones((n, 3))),
        quaternion=np.where(np.arange(n)[:, None] < 4, [[1.0, 0, 0, 0]], np.nan),
        pose_errors=errors(n),
    )
    first, points = references_of(session, None)
    assert (first.kind, first.rows.tolist()) == ("pose", [0, 1, 2, 3])
    assert (points.kind, points.rows.tolist()) == ("point", [4])
    assert len(session.rows([1, 2]).pose_errors) == 2
    with pytest.raises(InputError, match="expected finite root"):
        replace(errors(n), root=np.zeros((2, 3)))
