"""The error of the experiment against its box: what is kept, and the half-width that follows from it."""

import pytest

from truearm.wings.gao2017.claim_figures import (
    BoxRun,
    ExperimentBoxStudy,
    experiment_box_figure,
    load_experiment_box,
    widths_at,
)
from truearm.wings.gao2017.results import GOAL_MET, TIME_OVER
from truearm.wings.gao2017.tables import TABLES
from truearm.wings.gao2017.training_plan import EXPERIMENT

MOST_EPOCHS = "Maximum epoch reached."


def made_up(widths, errors, *, method="trainlm", stop=GOAL_MET):
    return [
        BoxRun(width, method, 0, 500, stop, error, 10 * error, 100.0)
        for width, error in zip(widths, errors, strict=True)
    ]


def test_the_half_width_of_an_error_is_interpolated_in_its_logarithm():
    study = ExperimentBoxStudy("", tuple(made_up([10.0, 20.0], [0.01, 0.04])))
    assert widths_at(study, 0.02) == pytest.approx([15.0])  # half way: twice, and twice again
    assert widths_at(study, 0.01) == [10.0]
    assert widths_at(study, 0.05) == []


def test_starts_of_one_box_count_by_their_median():
    runs = [BoxRun(12.0, "trainlm", seed, 1, GOAL_MET, error, 1.0, 1.0) for seed, error in enumerate((1.0, 9.0, 2.0))]
    assert ExperimentBoxStudy("", tuple(runs)).median_mm("trainlm") == {12.0: 2.0}


def test_the_box_of_the_experiment_follows_from_the_trainings_that_are_kept():
    """In whole degrees, the widest box in which a training at the goal errs no more than the paper's network."""
    study = load_experiment_box()
    (widest,) = widths_at(study, TABLES[4][-1].mean_mm)
    assert int(widest) == EXPERIMENT.half_width_deg
    at_the_goal = [run for run in study.runs if run.method == "trainlm" and abs(run.half_width_deg - widest) < 2]
    assert {run.stop for run in at_the_goal} == {GOAL_MET}
    assert TIME_OVER not in {run.stop for run in study.runs}
    assert study.how.startswith("python -m benchmarks paper box")


def test_the_figure_counts_the_trainings_that_met_the_goal():
    runs = [
        *made_up([10.0, 12.0], [0.01, 0.02]),
        *made_up([20.0], [0.03], stop=MOST_EPOCHS),
        *made_up([10.0, 20.0], [0.007, 0.008], method="varpro", stop=MOST_EPOCHS),
    ]
    figure = experiment_box_figure(ExperimentBoxStudy("", tuple(runs)), chosen=12.0)
    assert "2 of 3 trainings by trainlm met the goal" in " ".join(figure.alt.split())
    assert "\u00b112 deg" in figure.caption
