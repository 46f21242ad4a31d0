"""Laws of the constants beside the drawing: planted changes come back with honest uncertainties, in the file too."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import chain_from_dh, nearest_table
from truearm.arm.arm import Arm
from truearm.identification.references.alignment import align
from truearm.models.compensator import Compensator
from truearm.number_format import RoundedNumber
from truearm.pages.html import render
from truearm.pages.page import Page
from truearm.wings.exports.formats import constants
from truearm.wings.exports.formats.constants_table import (
    IDENTIFIABLE,
    NOMINAL,
    NOT_IDENTIFIABLE,
    SUM_ALONG_AXES,
    SUM_WITH_BASE,
    SUM_WITH_TIP,
    ConstantsTable,
    constants_table,
)
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.exports.targets.manifest import read_manifest
from truearm.wings.reports.report import constants_section

NOISE_MM = 0.02


def true_arm(arm: Arm, seed: int) -> Arm:
    """An arm whose constants are off by 1 mrad and 0.5 mm at every place."""
    rng = np.random.default_rng(seed)
    motions = rng.normal(size=(arm.chain.n_places, 6)) * ([1e-3] * 3 + [0.5] * 3)
    return replace(arm, chain=arm.chain.with_motions(motions))


def readings_of(arm: Arm, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    low, high = np.clip(arm.limits.T, -2.5, 2.5)
    q = rng.uniform(low, high, (n, arm.n_joints))
    return q, arm.chain.tip_in_base(q) + rng.normal(0, NOISE_MM, (n, 3))


@pytest.fixture(scope="module", params=["ur10", "panda"])
def planted(request) -> tuple[Arm, Compensator, ConstantsTable]:
    arm = true_arm(ta.load_arm(request.param), 4)
    model = ta.KinematicModel(ta.load_arm(request.param)).fit(*readings_of(arm, 200, 5))
    return arm, model, constants_table(model, best_rigid_arm(model))


@pytest.fixture(scope="module")
def ur10() -> Compensator:
    session = ta.simulate("ur10", poses=150, seed=1).session
    return ta.PhysicalModel(ta.load_arm("ur10"), highest=2).fit_readings(session)


@pytest.fixture(scope="module")
def whole(ur10, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("whole") / "constants.csv"
    constants.write(ur10, path)
    return path.read_text()


def found(table: ConstantsTable, place: str, name: str):
    return next(one for one in table.constants if (one.place, one.name) == (place, name))


def test_planted_constants_come_back_within_their_uncertainties(planted):
    arm, model, table = planted
    nominal = model.arm_.chain
    truth = nearest_table(arm.chain, nominal, convention=table.identified.convention)
    off = []
    for row, joint in enumerate(table.joint_names):
        for one in (one for one in table.constants if one.place == joint):
            is_known = one.status == IDENTIFIABLE
            if is_known:
                off.append((one.identified - getattr(truth, one.name)[row]) / one.std)
            elif one.status != NOT_IDENTIFIABLE:
                assert one.change == 0.0
                assert one.std < 1e-6  # rounding of the difference quotients
    # Normalized errors of 13 and more correlated constants: none beyond 4, their mean square near 1.
    assert len(off) >= 13
    assert max(map(abs, off)) < 4
    assert 0.2 < np.mean(np.square(off)) < 2.5


def test_uncertainties_are_those_of_many_sessions():
    # 6 sessions of the same arm: the scatter of a constant against its stated uncertainty. The ratio of a standard
    # deviation of 6 has a spread of 32 %; the median over the constants is much nearer to 1.
    chain = chain_from_dh(a=[50, 400, 60], d=[300, 0, 350], alpha=[1.5, 0.0, -1.5], tip_in_flange=[30, 0, 90])
    nominal = Arm("three joints", chain)
    arm, tables = true_arm(nominal, 1), []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        q = rng.uniform(-1.5, 1.5, (80, 3))
        points = arm.chain.tip_in_base(q) + rng.normal(0, NOISE_MM, (80, 3))
        model = ta.KinematicModel(nominal).fit(q, points)
        tables.append(constants_table(model, best_rigid_arm(model)))
    ratios = []
    for several in zip(*(table.constants for table in tables), strict=True):
        if all(one.status == IDENTIFIABLE for one in several):
            ratios.append(np.std([one.identified for one in several], ddof=1) / np.mean([one.std for one in several]))
    assert len(ratios) > 8
    assert 0.7 < np.median(ratios) < 1.3


def test_what_no_reading_separates_is_named_and_nominal(planted):
    _, _, table = planted
    first, last = table.joint_names[0], table.joint_names[-1]
    assert found(table, first, "theta").status == found(table, first, "d").status == SUM_WITH_BASE
    assert found(table, last, "theta").status == found(table, last, "d").status == SUM_WITH_TIP
    if table.identified.convention == "dh":
        assert found(table, last, "a").status == found(table, last, "alpha").status == SUM_WITH_TIP
        assert found(table, "J2", "d").status == found(table, "J3", "d").status == SUM_ALONG_AXES
        assert found(table, "J2", "beta").status == IDENTIFIABLE
    else:
        assert found(table, first, "a").status == found(table, first, "alpha").status == SUM_WITH_BASE


def test_too_few_poses_leave_constants_open():
    # Joint 5 hardly moves: the angle of its axis and the offset of joint 6 remain open.
    nominal = ta.load_arm("ur10")
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (60, 6)) * [2, 1, 1, 1e-4, 1e-4, 1e-4] + nominal.working
    model = ta.KinematicModel(nominal).fit(q, true_arm(nominal, 2).chain.tip_in_base(q) + rng.normal(0, 0.02, (60, 3)))
    table = constants_table(model, best_rigid_arm(model))
    assert found(table, "J2", "a").status == IDENTIFIABLE
    assert NOT_IDENTIFIABLE in {found(table, "J5", name).status for name in ("theta", "d", "a", "alpha")}


def test_a_known_base_and_tip_leave_joints_1_and_6_their_constants():
    nominal = ta.load_arm("ur10")
    motions = np.zeros((8, 6))
    motions[1, 2], motions[1, 5] = 2e-3, 0.5
    arm = replace(nominal, chain=nominal.chain.with_motions(motions))
    model = ta.KinematicModel(nominal, free=()).fit(*readings_of(arm, 150, 3))
    table = constants_table(model, best_rigid_arm(model))
    theta, d = found(table, "J1", "theta"), found(table, "J1", "d")
    assert theta.change == pytest.approx(2e-3, abs=5 * theta.std + 1e-6)
    assert d.change == pytest.approx(0.5, abs=5 * d.std + 1e-3)
    assert found(table, "base", "z").identified == pytest.approx(0.0, abs=1e-9)


def test_the_table_gives_the_stand_ins_tips(ur10):
    rigid = best_rigid_arm(ur10)
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    for convention in ("dh", "mdh"):
        chain = constants_table(ur10, rigid, convention=convention).identified.chain()
        expected = rigid.in_reference_frame().chain.tip_in_base(q)
        np.testing.assert_allclose(chain.tip_in_base(q), expected, atol=1e-9, rtol=0)


def test_a_network_has_constants_without_those_of_its_own():
    q, points = readings_of(true_arm(ta.load_arm("ur5"), 1), 60, 2)
    model = ta.NetworkModel(ta.load_arm("ur5"), hidden=(3,), epochs=5).fit(q, points)
    table = constants_table(model, best_rigid_arm(model))
    assert all(np.isfinite([one.identified, one.std]).all() for one in table.constants)


def test_the_file_gives_the_same_tips_and_its_check_poses(ur10, tmp_path):
    path = tmp_path / "constants.csv"
    rigid = constants.write(ur10, path, frame="reference").rigid
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    expected = rigid.in_reference_frame().chain.tip_in_base(q)
    np.testing.assert_allclose(constants.tips(path, q), expected, atol=1e-9, rtol=0)
    manifest = read_manifest(path)
    np.testing.assert_allclose(constants.tips(path, manifest.joints), manifest.tips, atol=1e-9, rtol=0)
    assert manifest.loss == rigid.loss
    rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert rows[0] == "place,constant,unit,nominal,identified,change,standard_uncertainty,status"
    assert sum(line.startswith("J2,") for line in rows) == 5


def test_in_its_own_base_the_arm_has_the_same_shape(ur10, tmp_path):
    q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
    placed, own = tmp_path / "placed.csv", tmp_path / "own.csv"
    constants.write(ur10, placed, frame="reference")
    constants.write(ur10, own)
    one, other = (constants.tips(path, q) for path in (placed, own))
    T = align(other, one)
    np.testing.assert_allclose(other @ T[:3, :3].T + T[:3, 3], one, atol=1e-8)
    assert ",nominal\n" in own.read_text()
    assert "base,x,mm,0.0,0.0,0.0,0.0,nominal" in own.read_text()


def test_a_flange_and_a_modified_table_are_in_the_file(tmp_path):
    nominal = ta.load_arm("panda")
    model = ta.KinematicModel(nominal).fit(*readings_of(true_arm(nominal, 3), 60, 1))
    path = tmp_path / "panda.csv"
    rigid = constants.write(model, path, frame="reference").rigid
    text = path.read_text()
    assert "mdh: Tx(a)" in text
    assert "\nflange,rz,rad," in text
    q = np.random.default_rng(0).uniform(-2, 2, (20, 7))
    expected = rigid.in_reference_frame().chain.tip_in_base(q)
    np.testing.assert_allclose(constants.tips(path, q), expected, atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("dh: Rz", "ddh: Rx"), "expected a comment with one of the formulas"),
        (lambda text: text.replace("place,constant,", "place,name,"), "line 3: expected the columns place,constant,"),
        (lambda text: text.replace("J2,a,mm", "J9,a,mm"), "there is no constant J9 a in this arm"),
        (lambda text: text.replace("J2,a,mm", "J1,a,mm"), "the constant a of J1 is stated twice"),
        (
            lambda text: "\n".join(line for line in text.splitlines() if not line.startswith("J2,a")),
            "a of J2 is missing",
        ),
        (
            lambda text: text.replace("J2,a,mm,-612.0,", "J2,a,mm,-612.0,x"),
            "column 'identified': expected a finite number",
        ),
        (lambda text: text.replace("J2,a,mm,", "J2,a,mm,1,"), "expected 8 cells, got 9"),
    ],
)
def test_a_damaged_file_is_refused(whole, tmp_path, change, message):
    path = tmp_path / "constants.csv"
    path.write_text(change(whole))
    refuses(message, constants.tips, path, np.zeros((1, 6)))


def test_the_page_has_every_constant(planted):
    _, model, table = planted
    section = constants_section(table, best_rigid_arm(model).loss, reach_mm=1000.0)
    changed, whole = section.tables
    assert whole.folded
    assert len(whole.rows) == len(table.constants)
    significant = {
        f"{one.place} {one.name}"
        for one in table.constants
        if one.place not in ("base", "tip") and abs(one.change) > 2 * one.std > 0
    }
    assert {row[0] for row in changed.rows} <= significant
    assert len(changed.rows) == min(len(significant), 8)
    page = render(Page("A page", sections=(section,)))
    assert "only as a sum with the base" in page


def test_a_constant_that_nothing_moves_is_nominal():
    """An arm from seats has the frame of its first joint: its base is held, with no uncertainty of the rounding.

    A wobble of that joint, which the model does not have, moves the base of the nearest rigid arm, but not along it.
    """
    session = ta.simulate("gao2017", strategy="seat", seats=4, poses=60, preset="shop", seed=1).session
    model = ta.KinematicModel(ta.load_arm("gao2017")).fit_readings(ta.Session(session.angles, seat=session.seat))
    rigid = best_rigid_arm(model)
    table = constants_table(model, rigid)
    status = {(one.place, one.name): one.status for one in table.constants}
    assert {status["base", name] for name in ("z", "rz")} == {NOMINAL}
    held = [one for one in table.constants if one.place == "base"]
    assert len(held) == 6
    assert [one.identified for one in held] == pytest.approx([one.nominal for one in held], abs=1e-9)
    assert status["J2", "theta"] == "identifiable"
    shown = constants_section(table, rigid.loss, reach_mm=1000.0).tables[1]
    held = next(row for row in shown.rows if row[0] == "base z")
    assert held[1] == held[2]
    assert held[3:5] == (None, None)
    for row in shown.rows:  # two digits of an uncertainty of 1e-8 would be eight zeros
        assert all(one.uncertainty > 1e-7 for one in row if isinstance(one, RoundedNumber) and one.uncertainty)
