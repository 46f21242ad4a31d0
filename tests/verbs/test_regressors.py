"""A regressor of the user's own in evaluate and report: the errors of any model, and nothing claimed beyond them."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sklearn.ensemble import RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

import truearm as ta
from page_transcripts import block
from refusals import refuses
from truearm.pages.html import render
from truearm.readings import Lengths
from truearm.verbs.record import to_plain

pytestmark = pytest.mark.usefixtures("undrawn")


class Same:
    """Predicts what a model of truearm predicts, and changes the array that it was given."""

    def __init__(self, model):
        self.model = model

    def predict(self, angles):
        points = self.model.predict(angles)
        angles *= 0
        return points


class Returns:
    """Predicts what it is given."""

    def __init__(self, points):
        self.points = points

    def predict(self, angles):
        del angles
        return self.points


@pytest.fixture(scope="module")
def readings():
    train, test = (ta.simulate("gao2017", poses=60, seed=seed).session for seed in (1, 2))
    return train, test


@pytest.fixture(scope="module")
def model(readings):
    return ta.KinematicModel(ta.load_arm("gao2017"), free=()).fit_readings(readings[0])


@pytest.fixture(scope="module")
def in_seats():
    return ta.simulate("gao2017", poses=12, strategy="seat", seats=2, seed=3).session


def without_points(session):
    return replace(session, points=None, point_std=None)


def nine_digits(errors):
    """Plain data without the last bits, which may hang on where numbers lie in memory."""
    return json.loads(json.dumps(to_plain(errors)), parse_float=lambda number: f"{float(number):.9g}")


# The same errors ------------------------------------------------------------------------------------------------------


def test_the_same_points_have_the_same_errors(readings, model):
    before = readings[1].angles.copy()
    own, of_model = (ta.evaluate(one, readings[1]) for one in (Same(model), model))
    expected = dict(of_model.errors["model"])
    del expected["removed_percent"]  # of a nominal arm, which a regressor has not
    assert nine_digits(own.errors) == nine_digits({"model": expected})
    assert (own.coverage, own.coverage_99, own.outliers, own.n_training) == (None, None, (), 0)
    assert re.fullmatch(r"Mean error \S+ mm on 60 readings\.", own.summary())
    assert own.to_dict()["nominal"] is None
    assert ta.evaluate(Same(model), readings[1], accept="not needed").remarks[0] == "Nothing had to be accepted."
    assert "<table" in own._repr_html_()
    np.testing.assert_array_equal(readings[1].angles, before)


def test_the_same_points_have_the_same_errors_in_seats_and_of_lengths(in_seats, model):
    a, b = sorted(set(in_seats.seat))
    lengths = Lengths([a], [b], [300.0], [0.01])
    for session in (in_seats, without_points(in_seats)):
        own, of_model = (ta.evaluate(one, session, lengths=lengths) for one in (Same(model), model))
        expected = {key: value for key, value in of_model.errors["model"].items() if key != "removed_percent"}
        assert nine_digits(own.errors["model"]) == nine_digits(expected)
        assert "lengths" in expected
    vague = Lengths([a, "c"], [b, "d"], [300.0, 300.0], [50.0, 50.0])
    said = " ".join(ta.evaluate(model, in_seats, lengths=vague).remarks)
    assert "50 mm, is 16.7% of it (and 1 more length with such an uncertainty)" in said


def test_the_same_points_have_the_same_row_on_a_page(readings, in_seats, model):
    for session in (readings[1], without_points(in_seats)):
        result = ta.report({"same": Same(model), "kinematic": model}, session)
        assert list(result.errors) == ["nominal", "kinematic", "same"]
        assert nine_digits(result.errors["same"]) == nine_digits(result.errors["kinematic"])
        assert "2 models compared" in str(result)
    compared = ta.report({"same": Same(model), "kinematic": model}, readings[1]).comparison
    assert nine_digits(compared.errors["same"]) == nine_digits(compared.errors["kinematic"])
    assert compared.errors["same"]["removed_percent"] > 50
    alone = ta.report(model, readings[1]).comparison
    assert nine_digits({name: compared.errors[name] for name in alone.errors}) == nine_digits(alone.errors)


# Real regressors ------------------------------------------------------------------------------------------------------


def test_a_pipeline_of_scikit_learn(readings, model):
    train, test = readings
    pipeline = make_pipeline(StandardScaler(), PolynomialFeatures(2), LinearRegression()).fit(
        train.angles, train.points
    )
    found = ta.evaluate(pipeline, test)
    distances = np.linalg.norm(pipeline.predict(test.angles) - test.points, axis=1)
    assert found.errors["model"]["mean_mm"] == pytest.approx(distances.mean(), rel=1e-12)
    assert ta.report([model, pipeline], test).errors["Pipeline"]["max_mm"] == pytest.approx(distances.max(), rel=1e-12)


def test_a_regressor_fitted_to_a_frame_gets_the_columns_it_knows(readings):
    train, test = readings
    angles = [f"q{joint}_deg" for joint in range(1, 7)][::-1]
    of_frame = LinearRegression().fit(train.to_frame()[angles], train.to_frame()[["x_mm", "y_mm", "z_mm"]])
    of_arrays = LinearRegression().fit(train.angles, train.points)
    errors = [ta.evaluate(one, test).errors["model"]["mean_mm"] for one in (of_frame, of_arrays)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)
    unknown = LinearRegression().fit(pd.DataFrame(train.angles, columns=list("abcdef")), train.points)
    error = refuses("the session lacks a column LinearRegression was fitted to", ta.evaluate, unknown, test)
    assert error.column == "a"
    assert "fit(train.angles, train.points)" in error.hint


def test_regressors_of_a_list_have_the_names_of_their_classes(readings, model):
    forests = [
        RandomForestRegressor(2, random_state=seed).fit(readings[0].angles, readings[0].points) for seed in range(2)
    ]
    names = ["nominal", "kinematic", "RandomForestRegressor 1", "RandomForestRegressor 3", "Same"]
    assert list(ta.report([forests[0], model, forests[1], Same(model)], readings[1]).errors) == names


# What nobody knows of it ----------------------------------------------------------------------------------------------


def test_a_page_says_what_it_does_not_know_and_escapes_the_name(readings, model):
    best = Returns(readings[1].points)
    result = ta.report({"kinematic": model, "best <b>&": best}, readings[1])
    page = result.page()
    assert page.verdict.state == "doubtful"
    assert "best <b>&: This regressor of the user's own" in page.verdict.detail
    assert "does not know its training readings" in page.verdict.detail
    (fact,) = (text for name, text in page.facts if name == "regressor best <b>&")
    assert "Returns) states no uncertainty" in fact
    assert any(remark.startswith("best <b>&: This regressor") for remark in result.remarks)
    html = render(page)
    assert "best &lt;b&gt;&amp;" in html
    assert "best <b>" not in html
    # A regressor that is not the best takes nothing from the verdict on the model.
    assert (
        ta.report({"kinematic": model, "b": Returns(readings[1].points + 9)}, readings[1]).page().verdict.state
        == "good"
    )


def test_a_page_in_seats_shows_it_too(in_seats, model):
    page = ta.report({"kinematic": model, "mine": Same(model)}, without_points(in_seats)).page()
    assert "mine: This regressor of the user&#39;s own" in render(page)


# Bad input ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (np.zeros(60), "expected x y z in mm from Returns, shape (60, 3), got (60,)"),
        (np.zeros((59, 3)), "got (59, 3)"),
        ((np.zeros((60, 3)), np.zeros((60, 3))), "got (2, 60, 3)"),
        (None, "got ()"),
        ({}, "Returns cannot predict these readings"),
        ([[1, 2, 3]] * 59 + [[1, 2]], "Returns cannot predict these readings"),
        (np.full((60, 3), np.nan), "reading 1: expected a finite point from Returns"),
        (np.where(np.arange(60)[:, None] == 4, np.inf, np.zeros((60, 3))), "reading 5: expected a finite point"),
    ],
)
def test_what_is_no_point_for_every_reading_is_refused(readings, model, points, said):
    for call in (
        lambda: ta.evaluate(Returns(points), readings[1]),
        lambda: ta.report([model, Returns(points)], readings[1]),
    ):
        refuses(re.escape(said), call)


def test_an_error_of_a_page_has_the_name_that_the_user_gave(readings, model):
    refuses(r"from mine, shape \(60, 3\)", ta.report, {"a": model, "mine": Returns(np.zeros(60))}, readings[1])


def test_what_is_not_fitted_or_of_other_joints_is_refused(readings):
    with pytest.raises(
        ta.InputError, match="RandomForestRegressor cannot predict these readings: .* not fitted"
    ) as error:
        ta.evaluate(RandomForestRegressor(), readings[1])
    assert "fit(train.angles, train.points)" in error.value.hint
    five = LinearRegression().fit(readings[0].angles[:, :5], readings[0].points)
    refuses("6 features, but LinearRegression is expecting 5", ta.evaluate, five, readings[1])


def test_the_message_of_a_model_inside_is_its_own(readings, model):
    inside = Same(model)
    inside.predict = lambda angles: model.with_tip("N4").predict(angles)
    of_model = refuses(None, inside.predict, readings[1].angles)
    assert str(refuses(None, ta.evaluate, inside, readings[1])) == str(of_model)


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        (GaussianProcessRegressor, "expected a model, got the class GaussianProcessRegressor"),
        (ta.KinematicModel, "expected a model, got the class KinematicModel"),
        (StandardScaler(), "expected a model, got StandardScaler"),
        (3, "expected a model, got int"),
    ],
)
def test_what_cannot_predict_is_refused(readings, model, thing, said):
    for call in (
        lambda: ta.evaluate(thing, readings[1]),
        lambda: ta.report(thing, readings[1]),
        lambda: ta.report([model, thing], readings[1]),
        lambda: ta.report({"a": thing, "b": model}, readings[1]),
    ):
        error = refuses(said, call)
        assert "a fitted model or a model file" in error.hint
        assert "predict(angles)" in error.hint


def test_a_report_needs_a_model_that_knows_the_arm(readings, model):
    error = refuses("at least one model of truearm", ta.report, Same(model), readings[1])
    assert 'ta.fit(arm, train, model="nominal").model' in error.hint
    nominal = ta.NominalModel(model.arm, free=()).fit_readings(readings[0])
    assert list(ta.report([nominal, Same(model)], readings[1]).errors) == ["nominal", "Same"]


def test_no_model_takes_the_name_of_the_nominal_arm(readings, model):
    for models in ({"nominal": model}, {"a": model, "nominal": Same(model)}):
        refuses("'nominal' is the name of the nominal arm", ta.report, models, readings[1])


def test_a_session_without_references_is_refused(readings, model):
    refuses("expected reference points, seats or", ta.evaluate, Same(model), ta.Session(readings[1].angles))


def test_other_verbs_take_models_of_truearm_only(readings, model):
    refuses("expected a model, got Same", ta.predict, Same(model), readings[1])


# The page of the docs -------------------------------------------------------------------------------------------------


def test_the_example_of_the_docs_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said: list[object] = []
    exec(block("start/researcher.md", "python"), {"print": said.append})
    evaluation, report = said
    errors = {name: figures["mean_mm"] for name, figures in report.errors.items()}
    assert errors["kinematic + process"] == evaluation.errors["model"]["mean_mm"] < errors["nominal"] / 5
    assert [path.name for path in tmp_path.iterdir()] == ["comparison.html"]
