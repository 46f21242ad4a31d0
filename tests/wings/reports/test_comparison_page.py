"""The page that compares models: its verdict in words, and the readings as an interactive scene."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.models.uncertainty import UncertaintyBudget
from truearm.pages.drawings.arm_scene import arm_at_readings
from truearm.pages.html import render
from truearm.readings import Session, compare_errors
from truearm.wings.reports.comparison_page import (
    ModelComparison,
    comparison_page,
    comparison_verdict,
    improvement_sentence,
)


@pytest.fixture(scope="module")
def compared():
    """Errors of a nominal arm of 0.5 mm and of a model ten times better, with the arm that it found."""
    random = np.random.default_rng(0)
    arm = ta.load_arm("gao2017")
    angles = random.uniform(-1, 1, (40, 6))
    points = arm.chain.tip_in_base(angles)
    predicted = {name: points + random.normal(0, size, (40, 3)) for name, size in (("nominal", 0.3), ("model", 0.03))}
    return ModelComparison(
        angles=angles,
        points=points,
        predicted=predicted,
        errors={name: dict(compare_errors(one, predicted["nominal"], points)) for name, one in predicted.items()},
        joint_names=arm.joint_names,
        lower=arm.limits[:, 0],
        upper=arm.limits[:, 1],
        sliding=[False] * 6,
        mechanism=arm_at_readings({"model": ta.NominalModel(arm).fit(angles, points)}, Session(angles)),
    )


def budget(covered, expanded=0.06):
    return {"model": UncertaintyBudget(0.01, 0.02, expanded / 2, 0.04, False, n_points=40, n_covered=covered)}


@pytest.mark.parametrize(
    ("covered", "doubts", "state", "said"),
    [
        (38, {}, "good", "Expanded uncertainty of a coordinate by model: U = 0.060 mm (k = 2)"),
        (38, {"model": "training readings"}, "doubtful", "training readings"),
        (20, {}, "doubtful", "50\u202f% of the readings lie in the ellipsoids that should hold 95\u202f%"),
    ],
)
def test_the_verdict_says_what_accuracy_of_what_and_how_sure(compared, covered, doubts, state, said):
    verdict = comparison_verdict(compared, budget(covered), doubts=doubts)
    assert verdict.state == state
    assert said in verdict.detail
    assert verdict.sentence.startswith("Mean error 0.0")
    assert "times smaller than before" in verdict.sentence
    assert "of 40 readings are below" in verdict.sentence


def test_a_model_that_does_not_help_is_bad(compared):
    swapped = {"nominal": compared.errors["model"], "model": compared.errors["nominal"]}
    verdict = comparison_verdict(replace(compared, errors=swapped), {})
    assert verdict.state == "bad"
    assert "does not reduce" in verdict.sentence
    assert "Do not use this model" in verdict.detail


def test_an_error_that_falls_by_less_than_its_uncertainty_has_no_tick(compared):
    random = np.random.default_rng(3)
    step = random.normal(0, 0.3, (40, 3))
    predicted = {"nominal": compared.points + step, "model": compared.points + random.permutation(0.99 * step)}
    errors = {name: dict(compare_errors(one, predicted["nominal"], compared.points)) for name, one in predicted.items()}
    verdict = comparison_verdict(replace(compared, predicted=predicted, errors=errors), {})
    assert verdict.state == "doubtful"
    assert "does not fall by more than the uncertainty of that difference" in verdict.detail


def test_readings_whose_neighbours_err_alike_count_by_their_effective_number(compared):
    """A model that is no better, whose gains drift in runs of 25 readings: chance gives 2.5 % of ticks."""
    n, run, ticks = 800, 25, 0
    points = np.zeros((n, 3))
    for seed in range(60):
        random = np.random.default_rng(seed)
        drift = np.repeat(random.normal(0, 0.1, n // run), run) + random.normal(0, 0.02, n)
        before, after = points.copy(), points.copy()
        before[:, 0], after[:, 0] = 1.0 + drift, 1.0
        predicted = {"nominal": before, "model": after}
        errors = {name: dict(compare_errors(one, before, points)) for name, one in predicted.items()}
        one = replace(compared, predicted=predicted, errors=errors, points=points)
        ticks += comparison_verdict(one, {}).state == "good"
    assert ticks <= 6  # of 60 where independent readings would give some 20


def test_the_readings_are_a_scene_with_the_arm_and_their_uncertainty(compared):
    stated = replace(compared, std_mm={"model": np.full(40, 0.02)}, reading_names=[f"line {i}" for i in range(40)])
    page = comparison_page(stated, title="T", subtitle="", facts=[])
    (scene,) = page.sections[0].scenes
    assert scene.mechanism.follows == [0, 1, 2, 3, 4, 5]
    assert [column.name for column in scene.cloud.values] == ["error, nominal", "error, model"]
    assert scene.cloud.shown == 1
    assert [column.name for column in scene.cloud.notes] == ["u of a coordinate, model"]
    np.testing.assert_allclose(scene.cloud.axes[2].values, np.degrees(compared.angles[:, 2]))
    html = render(replace(page, sections=()))
    assert html.index("times smaller than before") < html.index("<h1>T</h1>")
    # What a reader does not need at once is folded.
    assert [section.title for section in page.sections if not section.folded] == [
        "Where the errors are",
        "Error before and after",
    ]


def test_readings_of_several_sessions_have_no_common_arm(compared):
    arm = ta.load_arm("gao2017")
    model = {"model": ta.NominalModel(arm).fit(compared.angles, compared.points)}
    two = Session(compared.angles, compared.points, session=np.repeat(["A", "B"], 20))
    assert arm_at_readings(model, two) is None
    assert arm_at_readings({}, two) is None


def test_an_error_that_hardly_falls_is_as_large_as_before():
    said = improvement_sentence("Mean error", 0.102, 0.1).replace("\N{NARROW NO-BREAK SPACE}", " ")
    assert said == "Mean error 0.100 mm, as large as before (0.102 mm)."
    assert "1.1 times smaller than before" in improvement_sentence("Mean error", 0.106, 0.1)
