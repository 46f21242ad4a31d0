"""What a fleet teaches about the next arm: it helps where arms have something in common, and is refused where not."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from frame_laws import check_frame
from refusals import refuses
from truearm.identification.terms.type_prior import HeldOutGain
from truearm.wings.fleet.type_prior import (
    ArmTask,
    LearnedTypePrior,
    TypeEstimate,
    arm_equations,
    learned_from,
    linearised_arm,
)

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")


@pytest.fixture(scope="module")
def nominal():
    return ta.load_arm("ur10")


@pytest.fixture(scope="module")
def as_built(nominal):
    """The typical arm of a type whose drawing is wrong: a forearm 0.9 mm too long, an axis 1 mrad off."""
    motions = np.zeros((nominal.chain.n_places, 6))
    motions[3, 3], motions[1, 0] = 0.9, 1e-3
    return replace(nominal, chain=nominal.chain.with_motions(motions))


def readings(arm, seed, n=24):
    return ta.simulate(arm, preset="shop", strategy="uniform", poses=n, seed=seed, arm_seed=seed)


@pytest.fixture(scope="module")
def learned(nominal, as_built):
    return learned_from(nominal, {f"{i}": linearised_arm(nominal, readings(as_built, i).session) for i in range(5)})


def test_a_biased_drawing_is_learned(learned):
    assert learned.helps
    known = {one.name: one for one in learned.prior.constants}
    for name, truth in (("J3 translation along x", 0.9), ("J1 rotation about x", 1e-3)):
        # The drawn constants scatter by 3 um and 1.5 urad; other effects of a measuring arm take part.
        assert known[name].mean == pytest.approx(truth, abs=max(4 * known[name].mean_u, 0.03 * truth))
        assert known[name].std < 0.03 * truth
    assert "J3 translation along x" in str(learned)


def test_the_next_arm_needs_fewer_readings(nominal, as_built, learned, tmp_path):
    learned.save(tmp_path / "type.toml")
    simulated = readings(as_built, 7, n=10)
    angles = readings(as_built, 8, n=60).session.angles
    errors = {}
    for name, prior in (("without", None), ("with", tmp_path / "type.toml")):
        result = ta.fit(nominal, simulated.session, model="kinematic", prior=prior)
        off = result.model.predict(angles) - simulated.virtual.true_tip(angles)
        errors[name] = np.linalg.norm(off, axis=1).mean()
    assert errors["with"] < 0.7 * errors["without"]
    assert any("prior of type ur10 from 5 arms" in remark for remark in result.remarks)
    result.save(tmp_path / "m.truearm")
    assert ta.load_model(tmp_path / "m.truearm").type_prior_ == str(learned.prior)


def test_an_arm_that_taught_the_prior_gets_what_the_others_have_in_common(as_built, nominal, learned):
    four = {f"{i}": linearised_arm(nominal, readings(as_built, i).session) for i in (0, 1, 2, 4)}
    others, own = learned_from(nominal, four).prior, learned.prior.without("3")
    assert own.arms == others.arms
    for one, other in zip(own.constants, others.constants, strict=True):
        assert one.mean == pytest.approx(other.mean, abs=0.1 * other.std)
        assert one.std == pytest.approx(other.std, rel=0.1)
    of_arm = replace(nominal, serial_number="3")
    session = replace(readings(as_built, 3, n=10).session, serial_number=None)
    result = ta.fit(of_arm, session, model="kinematic", prior=learned.prior)
    assert "prior of type ur10 from 4 arms" in str(result)


def gain(ratio, u, n_arms=20):
    return HeldOutGain(n_readings=10, n_arms=n_arms, error_ratio=ratio, error_ratio_u=u)


@pytest.mark.parametrize(
    ("gains", "helps"),
    [
        ([gain(0.8, 0.05)], True),
        ([gain(0.95, 0.05)], False),  # chance
        ([gain(0.8, 0.05), gain(1.005, 0.02)], True),
        ([gain(0.8, 0.05), gain(1.02, 0.02)], False),  # worse by more than 1 % elsewhere
        ([gain(0.8, 0.1, n_arms=20)], True),
        ([gain(0.8, 0.1, n_arms=3)], False),  # three arms know their scatter less well
        ([], False),
    ],
)
def test_a_prior_is_kept_only_if_arms_held_out_say_so(gains, helps):
    assert TypeEstimate(None, tuple(gains)).helps is helps


def test_a_prior_that_does_not_help_is_not_written(learned, tmp_path):
    useless = LearnedTypePrior(learned.prior, helps=False)
    refuses(r"No gain", useless.save, tmp_path / "type.toml")
    assert not list(tmp_path.iterdir())


def test_too_few_arms_teach_nothing(nominal, as_built):
    two = {f"{i}": linearised_arm(nominal, readings(as_built, i).session) for i in range(2)}
    refuses("expected 3 arms or more of the type with 20 readings each, got 2", learned_from, nominal, two)


def test_a_file_that_cannot_be_used_is_a_reason(tmp_path):
    (tmp_path / "bad.csv").write_text("q1_deg,q2_deg\n1,2\n")
    assert "bad.csv" in arm_equations(ArmTask("A", "ur10", str(tmp_path / "bad.csv")))


def test_a_fleet_learns_from_its_files_whoever_computes(as_built, tmp_path):
    fleet = ta.Fleet.create(tmp_path / "fleet")
    for i in range(3):
        readings(as_built, i).save(tmp_path / f"{i}.csv")
        fleet.add(f"virtual-shop-{i}", "ur10", session=tmp_path / f"{i}.csv", model="nominal")
    refuses("no arm with a model in force", fleet.type_prior)
    fleet.run()
    serial = fleet.type_prior("ur10")
    check_frame(serial, len(serial.prior.constants))
    assert serial.prior.arms == ("virtual-shop-0", "virtual-shop-1", "virtual-shop-2")
    (tmp_path / "2.csv").write_text("q1_deg\n1\n")
    refuses("got 2", fleet.type_prior)
    refuses("expected the type panda, the fleet has arms of ur10", fleet.type_prior, "panda")
    fleet.close()


def test_a_run_fits_every_arm_with_what_the_others_of_its_type_have_in_common(as_built, learned, tmp_path):
    fleet = ta.Fleet.create(tmp_path / "fleet")
    for name, seed, model in (("3", 3, "kinematic"), ("7", 7, "kinematic"), ("8", 8, "nominal")):
        session = replace(readings(as_built, seed, n=10).session, serial_number=None)
        session.save(tmp_path / f"{name}.csv")
        fleet.add(name, "ur10", session=tmp_path / f"{name}.csv", model=model)
    assert fleet.run().n_fitted == 3
    learned.save(tmp_path / "type.toml")
    again = fleet.run(prior=tmp_path / "type.toml")
    assert [row.serial_number for row in again.rows] == ["3", "7"]
    assert "from 4 arms" in fleet.model("3").type_prior_
    assert "from 5 arms" in fleet.model("7").type_prior_
    assert not fleet.run().rows
    assert {state.what for state in fleet.status().arms} == {"in force"}
    learned.prior.model_copy(update={"arm_sha256": "0" * 64}).save(tmp_path / "other.toml")
    refuses("expected the prior of a type of the fleet, got one of 'ur10'", fleet.run, prior=tmp_path / "other.toml")
    for file in (tmp_path / "fleet" / "priors").iterdir():
        file.unlink()
    before = fleet.run()
    assert not before.rows  # the models without it are in force again
    assert not fleet.model("3").type_prior_
    fleet.close()
