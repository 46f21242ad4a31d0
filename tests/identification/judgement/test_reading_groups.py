"""A second tip, or a second nest of the reflector, in some of the readings is named; good readings are not."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.arm import load_arm
from truearm.wings.planning.designs.sampling import seat
from truearm.wings.planning.virtual import VirtualArm, load_preset

ALTERNATING, LAST = np.arange(90) % 2 == 1, np.arange(90) >= 60


def said(session, arm="ur5"):
    found = ta.fit(arm, session, model="kinematic").findings
    return [str(one) for one in found if one.what == "tips"]


@pytest.fixture(scope="module")
def good():
    return ta.simulate("ur5", poses=90, preset="shop", seed=2).session


def test_a_tip_that_is_5_mm_longer_in_every_second_reading_is_named_with_its_size(good):
    """Its offset is constant in the frame of the flange; the unit of the uncertainty is not blamed for the scatter."""
    R_base_flange = load_arm("ur5").chain.pose_jacobians(good.angles)[0].R_base_tip
    longer = replace(good, points=good.points + (R_base_flange @ [0, 0, 5.0]) * ALTERNATING[:, None])
    assert said(good) == []
    (sentence,) = said(longer)
    assert sentence.startswith("45 of 90 readings (reading 2, reading 4, reading 6 ...) have a tip")
    assert float(sentence.split(" have a tip ")[1].split()[0]) == pytest.approx(5.0, abs=0.3)  # the arm takes some
    findings = ta.fit("ur5", longer, model="kinematic").findings
    assert not [one for one in findings if one.what == "stated uncertainty"]


def test_a_reflector_in_another_nest_is_named_with_its_offset(good):
    other = replace(good, points=good.points + np.array([0, 0, 25.4]) * ALTERNATING[:, None])
    (sentence,) = said(other)
    assert "45 of 90 readings" in sentence
    assert "Was the reflector in another nest?" in sentence


def test_a_second_tip_in_seats_is_named_without_an_instrument():
    """The seats have places of their own, which the offset must not hide in."""
    arm = VirtualArm.draw(load_arm("measuring7"), load_preset("shop"), seed=4)
    poses = seat(arm.nominal, 90, seed=5, seats=3)

    def measured(offset_mm):
        away = arm.nominal.chain.pose_jacobians(poses.angles)[0].R_base_tip @ [0, 0, offset_mm]
        at = poses.seat_points - away * LAST[:, None]
        return arm.measure(poses.angles, seed=1, seat=poses.seat, seat_points=at, reference=False).readings

    assert said(measured(0.0), "measuring7") == []
    (sentence,) = said(measured(5.0), "measuring7")
    assert sentence.startswith("30 of 90 readings")
    assert "have a tip" in sentence
