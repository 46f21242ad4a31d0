"""What people get wrong in arm files: every mistake changes the arm, and the file's own table is the one meant."""

from dataclasses import replace

import numpy as np
import pytest

from arms_of_each_build import ARMS
from refusals import refuses
from truearm.arm import load_arm, read_arm, write_arm
from truearm.arm.description_mistakes import Interpretation, likely_mistakes, mended_arm


@pytest.mark.parametrize("name", ["gao2017", "panda", "ur10"])
def test_what_is_stated_is_the_arm_itself(name, rng):
    arm = load_arm(name)
    stated = Interpretation.stated(arm)
    angles = rng.uniform(-1, 1, (5, arm.n_joints))
    assert (stated.angles(angles) == angles).all()
    # Built from the same table: rounding at a reach of a metre.
    assert np.abs(stated.table.chain().tip_in_base(angles) - arm.chain.tip_in_base(angles)).max() < 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_every_mistake_changes_something_and_has_its_own_name(name):
    arm = load_arm(name)
    stated = Interpretation.stated(arm)
    mistakes = likely_mistakes(arm, has_lengths=True)
    assert len(mistakes) >= 40
    assert len({one.description for one in mistakes}) == len(mistakes)
    assert not any(one.mend(stated).is_same(stated) for one in mistakes)


def test_exchanges_and_signs_undo_themselves():
    stated = Interpretation.stated(load_arm("gao2017"))
    for one in likely_mistakes(load_arm("gao2017")):
        if one.description.startswith("sign") or ("exchanged" in one.description and "frame" not in one.description):
            assert one.mend(one.mend(stated)).is_same(stated), one.description


def test_a_mistake_without_effect_is_not_listed():
    """The d of J2 of this arm is zero, and so is the alpha of the UR10's J2."""
    names = {one.description for one in likely_mistakes(load_arm("gao2017"))}
    assert "sign of d of J1 reversed" in names
    assert "sign of d of J2 reversed" not in names
    assert "sign of alpha of J2 reversed" not in {one.description for one in likely_mistakes(load_arm("ur10"))}


def test_signs_act_on_the_stated_angle_and_zeros_on_the_axis():
    """The sign of an encoder does not turn the theta of the table."""
    stated = Interpretation.stated(load_arm("gao2017"))
    by_name = {one.description: one.mend for one in likely_mistakes(load_arm("gao2017"))}
    angles = np.arange(6.0)[None]
    both = by_name["sign of J4 reversed"](by_name["zero of J4 off by 90 deg: add 90 deg to its theta"](stated))
    assert both.angles(angles)[0].tolist() == pytest.approx([0, 1, 2, np.pi / 2 - 3, 4, 5])
    exchanged = by_name["J5 and J6 exchanged"](stated)
    assert exchanged.angles(angles)[0].tolist() == [0, 1, 2, 3, 5, 4]
    coupled = by_name["angle of J3 contains that of J2 (coupled joints)"](stated)
    assert coupled.angles(angles)[0].tolist() == [0, 1, 2 - 1, 3, 4, 5]


def test_an_arm_file_gives_its_table_as_it_stands(tmp_path):
    """Also angles beyond a turn, which the chain itself does not tell: -90 entered as radians."""
    write_arm(load_arm("gao2017"), tmp_path / "arm.toml")
    text = (tmp_path / "arm.toml").read_text(encoding="utf-8").replace("alpha_deg", "alpha_rad")
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    arm = read_arm(tmp_path / "arm.toml")
    assert arm.table is not None
    assert np.abs(arm.table.alpha).tolist() == [90.0] * 6
    names = {one.description: one for one in likely_mistakes(arm)}
    mended = names["alpha and theta of the arm are in deg, stated in rad"].mend(Interpretation.stated(arm))
    assert np.abs(mended.table.chain().fixed - load_arm("gao2017").chain.fixed).max() < 1e-12


def test_no_arm_file_mends_an_arm_that_is_another_one():
    mistake = "the arm is ur10e, not ur10"
    refuses(f"no file of ur10 mends this: {mistake}", mended_arm, load_arm("ur10"), [mistake])


def test_a_table_that_is_no_longer_that_of_the_chain_does_not_count():
    arm, other = load_arm("ur10"), load_arm("ur5")
    stated = Interpretation.stated(replace(arm, chain=other.chain))
    assert stated.table.a.tolist() == pytest.approx(other.table.a.tolist())


def test_a_urdf_has_mistakes_of_joints_but_none_of_a_table():
    """Nobody has written the D-H rows of an arm whose file has frames."""
    names = [one.description for one in likely_mistakes(load_arm("gen3lite"))]
    assert "sign of J2 reversed" in names
    assert not any("alpha" in name or " a of" in name for name in names)
