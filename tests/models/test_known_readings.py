"""A test on readings of the training is recognised by what was measured, however the file was written."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from truearm.models import load_model

N = 59


@pytest.fixture(scope="module")
def session():
    return replace(
        simulated := ta.simulate("ur10", poses=N + 40, seed=1).session, temperature_degC=np.full(len(simulated), 24.0)
    )


@pytest.fixture(scope="module")
def model(session, tmp_path_factory):
    path = tmp_path_factory.mktemp("known") / "m.truearm"
    ta.fit("ur10", session.rows(np.arange(N)), model="nominal").save(path)
    return load_model(path)


COPIES = {
    "another order": lambda s: s.rows(np.random.default_rng(1).permutation(N)),
    "a millionth": lambda s: replace(s, points=s.points + 1e-6, angles=s.angles + 1e-6),
    "a column less": lambda s: replace(s, temperature_degC=None, position=None),
    "3 decimals": lambda s: replace(s, points=s.points.round(3), angles=np.radians(np.degrees(s.angles).round(3))),
    "2 decimals": lambda s: replace(s, points=s.points.round(2), angles=np.radians(np.degrees(s.angles).round(2))),
    "a row less": lambda s: s.rows(np.arange(N - 1)),
}


@pytest.mark.parametrize("name", COPIES)
def test_a_copy_of_the_training_is_no_test(model, session, name):
    copy = COPIES[name](session.rows(np.arange(N)))
    assert f"{len(copy)} of {len(copy)} are training readings of the model" in str(ta.evaluate(model, copy))


def test_figures_are_those_of_the_readings_that_are_new(model, session):
    found, fair = ta.evaluate(model, session), ta.evaluate(model, session.rows(np.arange(N, N + 40)))
    assert "59 of 99 are training readings of the model and are skipped" in str(found)
    assert found.n_training == N
    assert found.errors == fair.errors
    assert "training readings" not in str(fair)


def test_one_row_changed_is_the_one_that_is_tested(model, session):
    points = session.points.copy()
    points[3] += 0.1
    found = ta.evaluate(model, replace(session, points=points).rows(np.arange(N)))
    assert (found.n_training, found.errors["model"]["n"]) == (N - 1, 1)


def test_parts_of_a_large_session_are_judged_as_one(model, session, tmp_path):
    for name, rows in (("a", np.arange(30)), ("b", np.arange(30, N))):
        session.rows(rows).save(tmp_path / f"{name}.csv")
    assert "59 of 59 are training readings of the model" in str(ta.evaluate(model, tmp_path))


def test_repeats_that_were_merged_are_known_one_by_one(session):
    mixed = session.rows(np.concatenate([np.repeat(np.arange(20), 3), np.arange(20, 30)]))
    mixed = replace(mixed, points=mixed.points + np.random.default_rng(2).normal(0, 0.005, mixed.points.shape))
    model = ta.fit("ur10", mixed.rows(np.arange(60)), model="nominal").model
    assert model.training_.n_readings == 20
    assert model.trained_on(mixed).tolist() == [True] * 60 + [False] * 10


def test_the_same_poses_measured_again_are_a_test(model, session):
    """A robot returns to within 0.01 mm, and a tracker shows it."""
    rng = np.random.default_rng(3)
    again = replace(session, points=session.points + rng.normal(0, 0.01, session.points.shape))
    assert not model.trained_on(again.rows(np.arange(N))).any()


def test_what_a_sample_knows_is_said_of_all():
    many = ta.simulate("ur10", poses=700, seed=4).session
    model = ta.fit("ur10", many, model="nominal").model
    said = str(ta.evaluate(model, many.rows(np.arange(350))))
    assert "about 350 of 350 are training readings of the model (its file knows 500 of 700)" in said
    assert len(model.training_.known.numbers) == 500
    there = replace(many, points=many.points + [100.0, 0, 0])
    moved = ta.refit(model, there, n_readings=20).model
    found = ta.evaluate(moved, there)
    assert (found.n_training, found.errors["model"]["n"]) == (20, 680)
    assert "training readings of the model (its" not in str(found)
