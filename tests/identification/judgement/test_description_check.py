"""A planted mistake is named, a right arm is left alone, and what readings do not tell apart is named together."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

import truearm as ta
from truearm.arm import load_arm
from truearm.arm.description_mistakes import Interpretation, likely_mistakes
from truearm.identification.judgement.description_check import (
    LEAST_EXPLAINED,
    NOISE_MM,
    _left_held_out,
    check_description,
    likelier_arm,
    restricted_likelihood,
)
from truearm.identification.judgement.description_fits import fit_descriptions, fixed_motions
from truearm.identification.references.reference_table import reference_table
from truearm.identification.terms.links import gravity_torques, uniform_links
from truearm.readings import Session

ARM = load_arm("gao2017")


@pytest.fixture(scope="module")
def readings() -> Session:
    session = ta.simulate(ARM, poses=60, strategy="uniform", preset="shop", seed=1).session
    return Session(session.angles, session.points)


@pytest.fixture(scope="module")
def in_seats() -> ta.SimulationResult:
    return ta.simulate(ARM, poses=60, strategy="seat", preset="shop", bars=2, reference=False, seed=1)


def found(arm, session, lengths=None, **options):
    table = reference_table(session, lengths, **options)
    assert table is not None
    return check_description(arm, table)


def signs(*joints: int) -> np.ndarray:
    return np.where(np.isin(np.arange(1, 7), joints), -1.0, 1.0)


# The mathematics -----------------------------------------------------------------------------------------------------


def test_the_restricted_likelihood_is_the_density_of_contrasts(rng):
    """Against the density of an orthonormal set of contrasts, up to the constant that the number of them gives."""
    r, free, tolerances = rng.normal(size=12), rng.normal(size=(12, 3)), rng.normal(size=(12, 4))
    contrasts = null_space(free.T)
    densities = [
        multivariate_normal.logpdf(
            contrasts.T @ r, cov=contrasts.T @ (noise**2 * np.eye(12) + tolerances @ tolerances.T) @ contrasts
        )
        for noise in NOISE_MM
    ]
    best, usual = restricted_likelihood(r, free, tolerances)
    assert best == pytest.approx(max(densities) + 0.5 * 9 * np.log(2 * np.pi), rel=1e-9)
    explained = contrasts.T @ tolerances
    assert usual == pytest.approx(np.sqrt((explained**2).sum() / 12), rel=1e-12)


def test_another_unit_of_the_data_changes_no_odds(rng):
    """Density of numbers in inches: residuals in mm, and the scale as its Jacobian."""
    r, free, tolerances = rng.normal(size=12), rng.normal(size=(12, 3)), rng.normal(size=(12, 4))
    in_mm, _ = restricted_likelihood(r, free, tolerances)
    in_inch, _ = restricted_likelihood(r, free, tolerances, scale=25.4)
    assert in_inch - in_mm == pytest.approx(9 * np.log(25.4))


@pytest.mark.parametrize("name", ["gao2017", "panda", "wam", "gen3lite"])  # the last one has beta
def test_many_chains_at_once_are_the_chains_one_by_one(name):
    stated = Interpretation.stated(load_arm(name))
    others = [one.mend(stated) for one in likely_mistakes(load_arm(name))[::7]]
    fixed = fixed_motions([stated, *others])
    for one, motions in zip([stated, *others], fixed, strict=True):
        assert np.abs(one.table.chain().fixed - motions).max() < 1e-9  # rounding at 1 m


def test_readings_without_errors_leave_none(rng):
    """Base and tip elsewhere: the fit finds both, whatever the frame."""
    angles = rng.uniform(-2, 2, (30, 6))
    tips = ARM.chain.with_tip(ARM.chain.tip_in_flange + [5, -8, 20]).tip_in_base(angles)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    table = reference_table(Session(angles, tips @ turn.T + [1e3, -500, 200]))
    fits = fit_descriptions(table, [Interpretation.stated(ARM)])
    assert np.abs(fits.residuals).max() < 1e-6  # Gauss-Newton, at a reach of 1.5 m
    assert fits.tip_in_flange[0] - ARM.chain.tip_in_flange == pytest.approx([5, -8, 20], abs=1e-6)


# Planted mistakes ----------------------------------------------------------------------------------------------------

CHANGES = {
    "sign of J4 reversed": lambda s: replace(s, angles=s.angles * signs(4)),
    "zero of J3 off by 90 deg: add 90 deg to its theta": lambda s: replace(
        s, angles=s.angles - np.radians(90) * (np.arange(6) == 2)
    ),
    "J3 and J4 exchanged": lambda s: replace(s, angles=s.angles[:, [0, 1, 3, 2, 4, 5]]),
    "joints in reverse order": lambda s: replace(s, angles=s.angles[:, ::-1]),
    "angle of J3 contains that of J2 (coupled joints)": lambda s: replace(
        s, angles=s.angles + s.angles[:, [1]] * (np.arange(6) == 2)
    ),
    "all angles are in rad, stated in deg": lambda s: replace(s, angles=np.radians(s.angles)),
    "all angles are in gon, stated in deg": lambda s: replace(s, angles=s.angles / 0.9),
    "J5 is in rad, stated in deg": lambda s: replace(
        s, angles=np.where(np.arange(6) == 4, np.radians(s.angles), s.angles)
    ),
    "reference points are in inch, stated in mm": lambda s: replace(s, points=s.points / 25.4),
    "frame of the reference points is left-handed (an axis mirrored, or two axes exchanged)": lambda s: replace(
        s, points=s.points[:, [1, 0, 2]]
    ),
    "references stand one row later than their readings": lambda s: replace(s, points=np.roll(s.points, 1, axis=0)),
}


@pytest.mark.parametrize("description", CHANGES)
def test_a_mistake_in_the_readings_is_named(readings, description):
    check = found(ARM, CHANGES[description](readings))
    assert check.findings[0].mistakes == (description,)
    assert check.findings[0].error_mm < 2 < 30 < check.stated.error_mm
    assert not check.stated.is_plausible


@pytest.mark.parametrize(
    ("turn", "description"),
    [
        (np.diag([1, -1, 1]), "sign of y of the reference points reversed"),
        (np.eye(3)[[1, 0, 2]], "x and y of the reference points exchanged"),
        (np.eye(3)[[0, 2, 1]], "y and z of the reference points exchanged"),
    ],
)
def test_where_the_base_is_known_the_axis_is_named(turn, description):
    angles = np.random.default_rng(5).uniform(-2, 2, (30, 6))
    table = reference_table(Session(angles, ARM.chain.tip_in_base(angles) @ turn), free=("tip",))
    assert check_description(ARM, table).findings[0].mistakes == (description,)


@pytest.mark.parametrize("description", ["sign of a of J2 reversed", "a and d of J3 exchanged", 'of convention "dh"'])
def test_a_mistake_in_the_arm_file_is_named(readings, description):
    """Where two changes of a table are the same arm in other words, both are named."""
    right = Interpretation.stated(ARM)
    if "convention" in description:
        table = replace(right.table, convention="mdh")
    else:
        table = next(one for one in likely_mistakes(ARM) if one.description == description).mend(right).table
    check = found(replace(ARM, chain=table.chain(), table=table), readings)
    assert description in " ".join(map(str, check.findings))
    assert all(one.error_mm < 2 for one in check.findings)


def test_equivalent_mistakes_are_named_together(readings):
    """The sign of J1, the sign of its alpha and half a turn of J2 are one mirrored shoulder in three descriptions."""
    check = found(ARM, replace(readings, angles=readings.angles * signs(1)))
    named = {one.mistakes[0] for one in check.findings}
    assert "sign of J1 reversed" in named
    assert "zero of J2 off by 180 deg: add 180 deg to its theta" in named


def test_two_mistakes_are_found_where_one_explains_nothing(readings):
    check = found(ARM, replace(readings, angles=(readings.angles * signs(4))[:, [0, 2, 1, 3, 4, 5]]))
    assert set(check.findings[0].mistakes) == {"sign of J4 reversed", "J2 and J3 exchanged"}
    assert check.findings[0].error_mm < 2


def test_a_tenth_of_gross_errors_hides_nothing(readings):
    points = readings.points.copy()
    points[::10] += 100.0
    check = found(ARM, replace(readings, angles=readings.angles * signs(4), points=points))
    assert check.findings[0].mistakes == ("sign of J4 reversed",)


@pytest.mark.parametrize("joint", [2, 3, 5])
def test_seats_and_a_bar_are_enough(in_seats, joint):
    session = replace(in_seats.session, angles=in_seats.session.angles * signs(joint))
    check = found(ARM, session, in_seats.lengths)
    assert f"sign of J{joint} reversed" in [one.mistakes[0] for one in check.findings]
    assert check.findings[0].error_mm < 2 < 30 < check.stated.error_mm


def test_the_unit_of_a_bar_shows(in_seats):
    inches = replace(in_seats.lengths, length_mm=in_seats.lengths.length_mm / 25.4)
    assert [str(one) for one in found(ARM, in_seats.session, inches).findings] == [
        "known lengths are in inch, stated in mm"
    ]


# Nothing to propose --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "seed"), [("measuring7", 1), ("ur10", 2)])
def test_a_right_arm_is_left_alone(name, seed):
    session = ta.simulate(name, poses=40, strategy="measuring", preset="worn", seed=seed, arm_seed=seed).session
    check = found(load_arm(name), session)
    assert check.stated.is_usual
    assert not check.findings


# Weight --------------------------------------------------------------------------------------------------------------


def sagging(arm, angles, *, rad_per_Nm: float, seed: int = 1) -> Session:
    """Readings of an arm of usual constants, with 0.05 mm of noise, whose joints yield under uniform links."""
    rng, chain = np.random.default_rng(seed), arm.chain
    motions = np.zeros((chain.n_places, 6))
    motions[1:-1] = rng.normal(size=(chain.n_places - 2, 6)) * [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3]
    torque = gravity_torques(chain, angles, uniform_links(chain, kg_per_m=20.0))[:, :, 2]
    points = chain.with_motions(motions).tip_in_base(angles + rad_per_Nm * torque)
    return Session(angles, points + 0.05 * rng.normal(size=points.shape))


def two_joints_move(arm, n: int = 60) -> np.ndarray:
    angles = np.zeros((n, arm.n_joints))
    angles[:, 0], angles[:, 1] = (
        np.tile(np.linspace(-1.4, 1.4, 5), n // 5),
        np.repeat(np.linspace(-1.3, 1.3, n // 5), 5),
    )
    return angles + np.random.default_rng(2).normal(0, 2e-5, angles.shape)


@pytest.mark.parametrize(
    ("name", "few"),
    [*(pytest.param(name, True, marks=pytest.mark.weekly) for name in ("iiwa7", "gao2017")), ("ur10", False)],
)
def test_an_arm_that_sags_has_no_mistake_in_its_file(name, few, rng):
    arm = load_arm(name)
    angles = two_joints_move(arm) if few else rng.uniform(-1.5, 1.5, (40, arm.n_joints))
    session = sagging(arm, angles, rad_per_Nm=3e-4)
    check = found(arm, session)
    assert not check.stated.is_usual
    assert not check.findings
    assert check.sagging.error_mm < 0.3 * check.stated.error_mm  # the rest are its constants
    assert ta.diagnose(arm, session).summary().startswith("No mistake in the arm file: joints yield under the weight")


def test_an_arm_that_sags_by_much_is_unusual_and_not_refused():
    arm = load_arm("iiwa7")
    result = ta.fit(arm, sagging(arm, two_joints_move(arm), rad_per_Nm=3e-4), model="nominal")
    assert "its joints yield under the weight of the arm" in " ".join(result.remarks)


@pytest.mark.parametrize("rad_per_Nm", [2e-5, 1e-4])
def test_a_mistake_in_an_arm_that_sags_is_still_named(rad_per_Nm, rng):
    session = sagging(ARM, rng.uniform(-1.5, 1.5, (40, 6)), rad_per_Nm=rad_per_Nm)
    check = found(ARM, replace(session, angles=session.angles * signs(4)))
    assert [one.mistakes for one in check.findings] == [("sign of J4 reversed",)]
    assert check.sagging is None


def test_a_joint_that_did_not_move_shows_no_mistake_of_its_column():
    """Nor what its angle contains of another; its zero may be wrong all the same."""
    arm = load_arm("ur10")
    angles = two_joints_move(arm)
    check = found(arm, Session(angles, arm.chain.tip_in_base(angles * signs(2))))
    assert check.findings[0].mistakes == ("sign of J2 reversed",)
    named = {name for one in (*check.findings, *check.others) for name in one.mistakes}
    for joint in range(3, 7):
        assert not [
            name for name in named if name.startswith((f"sign of J{joint} r", f"angle of J{joint}", f"J{joint} is"))
        ]


def test_what_is_named_explains_most_of_the_error_of_readings_held_out(readings):
    """Readings held out one by one, by their leverage, are predicted as by fits without them."""
    wrong = replace(readings, angles=readings.angles * signs(4))
    check = found(ARM, wrong)
    assert all(one.explained >= LEAST_EXPLAINED for one in check.findings)
    assert check.stated.explained == 0.0
    rng = np.random.default_rng(3)
    r, J = rng.normal(size=36), rng.normal(size=(36, 9))
    left = [
        r[i : i + 3] - J[i : i + 3] @ np.linalg.lstsq(np.delete(J, rows, 0), np.delete(r, rows), rcond=None)[0]
        for i in range(0, 36, 3)
        for rows in [np.arange(i, i + 3)]
    ]
    assert _left_held_out(r, J, 12) == pytest.approx((np.array(left) ** 2).sum() / 12, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "stated"), [("ur10e", "ur10"), ("ur10", "ur10e"), ("iiwa7", "iiwa14"), ("ur5", "ur10")]
)
def test_an_arm_that_is_taken_for_one_with_a_similar_name_is_named(name, stated):
    """Also where its drawing misses by no more than drawings do; the right arm has no likelier one."""
    session = ta.simulate(name, poses=40, seed=2).session
    table = reference_table(session)
    assert likelier_arm(load_arm(name), table) is None
    assert likelier_arm(load_arm(stated), table).mistakes == (f"the arm is {name}, not {stated}",)
    no_name_of_the_catalogue = replace(load_arm(stated), name="mine")
    assert likelier_arm(no_name_of_the_catalogue, table) is None


def test_a_fit_says_that_the_arm_is_another_one():
    result = ta.fit("ur10", ta.simulate("ur10e", poses=40, seed=2).session, model="kinematic")
    said = "By these readings the arm is ur10e, not ur10: they miss its drawing by 0.1"
    assert any(str(one).startswith(said) for one in result.findings)


def test_a_turned_base_or_a_longer_stylus_is_no_mistake(readings):
    """The zero of joint 1 and the place of the tip are free."""
    check = found(ARM, replace(readings, angles=readings.angles + [1.0, 0, 0, 0, 0, 0]))
    assert check.stated.is_usual
    assert not check.findings


def test_a_base_that_is_known_is_none_to_fit(readings):
    turned = replace(readings, angles=readings.angles - np.radians(90) * (np.arange(6) == 0))
    check = found(ARM, turned, free=("tip",))
    assert check.findings[0].mistakes == ("zero of J1 off by 90 deg: add 90 deg to its theta",)


def test_readings_of_no_arm_are_explained_by_nothing(rng):
    check = found(ARM, Session(rng.uniform(-2, 2, (40, 6)), rng.uniform(-500, 500, (40, 3))))
    assert not check.findings
    assert not check.stated.is_plausible


def test_too_few_readings_give_no_table(readings):
    assert reference_table(readings.rows(np.arange(7))) is None
    assert reference_table(Session(readings.angles)) is None


def test_one_session_and_one_tip_are_compared(readings):
    """Those with the most readings; where neighbours are missing, no shift is asked."""
    names = np.where(np.arange(60) < 20, "a", "b")
    table = reference_table(replace(readings, session=names))
    assert len(table.angles) == 38
    points = readings.points.copy()
    points[::2] = np.nan
    assert set(reference_table(replace(readings, points=points)).points) == {0}
