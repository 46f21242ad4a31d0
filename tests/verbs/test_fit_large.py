"""Fits to large sessions: planted truth is recovered from all readings, whoever sums; the rest is said by name."""

import importlib
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import Contradiction
from truearm.identification.estimation.reading_sums import TRIAL_NOISE, ReadingSums
from truearm.identification.from_sums import Iterate, improved, shown_motions
from truearm.identification.judgement.gross_errors import gross_error_limit
from truearm.identification.terms.basis import Temperature
from truearm.models.training_conditions import TrainingConditions
from truearm.readings import large_sessions as module
from truearm.readings.columns import session_columns
from truearm.readings.files import table_writer
from truearm.verbs import fit_sums
from truearm.verbs.fit_sums import Spread

fit_module = importlib.import_module("truearm.verbs.fit")  # ta.fit is the function
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


def test_a_long_session_in_memory_is_fitted_as_one_in_parts(found, session, monkeypatch):
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", N - 1)
    monkeypatch.setattr(module, "MAX_READINGS", PART)
    again = ta.fit("ur10", session, model="kinematic")
    off = again.model.fit_.coefficients - found.model.fit_.coefficients
    # In another order of summation, to a thousandth of the uncertainty.
    assert (np.abs(off) < 1e-3 * np.sqrt(found.model.fit_.covariance.diagonal())).all()
    assert again.to_dict()["n_gross"] == len(GROSS)
    for beside in ({"seat": np.full(N, "a")}, {"tip": np.full(N, "a")}, {"session": np.full(N, "a")}):
        assert not fit_module._is_summed(replace(session, **beside), "kinematic", None, {})


def fit_all_and_keep(fit_all, samples, model, *others):
    samples.append(model)
    return fit_all(model, *others)


@pytest.fixture(scope="module")
def physical_by_sums():
    """Of readings at one temperature, and at many: what is fitted, and the model of its sample."""
    samples, training = [], ta.simulate("ur10", poses=800, seed=1).session
    sessions = [replace(training, temperature_degC=np.full(800, 20.5)), training]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SAMPLE", 400)
        patch.setattr(fit_module, "MOST_AT_ONCE", 700)
        patch.setattr(fit_sums, "fit_all", partial(fit_all_and_keep, fit_sums.fit_all, samples))
        found = [ta.fit("ur10", session, model="physical") for session in sessions]
    return list(zip(sessions, found, samples, strict=True))


@pytest.mark.parametrize("model", [pytest.param("nominal", marks=pytest.mark.weekly), "kinematic"])
def test_rounding_of_the_angles_is_in_the_sums(model, monkeypatch):
    session = ta.simulate("ur10", poses=1000, seed=1).session
    session = replace(session, angles=np.radians(np.round(np.degrees(session.angles), 1)))
    whole = ta.fit("ur10", session, model=model).model
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 700)
    monkeypatch.setattr(module, "SAMPLE", 400)
    found = ta.fit("ur10", session, model=model)
    assert found.all_readings.total.sums.n_gross == 0
    u = np.sqrt(np.trace(whole.fit_.tip_covariance(whole.at(session).state), 0, 1, 2))
    off = np.linalg.norm(found.model.predict_readings(session) - whole.predict_readings(session), axis=1)
    assert np.sqrt(((off / u) ** 2).mean()) < 0.3
    sums = np.trace(found.model.fit_.tip_covariance(whole.at(session).state), 0, 1, 2)
    assert np.sqrt(sums / u**2).mean() == pytest.approx(1, rel=0.2)


def test_what_is_not_summed_is_fitted_at_once(session, monkeypatch):
    few = replace(session.rows(np.arange(0, N, N // 300)), temperature_degC=None)
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 200)
    monkeypatch.setattr(module, "SAMPLE", 100)
    fits = {"robust": {"model": "kinematic", "robust": False}, "nothing": {"model": "nominal", "free": ()}}
    wide = replace(few, points=ta.load_arm("ur10").chain.tip_in_base(few.angles))
    for options in fits.values():
        assert ta.fit("ur10", wide, **options).all_readings is None


def test_an_error_that_points_of_one_position_share_is_not_summed(tmp_path, monkeypatch):
    """In each part, or in a sample, a position has fewer readings than in all, which share its error."""
    session = ta.simulate("ur10", poses=120, seed=1).session
    session = replace(session, u_common_mm=np.full(120, 0.05), position=np.arange(120).astype(str))
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 100)
    assert ta.fit("ur10", session, model="nominal").all_readings is None
    for i in range(2):
        session.rows(np.arange(60 * i, 60 * (i + 1))).save(tmp_path / f"{i}.csv")
    said = str(ta.fit("ur10", tmp_path, model="nominal"))
    assert "the error that points of one position share (u_common_mm) is not summed" in said


def test_a_file_with_nearly_all_readings_is_not_predicted_by_the_others(tmp_path):
    session = ta.simulate("ur10", poses=200, seed=1).session
    for i, rows in enumerate((np.arange(190), np.arange(190, 200))):
        session.rows(rows).save(tmp_path / f"{i}.csv")
    found = ta.fit("ur10", tmp_path, model="kinematic")
    assert found.held_out_mm == pytest.approx(ta.fit("ur10", session, model="kinematic").held_out_mm, rel=0.05)


def test_a_sample_does_not_show_in_which_direction_joints_turned():
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.uniform(0.01, 0.05, (60, 6)) * np.sign(np.sin(np.arange(60)))[:, None], axis=0)
    points = ta.load_arm("ur10").chain.tip_in_base(path) + 0.02 * rng.normal(size=(60, 3))
    every, sample = (
        ta.fit("ur10", ta.Session(path, points, stride=stride), model="kinematic").model for stride in (1.0, 5.0)
    )
    assert every.hysteresis_.any()
    assert not sample.hysteresis_.any()


def test_outliers_of_a_long_session_have_its_rows(session, monkeypatch):
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 2000)
    monkeypatch.setattr(module, "SAMPLE", 1500)
    few = session.rows(np.arange(3000))
    points = few.points.copy()
    points[::7] += np.where(np.arange(0, 3000, 7)[:, None] % 70 == 0, 5.0, 0.0)
    found = ta.fit("ur10", replace(few, points=points), model="kinematic")
    rows = [one.row for one in found.outliers]
    assert rows
    assert all(row % 70 == 0 or row in GROSS for row in rows)


def test_a_physical_model_by_sums_is_that_of_all_readings_at_once(physical_by_sums):
    session, found, sample = physical_by_sums[0]
    assert found.all_readings.why_of_sample == ""
    whole = ta.fit("ur10", session, model="physical").model
    test = replace(ta.simulate("ur10", poses=300, seed=2).session, temperature_degC=np.full(300, 20.5))

    def u_mm(model):
        return np.sqrt(np.trace(model.fit_.tip_covariance(model.at(test).state), 0, 1, 2))

    def off(model):
        difference = np.linalg.norm(model.predict_readings(test) - whole.predict_readings(test), axis=1)
        return np.sqrt(((difference / u_mm(whole)) ** 2).mean())

    # Terms, scales of priors and robust weights are those of the sample.
    assert off(found.model) < 0.15 < off(sample)
    assert (u_mm(found.model) / u_mm(whole)).mean() == pytest.approx(1, rel=0.05)


def test_the_noise_of_few_readings_by_sums_is_that_of_these_at_once(monkeypatch):
    session = ta.simulate("ur10", poses=120, preset="shop", seed=21).session
    whole = ta.fit("ur10", session, model="physical").model.fit_
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 100)
    found = ta.fit("ur10", session, model="physical").model.fit_
    # Half as many coefficients as residuals, of which the prior determines most.
    assert found.references[0].noise_std == pytest.approx(whole.references[0].noise_std, rel=0.02)


@pytest.mark.parametrize(
    ("counts", "worth", "least", "largest"), [([40] * 100, 195, 0.0, 3.0), ([240] * 15 + [1] * 400, 60, 1.5, 4.5)]
)
def test_errors_that_come_back_with_their_poses_are_not_averaged(truth, counts, worth, least, largest, monkeypatch):
    """0.02 mm repeat at each pose, and 0.02 mm are noise: of a third of 3 numbers the squares are known to a half.

    Of 100 poses read 40 times, a share s = 1/2 that repeats leaves n / (1 + s (m - 1)) = 195 readings. Of unequal
    ones, the few that are read most are worth little more than one each, and the others all of theirs: by the mean
    count the squares are 12, and were all directions as uncertain as those of the few, 0.5.
    """
    rng, k, n = np.random.default_rng(7), len(counts), sum(counts)
    poses, test = rng.uniform(-0.9, 0.9, (k, 6)), rng.uniform(-0.9, 0.9, (200, 6))
    rows = rng.permutation(np.repeat(np.arange(k), counts))
    repeated = truth.predict(poses) + 0.02 * rng.normal(size=(k, 3))
    angles = poses[rows] + 2e-5 * rng.normal(size=(n, 6))
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 1000)
    found = ta.fit("ur10", ta.Session(angles, repeated[rows] + 0.02 * rng.normal(size=(n, 3))), model="physical")
    assert f"{n} readings come back to about " in str(found)
    assert found.all_readings.n_poses == pytest.approx(k, rel=0.3)  # some are at the edge of a cell
    assert found.all_readings.n_effective == pytest.approx(worth, rel=0.4)
    known = found.model.fit_.tip_covariance(found.model.at(ta.Session(test)).state)
    off = found.model.predict(test) - truth.predict(test)
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(known), off)
    assert least < squares.mean() < largest


def test_a_doubt_of_the_sample_is_said_to_be_of_it(session, monkeypatch):
    monkeypatch.setattr(fit_module, "MOST_AT_ONCE", 2000)
    monkeypatch.setattr(module, "SAMPLE", 1500)
    few = session.rows(np.arange(3000))
    found = ta.fit("ur10", replace(few, points=1.0003 * few.points), model="kinematic")
    assert found.model.arm_doubt_.startswith("By a sample of 1500 of 3000 readings: All lengths of the arm are ")


def test_what_no_reading_shows_and_how_links_grow_is_as_by_the_sample(physical_by_sums):
    session, found, sample = physical_by_sums[1]
    fit, of_sample = found.model.fit_, sample.fit_
    assert [group.name for group in fit.groups] == [group.name for group in of_sample.groups]
    grows = fit.columns_of(lambda term: isinstance(term.basis, Temperature))
    assert grows.any()
    assert np.array_equal(fit.coefficients[grows], of_sample.coefficients[grows])
    block = np.ix_(grows, grows)
    assert np.allclose(fit.covariance[block], of_sample.covariance[block])
    size = np.sqrt(fit.covariance.diagonal())
    assert np.linalg.eigvalsh(fit.covariance / np.outer(size, size)).min() > -1e-9  # rounding
    at = found.model.at(session).state
    assert np.trace(fit.tip_covariance(at), 0, 1, 2).mean() < np.trace(of_sample.tip_covariance(at), 0, 1, 2).mean()


def test_a_motion_that_readings_hardly_show_stays_as_by_the_sample():
    gram, gradient = np.diag([1e4, 0.5]), np.array([-2e4, -5.0])  # of the second three times its prior
    sums = ReadingSums(1000, 0, gram, gradient, np.ones(len(TRIAL_NOISE)), np.zeros((1, 2)))
    arm, at = SimpleNamespace(prior_std=np.ones(2)), Iterate(np.zeros(2), 1.0)
    found = improved(arm, at, sums, shown_motions(arm, at, sums))
    assert found.x == pytest.approx([2e4 / (1e4 + 1), 0.0], abs=1e-9)


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


def test_the_model_does_not_depend_on_who_sums(found, folder, two_processes):
    again = ta.fit("ur10", folder, model="kinematic", executor=two_processes)
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
