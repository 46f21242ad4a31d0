"""Several tips on one flange: each offset is found, each tip predicted, and none is taken for another."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.identification.estimation.tip_offsets import tip_offsets, what_tips_show
from truearm.identification.references.tips import check_tips
from truearm.identification.terms import OfTip
from truearm.models import KinematicModel, NetworkModel, NominalModel
from truearm.models.model_file import load_model
from truearm.models.refit import refit
from truearm.readings import Session, read_session, write_session
from truearm.verbs.fit import fit

STD, POSES = 0.02, 30
# Three nests on one plate: the first is the tip of the arm file, as it is.
OFFSETS = {"N1": np.zeros(3), "N2": np.array([80.0, 10.0, -30.0]), "N3": np.array([-20.0, 95.0, 15.0])}


def with_offset(chain, offset):
    return replace(chain, tip_in_flange=chain.tip_in_flange + offset)


def measured(real, rng, *, poses=POSES, names=tuple(OFFSETS), std=STD):
    """Every tip in every pose."""
    angles = real.arm.working + 0.8 * rng.uniform(-1, 1, (poses, 6))
    points = np.stack([with_offset(real.chain, OFFSETS[name]).tip_in_base(angles) for name in names], axis=1)
    points = points.reshape(-1, 3) + rng.normal(0, std, (poses * len(names), 3))
    return Session(np.repeat(angles, len(names), axis=0), points, tip=np.tile(names, poses))


def mean_error(real, model, name):
    angles = real.arm.working + 0.8 * np.random.default_rng(5).uniform(-1, 1, (100, 6))
    predicted = model.predict_readings(Session(angles, tip=np.full(100, name)))
    return np.linalg.norm(predicted - with_offset(real.chain, OFFSETS[name]).tip_in_base(angles), axis=1).mean()


@pytest.fixture(scope="module")
def nests(real):
    return measured(real, np.random.default_rng(21))


@pytest.fixture(scope="module")
def model(real, nests):
    return KinematicModel(real.arm).fit_readings(nests)


def test_every_offset_is_found_within_its_uncertainty(real, model):
    assert model.tips_ == ("N1", "N2", "N3")
    found = tip_offsets(model.fit_, model.tips_)
    terms = model.fit_.perturbed_chain.terms
    rows = [i for i, term in enumerate(terms) if isinstance(term.basis, OfTip)]
    std = np.sqrt(model.fit_.covariance.diagonal()[rows]).reshape(2, 3)
    # The flange's axes of the true chain are turned against the model's by its constants, some mrad over 90 mm.
    np.testing.assert_allclose(found, list(OFFSETS.values()), atol=0.6)
    assert (std < 0.6).all()
    for name in OFFSETS:
        assert mean_error(real, model, name) < STD


def test_three_tips_not_in_a_line_determine_the_flange(real, model, rng):
    assert "determine the orientation of the flange" in str(*what_tips_show(model.fit_, model.tips_))
    two = KinematicModel(real.arm).fit_readings(measured(real, rng, poses=12, names=("N1", "N2")))
    assert "They are in a line" in str(*what_tips_show(two.fit_, two.tips_))
    one = measured(real, rng, poses=12, names=("N1", "N1"), std=0.1)
    one = replace(one, tip=np.tile(["N1", "N2"], 12))
    near = NominalModel(real.arm).fit_readings(one)
    assert "in one place within their uncertainty" in str(*what_tips_show(near.fit_, near.tips_))


def test_a_refit_of_the_tip_takes_the_name_of_a_new_one(real, model, rng):
    new = measured(real, rng, poses=10, names=("N3",))
    moved = refit(model.with_tip("N1"), replace(new, tip=np.full(10, "M")), free=("tip",))
    assert moved.tips_ == ("M",)
    predicted = moved.predict_readings(replace(new, tip=None))
    assert np.linalg.norm(predicted - new.points, axis=1).mean() < 4 * STD


def test_tips_of_one_pose_are_held_out_together(model):
    assert len(np.unique(model.held_out_.group)) == POSES
    assert model.held_out_.mean_mm < 3 * STD


def test_a_model_of_several_tips_predicts_no_unnamed_or_unknown_tip(real, model):
    angles = np.tile(real.arm.working, (2, 1))
    refuses(r"the model has 3 tips \(N1, N2, N3\), and the readings name none", model.predict, angles)
    error = refuses("expected a tip of the model", model.predict_readings, Session(angles, tip=["N1", "N4"]))
    assert error.column == "tip"
    assert "reading 2" in str(error)


@pytest.mark.parametrize(
    ("tips", "said"),
    [
        (("T{x}", "{}"), "expected a tip of the model (T{x}, {}), got '{0}'"),
        ((), "expected one tip, as the model has, got '{0}' beside 'T{x}'"),
    ],
)
def test_a_tip_whose_name_has_braces_is_named_as_it_is(tips, said):
    error = refuses(None, check_tips, tips, Session(np.zeros((3, 6)), tip=["T{x}", "T{x}", "{0}"]))
    assert str(error).startswith(f"reading 3, column 'tip': {said}. Try: ")


def test_readings_checked_by_another_model_are_checked_again(model, nests):
    one = model.with_tip("N2")
    checked = one.checked(Session(nests.angles[:3]))
    refuses("3 tips", model.predict_readings, checked)
    own = model.checked(nests)
    assert model.checked(own) is own


def test_angles_without_a_tip_and_far_beyond_all_limits_are_outside_the_trained_range(real, model):
    """A judgement of angles answers where a prediction refuses."""
    assert model.outside_training(np.rad2deg(real.arm.working + np.ones((4, 6)))).all()
    assert not model.outside_training(real.arm.working[None]).any()


def test_the_model_of_one_tip_predicts_the_same_points_and_uncertainties(real, model):
    angles = real.arm.working + 0.5 * np.random.default_rng(6).uniform(-1, 1, (20, 6))
    for name in model.tips_:
        one = model.with_tip(name)
        named = model.predict_readings(Session(angles, tip=np.full(20, name)), return_cov=True)
        for own, of_all in zip(one.predict(angles, return_cov=True), named, strict=True):
            # Sums in another order.
            np.testing.assert_allclose(own, of_all, rtol=1e-9, atol=1e-9)
        assert one.tips_ == (name,)
        np.testing.assert_allclose(
            one.predict_nominal(angles), model.predict_nominal_readings(Session(angles, tip=np.full(20, name)))
        )
    assert model.tips_ == ("N1", "N2", "N3")
    refuses("expected a tip of the model", model.with_tip, "N4")
    with pytest.raises(InputError, match="expected a tip of the model"):
        model.with_tip("N1").predict_readings(Session(angles, tip=np.full(20, "N2")))


def test_a_file_keeps_the_tips(model, nests, tmp_path):
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    assert again.tips_ == model.tips_
    np.testing.assert_array_equal(again.predict_readings(nests), model.predict_readings(nests))
    write_session(nests, tmp_path / "nests.csv")
    read = read_session(tmp_path / "nests.csv")
    np.testing.assert_array_equal(read.tip, nests.tip)


def test_exports_are_of_one_tip(model, tmp_path):
    for call in (
        lambda: ta.export(model, tmp_path / "arm.json"),
        lambda: ta.correct(model, model.arm.working[None]),
        lambda: ta.task(model, "length", 100.0),
    ):
        refuses("expected one tip, the model has 3: N1, N2, N3", call)
    ta.export(model, tmp_path / "arm.json", tip="N2")
    assert ta.check_export(model, tmp_path / "arm.json", tip="N2").agrees
    assert not ta.check_export(model, tmp_path / "arm.json", tip="N3").agrees
    assert not ta.correct(model.with_tip("N3"), model.arm.working[None]).refused.any()


def test_a_report_is_of_one_tip(model, nests):
    refuses("expected the readings of one tip, got those of 3", ta.report, model, nests)
    refuses("expected one tip, the model has 3", ta.report, model, replace(nests, tip=None))
    found = ta.evaluate(model, nests)
    assert found.errors["model"]["mean_mm"] < 3 * STD


def test_tips_moved_as_one_are_found_again(real, model, rng):
    moved = replace(real, chain=with_offset(real.chain, [4.0, -3.0, 2.0]))
    new = measured(moved, rng, poses=8)
    again = refit(model, new, free=("tip",))
    for name in OFFSETS:
        assert mean_error(moved, again, name) < 2 * STD
    refuses("expected a tip of the model", refit, model, replace(new, tip=np.full(len(new), "N7")), free=("tip",))


def test_tips_join_seats_and_distances(real, rng):
    """Without a point: seats take any ball, wires are hooked to any tip."""
    anchors = np.array([[900.0, 200.0, 100.0], [-700.0, 800.0, -200.0]])
    nests = measured(real, rng, poses=40, names=("N1", "N2"), std=0.0)
    distance = np.linalg.norm(nests.points[:, None] - anchors, axis=2) + rng.normal(0, STD, (len(nests), 2))
    wires = replace(
        nests.rows(np.repeat(np.arange(len(nests)), 2)),
        points=None,
        numbers=None,
        anchor=np.tile(["A", "B"], len(nests)),
        distance_mm=distance.ravel(),
    )
    found = fit(real.arm, wires, model="kinematic")
    # The second offset by distances alone: 80 distances of 0.02 mm.
    np.testing.assert_allclose(
        np.linalg.norm(tip_offsets(found.model.fit_, found.model.tips_)[1]), np.linalg.norm(OFFSETS["N2"]), atol=0.2
    )
    held = real.held(rng)
    both = replace(held, tip=np.full(len(held), "N1"))
    assert KinematicModel(real.arm).fit_readings(both).tips_ == ("N1",)


def test_what_cannot_be_is_refused(real, nests):
    assert "reading 2" in str(refuses("expected the tip of every reading", Session, np.zeros((2, 1)), tip=["A", ""]))
    assert Session(np.zeros((2, 1)), tip=["", ""]).tip is None
    with pytest.raises(InputError, match="the readings have 3 tips, and a fit with a known tip has one"):
        KinematicModel(real.arm, free=("base",)).fit_readings(nests)
    refuses("expected the readings of one tip", NetworkModel(real.arm).fit_readings, nests)
    refuses("expected a name as text", OfTip, "")


def test_a_model_without_a_name_takes_one_name(real, rng):
    session = replace(measured(real, rng, poses=20, names=("N1",)), tip=None)
    model = KinematicModel(real.arm).fit_readings(session)
    assert model.tips_ == ()
    named = Session(session.angles, tip=np.full(len(session), "probe"))
    np.testing.assert_array_equal(model.predict_readings(named), model.predict(session.angles))
    with pytest.raises(InputError, match="expected one tip, as the model has"):
        model.predict_readings(replace(named, tip=np.array(["probe", "other"] * 10)))
