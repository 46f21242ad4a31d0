"""Laws of the records of plan, verify, task, certificate, check, report: one result for both doors."""

import json
from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from confirmed_plan import confirmed
from refusals import refuses
from truearm.verbs.record import Record
from truearm.wings.laboratory.certificate.certificate import check_plan
from truearm.wings.laboratory.standards.coordinate_origin import ARM_SOFTWARE, CoordinateOrigin

pytestmark = pytest.mark.usefixtures("undrawn", "quick_plans")


@pytest.fixture(scope="module")
def simulated():
    return ta.simulate_verification("shop", n_arms=2, seed=1)


@pytest.fixture(scope="module")
def verification(simulated):
    return ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)


@pytest.fixture(scope="module")
def model_and_session():
    train, test = (ta.simulate("gao2017", poses=60, seed=seed).session for seed in (1, 2))
    return ta.KinematicModel(ta.load_arm("gao2017"), free=()).fit_readings(train), test


@pytest.fixture(scope="module")
def records(simulated, verification, model_and_session, tmp_path_factory) -> dict[str, Record]:
    model, session = model_and_session
    in_seats = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, seed=3).session
    history = tmp_path_factory.mktemp("history") / "arm.sqlite"
    return {
        "plan": ta.plan("gao2017", "seat", poses=6, seats=2, terms="constants"),
        "simulate_verification": simulated,
        "verify": verification,
        "operator_sheet": ta.operator_sheet("iso10360-12"),
        "task": ta.task(model, "length", 300, tolerance_mm=0.2, n_arms=100),
        "report": ta.report({"mine": model}, session),
        "check": ta.check(model, in_seats, history),
    }


def test_simulated_points_never_decide_conformity(simulated):
    plan = confirmed(simulated.plan, max(one.date for one in simulated.artefacts.all))
    of = {"artefacts": simulated.artefacts, "specification": simulated.specification}
    result = ta.verify(simulated.points(0), plan=plan, **of)
    assert result.verdict.value == "not for conformity decisions"
    assert str(result).startswith("Not for conformity decisions: the points are simulated")
    assert result.to_dict()["coordinates"]["from"] == "virtual arm"
    refuses(r"no certificate: the points are simulated: no arm was measured", check_plan, result.verification)


def test_points_with_the_serial_number_of_a_virtual_arm_never_decide_conformity(simulated):
    arm = ta.VirtualArm.draw(ta.load_arm("measuring7"), "shop", seed=0)
    measured = replace(simulated.points(0), serial_number=arm.serial_number, origin=CoordinateOrigin(ARM_SOFTWARE))
    plan = confirmed(simulated.plan, max(one.date for one in simulated.artefacts.all))
    of = {"artefacts": simulated.artefacts, "specification": simulated.specification}
    result = ta.verify(measured, plan=plan, **of)
    said = f"the serial number {arm.serial_number!r} of the points is that of a virtual arm: no arm was measured"
    assert result.verdict.value == "not for conformity decisions"
    assert str(result).startswith(f"Not for conformity decisions: {said.partition(': ')[0]}.")
    refuses(rf"no certificate: {said}. Try: measure the arm", check_plan, result.verification)
    assert "not confirmed" in (ta.verify(measured, **of).verification.gap or "")  # what the plan lacks comes first
    real = ta.verify(replace(measured, serial_number="A-77"), plan=plan, **of)
    assert real.verification.gap is None


VERBS = ("plan", "simulate_verification", "verify", "operator_sheet", "task", "report", "check")


@pytest.mark.parametrize("verb", VERBS)
def test_a_record_reads_as_text_as_html_and_as_json(records, verb):
    record = records[verb]
    assert str(record).splitlines()
    assert repr(record).startswith(f"<{type(record).__name__}: ")
    assert "<p>" in record._repr_html_()
    assert json.loads(json.dumps(record.to_dict(), allow_nan=False)) == record.to_dict()


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != "simulate_verification"])
def test_a_page_is_written_whole_under_a_page_s_name(records, verb, tmp_path):
    records[verb].save_page(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    refuses("ends in .html", records[verb].save_page, tmp_path / "page.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_page_is_not_written_over_an_input_file(model_and_session, tmp_path):
    model, session = model_and_session
    file = tmp_path / "model.html"
    model.save(file)
    before = file.read_bytes()
    refuses("is an input file", ta.report, file, session, file)
    refuses("is an input file", ta.task(file, "length", 300, n_arms=100).save_page, file)
    assert file.read_bytes() == before


def test_a_page_is_not_written_to_links_that_form_a_loop(model_and_session, tmp_path):
    model, session = model_and_session
    page, file = tmp_path / "loop.html", tmp_path / "model.truearm"
    model.save(file)
    page.symlink_to(page)
    refuses("leads back to itself", ta.report, file, session, page)
    assert page.is_symlink()


def test_paths_and_objects_give_the_same_result(model_and_session, tmp_path):
    model, _ = model_and_session
    file = tmp_path / "model.truearm"
    model.save(file)
    objects, paths = (ta.task(given, "length", 300, n_arms=100, seed=4) for given in (model, file))
    assert objects.to_dict()["quantities"] == paths.to_dict()["quantities"]
    in_seats = ta.simulate("gao2017", poses=8, strategy="seat", seats=2, seed=3).session
    for given in (model, file):  # the same model: its second check of this session is its first
        result = ta.check(given, in_seats, tmp_path / "history.sqlite", date="2026-01-05")
    assert (result.record.added, len(result.record.checks)) == (False, 1)


def test_a_plan_saves_a_session_to_fill_in_and_never_over_a_file(records, tmp_path):
    (session,) = records["plan"].save(tmp_path / "plan.csv")
    assert session.read_text().count("\n") == 7
    refuses("another name", records["plan"].save, tmp_path / "plan.csv")
    files = ta.plan("gao2017", "bar", poses=8, seats=1, length_mm=250, terms="constants").save(tmp_path / "bar.csv")
    assert [file.name for file in files] == ["bar.csv", "bar-lengths.csv"]


def test_the_points_of_a_simulated_arm_verify_as_the_simulation_did(simulated, verification):
    assert verification.verification.verdict is simulated.verifications[0].verdict
    assert [row.value for row in verification.rows] == [row.value for row in simulated.verifications[0].rows]


def test_a_task_takes_a_preset_a_specification_or_a_model(simulated, model_and_session):
    limits = simulated.specification
    for source, what in ((limits, limits.name), (model_and_session[0], "a model of 60 readings"), ("shop", "shop")):
        assert what in ta.task(source, "length", 300, n_arms=100).source


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: ta.task("ur10", "length", 300), "got the arm 'ur10'"),
        (lambda: ta.task("shop", "torus", 300), "expected a feature out of"),
        (lambda: ta.task("shop", "sphere", 25, along=(0, 0, 1)), "does not apply to a sphere"),
        (lambda: ta.plan("gao2017", "tracker", volume=(1, 2, 3)), "five numbers"),
        (lambda: ta.reproduce("gao2018"), "there is no paper"),
        (lambda: ta.reproduce(table=2, figure=1), "got both"),
        (lambda: ta.report([], "s.csv"), "one or more models"),
    ],
)
def test_what_does_not_fit_is_refused(call, said):
    refuses(said, call)


def test_the_figure_of_a_record_is_saved_and_its_absence_is_said(records, model_and_session, tmp_path):
    records["task"].save_figure(tmp_path / "task.svg")
    assert (tmp_path / "task.svg").read_text(encoding="utf-8").startswith("<?xml")
    refuses("a Prediction has no figure", ta.predict(*model_and_session).save_figure, tmp_path / "none.svg")
    with pytest.raises(ta.InputError, match=r"expected the ending \.svg, \.pdf, \.png, got '\.eps'"):
        records["report"].save_figures(tmp_path / "figures", ending=".eps")
    assert not (tmp_path / "figures").exists()


@pytest.mark.parametrize(("n", "is_few"), [(1, True), (3, True), (10, False)])
def test_an_evaluation_on_few_readings_says_that_they_show_nothing(n, is_few):
    session = ta.simulate("ur10", poses=50, seed=1).session
    model = ta.fit("ur10", session.rows(np.arange(40)), model="nominal").model
    said = ta.evaluate(model, session.rows(np.arange(40, 40 + n))).summary()
    assert f" on {n} reading{'s' * (n > 1)}" in said
    assert ("So few readings show nothing" in said) == is_few
