"""Every public result that is a table has it as a DataFrame."""

import numpy as np
import pytest

import truearm as ta
from frame_laws import check_frame
from truearm.verbs.record import Record, TableRecord

# Their answer is sentences, a page, a file or a session; what they have as a table is in the object that is named.
NOT_TABLES = {
    "ArtefactsFromCertificate": "a file to complete",
    "BoardSheet": "a sheet to print",
    "CertificateResult": "a certificate; its values are those of `verify`",
    "CornersResult": "corners; their table is `pixels`",
    "CorrectedProgram": "a program; its targets are those of `difference`",
    "ExportResult": "a file",
    "FitResult": "a model",
    "HandEyeResult": "transforms",
    "ImageFit": "transforms and a model",
    "ImageSimulation": "images and a session, which has `to_frame`",
    "OperatorSheetResult": "a form to fill in",
    "PublishedReadings": "a session, which has `to_frame`",
    "ReadCertificate": "a certificate",
    "RefitResult": "a model",
    "SimulationResult": "a session, which has `to_frame`",
    "SourceTrial": "what one source sends",
    "WithdrawalResult": "an entry of a history",
}
# Made in the tests of the paper and of a fleet, where there are results of them.
ELSEWHERE = {"FleetRun", "FleetStatus", "LearnedTypePrior", "ReproductionResult"}


def public_records() -> dict[str, type]:
    public = {name: getattr(ta, name) for name in ta.__all__}
    return {name: one for name, one in public.items() if isinstance(one, type) and issubclass(one, Record)}


@pytest.fixture(scope="module")
def simulated():
    return ta.simulate_verification("shop", n_arms=2, seed=1)


def circle_arm():
    """Each joint of a UR10 moved over 80 degrees, seen from a target on its flange."""
    arm, turns = ta.load_arm("ur10"), np.radians(np.linspace(-40, 40, 12))
    angles = np.tile(arm.working, (72, 1))
    for joint in range(6):
        angles[12 * joint : 12 * joint + 12, joint] += turns
    return ta.arm_from_circles(
        ta.Session(angles, arm.chain.tip_in_base(angles) + arm.forward(angles).R_base_tip @ [100.0, 0.0, 50.0])
    )


@pytest.fixture(scope="module")
def tables(ur10_session, ur10_model, simulated, quick_plans, tmp_path_factory):
    """A result of every kind, and the number of its rows."""
    folder = tmp_path_factory.mktemp("tables")
    in_seats = ta.simulate("ur10", poses=8, strategy="seat", seats=2, seed=3).session
    verified = ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)
    change = ta.compare(ur10_model, ta.fit("ur10", ur10_session, model="nominal").model)
    checked = ta.check(ur10_model, in_seats, folder / "history.sqlite")
    ends = ta.Session(ur10_session.angles[:2], seat=["A", "B"])
    measured = ta.measure(ur10_model, ends, "length", n_arms=100)
    ta.export(ur10_model, folder / "arm.urdf")
    exported = ta.check_export(ur10_model, folder / "arm.urdf")
    diagnosis = ta.diagnose("ur10", ur10_session)
    found = ta.reproduce(readings=ur10_session, hidden=((2,), (3,)), epochs=3, folds=2, folder=folder / "paper")
    sources = ta.list_sources()
    return {
        "Prediction": (ta.predict(ur10_model, ur10_session), 60),
        "CorrectedTargets": (ta.correct(ur10_model, ur10_session.angles[:5]), 5),
        "Evaluation": (ta.evaluate(ur10_model, ur10_session), 2),
        "ModelChange": (change, len(change.constants)),
        "VerificationResult": (verified, len(verified.rows)),
        "SimulatedVerification": (simulated, len(simulated.rows)),
        "TaskResult": (ta.task(ur10_model, "length", 300, n_arms=100), 1),
        "MeasuredFeatures": (measured, len(measured.features[0].quantities)),
        "CheckResult": (checked, len(checked.assessment.trends)),
        "CheckPlan": (ta.plan_check("measuring7", length_mm=400), 18),
        "ImagePlan": (ta.plan_images("ur5", poses=6), 6),
        "PlanResult": (ta.plan("gao2017", "seat", poses=6, seats=2, terms="constants"), 6),
        "ExportCheck": (exported, len(exported.findings)),
        "Diagnosis": (diagnosis, 1),
        "ProcedureResult": (found, len(found.results.errors)),
        "SourceList": (sources, len(sources.missing)),
        "CircleArm": (circle_arm(), 6),
        "CirclesPlan": (ta.plan_circles(6), 4),
        "ReportResult": (ta.report(ur10_model, ur10_session), 2),
    }


def test_every_public_result_is_a_table_or_is_said_not_to_be():
    records = public_records()
    tables = {name for name, one in records.items() if issubclass(one, TableRecord)}
    assert tables | NOT_TABLES.keys() == records.keys()
    assert not tables & NOT_TABLES.keys()


def test_a_table_has_a_row_for_each_line_and_the_unit_of_each_number(tables):
    records = {name for name, one in public_records().items() if issubclass(one, TableRecord)}
    assert tables.keys() == records - ELSEWHERE
    for name, (result, n_rows) in tables.items():
        assert type(result).__name__ == name
        check_frame(result, n_rows)


def test_numbers_of_a_frame_are_those_of_the_result(tables, ur10_model, ur10_session):
    evaluation = tables["Evaluation"][0]
    by_arm = evaluation.to_frame().set_index("arm")
    for name, errors in evaluation.errors.items():
        assert by_arm.loc[name, "mean_mm"] == errors["mean_mm"]
    values = tables["VerificationResult"][0]
    np.testing.assert_array_equal(values.to_frame()["value"], [row.value for row in values.rows])
    plan = tables["PlanResult"][0]
    angles = plan.to_frame()[[f"q{i}_deg" for i in range(1, 7)]]
    # A degree and back: a rounding of the last bit.
    np.testing.assert_allclose(np.radians(angles), plan.poses.angles, rtol=1e-15)
