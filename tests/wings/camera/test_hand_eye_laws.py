"""Hand-eye on data without noise is exact, in closed form and by least squares; what contradicts is named."""

import numpy as np
import pytest
from hand_eye_cells import flanges, frame, make_cell
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import truearm as ta
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import inverse, motion
from truearm.errors import InputError
from truearm.wings.camera.closed_form import Parallel, closed_form, refined
from truearm.wings.camera.mounts import Transform, small_motion

ANGLES = st.floats(-3.0, 3.0)
LENGTHS = st.floats(-900.0, 900.0)
MOTIONS = st.builds(
    lambda r, t: motion(Rotation.from_rotvec(r).as_matrix(), np.array(t)),
    st.tuples(ANGLES, ANGLES, ANGLES),
    st.tuples(LENGTHS, LENGTHS, LENGTHS),
)


def poses(seed, n, turn=1.0):
    rng = np.random.default_rng(seed)
    return motion(Rotation.from_rotvec(turn * rng.uniform(-1, 1, (n, 3))).as_matrix(), rng.uniform(-500, 500, (n, 3)))


@settings(max_examples=40, deadline=None)
@given(X=MOTIONS, Y=MOTIONS, seed=st.integers(0, 999), n=st.integers(4, 20))
def test_closed_form_is_exact_without_noise(X, Y, seed, n):
    A = poses(seed, n)
    found = closed_form(A, X @ A @ Y, sized=True)
    assert abs(found.size - 1) < 1e-9  # rounding of lengths of a metre
    assert np.abs(found.X - X).max() < 1e-7  # [mm]
    assert np.abs(found.Y - Y).max() < 1e-7
    assert found.rms_mm < 1e-7


@settings(max_examples=20, deadline=None)
@given(X=MOTIONS, Y=MOTIONS, seed=st.integers(0, 999), size=st.floats(0.3, 3.0), depth=st.floats(0.95, 1.05))
def test_the_size_of_the_board_is_linear_and_exact(X, Y, seed, size, depth):
    A = poses(seed, 15)
    C = X @ A @ Y
    stated = C.copy()
    stated[:, :3, 3] /= size
    assert closed_form(A, stated, sized=True).size == pytest.approx(size, rel=1e-8)
    stated[:, 2, 3] /= depth
    assert closed_form(A, stated, sized=True).depth == pytest.approx(depth, rel=1e-7)


@settings(max_examples=20, deadline=None)
@given(X=MOTIONS, Y=MOTIONS, seed=st.integers(0, 999))
def test_least_squares_return_to_the_exact_motions(X, Y, seed):
    A = poses(seed, 12)
    C = X @ A @ Y
    start = closed_form(A, C, sized=False)
    moved = motion(Rotation.from_rotvec([0.02, -0.03, 0.01]).as_matrix(), np.array([4.0, -3.0, 2.0]))
    off = start.__class__(X @ moved, moved @ Y, 1.0, 0.0, 1.0, 0.0, 1.0)
    found = refined(A, C, off)
    assert np.abs(found.X - X).max() < 1e-6  # [mm]
    assert np.abs(found.Y - Y).max() < 1e-6
    assert found.rows.all()


def test_held_out_positions_are_those_of_fits_without_the_image():
    cell = make_cell(3, 14, noise=(0.2, 0.5))
    start = closed_form(cell.flange, cell.seen, sized=False)
    found = refined(cell.flange, cell.seen, start)
    rest = np.arange(14) != 4
    without = refined(cell.flange[rest], cell.seen[rest], start)
    left = (without.X @ cell.flange[4] @ without.Y)[:3, 3] - cell.seen[4, :3, 3]
    # The noise of the others changes a little without the image.
    assert found.held_out_mm[4] == pytest.approx(np.linalg.norm(left), rel=0.05)


@pytest.mark.parametrize("k", range(12))
def test_derivatives_are_difference_quotients(k):
    """By the covariance of a fit: its inverse is the sum of squares of the derivatives over the variances."""
    cell = make_cell(5, 10, noise=(0.1, 0.2))
    A, C = cell.flange, cell.seen
    found = refined(A, C, closed_form(A, C, sized=False))
    step = 1e-5
    change = np.zeros(12)
    change[k] = step

    def residuals(x):
        X = motion(Rotation.from_rotvec(x[3:6]).as_matrix() @ found.X[:3, :3], found.X[:3, 3] + x[:3])
        Y = motion(Rotation.from_rotvec(x[9:]).as_matrix() @ found.Y[:3, :3], found.Y[:3, 3] + x[6:9])
        seen = X @ A @ Y
        t = (seen[:, :3, 3] - C[:, :3, 3]) / found.position_std
        turned = Rotation.from_matrix(C[:, :3, :3].transpose(0, 2, 1) @ seen[:, :3, :3]).as_rotvec() / found.turn_std
        return np.concatenate([t, turned], axis=1).ravel()

    by = (residuals(change) - residuals(-change)) / (2 * step)
    precision = np.linalg.inv(found.covariance)
    assert by @ by == pytest.approx(precision[k, k], rel=5e-3)  # noise turns by 0.1 deg what the quotient is of


@settings(max_examples=20, deadline=None)
@given(T=MOTIONS, seed=st.integers(0, 999))
def test_an_inverted_transform_has_the_covariance_of_the_inverse(T, seed):
    rng = np.random.default_rng(seed)
    root = 1e-6 * rng.normal(size=(6, 6)) * np.repeat([1.0, 1e-3], 3)[:, None]
    back = Transform("camera", "base", T, root @ root.T).inverted()
    moved = [motion(Rotation.from_rotvec(one[3:]).as_matrix() @ T[:3, :3], T[:3, 3] + one[:3]) for one in root.T]
    changes = np.stack([small_motion(inverse(one), inverse(T)) for one in moved])
    expected = changes.T @ changes
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(back.covariance - expected).max() < 1e-4 * scale.max()  # second order, and rounding of 1e-9 rad
    assert np.abs(back.inverted().T_parent_child - T).max() < 1e-9


def test_poses_that_turn_about_one_axis_leave_the_position_along_it_open():
    rng = np.random.default_rng(1)
    axis = np.array([0.6, 0.0, 0.8])
    A = motion(Rotation.from_rotvec(rng.uniform(-1, 1, (15, 1)) * axis).as_matrix(), rng.uniform(-500, 500, (15, 3)))
    found = Parallel.of(A)
    assert found.is_open
    assert np.abs(found.axis - axis).max() < 1e-6
    assert not Parallel.of(poses(1, 15)).is_open


def test_two_images_are_too_few():
    with pytest.raises(InputError, match="three images or more, got 2"):
        closed_form(poses(1, 2), poses(1, 2), sized=False)


@pytest.mark.parametrize("eye_in_hand", [False, True])
@pytest.mark.parametrize("joints", [False, True])
def test_camera_and_board_are_found_in_the_axes_of_the_arm(eye_in_hand, joints):
    """Position in mm: without noise only the prior of the arm's constants is left, with joints."""
    cell = make_cell(2, 20, eye_in_hand=eye_in_hand)
    found = cell.hand_eye(joints=joints)
    for transform, true in ((found.camera, cell.camera), (found.board, cell.board)):
        assert np.abs(transform.T_parent_child - true).max() < 1e-3
    assert found.camera.parent == ("flange" if eye_in_hand else "base")


@pytest.mark.parametrize("eye_in_hand", [pytest.param(False, marks=pytest.mark.weekly), True])
def test_an_arm_with_errors_is_identified_with_the_mounts(eye_in_hand):
    cell = make_cell(4, 40, eye_in_hand=eye_in_hand, errors=(1e-3, 0.5), noise=(0.01, 0.1))
    found = cell.hand_eye(joints=True)
    alone, identified = found.held_out_mm
    assert identified < 0.6 * alone
    for transform, true in ((found.camera, cell.camera), (found.board, cell.board)):
        off = small_motion(transform.T_parent_child, true)
        assert np.linalg.norm(off[:3]) < 2 * transform.U_mm
        assert np.degrees(np.linalg.norm(off[3:])) < 2 * transform.U_deg


@pytest.mark.parametrize("eye_in_hand", [False, pytest.param(True, marks=pytest.mark.weekly)])
def test_regions_of_hand_eye_alone_hold_the_truth(eye_in_hand):
    """Of 80 poses, each in a region of 95 %: fewer than 70 or all 80 have a probability of 0.2 % and 2 %."""
    within = 0
    for seed in range(40):
        cell = make_cell(seed, 15, eye_in_hand=eye_in_hand, noise=(0.1, 0.3))
        found = cell.hand_eye()
        for transform, true in ((found.camera, cell.camera), (found.board, cell.board)):
            off = small_motion(transform.T_parent_child, true)
            within += off @ np.linalg.solve(transform.covariance, off) < chi2.ppf(0.95, 6)
    assert within >= 70


@pytest.mark.slow
@pytest.mark.parametrize("eye_in_hand", [False, pytest.param(True, marks=pytest.mark.weekly)])
def test_regions_with_the_arm_identified_hold_the_truth(eye_in_hand):
    """The short form of `python -m benchmarks handeye cells`: of 24 poses fewer than 20 have a probability of 0.7 %."""
    within = 0
    for seed in range(12):
        cell = make_cell(seed, 25, eye_in_hand=eye_in_hand, errors=(5e-4, 0.3), noise=(0.05, 0.2))
        found = cell.hand_eye(joints=True)
        for transform, true in ((found.camera, cell.camera), (found.board, cell.board)):
            off = small_motion(transform.T_parent_child, true)
            within += off @ np.linalg.solve(transform.covariance, off) < chi2.ppf(0.95, 6)
    assert within >= 20


@pytest.mark.parametrize(
    ("name", "eye_in_hand"),
    [
        *(("panda", False), ("so101", True)),
        *(pytest.param(name, False, marks=pytest.mark.weekly) for name in ("ur10", "irb120", "so101")),
        *(pytest.param(name, True, marks=pytest.mark.weekly) for name in ("panda", "ur10", "irb120")),
    ],
)
def test_mounts_are_found_on_arms_of_five_to_seven_axes(name, eye_in_hand):
    """Without noise, from joints: to a thousandth of a millimetre, the prior of the arm's constants."""
    rng, arm = np.random.default_rng(2), ta.load_arm(name)
    joints = arm.working + rng.uniform(-0.5, 0.5, (20, arm.n_joints))
    flange = flanges(arm.chain.with_tip(np.zeros(3)), joints)
    camera, board = frame([20, 30, 10], [100, -50, 400]), frame([5, -4, 30], [60, -50, 90])
    seen = inverse(camera) @ (inverse(flange) if eye_in_hand else flange) @ board
    found = ta.hand_eye(seen, joints, arm=name, eye_in_hand=eye_in_hand, accept="the camera sees through the board")
    assert np.abs(found.camera.T_parent_child - camera).max() < 1e-3
    assert np.abs(found.board.T_parent_child - board).max() < 1e-3


def test_an_arm_of_four_axes_is_refused_with_the_axis():
    fixed = motion(np.eye(3), np.array([[0, 0, 300.0], [250, 0, 0], [200, 0, 0], [0, 0, 0], [0, 0, -50]]))
    arm = ta.Arm("scara", Chain(fixed, np.zeros(3), np.array([False, False, True, False])))
    joints = np.random.default_rng(1).uniform(-0.5, 0.5, (12, 4)) * [1, 1, 50, 1]
    seen = inverse(frame([180, 0, 0], [100, 0, 900])) @ flanges(arm.chain, joints) @ frame([0, 0, 20], [10, 20, 30])
    with pytest.raises(InputError, match=r"turn about one axis, \(0.00, 0.00, 1.00\) of the base"):
        ta.hand_eye(seen, joints, arm=arm)
