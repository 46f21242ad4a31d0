"""The paper's procedure on readings of one's own, on tiny sets: choice, resuming, the 2-sigma sentence, refusals."""

import json
import shutil

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.models import NetworkModel
from truearm.models.arm_check import arm_of_readings
from truearm.nets.perceptron import Perceptron
from truearm.readings import Session
from truearm.wings.gao2017.search import CoordinateErrors, CrossValidation, NetworkSetting, SearchGrid, fold_rows

TINY = {"hidden": ((1,), (4,)), "epochs": 25, "folds": 2}
ONE = {"hidden": ((1,),), "epochs": 2, "folds": 2}


@pytest.fixture(autouse=True)
def kinematic_only(monkeypatch):
    """Fits of the hybrid and the physical model take seconds, and their path is that of the kinematic one.

    A model of another name cannot be fitted, like one that the readings do not determine.
    """
    monkeypatch.setattr("truearm.wings.gao2017.reproduce.MODELS", ("kinematic", "nothing"))


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
    """A search that was interrupted in its fourth training and then resumed, its folder, and the trainings run."""
    train, test = planted
    folder, trained, fit = tmp_path_factory.mktemp("own"), [], NetworkModel.fit_readings

    def counted(self, readings, **options):
        model = fit(self, readings, **options)
        trained.append((self.hidden, self.seed, len(readings)))
        return model

    def interrupt(share, note):
        if len(trained) == 3 and "epoch 3" in note:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(NetworkModel, "fit_readings", counted)
        with pytest.raises(KeyboardInterrupt):
            ta.reproduce(readings=train, test=test, folder=folder, progress=interrupt, **TINY)
        assert len(list((folder / "runs").iterdir())) == 3
        return ta.reproduce(readings=train, test=test, folder=folder, **TINY), folder, trained


def test_the_search_finds_the_structure_that_made_the_readings(found):
    results = found[0].results
    assert results.chosen.setting.hidden == (4,)
    few, many = results.search
    assert few.errors.mean_mm > 100 * many.errors.mean_mm
    assert results.errors["network"].mean_mm < 0.01  # noise of 0.001 mm
    assert [row.n_train for row in results.amounts] == [10, 20, 40]
    assert results.amounts[0].errors.mean_mm > results.amounts[-1].errors.mean_mm


def test_without_an_arm_the_models_of_an_arm_are_missing_and_it_is_said(found):
    result = found[0]
    assert list(result.results.errors) == ["network"]
    assert result.results.best is None
    assert any("No arm is given" in remark and "truearm arms" in remark for remark in result.remarks)
    assert "on 80 fresh readings" in result.summary()
    assert result.page().verdict.state == "none"
    assert "More readings will help." in str(result)
    assert "joint ranges of its readings.\n12 of 80 test readings lie outside them." in str(result)


def test_the_model_file_is_the_network_of_the_test(found, planted):
    result, folder, _ = found
    files = {file.name for file in result.save(folder)}
    assert files == {"procedure.json", "procedure.html", "network.truearm", "figure-7.png", "figure-8.png"}
    model = ta.load_model(folder / "network.truearm")
    np.testing.assert_array_equal(model.predict_readings(planted[1]), result.results.predicted["network"])
    assert json.loads((folder / "procedure.json").read_text()) == json.loads(json.dumps(result.to_dict()))
    page = (folder / "procedure.html").read_text()
    assert "Figure 7 of the paper, of this arm" in page
    assert "Figure 6 of the paper" not in page


def test_an_interrupted_search_goes_on_and_trains_nothing_twice(found, planted):
    result, folder, trained = found
    assert len(trained) == len(set(trained)) == 9  # 2 networks and two smaller amounts on 2 folds, and the last one
    assert len(list((folder / "runs").iterdir())) == 9
    train, results = planted[0], result.results
    rows = fold_rows(np.arange(80), 2, 0)[0]  # predicted by the network that was trained before the interruption
    others = train.rows(np.setdiff1d(np.arange(80), rows))
    network = NetworkModel(arm_of_readings(train), hidden=(1,), epochs=25).fit_readings(others)
    errors = np.abs(network.predict_readings(train.rows(rows)) - train.points[rows])
    assert results.search[0].fold_mean_mm[0] == errors.mean()


def test_of_readings_that_have_changed_networks_are_trained_again(planted, tmp_path):
    train = planted[0]
    network = NetworkSetting((1,), epochs=1)
    for readings in (train, Session(train.angles, train.points + 1e-9), train):
        run = CrossValidation(readings, SearchGrid(folds=2), tmp_path)
        model = run.network(network.model(run.no_arm, seed=0), network, readings, "")
        assert model.n_train_ == 80
    assert len(list(tmp_path.iterdir())) == 2


def test_the_model_file_has_the_arm_that_is_given(measured, tmp_path):
    arm, train = ta.load_arm("gao2017"), measured[0].rows(np.arange(20))
    network, names = NetworkSetting((1,), epochs=1), []
    run = CrossValidation(train, SearchGrid(folds=2), tmp_path)
    for known, free in ((run.no_arm, ("base", "tip")), (arm, ("base", "tip")), (arm, ())):
        model = run.network(network.model(known, seed=0, free=free), network, train, "")
        names.append((model.arm_.name, model.free))
    assert names == [(run.no_arm.name, ("base", "tip")), (arm.name, ("base", "tip")), (arm.name, ())]


def test_what_is_unknown_of_an_arm_needs_an_arm(planted, tmp_path):
    refuses("no arm is given.*--arm", ta.reproduce, readings=planted[0], free=("tip",), folder=tmp_path, **TINY)
    assert not list(tmp_path.iterdir())


def test_fewer_readings_that_no_network_can_learn_have_no_row(tmp_path):
    session = ta.simulate("gao2017", poses=64, seed=3).session
    still = session.points[np.repeat(np.arange(8), 8)]
    position = np.repeat(list("abcdefgh"), 8)
    at_few_positions = Session(session.angles, np.ascontiguousarray(still), position=position)
    results = ta.reproduce(readings=at_few_positions, folder=tmp_path, hidden=((1,),), epochs=3, folds=2).results
    assert [row.n_train for row in results.amounts] == [16, 32]  # 8 readings are of one position


def test_a_damaged_file_is_named(found, planted, tmp_path):
    train, test = planted
    shutil.copytree(found[1] / "runs", tmp_path / "runs")
    file, other = sorted((tmp_path / "runs").glob("own-1-*"))
    for content in (b"{}", other.read_bytes()):
        file.write_bytes(content)
        refuses(f"{file.name}.*delete it", ta.reproduce, readings=train, test=test, folder=tmp_path, **TINY)


def test_beside_the_network_stand_the_models_of_the_arm(measured, tmp_path):
    train, test = measured
    result = ta.reproduce(readings=train, test=test, arm="gao2017", folder=tmp_path, **ONE)
    results = result.results
    assert list(results.errors) == ["nominal", "network", "kinematic"]
    kinematic = ta.fit("gao2017", train, model="kinematic").model.predict_readings(test)
    np.testing.assert_array_equal(results.predicted["kinematic"], kinematic)
    # With 60 readings a network is far worse than a kinematic model, and the first sentence says so.
    assert results.errors["network"].mean_mm > 10 * results.errors["kinematic"].mean_mm
    assert result.summary().endswith("times smaller: use the kinematic model.")
    assert str(result).startswith(result.summary())
    assert result.page().verdict.sentence == result.summary()
    assert "truearm fit SESSION --arm ARM --model kinematic" in str(result)
    assert list(results.refused) == ["nothing"]
    assert "There is no nothing model: expected a model among" in str(result)
    assert "There is no nothing model" in result.page().sections[0].text
    captions = [figure.caption for section in result.page().sections for figure in section.figures]
    for number in (6, 7, 8):
        assert sum(caption.startswith(f"Figure {number} of the paper, of this arm") for caption in captions) == 1


def test_without_a_test_every_model_predicts_what_its_folds_held_out(measured, tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.wings.gao2017.reproduce.MODELS", ())
    train = measured[0]
    result = ta.reproduce(readings=train, arm="gao2017", folder=tmp_path, **ONE)
    results = result.results
    assert not results.fresh
    assert "60 readings that the cross-validation held out" in result.summary()
    assert "There are no fresh readings (--test-session)" in str(result)
    rows = fold_rows(np.arange(60), 2, 0)[1]
    others = train.rows(np.setdiff1d(np.arange(60), rows))
    nominal = ta.fit("gao2017", others, model="nominal").model.predict_readings(train.rows(rows))
    np.testing.assert_array_equal(results.predicted["nominal"][rows], nominal)


def test_two_sigma_by_hand():
    # Six coordinates: 0.01, 0.06, 0.09 and three zeros.
    errors = CoordinateErrors.of(np.array([[0.01, -0.06, 0.09], [0, 0, 0]]))
    assert errors.n == 2
    assert errors.over_mm == {0.05: 2, 0.08: 1}
    assert errors.mean_mm == pytest.approx(0.16 / 6)
    assert errors.two_sigma_mm == pytest.approx(2 * np.sqrt((0.0001 + 0.0036 + 0.0081) / 6))  # 0.0887
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
    refuses(message, ta.reproduce, readings=change(measured[0]), arm="gao2017", folder=tmp_path, **TINY)
    assert not list(tmp_path.rglob("own-*"))


def test_a_test_with_training_readings_is_refused(measured, tmp_path):
    train, test = measured
    both = Session(np.vstack([test.angles, train.angles[:2]]), np.vstack([test.points, train.points[:2]]))
    with pytest.raises(InputError, match="2 of 32 test readings are training readings"):
        ta.reproduce(readings=train, test=both, folder=tmp_path, **TINY)


def test_options_of_the_other_use_are_refused(measured, tmp_path):
    refuses("need readings", ta.reproduce, folder=tmp_path, hidden=((2,),), figure=3)
    refuses("paper's own arm", ta.reproduce, readings=measured[0], folder=tmp_path, table=4)
    for impossible in ({"goal": (0.0, -1.0)}, {"trainer": ("varpro", "adam")}, {"hidden": ((2,), (0,))}, {"folds": 1}):
        with pytest.raises(InputError, match=r"goal|trainer|hidden layers|2 folds"):
            ta.reproduce(readings=measured[0], folder=tmp_path, **(TINY | impossible))
    assert not list(tmp_path.rglob("own-*"))
    refuses(r"unknown options \['units'\].*hidden", ta.reproduce, readings=measured[0], folder=tmp_path, units=3)


def test_learning_rates_are_tried_with_gradient_descent_alone():
    grid = SearchGrid(hidden=((3,),), trainer=("traingdx",), learning_rate=(0.01, 0.1))
    assert [one.training for one in grid.settings(100, 6)] == ["traingdx 0.01", "traingdx 0.1"]
    refuses("belongs to gradient descent", SearchGrid, learning_rate=(0.1,))
