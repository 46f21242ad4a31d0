"""`arms`: constants in the branch of the drawing."""

import numpy as np
import pytest

import truearm as ta
from truearm.arm import chain_from_dh
from truearm.wings.reports.arms import catalogue, describe_arm


def test_an_identified_arm_is_described_near_its_drawing():
    # gauge2000's rows: drawn with quarter turns, of which another branch would state -50 and +90.
    drawing = {
        "a": [0, 50, 0, 50, 0, 0],
        "d": [300, 0, 900, 0, 700, 0],
        "alpha": np.deg2rad([-90, -90, -90, -90, -90, 0]),
        "theta": np.deg2rad([0, 90, 90, 90, 90, 90]),
    }
    nominal = ta.Arm("gauge", chain_from_dh(**drawing, tip_in_flange=[0, 0, 150]))
    motions = np.random.default_rng(0).normal(size=(8, 6)) * ([5e-4] * 3 + [0.2] * 3)
    q = np.random.default_rng(1).uniform(-2, 2, (60, 6))
    model = ta.KinematicModel(nominal).fit(q, nominal.chain.with_motions(motions).tip_in_base(q))
    found = describe_arm(model).to_dict()["dh"]
    for key, column in (("a_mm", drawing["a"]), ("d_mm", drawing["d"])):
        np.testing.assert_allclose(found[key], column, atol=2)
    for key in ("alpha", "theta"):
        np.testing.assert_allclose(found[f"{key}_deg"], np.degrees(drawing[key]), atol=0.5)


@pytest.mark.parametrize("name", ["gen3lite", "ur10"])
def test_every_arm_has_a_table(name):
    text = str(describe_arm(name))
    assert ("beta_deg" in text) == (name == "gen3lite")
    assert "alpha_deg" in text


# The catalogue


def test_the_list_names_each_maker_once_before_its_arms():
    lines = str(catalogue("iiwa")).splitlines()
    assert [line.split()[0] for line in lines] == ["maker", "KUKA", "iiwa7"]
    assert "LBR iiwa 14 R820" in lines[1]
    found = catalogue("stäubli").to_dict()
    assert list(found) == ["rx160", "tx2-60", "tx2-90"]
    assert found["rx160"]["maker"] == "Stäubli"
    assert set(catalogue().to_dict()) == set(ta.list_arms())


@pytest.mark.parametrize("name", ["ur5e", "kr6r900", "vx300s"])
def test_an_arm_that_the_catalogue_has_nearly_twice_is_not_contradicted(name):
    # ur5 and ur5e, kr6r900 and kr10r1100, vx300s and wx250s: the check weighs mistakes, no other arms.
    arm = ta.load_arm(name)
    rng = np.random.default_rng(3)
    angles = np.clip(arm.working + rng.uniform(-0.8, 0.8, (40, 6)), *arm.limits.T)
    real = arm.chain.with_motions(rng.normal(size=(arm.chain.n_places, 6)) * ([1e-3] * 3 + [0.5] * 3))
    found = ta.diagnose(arm, ta.Session(angles=angles, points=real.tip_in_base(angles)))
    assert not found.check.findings


def test_zeros_of_an_identified_arm_are_said_in_counts_of_a_servo():
    arm = ta.load_arm("ur5e")
    shift = np.radians([0.0, 2.0, -3.0, 1.5, 0.0, 0.0])  # J5's is the tip's, which is on the axis of J6
    angles = arm.working + np.random.default_rng(4).uniform(-0.7, 0.7, (60, arm.n_joints))
    points = arm.chain.tip_in_base(angles + shift) + np.random.default_rng(5).normal(0, 0.02, (60, 3))
    described = describe_arm(ta.KinematicModel(arm).fit_readings(ta.Session(angles, points)))
    found = described.to_dict()
    # deg: 0.02 mm at a lever of 100 mm are 0.01.
    np.testing.assert_allclose(found["zero_deg"], np.degrees(shift), atol=0.05)
    np.testing.assert_allclose(found["zero_counts"], np.asarray(found["zero_deg"]) * 4096 / 360)
    assert "counts of 4096" in str(described)
    assert "zero_deg" not in describe_arm(arm).to_dict()
    assert described.to_frame()["zero_deg"].tolist() == found["zero_deg"]
    assert set(catalogue().to_frame()["name"]) == set(ta.list_arms())
