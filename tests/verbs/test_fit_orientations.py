"""Laws of a fit to orientations: they have a noise of their own, in degrees, and a tool that may be mounted again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from truearm.errors import Contradiction

ARM, N = ta.load_arm("ur10"), 60
SECOND = np.arange(N) >= N // 2


def poses(*, turn_deg: float = 0.02, remount_deg: tuple[float, float, float] | None = None, **names: object):
    """Readings of an arm 1 mm off, 0.05 mm of noise, its marker mounted again for the second half."""
    rng, motions = np.random.default_rng(1), np.zeros((ARM.chain.n_places, 6))
    motions[1:-1] = rng.normal(size=(ARM.chain.n_places - 2, 6)) * [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3]
    chain, angles = ARM.chain.with_motions(motions), rng.uniform(-1.5, 1.5, (N, 6))
    points = chain.tip_in_base(angles) + 0.05 * rng.normal(size=(N, 3))
    marker = Rotation.from_matrix(chain.pose(angles).R_base_tip) * Rotation.from_rotvec([0.2, 0.3, 0.5])
    if remount_deg is not None:
        turn = Rotation.from_rotvec(SECOND[:, None] * np.radians(remount_deg))
        marker = marker * turn
    marker = marker * Rotation.from_rotvec(np.radians(turn_deg) * rng.normal(size=(N, 3)))
    return ta.Session(angles, points=points, quaternion=marker.as_quat(scalar_first=True), **names)


def error_mm(result, session) -> float:
    """Mean error at the points, without their orientations."""
    return ta.evaluate(result.model, replace(session, quaternion=None)).errors["model"]["mean_mm"]


@pytest.mark.parametrize(
    ("name", "turn"),
    [
        ("session", (90.0, 0.0, 30.0)),
        ("tip", (2.0, 0.0, 1.0)),
        pytest.param("tip", (90.0, 0.0, 30.0), marks=pytest.mark.weekly),
        pytest.param("session", (2.0, 0.0, 1.0), marks=pytest.mark.weekly),
    ],
)
def test_a_marker_that_was_mounted_again_has_a_rotation_of_its_own(name, turn):
    session = poses(remount_deg=turn, **{name: np.where(SECOND, "B", "A")})
    result = ta.fit(ARM, session, model="kinematic")
    assert error_mm(result, session) < 0.1  # mm: 0.08 is noise
    turned = next(one for one in result.model.fit_.references if one.kind == "orientation")
    assert np.degrees(turned.noise_std / 1000) == pytest.approx(0.02, rel=0.2)  # of 180 components


@pytest.mark.parametrize("turn_deg", [3.0, pytest.param(10.0, marks=pytest.mark.weekly)])
def test_noisy_orientations_are_said_in_degrees_and_take_nothing_from_the_points(turn_deg):
    session = poses(turn_deg=turn_deg)
    for model in ("nominal", "kinematic"):
        result = ta.fit(ARM, session, model=model)
        said = " ".join(result.remarks)
        degrees = float(said.split("The orientations scatter by ")[1].split(" deg about each axis")[0])
        assert degrees == pytest.approx(turn_deg, rel=0.2)
        assert "These readings scatter" not in said
    assert error_mm(result, session) < 0.1  # mm, of the kinematic model


@pytest.mark.parametrize(
    "wrong", [pytest.param({"turn_deg": 90.0}, marks=pytest.mark.weekly), {"remount_deg": (90.0, 0.0, 0.0)}]
)
def test_orientations_that_no_arm_has_are_refused_in_degrees(wrong):
    session = poses(**wrong)
    with pytest.raises(Contradiction, match=r"the orientations differ .* deg at one reading of four") as refused:
        ta.fit(ARM, session, model="nominal")
    assert "mm at one reading" not in str(refused.value)
    assert "if the marker was mounted again, name its mountings" in refused.value.hint
    assert error_mm(ta.fit(ARM, session, model="nominal", accept="the points are right"), session) < 2.0  # mm


def test_orientations_are_evaluated_in_degrees_with_the_coverage_of_their_regions():
    """0.02 deg about each of three axes is a mean angle of 0.032 deg; an arm 1 mm off turns its flange by far more."""
    train, test = poses().split(by="row", hold_out=0.4, seed=2)
    of_constants = ta.evaluate(ta.fit(ARM, train, model="kinematic").model, test)
    found = of_constants.errors["model"]
    assert found["n_orientations"] == len(test)
    assert 0.02 < found["orientation_mean_deg"] < 0.05
    assert of_constants.errors["nominal"]["orientation_mean_deg"] > 3 * found["orientation_mean_deg"]
    assert of_constants.orientation_coverage >= 0.8  # of 24
    assert "of the orientations are inside their stated 95 % regions" in str(of_constants)
    assert of_constants.to_dict()["orientation_coverage"] == of_constants.orientation_coverage
    of_points = ta.evaluate(ta.fit(ARM, replace(train, quaternion=None), model="kinematic").model, test)
    assert of_points.orientation_coverage is None  # nothing told how the marker is turned
