"""The paper's procedure on readings of one's own, on tiny sets: choice, resuming, the 2-sigma sentence, refusals."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.arm.masses import LinkMasses
from truearm.compensation.models import NetworkModel
from truearm.compensation.models.arm_check import arm_of_readings
from truearm.compensation.nets.perceptron import Perceptron
from truearm.errors import InputError
from truearm.papers.gao2017.search import CoordinateErrors, SearchGrid, fold_rows
from truearm.papers.gao2017.training import LARGEST_FILE
from truearm.papers.gao2017.trials import NetworkSetting, Trial
from truearm.readings import Session

TINY = {"hidden": ((1,), (4,)), "epochs": 25, "folds": 2, "amount": (20,)}


@pytest.fixture(autouse=True)
def kinematic_only(monkeypatch):
    """Fits of the hybrid and the physical model take seconds, and their path is that of the kinematic one.

    A model of another name cannot be fitted, like one that the readings do not determine.
    """
    monkeypatch.setattr("truearm.workflows.procedure.MODELS", ("kinematic", "nothing"))


@pytest.fixture(scope="module")
def planted():
    """Readings that a network of four units has made, and as many fresh ones."""
    network = Perceptron.with_layers(3, (4,), 3, activation="tansig")
    rng = np.random.default_rng(5)
    weights = rng.normal(0, 1, network.n_weights)
    angles = rng.uniform(-1, 1, (160, 3))
    points = 100 * network.outputs(weights, angles.T).T + rng.normal(0, 1e-3, (160, 3))
    session = Session(angles, np.ascontiguousarray(points))
    return session.rows(np.arange(80)), session.rows(np.arange(80, 160))


@pytest.fixture(scope="module")
def measured():
    """Readings of an arm, and fresh ones."""
    session = ta.simulate("gao2017", poses=90, seed=2).session
    return session.rows(np.arange(60)), session.rows(np.arange(60, 90))


@pytest.fixture(scope="module")
def found(planted, tmp_path_factory):
    train, test = planted
    folder = tmp_path_factory.mktemp("own")
    return ta.reproduce(readings=train, test=test, folder=folder, **TINY), folder


def timeless(value):
    """Every number but times, which differ from run to run."""
    if isinstance(value, dict):
        return {key: timeless(item) for key, item in value.items() if key != "seconds"}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def test_the_search_finds_the_structure_that_made_the_readings(found):
    results = found[0].results
    assert results.chosen.setting.hidden == (4,)
    few, many = results.search
    assert few.errors.mean_mm > 100 * many.errors.mean_mm
    assert results.errors["network"].mean_mm < 0.01  # noise of 0.001 mm
    assert [row.n_train for row in results.amounts] == [20, 40]
    assert results.amounts[0].errors.mean_mm > results.amounts[1].errors.mean_mm


def test_without_an_arm_the_models_of_an_arm_are_missing_and_it_is_said(found):
    result = found[0]
    assert list(result.results.errors) == ["network"]
    assert result.results.best is None
    assert any("No arm is given" in remark and "truearm arms" in remark for remark in result.remarks)
    assert "on 80 fresh readings" in result.summary()
    assert result.page().verdict.state == "none"
    assert "still falls with the number of readings" in result.page().verdict.detail


def test_the_model_file_is_the_network_of_the_test(found, planted):
    result, folder = found
    files = {file.name for file in result.save(folder)}
    assert files == {"procedure.json", "procedure.html", "network.truearm", "figure-7.png", "figure-8.png"}
    model = ta.load_model(folder / "network.truearm")
    np.testing.assert_array_equal(model.predict_readings(planted[1]), result.results.predicted["network"])
    assert json.loads((folder / "procedure.json").read_text()) == json.loads(json.dumps(result.to_dict()))
    page = (folder / "procedure.html").read_text()
    assert "Figure 7 of the paper, of this arm" in page
    assert "Figure 6 of the paper" not in page


def test_an_interrupted_search_goes_on_and_trains_nothing_twice(found, planted, tmp_path, monkeypatch):
    train, test = planted
    trained, fit = [], NetworkModel.fit_readings

    def counted(self, readings, **options):
        model = fit(self, readings, **options)
        trained.append((self.hidden, self.seed, len(readings)))
        return model

    def interrupt(share, note):
        if len(trained) == 4 and "epoch 3" in note:
            raise KeyboardInterrupt

    monkeypatch.setattr(NetworkModel, "fit_readings", counted)
    with pytest.raises(KeyboardInterrupt):
        ta.reproduce(readings=train, test=test, folder=tmp_path, progress=interrupt, **TINY)
    assert len(list((tmp_path / "runs").glob("own-*.json"))) == 3  # and the network of one unit that guards
    assert not [file for file in (tmp_path / "runs").iterdir() if file.name.startswith(".")]
    again = ta.reproduce(readings=train, test=test, folder=tmp_path, **TINY)
    searched = [one for one in trained if one[0] != (1,) or one[2] != len(train)]
    assert len(searched) == len(set(searched)) == 7  # 2 networks and a smaller amount on 2 folds, and the last one
    assert timeless(again.to_dict()) == timeless(found[0].to_dict())


def test_other_readings_are_noticed(found, planted):
    train, test = planted
    moved = Session(train.angles, train.points + 1e-9)
    with pytest.raises(InputError, match=r"of other readings \(80 readings of no file\).*--out"):
        ta.reproduce(readings=moved, test=test, folder=found[1], **TINY)


def test_a_damaged_file_is_named(found, planted, tmp_path):
    train, test = planted
    shutil.copytree(found[1] / "runs", tmp_path / "runs")
    file = next((tmp_path / "runs").glob("own-1-*.json"))
    for content in ("{}", file.read_text().replace("predicted", "guessed"), "x" * (LARGEST_FILE + 1)):
        file.write_text(content)
        with pytest.raises(InputError, match=file.name):
            ta.reproduce(readings=train, test=test, folder=tmp_path, **TINY)


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A folder for the trainings on `measured`, which tests share."""
    return tmp_path_factory.mktemp("shared")


def test_beside_the_network_stand_the_models_of_the_arm(measured, shared):
    train, test = measured
    result = ta.reproduce(readings=train, test=test, arm="gao2017", folder=shared, **TINY)
    results = result.results
    assert list(results.errors) == ["nominal", "network", "kinematic"]
    kinematic = ta.fit("gao2017", train, model="kinematic").model.predict_readings(test)
    np.testing.assert_array_equal(results.predicted["kinematic"], kinematic)
    # With 60 readings a network is far worse than a kinematic model, and the first sentence says so.
    assert results.errors["network"].mean_mm > 10 * results.errors["kinematic"].mean_mm
    assert result.summary().endswith("times smaller: use the kinematic model.")
    assert str(result).startswith(result.summary())
    assert result.page().verdict.sentence == result.summary()
    assert "With 60 readings a network does not reach the kinematic model" in result.page().verdict.detail
    assert list(results.refused) == ["nothing"]
    assert "no nothing model: expected a model among" in str(result)
    assert "There is no nothing model" in result.page().sections[0].text
    captions = [figure.caption for section in result.page().sections for figure in section.figures]
    for number in (6, 7, 8):
        assert sum(caption.startswith(f"Figure {number} of the paper, of this arm") for caption in captions) == 1


def test_without_a_test_every_model_predicts_what_its_folds_held_out(measured, shared):
    train = measured[0]
    result = ta.reproduce(readings=train, arm="gao2017", folder=shared, **TINY)
    results = result.results
    assert not results.fresh
    assert "60 readings that the cross-validation held out" in result.summary()
    groups = np.arange(len(train))
    for rows in fold_rows(groups, 2, 0):
        others = train.rows(np.setdiff1d(groups, rows))
        kinematic = ta.fit("gao2017", others, model="kinematic").model.predict_readings(train.rows(rows))
        np.testing.assert_array_equal(results.predicted["kinematic"][rows], kinematic)


def test_another_arm_or_placement_is_another_trial(measured):
    train, test = measured
    arm = ta.load_arm("gao2017")
    trial = Trial("kinematic", train, test, arm, free=("base",))
    heavier = replace(arm, masses=LinkMasses(np.ones(6), np.zeros((6, 3))))
    others = [
        replace(trial, free=("base", "tip")),
        replace(trial, arm=heavier),
        replace(trial, what="physical"),
        replace(trial, train=train.rows(np.arange(50))),
        replace(trial, tested=test.rows(np.arange(20))),
    ]
    assert len({one.fingerprint for one in (trial, *others)}) == 6
    assert replace(trial).fingerprint == trial.fingerprint


def test_two_sigma_by_hand():
    # Six coordinates: 0.01, 0.06, 0.09 and three zeros.
    errors = CoordinateErrors.of(np.array([[0.01, -0.06, 0.09], [0, 0, 0]]))
    assert errors.n == 2
    assert errors.over_mm == {0.05: 2, 0.08: 1}
    assert errors.mean_mm == pytest.approx(0.16 / 6)
    assert errors.two_sigma_mm == pytest.approx(2 * np.sqrt((0.0001 + 0.0036 + 0.0081) / 6))  # 0.0887
    assert errors.mean_distance_mm == pytest.approx(np.sqrt(0.0118) / 2)
    sentence = errors.two_sigma_sentence()
    assert "Of 6 coordinates the network errs by more than 0.05 mm in 2 and by more than 0.08 mm in 1" in sentence
    assert "By count no: 66.7 % are within it" in sentence
    assert "By twice the root mean square error no: 0.0887 mm" in sentence


def test_two_sigma_of_the_paper_is_below_by_count():
    errors = np.full(600, 0.01)
    errors[:13], errors[:3] = 0.06, 0.085
    sentence = CoordinateErrors.of(errors.reshape(-1, 3)).two_sigma_sentence()
    assert "By count yes: 97.8 %" in sentence
    assert "root mean square error yes" in sentence


def test_the_grid_is_every_combination_and_networks_with_more_weights_than_coordinates_are_not_tried():
    grid = SearchGrid(hidden=((3,), (2, 2)), trainer=("varpro", "trainlm"), goal=(0.0, 4e-9))
    assert len(grid.settings(100, 6)) == 8
    # 800 readings, five folds: 1632 coordinates are fitted. 30-30 has 1233 weights, 40-40 has 2043.
    assert [one.hidden for one in SearchGrid().settings(800, 6)][-1] == (30, 30)
    assert NetworkSetting((30, 30)).n_weights(6) == 1233
    assert len(SearchGrid().settings(10, 6)) == 3
    assert SearchGrid(trainer=("traingd",), learning_rate=(0.1, 0.01)).settings(10, 6)[0].learning_rate == 0.1


def test_a_learning_rate_trains_by_gradient_descent_only(planted):
    with pytest.raises(InputError, match="belongs to gradient descent"):
        SearchGrid(trainer=("varpro", "traingd"), learning_rate=(0.1,))
    readings, arm = planted[0], arm_of_readings(planted[0])
    slow, fast = (
        NetworkSetting((2,), "traingd", learning_rate=rate, epochs=5).model(arm, seed=1).fit_readings(readings)
        for rate in (1e-3, 1e-1)
    )
    drops = [one.record_.perf[0] - one.record_.perf[1] for one in (slow, fast)]
    assert drops[1] / drops[0] == pytest.approx(100, rel=0.1)  # the first step is as long as the rate


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: Session(s.angles, None, seat=np.array(["A", "B"] * 30)), "no reading has a point"),
        (lambda s: s.rows(np.arange(3)), "expected|few"),
        (lambda s: Session(np.degrees(s.angles), s.points), "unit|rad"),
        (lambda s: Session(s.angles, s.points, session=np.array(["a", "b"] * 30)), "session"),
        (lambda s: Session(s.angles[:, :5], s.points), "joints|angles"),
    ],
)
def test_what_no_network_can_learn_is_refused_before_the_search(measured, tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        ta.reproduce(readings=change(measured[0]), arm="gao2017", folder=tmp_path, **TINY)
    assert not list(tmp_path.rglob("own-*"))


def test_a_test_with_training_readings_is_refused(measured, tmp_path):
    train, test = measured
    both = Session(np.vstack([test.angles, train.angles[:2]]), np.vstack([test.points, train.points[:2]]))
    with pytest.raises(InputError, match="2 of 32 test readings are training readings"):
        ta.reproduce(readings=train, test=both, folder=tmp_path, **TINY)


def test_options_of_the_other_use_are_refused(measured, tmp_path):
    with pytest.raises(InputError, match="need readings"):
        ta.reproduce(folder=tmp_path, hidden=((2,),), figure=3)
    with pytest.raises(InputError, match="paper's own arm"):
        ta.reproduce(readings=measured[0], folder=tmp_path, table=4)
    for impossible in ({"goal": (0.0, -1.0)}, {"trainer": ("varpro", "adam")}, {"hidden": ((2,), (0,))}, {"folds": 1}):
        with pytest.raises(InputError, match=r"goal|trainer|hidden layers|2 folds"):
            ta.reproduce(readings=measured[0], folder=tmp_path, **(TINY | impossible))
    assert not list(tmp_path.rglob("own-*"))
    with pytest.raises(InputError, match=r"unknown options \['units'\].*hidden"):
        ta.reproduce(readings=measured[0], folder=tmp_path, units=3)
