"""The doctor at every door: the verb, the command, and the hints of refusals. It proposes, and changes no file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.arm import chain_from_dh, write_arm
from truearm.arm.description_mistakes import mended_arm
from truearm.errors import InputError
from truearm.readings import Session, write_lengths, write_session

pytestmark = pytest.mark.usefixtures("undrawn")

SIGN = np.where(np.arange(6) == 3, -1.0, 1.0)


@pytest.fixture(scope="module")
def readings() -> Session:
    session = ta.simulate("gao2017", poses=40, strategy="uniform", preset="shop", seed=1).session
    return Session(session.angles, session.points)


@pytest.fixture(scope="module")
def wrong(readings) -> Session:
    return replace(readings, angles=readings.angles * SIGN)


def test_the_first_line_names_the_mistake_and_both_errors(wrong):
    diagnosis = ta.diagnose("gao2017", wrong)
    first, *_, last = str(diagnosis).splitlines()
    assert first.startswith("sign of J4 reversed: ")
    assert first.endswith("if this is put right.")
    assert "Nothing was changed" in last
    assert diagnosis.to_dict()["findings"][0]["mistakes"] == ["sign of J4 reversed"]


def test_a_right_arm_is_said_to_be_right(readings):
    diagnosis = ta.diagnose("gao2017", readings)
    assert diagnosis.summary().startswith("The readings do not contradict the arm")
    assert diagnosis.to_dict()["findings"] == []


def test_a_frozen_encoder_is_named_by_the_doctor_and_by_a_fit(readings):
    angles = readings.angles.copy()
    angles[10:18, 5] = angles[10, 5]
    frozen = replace(readings, angles=angles)
    assert "J6 is " in "\n".join(map(str, ta.diagnose("gao2017", frozen).blocks()))
    assert any("to the last digit" in one for one in ta.fit("gao2017", frozen, model="nominal").remarks)


def test_it_says_which_readings_it_compares(readings):
    """A shift by one row needs a neighbour on either side; of many readings sixty show what all do."""
    assert "Compared: 38 of 40 readings, those with a reference point" in str(ta.diagnose("gao2017", readings))
    many = readings.rows(np.arange(100) % 40)
    assert "Compared: 60 of 100 readings, evenly spaced" in str(ta.diagnose("gao2017", many))


def test_equal_poses_show_nothing(readings):
    same = readings.rows(np.zeros(12, dtype=int))
    diagnosis = ta.diagnose("gao2017", same)
    assert diagnosis.summary().startswith("The poses of these readings show nothing")
    assert diagnosis.to_dict()["findings"] == []


def test_no_explanation_is_said(readings, rng):
    lost = replace(readings, points=rng.uniform(-500, 500, readings.points.shape))
    assert ta.diagnose("gao2017", lost.rows(np.arange(12))).summary().startswith("No known mistake explains")


@pytest.mark.parametrize("joint", [3, pytest.param(4, marks=pytest.mark.weekly)])
def test_it_names_what_the_refusal_of_a_fit_names(readings, joint):
    """A reversed sign beside zeros that are off by degrees: neither alone explains the readings."""
    sign = np.where(np.arange(6) == joint - 1, -1.0, 1.0)
    wrong = replace(readings, angles=sign * readings.angles + np.radians([0, 8, -9, 7, 8, 0]))
    caught = refuses("misses its references", ta.fit, "gao2017", wrong, model="kinematic")
    assert f"put this right: sign of J{joint} reversed (" in caught.hint
    diagnosis = ta.diagnose("gao2017", wrong)
    assert diagnosis.summary().startswith(f"sign of J{joint} reversed: ")
    assert "contradicted" not in [row for row in str(diagnosis).splitlines() if row.startswith("sign of J")][1]


def test_a_horn_that_is_far_off_is_a_zero_to_add(rng):
    """Beyond an eighth of a turn, where the other constants of the arm are right: both say what to add."""
    chain = chain_from_dh(
        a=[0, 150, 140, 0],
        d=[95, 0, 0, 0],
        alpha=np.radians([90, 0, 0, -90]),
        theta=np.zeros(4),
        tip_in_flange=[80, 0, 0],
    )
    arm, angles = ta.Arm("printed", chain), rng.uniform(-1.2, 1.2, (60, 4))
    points = chain.tip_in_base(angles + np.radians([0, 0, -51, 0])) + rng.normal(0, 0.5, (60, 3))
    wrong = Session(angles, points)
    caught = refuses("a zero is off by more than 45 deg, and its other constants", ta.fit, arm, wrong)
    assert "in the arm file, add to their theta: J3 -5" in caught.hint
    assert "nominal_error_mm" not in caught.hint
    assert ta.diagnose(arm, wrong).summary().startswith("Zeros of joints are off: add to their theta: J3 -5")
    result = ta.fit(arm, wrong, model="kinematic", accept="the horn of J3 was turned")
    assert result.held_out_mm[0] < 2 * 0.5 * np.sqrt(3)  # the noise


def test_a_factor_of_all_angles_is_said(readings):
    factored = replace(readings, angles=1.03 * readings.angles)
    assert ta.diagnose("gao2017", factored).summary().startswith("All joints turn by 0.971 times their stated angles")


def test_too_few_readings_are_refused(readings):
    with pytest.raises(InputError, match="expected 8 or more readings with a reference point or in a seat"):
        ta.diagnose("gao2017", readings.rows(np.arange(5)))
    refuses("J1 .. J7", ta.diagnose, "measuring7", readings)


def test_the_command_prints_it_and_changes_no_file(wrong, truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_arm(ta.load_arm("gao2017"), "my-arm.toml")
    write_session(wrong, "readings.csv")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert truearm("arms", "my-arm.toml", "--session", "readings.csv").out.startswith("sign of J4 reversed: ")
    as_json = truearm("arms", "my-arm.toml", "--session", "readings.csv", "--json").out
    assert json.loads(as_json)["is_contradicted"] is True
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_apply_writes_an_arm_that_explains_the_readings(wrong, readings, truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_session(wrong, "readings.csv")
    truearm("arms", "gao2017", "--session", "readings.csv", "--apply", "mended.toml").done()
    mended, nominal = ta.load_arm("mended.toml"), ta.load_arm("gao2017")
    np.testing.assert_allclose(
        mended.chain.tip_in_base(wrong.angles), nominal.chain.tip_in_base(readings.angles), rtol=0, atol=1e-6
    )  # mm
    assert "mended: sign of J4 reversed" in mended.source
    assert ta.diagnose(mended, wrong).check.stated.is_usual
    assert truearm("arms", "gao2017", "--session", "readings.csv", "--apply", "mended.toml").code == 2  # exists


@pytest.mark.parametrize(
    ("mistake", "matrix"),
    [
        ("angle of J3 lacks that of J2 (coupled joints)", {(2, 1): 1.0}),
        ("zero of J3 off by 90 deg: add 90 deg to its theta", {}),
    ],
)
def test_sums_and_zeros_are_mended(mistake, matrix, readings):
    arm = ta.load_arm("gao2017")
    mended = mended_arm(arm, [mistake])
    coupling = np.eye(arm.n_joints) if mended.chain.coupling is None else mended.chain.coupling
    expected = np.eye(arm.n_joints)
    for place, value in matrix.items():
        expected[place] = value
    np.testing.assert_array_equal(coupling, expected)
    shift = np.radians(90) * (np.arange(arm.n_joints) == 2) * (not matrix)
    joints = readings.angles @ expected.T + shift
    np.testing.assert_allclose(
        mended.chain.tip_in_base(readings.angles), arm.chain.tip_in_base(joints), rtol=0, atol=1e-6
    )


def test_what_is_wrong_in_the_readings_is_not_mended_in_the_arm():
    for mistake in ("reference points are in m, stated in mm", "J2 is in rad, stated in deg"):
        refuses("no arm file mends this", mended_arm, ta.load_arm("gao2017"), [mistake])


def test_seats_and_a_bar_serve_the_command(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulated = ta.simulate("gao2017", poses=40, strategy="seat", preset="shop", bars=2, reference=False, seed=1)
    write_session(replace(simulated.session, angles=simulated.session.angles * SIGN), "readings.csv")
    write_lengths(simulated.lengths, "lengths.csv")
    ran = truearm("arms", "gao2017", "--session", "readings.csv", "--lengths", "lengths.csv").done()
    assert "sign of J4 reversed" in ran.out.splitlines()[0]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["arms", "gao2017", "--lengths", "x.csv"], "--lengths and --apply need --session"),
        (["arms", "gao2017", "--apply", "a.toml"], "--apply need --session"),
        (["arms", "gao2017", "--session", "x.csv", "--out", "a.toml"], "--session needs a nominal arm"),
        (["arms", "gao2017", "--session", "x.csv", "--page", "p.html"], "--session needs a nominal arm"),
        (["arms", "gao2017", "--session", "x.csv"], "x.csv"),
    ],
)
def test_what_does_not_go_together_is_refused(arguments, says, truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = truearm(*arguments)
    assert ran.code == 2
    assert says in ran.err
    assert "ARM" not in ran.err


def test_a_refused_fit_names_the_mistake(wrong):
    with pytest.raises(InputError, match="misses its references") as refused:
        ta.fit(replace(ta.load_arm("gao2017"), lower=None, upper=None), wrong, model="nominal")
    assert refused.value.hint.startswith("put this right: sign of J4 reversed (")


def test_an_evaluation_names_it_too(readings, wrong):
    model = ta.fit("gao2017", readings, model="nominal").model
    remarks = " ".join(ta.evaluate(model, wrong).remarks)
    assert "Put this right: sign of J4 reversed (" in remarks


def test_a_model_file_does_not_keep_the_table(readings, tmp_path):
    """It is of the arm file; what is read back has the same arm."""
    model = ta.fit("gao2017", readings, model="nominal").model
    model.save(tmp_path / "m.truearm")
    again = ta.load_model(tmp_path / "m.truearm")
    assert model.arm_.table is not None
    assert again.arm_.table is None
    assert (again.arm_.chain.fixed == model.arm_.chain.fixed).all()


def test_orientations_in_another_unit_are_named(readings):
    """Rotation vectors in degrees, read as radians: the points agree, and so it is not the arm."""
    arm, readings = ta.load_arm("gao2017"), readings.rows(np.arange(14))
    turns = Rotation.from_matrix(arm.chain.pose(readings.angles).R_base_tip).as_rotvec()
    wrong = Rotation.from_rotvec(np.degrees(turns)).as_quat(scalar_first=True)
    with pytest.raises(InputError, match=r"the orientations differ .* by 1\d\d deg at one reading of four") as refused:
        ta.fit(arm, replace(readings, quaternion=wrong), model="nominal")
    assert "the points agree with the arm to " in refused.value.hint
    assert "--orientation-unit" in refused.value.hint


def test_an_arm_with_a_similar_name_is_the_mistake_though_readings_do_not_contradict_the_one_stated():
    diagnosis = ta.diagnose("ur10", ta.simulate("ur10e", poses=40, seed=2).session)
    assert diagnosis.check.stated.is_usual
    assert diagnosis.summary().startswith("the arm is ur10e, not ur10: ")
    refuses("no file of ur10 mends this", diagnosis.mended_arm)
    assert ta.diagnose("ur5e", ta.simulate("ur10e", poses=40, seed=2).session).check.findings[0].mistakes == (
        "the arm is ur10e, not ur5e",
    )
