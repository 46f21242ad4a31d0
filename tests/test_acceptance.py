"""Laws of acceptance: a judgement is refused without a reason, overridden with one, and the reason is kept."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.acceptance import MAX_TEXT, OVERRIDE, Acceptance, accepted, accepting, accepts, contradict
from truearm.errors import Contradiction, InputError, SeveralFaults
from truearm.pages.html import render

pytestmark = pytest.mark.usefixtures("undrawn")

WHY = "the encoder was turned round, the drawing follows"
SESSION = ta.simulate("ur10", poses=30, seed=1).session


def contradicted(name: str) -> tuple[ta.Arm, ta.Session]:
    """An arm and readings that contradict it."""
    arm, session = ta.load_arm("ur10"), SESSION
    if name == "sign":
        return arm, replace(session, angles=session.angles * [1, 1, 1, -1, 1, 1])
    if name == "unit":
        return arm, replace(session, points=session.points * 25.4)
    if name == "far point":
        far = session.points.copy()
        far[3] += 1e5
        return arm, replace(session, points=far)
    if name == "stated uncertainty":
        return arm, replace(session, point_std=np.full((30, 3), 50.0))
    if name == "limits":
        return arm, replace(session, angles=session.angles + [0, 0, 4 * np.pi, 0, 0, 0])
    assert name == "serial number"
    return replace(arm, serial_number="2"), replace(session, serial_number=np.full(30, "1"))


@pytest.fixture(scope="module")
def mistaken() -> ta.KinematicModel:
    """Accepted with a wrong sign."""
    return ta.fit(*contradicted("sign"), model="kinematic", accept=WHY).model


CASES = ("sign", "unit", "far point", "stated uncertainty", "limits", "serial number")


@pytest.mark.parametrize("name", CASES)
def test_a_judgement_is_refused_without_a_reason_and_done_with_one(name, tmp_path):
    arm, session = contradicted(name)
    with pytest.raises(Contradiction, match="--accept REASON"):
        ta.fit(arm, session, model="nominal")
    result = ta.fit(arm, session, model="nominal", accept=WHY)
    (one,) = result.model.accepted_
    assert one.reason == WHY
    assert one.contradictions
    assert result.remarks[0] == f"Accepted ({WHY}): {'; '.join(one.contradictions)}."
    assert result.to_dict()["accepted"] == [{"reason": WHY, "contradictions": list(one.contradictions)}]
    result.save(tmp_path / "m.truearm")
    assert ta.load_model(tmp_path / "m.truearm").accepted_ == (one,)


def test_what_was_accepted_in_a_fit_and_in_a_transfer_stays_with_the_model(mistaken):
    moved = ta.refit(mistaken, contradicted("sign")[1], accept="another reason").model
    assert moved.accepted_[0] == mistaken.accepted_[0]
    with ta.accepting("of the block"):
        of_class = ta.NominalModel(ta.load_arm("ur10")).fit_readings(contradicted("sign")[1])
    assert [one.reason for one in of_class.accepted_] == ["of the block"]


def test_a_reason_with_nothing_to_accept_changes_nothing():
    plain, harmless = (ta.fit("ur10", SESSION, model="kinematic", accept=accept) for accept in (None, WHY))
    assert harmless.remarks[0] == "Nothing had to be accepted."
    assert harmless.model.accepted_ == ()
    assert np.array_equal(harmless.model.fit_.coefficients, plain.model.fit_.coefficients)
    assert plain.remarks == harmless.remarks[1:]


@pytest.mark.parametrize("reason", ["", "  ", "two\nlines", "x" * (MAX_TEXT + 1), 3])
def test_a_reason_is_one_line_of_words(reason):
    refuses("expected a reason", ta.fit, "ur10", SESSION, model="nominal", accept=reason)


def test_what_cannot_be_calculated_has_no_override():
    still = replace(SESSION, angles=np.tile(SESSION.angles[0], (30, 1)))
    for arm, session, options in (
        (ta.load_arm("ur5"), ta.Session(SESSION.angles[:, :5], SESSION.points), {}),
        (ta.load_arm("ur10"), still, {}),
        (ta.load_arm("ur10"), SESSION, {"model": "best"}),
        (ta.load_arm("ur10"), SESSION, {"free": ["joints"]}),
    ):
        refused = refuses(None, ta.fit, arm, session, accept=WHY, **{"model": "nominal", **options})
        assert not isinstance(refused, Contradiction)


def test_judgements_of_using_a_model_are_overridden_too():
    arm, session = contradicted("serial number")
    model = ta.fit(arm, replace(session, serial_number=None), model="nominal").model
    for verb in (ta.evaluate, ta.predict, ta.report):
        with pytest.raises(Contradiction, match="serial number"):
            verb(model, session)
        assert verb(model, session, accept=WHY).remarks[0].startswith(f"Accepted ({WHY}): the readings are of the arm")
        assert verb(model, replace(session, serial_number=None), accept=WHY).remarks[0] == "Nothing had to be accepted."
    assert model.accepted_ == ()
    assert f"Accepted ({WHY})" in render(ta.report(model, session, accept=WHY).page())


def test_pages_of_an_accepted_model_state_the_reason(mistaken):
    model, session = mistaken, contradicted("sign")[1]
    stated = f"When the model was fitted: {model.accepted_[0]}"
    for result in (ta.evaluate(model, session), ta.predict(model, session)):
        assert stated in result.remarks
        assert stated in result.to_dict()["remarks"]
    assert stated in ta.correct(model, session.angles[:1], untrained="accept").to_dict()["remarks"]
    compared = ta.compare(model, ta.fit(ta.load_arm("ur10"), SESSION, model="kinematic").model)
    assert stated.replace("the model", "the old model") in compared.remarks
    task = ta.task(model, "length", 300, n_arms=100)
    assert stated in task.remarks
    assert WHY in render(ta.report(model, session).page())
    assert WHY in render(task.page())


@pytest.mark.parametrize(
    "name", ["arm.json", "arm.urdf", *(pytest.param(one, marks=pytest.mark.weekly) for one in ("arm.c", "arm.mjs"))]
)
def test_exports_of_an_accepted_model_state_the_reason(mistaken, name, tmp_path):
    exported = ta.export(mistaken, tmp_path / name)
    assert exported.manifest.provenance.accepted == mistaken.accepted_
    assert f"When the model was fitted: {mistaken.accepted_[0]}" in str(exported)
    assert ta.check_export(mistaken, tmp_path / name).agrees


def test_an_interim_check_and_its_page_state_the_reason(tmp_path):
    readings = ta.simulate("gao2017", poses=30, preset="perfect").session
    arm = replace(ta.load_arm("gao2017"), serial_number="2")
    model = ta.NominalModel(arm).fit_readings(replace(readings, serial_number=None))
    in_seats = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, preset="perfect", seed=1).session
    with pytest.raises(Contradiction, match="--accept REASON"):
        ta.check(model, in_seats, tmp_path / "a.sqlite")
    result = ta.check(model, in_seats, tmp_path / "a.sqlite", accept=WHY)
    assert f"Accepted ({WHY})" in str(result)
    assert f"Accepted ({WHY})" in render(result.page())
    assert str(result).count(WHY) == 1
    later = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, preset="perfect", seed=2).session
    result = ta.check(model, replace(later, serial_number=None), tmp_path / "a.sqlite")
    (said,) = result.record.checks[0].accepted
    assert f"Check 1 of {result.record.checks[0].date:%Y-%m-%d %H:%M}: {said}" in result.remarks
    assert WHY in render(result.page())


def test_readings_of_two_arms_are_filled_in_with_the_reason(tmp_path):
    model = ta.fit("ur10", replace(SESSION, serial_number=None), model="nominal").model
    two = replace(SESSION.rows(np.array([0, 0])), serial_number=np.array(["1", "2"]))
    with pytest.raises(Contradiction, match="readings of one arm"):
        ta.predict(model, two)
    prediction = ta.predict(model, two, accept=WHY)
    assert prediction.serial_number == "1"
    few = ta.load_verification_plan("asme-b89.4.22").model_copy(update={"effective_diameter": None, "volumetric": None})
    ta.operator_sheet(few).save_points(tmp_path / "points.csv", tip_diameter_mm=6)
    lines = (tmp_path / "points.csv").read_text().splitlines(keepends=True)
    (tmp_path / "points.csv").write_text("".join(lines[:3]))
    assert ta.fill_points(prediction, tmp_path / "points.csv", artefact_degC=20) == 2
    assert WHY in (tmp_path / "points.csv").read_text()


def test_a_plan_from_contradicted_readings_states_the_reason():
    arm, session = contradicted("limits")
    few = session.rows(slice(0, 6))
    options = {"artefact": "tracker", "poses": 3, "terms": "constants", "session": few}
    with pytest.raises(Contradiction, match="--accept REASON"):
        ta.plan(arm, **options)
    plan = ta.plan(arm, **options, accept=WHY)
    assert plan.to_dict()["accepted"] == list(plan.accepted)
    assert f"Accepted ({WHY})" in str(plan)
    assert f"Accepted ({WHY})" in render(plan.page())


def test_points_of_an_accepted_arm_say_so_in_their_verification(tmp_path):
    plan = ta.load_verification_plan("asme-b89.4.22")
    few = plan.model_copy(update={"effective_diameter": None, "volumetric": None})
    sheet = ta.operator_sheet(few)
    sheet.save_points(tmp_path / "points.csv", tip_diameter_mm=6)
    made = ta.rehearse(
        "measuring7", tmp_path / "points.csv", artefacts=sheet.sheet.artefacts, preset="shop", arm_seed=1
    )
    arm = replace(ta.load_arm("measuring7"), serial_number="2")
    model = ta.fit(arm, replace(ta.simulate("measuring7", poses=30).session, serial_number=None), model="nominal").model
    ta.fill_points(ta.predict(model, made.session, accept=WHY), tmp_path / "points.csv", artefact_degC=20)
    (said,) = ta.read_points(tmp_path / "points.csv").accepted
    assert said.startswith(f"Accepted ({WHY}): the readings are of the arm with serial number")
    simulated = ta.simulate_verification("perfect", n_arms=1)
    points = replace(simulated.points(0), accepted=(said,))
    result = ta.verify(points, artefacts=simulated.artefacts, specification=simulated.specification)
    assert said.removesuffix(".") in result.verification.remarks
    cut = replace(points, accepted=(str(Acceptance(WHY, ("the readings are...",))),))
    result = ta.verify(cut, artefacts=simulated.artefacts, specification=simulated.specification)
    assert f"Accepted ({WHY}): the readings are..." in result.verification.remarks
    assert WHY in render(result.page())


def test_blocks_nest_and_end():
    with accepting("outer"):
        contradict(InputError("first"))
        with accepting(None):
            contradict(InputError("second"))
        with accepting("inner"):
            contradict(InputError("third"))
            assert accepted() == (Acceptance("inner", ("third",)),)
        contradict(InputError("first"))
        before = (Acceptance("outer", ("zeroth",)), Acceptance("before", ("x",)))
        assert accepted(before) == (Acceptance("outer", ("zeroth", "first", "second")), before[1])
    assert accepted() == ()
    with pytest.raises(Contradiction) as refused:
        contradict(InputError("word " * 100, hint="try", line=3, file="a.csv"))
    assert refused.value.hint == "try"
    assert isinstance(refused.value.in_file("b.csv").with_hint("other"), Contradiction)
    with accepting("long"):
        contradict(refused.value)
        assert len(accepted()[0].contradictions[0]) == MAX_TEXT


def test_a_second_fit_in_a_block_has_none_of_the_first_ones_contradictions():
    with ta.accepting(WHY):
        first = ta.NominalModel(ta.load_arm("ur10")).fit_readings(contradicted("unit")[1])
        second = ta.NominalModel(ta.load_arm("ur10")).fit_readings(SESSION)
        verb = ta.fit("ur10", SESSION, model="nominal").model
        assert accepted() == first.accepted_  # the block has them all
    assert len(first.accepted_) == 1
    assert second.accepted_ == verb.accepted_ == ()


def test_several_contradictions_name_the_way_once():
    """With the last of them; faults that have no override do not name it."""

    @accepts
    def verb(faults):
        raise SeveralFaults(faults)

    two = [Contradiction("first"), Contradiction("second", hint="try")]
    with pytest.raises(SeveralFaults) as refused:
        verb([*two, InputError("third")])
    assert [fault.hint for fault in refused.value.faults] == [None, f"try; {OVERRIDE}", None]
    with pytest.raises(SeveralFaults) as refused:
        verb([InputError("first"), InputError("second")])
    assert OVERRIDE not in str(refused.value)
