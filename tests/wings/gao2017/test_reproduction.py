"""A small reproduction: which trainings run, which rows share one, resuming, and the rule of the verdicts."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.models import NominalModel
from truearm.models.network import TRAINERS
from truearm.verbs.record import to_plain
from truearm.wings.gao2017.reproduction import GOAL_MET, _reason, arm_pose, poses_outside, reproduce, verdict
from truearm.wings.gao2017.results import FITTED_BOX, METHODS, TIME_OVER
from truearm.wings.gao2017.tables import TABLES
from truearm.wings.gao2017.training import CURVE_POINTS, TEST_STREAM, TRAINING_STREAM, machine_data, run_training
from truearm.wings.gao2017.training_plan import (
    BOX_FITTING_ROWS,
    FULL_EFFORT,
    PARTS,
    QUICK_EFFORT,
    plan_trainings,
    training_of,
    trainings,
)

# Rows of the paper with special cases: shared trainings, other activations, gradient descent.
ROWS = {2: (1, 6, 8, 15), 3: (6, 9, 11, 12), 4: (4,)}
EFFORT = replace(
    FULL_EFFORT,
    epochs=5,
    box_epochs=2,
    varpro_epochs={2: 3, 3: 3, 4: 3},
    starts=((math.inf, 2),),
    starts_by_row={(2, 1): 3},
    half_widths_deg=(20.0, 34.0),
)


PAPERS_TABLES = dict(TABLES)


def smaller(row):
    hidden = tuple(2 + len(row.hidden) + row.row // 15 for _ in row.hidden)
    return replace(row, n_train=150, hidden=hidden, mean_mm=150 + row.row)


@pytest.fixture(scope="module", autouse=True)
def small_tables():
    """The paper's rows with a few poses and units, and averages that a few epochs reach."""
    with pytest.MonkeyPatch.context() as patch:
        for table, numbers in ROWS.items():
            rows = [row for row in TABLES[table] if row.row in numbers]
            patch.setitem(TABLES, table, tuple(smaller(row) for row in rows))
        # Their fits take seconds, and what they do is tested elsewhere.
        for model in ("HybridModel", "PhysicalModel"):
            patch.setattr(f"truearm.wings.gao2017.reproduction.{model}", NominalModel)
        yield


@pytest.mark.parametrize("effort", [FULL_EFFORT, QUICK_EFFORT], ids=["full", "quick"])
@pytest.mark.parametrize("limit", [1.0, None])
def test_another_time_limit_plans_the_same_trainings(effort, limit):
    def planned(own):
        wanted, skipped = plan_trainings(PARTS, own)
        return [replace(one, time_limit_s=None) for one in wanted], skipped

    with pytest.MonkeyPatch.context() as patch:
        for table, rows in PAPERS_TABLES.items():
            patch.setitem(TABLES, table, rows)
        assert planned(replace(effort, time_limit_s=limit)) == planned(effort)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return reproduce(PARTS, effort=EFFORT, folder=tmp_path_factory.mktemp("runs"))


def without_times(results):
    """Every number of a reproduction but times, which differ from run to run."""

    def plain(value):
        if isinstance(value, dict):
            timeless = {key: item for key, item in value.items() if "seconds" not in key and key != "trained"}
            return {key: [[at, error] for at, _, error in item] if key == "curve" else plain(item)
                    for key, item in timeless.items()}  # fmt: skip
        return [plain(item) for item in value] if isinstance(value, list) else value

    return plain(to_plain(results))


def row_of(results, table, number):
    return next(row for row in results.tables[table] if row.paper.row == number)


# Trainings ------------------------------------------------------------------------------------------------------------


def test_the_results_are_json(results):
    plain = to_plain(results)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["quick"] is False
    assert set(plain["tables"]["2"][0]["results"]) == set(METHODS)


def test_every_row_has_both_methods_with_a_run_for_each_seed(results):
    for table, rows in results.tables.items():
        assert [row.paper.row for row in rows] == list(ROWS[table])
        for row in rows:
            for method in METHODS:
                one = row.results[method]
                assert [run.seed for run in one.runs] == list(range(len(one.runs)))
                errors = [run.mean_many_mm for run in one.runs]
                assert one.median["mean_many_mm"] == np.median(errors)
                assert one.range_mm == (min(errors), max(errors))
                assert row.ratio[method] == np.median(errors) / row.paper.mean_mm


def test_seeds_differ_in_poses_and_start(results):
    runs = row_of(results, 2, 1).results["trainlm"].runs
    assert len({run.mean_many_mm for run in runs}) == len(runs) == 3


def test_rows_that_differ_only_in_settings_without_effect_are_one_training(results):
    first, goal, rate = (row_of(results, 2, number) for number in (1, 6, 8))
    assert [row.same_training_as for row in (first, goal, rate)] == [None, 1, 1]
    assert first.results["trainlm"].runs[0].mean_many_mm == rate.results["trainlm"].runs[0].mean_many_mm
    assert first.verdict["trainlm"] == FITTED_BOX
    assert [row.verdict[method] for row in (goal, rate) for method in METHODS] == [None] * 4
    assert "no start met that of row 1" in goal.note
    assert rate.note.startswith("The paper states 123 s for 360 epochs here and 124 s for the 1000 epochs of row 1")
    assert rate.note.endswith("The same training as row 1: trainlm has no learning rate.")
    claim = results.claims.learning_rate
    assert (claim.rates, claim.rows) == ((0.1, 1.0), (1, 8))
    assert claim.mean_mm == first.results["trainlm"].median["mean_many_mm"]
    assert claim.paper_mean_mm == (151.0, 158.0)
    wanted, _ = plan_trainings(["table 2"], EFFORT)
    assert len(wanted) == len(set(wanted)) == 2 * (3 + 2)  # methods, seeds of rows 1 and 15


def test_a_start_that_met_the_first_rows_goal_is_counted():
    first, goal = TABLES[2][:2]
    for stops, text in ((["Maximum epoch reached.", GOAL_MET], "1 start met"), ([GOAL_MET] * 2, "2 starts met")):
        result = SimpleNamespace(runs=[SimpleNamespace(stop=stop) for stop in stops])
        assert text in _reason(goal, first, result)
    assert _reason(goal, first, None) == "only the goal differs"


def test_the_spread_of_starts_is_that_of_their_means(results):
    claim, runs = results.claims.scatter, row_of(results, 2, 1).results["trainlm"].runs
    means = tuple(run.mean_mm for run in runs)
    assert claim.mean_mm == means
    assert claim.mean_many_mm == tuple(run.mean_many_mm for run in runs)
    assert claim.relative_spread == (max(means) - min(means)) / np.median(means)
    assert claim.paper_rows_mean_mm == (151.0, 156.0, 158.0)
    assert claim.paper_relative_spread == 7.0 / 156.0


def test_rows_that_the_table_does_not_distinguish_have_other_activations(results):
    plain, other = row_of(results, 3, 6), row_of(results, 3, 9)
    assert (plain.activation, other.activation) == ("tansig", "tansig, purelin")
    assert "inference" in other.note
    assert plain.results["trainlm"].median["mean_mm"] != other.results["trainlm"].median["mean_mm"]


def test_gradient_descent_has_its_own_trainers(results):
    rows = [row_of(results, 3, number) for number in (11, 12)]
    assert [row.results["trainlm"].trainer for row in rows] == ["traingd", "traingdx"]
    for row in rows:
        assert row.results["varpro"].runs[0].mean_mm == row_of(results, 3, 6).results["varpro"].runs[0].mean_mm
        assert row.verdict["trainlm"] is not None
        assert row.verdict["varpro"] is None
        assert {run.seconds_to_paper for one in row.results.values() for run in one.runs} == {None}


def test_the_first_epoch_at_the_papers_level_is_recorded_for_every_row_that_shares_a_training(tmp_path):
    row = TABLES[2][0]
    training = training_of(2, row, "varpro", EFFORT, seed=0)
    assert training.levels_mm == (151.0, 156.0, 158.0)
    one, epochs = run_training(training, tmp_path, lambda share, note: None), {}
    for stop in range(one.epochs + 1):  # the same training, ended earlier
        part = run_training(replace(training, epochs=max(stop, 1)), tmp_path, lambda share, note: None)
        error = float(part.errors(2000, 3).mean())
        for level in training.levels_mm:
            if stop > 0 and error <= level:
                epochs.setdefault(level, stop)
    assert {level: max(epoch, 1) for level, epoch, _ in one.reached} == epochs


def test_a_part_alone_runs_only_the_trainings_it_needs(tmp_path):
    for part in ("figure 1", "figure 3", "figure 6"):
        assert plan_trainings([part], EFFORT) == ([], [])
    drawn = reproduce(["figure 3"], effort=EFFORT, folder=tmp_path)
    assert drawn.figures.network == (6, 4, 4, 3)
    assert drawn.tables == {2: None, 3: None, 4: None}
    assert not list(tmp_path.iterdir())
    wanted, _ = plan_trainings(["figure 4"], EFFORT)
    assert [(one.trainer, one.seed) for one in wanted] == [("trainlm", 0), ("varpro", 0)]
    for part in ("figure 7", "figure 8"):
        assert [(one.trainer, one.seed) for one in plan_trainings([part], EFFORT)[0]] == [("varpro", 0)]
    drawn = reproduce(["figure 8"], effort=EFFORT, folder=tmp_path)
    assert drawn.figures.figure_8 is not None
    assert set(vars(drawn.claims).values()) == {None}


def test_a_quick_run_lists_the_parts_it_skips(tmp_path):
    quick = replace(EFFORT, quick=True, starts=((1e-9, 1),), starts_by_row={}, half_widths_deg=(20.0,))
    results = reproduce(["table 4", "table 3"], effort=quick, folder=tmp_path)
    assert results.quick
    assert results.skipped[0].startswith("Table 3, row 6, trainlm: about ")
    assert len(results.skipped) == len(ROWS[3]) + 1 + 2 * len(ROWS[4])  # varpro of Table 3 is one training
    row = row_of(results, 4, 4)
    assert (row.results, row.verdict) == (dict.fromkeys(METHODS), dict.fromkeys(METHODS, "skipped"))
    assert results.final_test is None


def test_a_quick_run_is_part_of_a_full_one():
    """Its trainings are reused by --all."""
    for table, rows in TABLES.items():
        for row in rows:
            for method in METHODS:
                quick, full = (set(trainings(table, row, method, effort)) for effort in (QUICK_EFFORT, FULL_EFFORT))
                assert quick <= full


@pytest.mark.parametrize("effort", [FULL_EFFORT, QUICK_EFFORT])
def test_the_estimated_times_are_those_that_the_help_states(effort, monkeypatch):
    for table, rows in PAPERS_TABLES.items():
        monkeypatch.setitem(TABLES, table, rows)
    seconds = sum(training.estimated_seconds for training in plan_trainings(PARTS, effort)[0])
    assert seconds < (200 if effort.quick else 4500)


def test_a_time_limit_that_stopped_a_training_is_recorded(tmp_path):
    results = reproduce(["table 4"], effort=replace(EFFORT, time_limit_s=1e-9), folder=tmp_path)
    one = row_of(results, 4, 4).results["trainlm"]
    assert one.time_limit_s == 1e-9
    assert one.runs[0].stop == "Maximum time elapsed."
    assert one.n_cut == len(one.runs) == 2
    assert results.final_test.n_cut("trainlm") == 2
    assert results.final_test.n_cut("kinematic") == 0
    assert results.claims.outside.n_cut == 2


def test_a_training_that_a_lower_limit_cut_runs_again_and_a_complete_one_does_not(tmp_path):
    def run(limit_s):
        training = training_of(2, TABLES[2][0], "varpro", replace(EFFORT, time_limit_s=limit_s), seed=0)
        return run_training(training, tmp_path, lambda share, note: None)

    cut = run(1e-9)
    assert (cut.was_cut, cut.epochs) == (True, 0)
    assert run(1e-9).ended == cut.ended
    whole = run(None)
    assert (whole.was_cut, whole.epochs) == (False, 3)
    for limit_s in (1e-9, 1e9):  # it took what it took
        again = run(limit_s)
        assert (again.epochs, again.ended, again.limit_s) == (3, whole.ended, None)
    assert len(list(tmp_path.iterdir())) == 1


# The final test and the claims ----------------------------------------------------------------------------------------


def test_counts_and_shares_of_the_final_test_are_those_of_its_errors(results):
    errors = np.abs(results.figures.figure_8.deviations()["varpro"])
    nominal = np.abs(results.figures.figure_6.deviations()["nominal"])
    run = results.final_test.runs[0]
    varpro = run.errors["varpro"]
    assert errors.shape == (200, 3)
    assert (varpro.mean_mm, varpro.max_mm) == (errors.mean(), errors.max())
    assert varpro.over_mm[0.05] == (errors > 0.05).sum()
    assert run.errors["nominal"].mean_mm == nominal.mean()
    # Percent, by another way of computing it: rounding only.
    assert varpro.removed_percent == pytest.approx(100 - 100 * errors.mean() / nominal.mean(), abs=1e-9)
    assert run.noise_floor_mm < run.errors["kinematic"].mean_mm < run.errors["nominal"].mean_mm


def test_a_kinematic_model_holds_outside_the_box_and_a_network_does_not(results):
    outside = results.claims.outside
    median = outside.median_mm
    assert outside.distance_deg[0] == 0
    assert median["varpro"][-1] > 3 * median["varpro"][0]
    assert median["kinematic"][-1] < median["nominal"][-1]


@pytest.mark.parametrize("distance", [0.5, 5.0, 60.0])
def test_poses_outside_are_as_far_outside_as_they_say(distance):
    angles = poses_outside(200, half_width_deg=20.0, distance_deg=distance, seed=1)
    beyond = np.abs(np.degrees(angles - load_arm("gao2017").working)).max(axis=1) - 20.0
    np.testing.assert_allclose(beyond, distance, atol=1e-9)  # deg, rounding


def test_poses_at_no_distance_are_inside():
    angles = poses_outside(200, half_width_deg=20.0, distance_deg=0.0, seed=1)
    assert np.abs(np.degrees(angles - load_arm("gao2017").working)).max() <= 20


def test_frames_of_the_figure_end_at_the_tip_of_the_arm():
    pose, arm = arm_pose(), load_arm("gao2017")
    assert pose.frames.shape == (7, 4, 4)
    np.testing.assert_allclose(pose.tip_mm, arm.chain.tip_in_base(arm.working[None])[0], atol=1e-9)  # mm, rounding
    np.testing.assert_allclose(pose.angles_deg, np.degrees(arm.working))


@pytest.mark.parametrize(
    ("table", "ratio", "limit", "expected"),
    [
        (3, 1.0, None, "reproduced"),
        (3, 1.49, None, "reproduced"),
        (3, 0.67, None, "reproduced"),
        (3, 0.66, None, "better"),
        (3, 1.51, None, "not reached"),
        (4, 1.19, None, "reproduced"),
        (4, 1.21, None, "not reached"),
        (4, 0.84, None, "reproduced"),
        (4, 0.83, None, "better"),
        # Cut short, it may still be good enough.
        (3, 1.51, 120.0, "stopped by the time limit"),
        (3, 1.0, 120.0, "reproduced"),
        (3, 0.5, 120.0, "better"),
    ],
)
def test_the_rule_of_the_verdicts(table, ratio, limit, expected, monkeypatch):
    monkeypatch.setitem(TABLES, table, PAPERS_TABLES[table])
    row = TABLES[table][0]
    result = SimpleNamespace(median={"mean_many_mm": ratio * row.mean_mm}, time_limit_s=limit)
    for method in METHODS:
        assert verdict(table, row, method, result) == expected
        assert verdict(table, row, method, None) == "skipped"


def test_only_distinct_rows_that_did_not_fit_the_box_are_judged(monkeypatch):
    for table, rows in PAPERS_TABLES.items():
        monkeypatch.setitem(TABLES, table, rows)

    def judged(table, method):
        result = SimpleNamespace(median={"mean_many_mm": 1e9}, time_limit_s=None)
        return [row.row for row in TABLES[table] if verdict(table, row, method, result) == "not reached"]

    assert judged(2, "trainlm") == judged(2, "varpro") == [2, 3, 4, 5]
    assert judged(3, "trainlm") == list(range(1, 13))
    assert judged(3, "varpro") == list(range(1, 9))
    assert judged(4, "trainlm") == judged(4, "varpro") == [1, 2, 3]
    assert {(2, 1), (2, 12), (2, 17), (4, 4)} < BOX_FITTING_ROWS
    for row in TABLES[2][5:11]:
        assert verdict(2, row, "varpro", None) is None


# Stops and files ------------------------------------------------------------------------------------------------------


class Stopper:
    """Interrupts a reproduction at the n-th report of progress."""

    def __init__(self, after):
        self.left = after

    def __call__(self, share, note):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The trainings of table 2 without an interruption, and their files."""
    folder = tmp_path_factory.mktemp("whole")
    return reproduce(["table 2"], effort=EFFORT, folder=folder), sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("after", [1, pytest.param(3, marks=pytest.mark.weekly), 16])
def test_an_interrupted_reproduction_resumes_with_the_next_training_to_the_same_results(tmp_path, whole, after):
    """At the start of a training, in its middle, after others have finished."""
    with pytest.raises(KeyboardInterrupt):
        reproduce(["table 2"], effort=EFFORT, folder=tmp_path, progress=Stopper(after))
    finished = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert bool(finished) == (after == 16)
    resumed = reproduce(["table 2"], effort=EFFORT, folder=tmp_path)
    assert without_times(resumed) == without_times(whole[0])
    assert sorted(path.name for path in tmp_path.iterdir()) == whole[1]
    assert all(name.endswith(".json") for name in whole[1])
    assert all((tmp_path / name).stat().st_mtime_ns == time for name, time in finished.items())


def test_a_finished_training_does_not_run_again(tmp_path):
    shares = []
    parts = ["figure 4"]
    first = reproduce(parts, effort=EFFORT, folder=tmp_path, progress=lambda share, note: shares.append(share))
    count = len(shares)
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] == pytest.approx(1.0)  # shares of estimated time add up to rounding
    again = reproduce(parts, effort=EFFORT, folder=tmp_path, progress=lambda share, note: shares.append(share))
    assert to_plain(again) == to_plain(first)
    assert len(shares) == count


@pytest.mark.parametrize(
    "damage",
    [
        lambda kept: kept | {"fingerprint": "0" * 64},
        lambda kept: kept | {"weights": kept["weights"][:-1]},
        lambda kept: kept | {"weights": [*kept["weights"][:-1], None]},
        lambda kept: kept | {"weights": [*kept["weights"][:-1], 1e300]},
        lambda kept: kept | {"weights": [*kept["weights"][:-1], 10**400]},
        lambda kept: kept | {"angle_range": kept["angle_range"][::-1]},
        lambda kept: kept | {"point_range": [[0.0], [1.0]]},
        lambda kept: kept | {"epochs": -1},
        lambda kept: kept | {"epochs": 10**6},
        lambda kept: kept | {"epochs": "3"},
        lambda kept: kept | {"seconds": math.nan},
        lambda kept: kept | {"stop": 5},
        lambda kept: kept | {"stop": TIME_OVER, "limit_s": "9"},
        lambda kept: kept | {"ended": None},
        lambda kept: kept | {"reached": [[1.0, 1, 0.0]]},
        lambda kept: kept | {"curve": [[10**6, 1.0, 1.0]]},
        lambda kept: kept | {"curve": [[1, 1.0, -1.0]]},
        lambda kept: kept | {"curve": [["1", "1.0", "1.0"]]},
        lambda kept: kept | {"machine": {}},
        lambda kept: kept | {"more": 1},
        lambda kept: {key: value for key, value in kept.items() if key != "stop"},
        lambda kept: [],
    ],
)
def test_a_damaged_file_of_a_training_is_refused(tmp_path, damage):
    training = training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0)
    run_training(training, tmp_path, lambda share, note: None)
    (file,) = tmp_path.iterdir()
    file.write_text(json.dumps(damage(json.loads(file.read_text()))))
    with pytest.raises(InputError, match="not the file of a finished training.*delete it") as error:
        run_training(training, tmp_path, lambda share, note: None)
    assert error.value.file == file


def test_any_time_limit_is_kept(tmp_path):
    training = replace(training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0), time_limit_s=1e10)
    for _ in range(2):
        assert run_training(training, tmp_path, lambda share, note: None).limit_s == 1e10


def test_a_training_whose_result_cannot_be_written_does_not_begin(tmp_path):
    training = training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0)
    begun = []
    with pytest.raises(InputError, match="the folder .*missing does not exist"):
        run_training(training, tmp_path / "missing", lambda share, note: begun.append(share))
    assert not begun


def test_a_learning_curve_is_kept_and_may_be_missing_in_files_of_earlier_versions(tmp_path):
    training = training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0)
    done = run_training(training, tmp_path, lambda share, note: None)
    again = run_training(training, tmp_path, lambda share, note: None)
    assert again.curve == done.curve
    epochs, seconds, errors = np.array(done.curve).T
    assert (epochs[0], epochs[-1]) == (0, done.epochs)
    assert 1 < len(epochs) <= CURVE_POINTS
    assert (np.diff(epochs) > 0).all()
    assert (np.diff(seconds) >= 0).all()
    # The last point is the error of the network that is kept, on the poses that it was fitted to; the trainer weighs
    # each coordinate by its range, which differ by a third.
    angles, points = training.source.data(training.n_train, seed=0, stream=TRAINING_STREAM)
    assert errors[-1] == pytest.approx(np.sqrt(((done.predict(angles) - points) ** 2).mean()), rel=0.3)
    (file,) = tmp_path.iterdir()
    kept = json.loads(file.read_text())
    del kept["curve"]
    file.write_text(json.dumps(kept))
    assert run_training(training, tmp_path, lambda share, note: None).curve == ()


def test_half_a_file_and_one_that_is_too_large_are_refused(tmp_path, monkeypatch):
    training = training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0)
    done = run_training(training, tmp_path, lambda share, note: None)
    (file,) = tmp_path.iterdir()
    again = run_training(training, tmp_path, lambda share, note: None)
    np.testing.assert_array_equal(again.errors(10, TEST_STREAM), done.errors(10, TEST_STREAM))
    text = file.read_text()
    for damaged in (text[: len(text) // 2], "[" * 100_000, "[" * 100_000 + "]" * 100_000):
        file.write_text(damaged)
        refuses("delete it", run_training, training, tmp_path, lambda share, note: None)
    file.write_text(text)
    monkeypatch.setattr("truearm.wings.gao2017.training.LARGEST_FILE", 100)
    refuses("larger than 0.0001 MB", run_training, training, tmp_path, lambda share, note: None)
    file.unlink()
    file.mkdir()
    refuses("expected a file, got a folder", run_training, training, tmp_path, lambda share, note: None)


def test_a_training_of_another_recipe_is_another_training(monkeypatch):
    training = training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0)
    name = training.name
    monkeypatch.setattr("truearm.wings.gao2017.training.RECIPE", 0)
    assert training.name != name


def test_machine_and_time_of_day_are_kept_with_a_training(tmp_path):
    results = reproduce(["figure 7"], effort=EFFORT, folder=tmp_path)
    (file,) = tmp_path.iterdir()
    kept = json.loads(file.read_text())
    assert kept["machine"] == machine_data().model_dump()
    assert results.trained == (kept["ended"],) * 2
    kept["machine"]["cpu"] = "another"
    file.write_text(json.dumps(kept))
    assert reproduce(["figure 7"], effort=EFFORT, folder=tmp_path).machines == [kept["machine"]]
    both = reproduce(["figure 7", "figure 4"], effort=EFFORT, folder=tmp_path)
    assert {one["cpu"] for one in both.machines} == {"another", machine_data().cpu}
    assert len(both.machines) == 2


def test_evaluation_on_further_poses_is_not_training_time(tmp_path, monkeypatch):
    """A training of 3 epochs of 10 s, after each of which the evaluation takes 100 s."""
    clock = [0.0]

    def trainer(fit, weights, *, callback, **options):
        for number in range(3):
            clock[0] += 10
            callback(SimpleNamespace(epoch=number, seconds=clock[0], perf=1.0, weights=lambda: weights))
        return weights, SimpleNamespace(perf=[1.0] * 3, time=[clock[0]], stop="")

    def progress(share, note):
        clock[0] += 100

    monkeypatch.setattr("truearm.wings.gao2017.training.process_time", lambda: clock[0])
    monkeypatch.setitem(TRAINERS, "varpro", trainer)
    # Levels that are reached at once, and never.
    training = replace(training_of(2, TABLES[2][0], "varpro", EFFORT, seed=0), levels_mm=(1e-9, 1e9))
    result = run_training(training, tmp_path, progress)
    assert clock[0] == 330
    assert result.seconds == 30
    assert result.reached == ((1e9, 0, 10.0),)
