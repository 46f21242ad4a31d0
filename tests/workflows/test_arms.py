"""`arms`: constants in the branch of the drawing."""

import numpy as np
import pytest

import truearm as ta
from truearm.arm import chain_from_dh
from truearm.workflows.arms import describe_arm


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
