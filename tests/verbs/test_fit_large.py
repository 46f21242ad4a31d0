"""Fits to large sessions: planted truth is recovered from all readings, whoever sums; the rest is said by name."""

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import Contradiction
from truearm.identification.judgement.gross_errors import gross_error_limit
from truearm.models.training_conditions import TrainingConditions
from truearm.readings import large_sessions as module
from truearm.readings.columns import session_columns
from truearm.readings.files import table_writer
from truearm.solve.executors import Processes
from truearm.verbs.fit_sums import Spread

N, PART = 24 * 1024, 4 * 1024
RHO = 0.9
GROSS = (700, 15_000)

pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def small_sample(monkeypatch):
    monkeypatch.setattr(module, "SAMPLE", 1000)


@pytest.fixture(scope="module")
def truth():
    return ta.fit("ur10", ta.simulate("ur10", poses=300, seed=1).session, model="kinematic").model


@pytest.fixture(scope="module")
def session(truth):
    """Of an arm that moves: a smooth path, autocorrelated noise, two gross errors, some rows without a point."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(4)
    angles = 0.9 * lfilter([np.sqrt(1 - 0.999**2)], [1, -0.999], rng.normal(size=(N, 6)), axis=0)
    noise = 0.03 * lfilter([np.sqrt(1 - RHO**2)], [1, -RHO], rng.normal(size=(N, 3)), axis=0)
    points = truth.predict(angles) + noise
    points[list(GROSS)] += 5.0
    points[5000:5010] = np.nan
    return ta.Session(angles, points, temperature_degC=np.linspace(20, 21, N))


@pytest.fixture(scope="module")
def folder(session, tmp_path_factory):
    path = tmp_path_factory.mktemp("large") / "readings"
    path.mkdir()
    with table_writer(path / "a.parquet") as append:
        for rows in np.split(np.arange(N), N // PART):
            append(session_columns(session.rows(rows)))
    return path


@pytest.fixture(scope="module")
def found(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SAMPLE", 1000)
        return ta.fit("ur10", folder, model="kinematic")


@pytest.fixture(scope="module", params=[2, pytest.param(8, marks=pytest.mark.weekly)])
def folder_with_radians(request, tmp_path_factory):
    """Files of one arm, the first with radians under the names of degrees."""
    path = tmp_path_factory.mktemp("radians")
    for day in range(request.param):
        session = ta.simulate("ur10", poses=40, seed=day).session
        angles = session.angles if day else np.radians(session.angles)
        ta.Session(angles, session.points, point_std=session.point_std).save(path / f"{day}.csv")
    return path


def test_a_file_in_other_units_is_named(folder_with_radians, tmp_path):
    n = len(list(folder_with_radians.iterdir()))
    said = (
        "0.csv: 40 of 40 readings are gross errors, and those of 7 other files are not"
        if n == 8
        else "or fit each file alone"
    )
    with pytest.raises(Contradiction, match=said):
        ta.fit("ur10", folder_with_radians, model="nominal")
    if n == 8:
        accepted = ta.fit("ur10", folder_with_radians, model="nominal", accept="a try")
        assert [said.removeprefix("0.csv: ") in str(one) for one in accepted.model.accepted_] == [True]
        assert str(accepted.model.accepted_[0]) in accepted.remarks
    model = ta.fit("ur10", folder_with_radians / "1.csv", model="nominal").model
    evaluation = ta.evaluate(model, folder_with_radians)
    assert "40 of 40 outliers are in 0.csv: it may be in other units" in str(evaluation)
    assert list(evaluation.to_dict()["outliers_of_file"].values()) == [40]


def test_the_arm_of_all_readings_is_nearer_to_the_truth_than_that_of_the_sample(found, folder, truth, tmp_path):
    rng = np.random.default_rng(5)
    test = ta.Session(0.9 * rng.normal(size=(300, 6)))
    sample = ta.fit("ur10", found.session, model="kinematic").model

    def error(model):
        return np.sqrt(((model.predict_readings(test) - truth.predict_readings(test)) ** 2).mean())

    assert error(found.model) < 0.8 * error(sample)
    covariance = found.model.fit_.tip_covariance(found.model.at(test).state)
    off = found.model.predict_readings(test) - truth.predict_readings(test)
    assert (np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off) < 7.815).mean() > 0.93
    found.save(tmp_path / "k.truearm")
    read = ta.load_model(tmp_path / "k.truearm")
    assert np.allclose(read.predict_readings(test), found.model.predict_readings(test), atol=1e-9)


def test_it_says_what_the_readings_are_worth_and_which_were_excluded(found):
    said = found.to_dict()
    assert said["n_readings"] == N
    assert said["n_gross"] == len(GROSS)
    assert said["n_used"] == N - len(GROSS) - 10
    assert N / said["n_effective"] == pytest.approx((1 + RHO) / (1 - RHO), rel=0.4)
    assert said["held_out"]["mean_mm"] == pytest.approx(0.03 * np.sqrt(8 / np.pi), rel=0.1)  # of three normal numbers
    text = str(found)
    assert "have like errors" in text
    names = "reading 701 of a.parquet, reading 15001 of a.parquet"
    assert f"{len(GROSS)} readings are gross errors and were excluded: {names}." in text
    assert "10 readings have no reference point" in text


def test_the_model_does_not_depend_on_who_sums(found, folder):
    again = ta.fit("ur10", folder, model="kinematic", executor=Processes(2))
    assert np.array_equal(again.model.fit_.coefficients, found.model.fit_.coefficients)
    assert np.array_equal(again.model.fit_.covariance, found.model.fit_.covariance)
    one, other = again.to_dict(), found.to_dict()
    del one["sample"]["fit_seconds"], other["sample"]["fit_seconds"]
    assert one == other


def test_conditions_are_those_of_all_readings(found, session):
    every = session.rows(session.has_point)
    whole, of_all = TrainingConditions.of(every, np.zeros(6, bool)), found.model.training_
    assert np.array_equal(of_all.angle_ranges, whole.angle_ranges)
    assert of_all.n_readings == whole.n_readings
    assert of_all.temperature_degC.mean == pytest.approx(whole.temperature_degC.mean)
    assert of_all.temperature_degC.variance == pytest.approx(whole.temperature_degC.variance, rel=1e-6)
    a, b = map(Spread.of, np.split(every.angles, [3000]))
    both, of_every = a + b, Spread.of(every.angles)
    assert all(map(np.allclose, vars(both).values(), vars(of_every).values()))


def test_a_nominal_arm_is_placed_by_all_readings(folder):
    found = ta.fit("ur10", folder, model="nominal")
    assert found.all_readings.total.sums.gram.shape == (9, 9)
    assert found.model.nominal_ is found.model.fit_
    assert not found.all_readings.why_of_sample


def test_models_that_are_no_sums_are_those_of_the_sample_and_say_so(folder):
    found = ta.fit("ur10", folder, model="network", hidden=(3,), epochs=2)
    assert found.all_readings.why_of_sample
    assert "The model is that of 1000 readings, evenly spaced in the session, and not of all" in str(found)
    assert found.all_readings.n_effective is None


def test_a_large_session_without_points_is_refused_as_a_small_one(session, tmp_path):
    (tmp_path / "set").mkdir()
    ta.Session(session.angles[:300]).save(tmp_path / "set" / "a.csv")
    refuses("no reference at all", ta.fit, "ur10", tmp_path / "set", model="kinematic")


def test_the_limit_of_gross_errors_is_beyond_honest_ones(truth):
    limit = gross_error_limit(truth.fit_, truth.held_out_)
    assert 4.0 < limit < 20.0
