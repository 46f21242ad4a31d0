"""Laws of `compare`: its answer, its record, what it refuses, and the command."""

import json
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import truearm as ta
from refusals import refuses
from truearm.command_line import make_app
from truearm.models.training_conditions import InputRange
from truearm.wings.reports import compare as compare_module


@pytest.fixture(scope="module")
def models():
    """Kinematic models of an arm, of the same arm again, and after the offset of joint 4 changed by 0.2 deg."""
    first, again = (ta.simulate("gao2017", poses=80, seed=seed).session for seed in (1, 2))
    angles = again.angles.copy()
    angles[:, 3] -= np.radians(0.2)
    sessions = {"old": first, "again": again, "crashed": replace(again, angles=angles)}
    arm = ta.load_arm("gao2017")
    return {name: ta.KinematicModel(arm).fit_readings(session) for name, session in sessions.items()}


@pytest.fixture(scope="module")
def crash(models):
    return ta.compare(models["old"], models["crashed"])


def test_the_constant_that_changed_is_named_with_its_size(crash):
    first = crash.changed[0]
    assert (first.place, first.name) == ("J4", "theta")
    assert first.change == pytest.approx(np.radians(0.2), abs=first.U)
    text = str(crash).splitlines()
    n = len(crash.constants)
    assert text[0] == crash.summary()
    assert text[0].startswith(
        f"New model of {crash.new.arm_.name} against the old one: {len(crash.changed)} of {n} constants changed by "
        "more than the uncertainty; the tip moves"
    )
    assert text[1].startswith("J4 theta moves the tip most: 0.")
    heading = next(i for i, line in enumerate(text) if line.startswith("constant "))
    assert text[heading + 1].split()[:2] == ["J4", "theta"]
    assert " yes " in text[heading + 1]
    assert sum(line.startswith(("J1", "J2", "J3", "J4", "J5", "J6")) for line in text[heading:]) == min(n, 10)


def test_an_unchanged_arm_is_said_to_be_unchanged(models):
    again = ta.compare(models["old"], models["again"])
    assert again.changed == ()
    assert again.summary().startswith(
        "New model of gao2017 against the old one: no constant changed by more than its uncertainty (18 compared); the "
        "tip moves by"
    )
    assert again.summary().endswith("within the uncertainty.")


def test_what_the_readings_do_not_determine_is_said_in_place_of_a_huge_uncertainty():
    """Of a UR10 whose tip is on the axis of joint 6 no readings tell where that axis is: U would be 200 mm."""
    change = ta.compare(*(ta.fit("ur10", ta.simulate("ur10", poses=40, seed=seed).session, model="kinematic").model
                          for seed in (1, 2)))  # fmt: skip
    one = next(one for one in change.constants if (one.place, one.name) == ("J5", "d"))
    assert not one.is_determined
    assert one.U > 50.0  # mm
    row = next(line for line in str(change).splitlines() if line.startswith("J5 d "))
    assert "not determined  no" in row
    assert next(one for one in change.constants if (one.place, one.name) == ("J3", "a")).is_determined


def test_a_right_arm_has_no_constant_that_is_not_determined():
    """Evidence shrinks the priors of an arm as drawn to um: what readings add to that is no measure of knowledge."""
    arm, models = ta.load_arm("ur10"), []
    for seed in (1, 2):
        q = ta.simulate("ur10", poses=200, seed=seed).session.angles
        noise = np.random.default_rng(seed).normal(0, 0.005, (len(q), 3))  # mm
        models.append(ta.KinematicModel(arm).fit(q, arm.chain.tip_in_base(q) + noise))
    change, limits = ta.compare(*models), {"mm": 0.1, "rad": 1e-3}
    for one in change.constants:
        assert one.is_determined
        assert limits[one.unit] > one.U  # a third or less of what is assumed of a drawing, 3 mm or 3 mrad
    text = str(change)
    assert "not determined" not in text
    assert text.count("8 more constants: --json or to_dict().") == 1


def test_a_tip_that_moves_without_one_constant_is_said(models):
    again = ta.compare(models["old"], models["again"])
    moved = replace(again.change, displacement=replace(again.change.displacement, limit_mm=1e-6))
    assert replace(again, change=moved).summary().endswith(", more than the uncertainties explain.")


def test_nominal_models_differ_by_base_and_tip_only():
    arm = ta.load_arm("gao2017")
    sessions = [ta.simulate("gao2017", poses=30, seed=seed).session for seed in (1, 2)]
    same = ta.compare(*(ta.NominalModel(arm).fit_readings(session) for session in sessions))
    assert same.changed == ()
    assert same.summary().endswith(
        "the tip moves by 0.00000 mm on average, 0.00000 mm at most, within the uncertainty."
    )


def test_the_record_reads_as_text_as_html_and_as_json(crash):
    plain = crash.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["n_constants"] == len(plain["constants"]) == 18
    assert plain["n_changed"] == sum(one["is_changed"] for one in plain["constants"]) > 0
    assert plain["displacement"]["is_significant"] is True
    one = next(one for one in plain["constants"] if (one["place"], one["name"]) == ("J4", "theta"))
    u = np.hypot(one["u_old"], one["u_new"])
    assert one["expanded_uncertainty"] == pytest.approx(one["coverage_factor"] * u, rel=1e-12)
    assert repr(crash).startswith("<ModelChange: ")
    assert "<table>" in crash._repr_html_()


def test_files_and_the_command_give_the_same_answer(models, crash, tmp_path):
    files = [tmp_path / f"{name}.truearm" for name in ("old", "crashed")]
    for file in files:
        models[file.stem].save(file)
    ran = CliRunner().invoke(make_app("compare"), ["compare", *map(str, files)])
    assert ran.exit_code == 0
    assert ran.stdout.splitlines()[0] == crash.summary()
    told = json.loads(CliRunner().invoke(make_app("compare"), ["compare", *map(str, files), "--json"]).stdout)
    assert told["summary"] == crash.summary()
    assert told["constants"][0]["change"] == pytest.approx(crash.constants[0].change, abs=1e-9)
    refuses(r"no-model", ta.compare, files[0], tmp_path / "no-model.truearm")


def with_training(model, **changes):
    """A copy of a fitted model with other training conditions."""
    other = copy(model)
    other.training_ = replace(model.training_, **changes)
    return other


def with_serial_number(model, serial_number):
    other = copy(model)
    other.arm_ = replace(model.arm_, serial_number=serial_number)
    return other


def test_what_else_differs_is_said(models, crash, monkeypatch):
    """Remarks on the models; the change itself is that of the crash, calculated once."""
    change = crash.change
    monkeypatch.setattr(compare_module, "constants_change", lambda *_: change)

    def remarks(one, other):
        return " ".join(ta.compare(one, other).remarks)

    old, again = models["old"], models["again"]
    assert remarks(old, again) == ""
    warm = with_training(again, temperature_degC=InputRange(26.0, 0.1, 25.0, 27.0))
    assert "mean temperatures of the training differ (2" in remarks(old, warm)
    loaded = with_training(again, columns={"payload_kg": InputRange(5.0, 0.0, 5.0, 5.0)})
    assert "payloads of the training differ (0 and 5 kg)" in remarks(old, loaded)
    assert "numbers differ (1, 2): these are two arms" in remarks(*map(with_serial_number, (old, again), "12"))
    assert remarks(*map(with_serial_number, (old, again), "11")) == ""
    own = copy(again)
    own.terms = (ta.Term("J4 by its cable", 4, (0, 0, 1, 0, 0, 0), ta.Expression.angle(4) ** 2, "cable", 1e-4),)
    assert "Terms of your own (J4 by its cable) are not compared" in remarks(old, own)
    change = replace(change, displacement=replace(change.displacement, region="either"))
    assert "Few poses are in the trained range of both" in remarks(old, again)
    assert remarks(old, again).endswith("compare physical models.")


def test_a_refitted_model_has_the_constants_of_the_first(models):
    refitted = ta.refit(models["old"], ta.simulate("gao2017", poses=30, seed=4).session).model
    same = ta.compare(models["old"], refitted)
    assert same.changed == ()
    assert same.remarks[0].startswith("The new model was refitted: its constants are those of before")


def test_what_cannot_be_compared_is_refused(models):
    old = models["old"]
    session = ta.simulate("gao2017", poses=30, seed=1).session
    network = ta.NetworkModel(ta.load_arm("gao2017"), hidden=(2,), epochs=2).fit_readings(session)
    ur10 = ta.KinematicModel(ta.load_arm("ur10")).fit_readings(ta.simulate("ur10", poses=40, seed=1).session)
    arm = ta.load_arm("gao2017")
    longer = replace(arm, chain=arm.chain.with_tip(arm.chain.tip_in_flange + [0, 0, 1.0]))
    edited = ta.KinematicModel(longer).fit_readings(session)
    named = replace(session, tip=np.array(["A", "B"] * 15))
    tips = ta.KinematicModel(arm).fit_readings(named)
    for new, said in (
        (network, "expected a nominal, kinematic or physical model, got a NetworkModel"),
        (ur10, "expected two models of one nominal arm, got '(gao2017|ur10)' "),
        (edited, "with other nominal constants"),
        (tips, "expected one tip, the model has 2: A, B"),
        (ta.KinematicModel(arm), "is not fitted"),
        (session, "expected a model, got Session"),
    ):
        refuses(said, ta.compare, old, new)
        refuses(said, ta.compare, new, old)


def test_one_of_several_tips_is_compared():
    sessions = [ta.simulate("gao2017", poses=60, seed=seed).session for seed in (1, 2)]
    named = [replace(session, tip=np.array(["A", "B"] * 30)) for session in sessions]
    old, new = (ta.KinematicModel(ta.load_arm("gao2017")).fit_readings(session) for session in named)
    assert ta.compare(old, new, tip="B").changed == ()


def test_what_is_no_change_in_time_is_said(models):
    old = models["old"]
    drawn = ta.NominalModel(old.arm).fit_readings(ta.simulate("gao2017", poses=80, seed=2).session)
    assert ta.compare(drawn, old).remarks[0].startswith("The old model is nominal: changes are differences from the")
    assert "Both models are of the same readings" in ta.compare(old, copy(old)).remarks[0]
