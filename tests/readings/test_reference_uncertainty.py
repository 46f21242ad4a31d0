"""Uncertainties of the reference that readings share: where they are stated, and what they mean for repeats."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from refusals import refuses
from truearm.readings import Session, read_session
from truearm.readings.reference_uncertainty import common_variance_of_repeats, scale_errors

RNG = np.random.default_rng(3)
POINTS = RNG.normal(0, 500, (6, 3))


def session(**more):
    return Session(np.zeros((6, 2)), POINTS, **more)


def test_they_survive_the_session_file(tmp_path):
    whole = session(u_scale_ppm=np.full(6, 5.0), u_common_mm=np.full(6, 0.01), position=list("AABBCC"))
    whole.save(tmp_path / "s.csv")
    again = read_session(tmp_path / "s.csv")
    np.testing.assert_array_equal(again.u_scale_ppm, whole.u_scale_ppm)
    np.testing.assert_array_equal(again.u_common_mm, whole.u_common_mm)
    np.testing.assert_array_equal(again.rows([1, 4]).u_common_mm, [0.01, 0.01])
    np.testing.assert_array_equal(Session.from_frame(whole.to_frame()).u_scale_ppm, whole.u_scale_ppm)


@pytest.mark.parametrize(
    ("column", "cells", "message"),
    [
        ("u_scale_ppm", [5.0, 6.0], "one u_scale_ppm in all readings of a session, got 6 beside 5"),
        ("u_common_mm", [0.01, 0.02], "one u_common_mm in all readings"),
        ("u_scale_ppm", [-1.0, -1.0], "u_scale_ppm from 0 to 10000, got -1"),
        ("u_common_mm", [5.0, 5.0], "u_common_mm from 0 to 1, got 5"),
        ("u_scale_ppm", [np.nan, np.nan], "finite number"),
    ],
)
def test_impossible_ones_are_refused(column, cells, message):
    frame = pd.DataFrame({"q1_deg": [0.0, 1.0], "x_mm": [1.0, 2.0], "y_mm": 0.0, "z_mm": 0.0, column: cells})
    refuses(message, Session.from_frame, frame)


def test_a_misspelt_column_is_guessed():
    refuses("u_scale_ppm", Session.from_frame, pd.DataFrame({"q1_deg": [0.0], "u_scal_ppm": [1.0]}))


def test_sessions_may_differ():
    two = session(u_scale_ppm=np.repeat([5.0, 8.0], 3), session=np.repeat(["May", "June"], 3))
    assert two.u_scale_ppm[-1] == 8.0
    refuses("of a session", replace, two, session=None)


def test_the_mean_of_repeats_keeps_their_common_error():
    """m readings with ``s^2 + m u^2`` each have the mean of variance ``s^2 / m + u^2``, as by the block covariance."""
    u, s, position = 0.02, 0.01, ["A", "A", "A", "B", "", ""]
    variance, of_repeats = common_variance_of_repeats(session(u_common_mm=np.full(6, u), position=position))
    information = 1 / (s**2 + variance + of_repeats)
    block = s**2 * np.eye(3) + u**2
    assert information[:3].sum() == pytest.approx(np.linalg.inv(block).sum(), rel=1e-12)
    np.testing.assert_allclose(information[3:], 1 / (s**2 + u**2), rtol=1e-12)


def test_readings_without_a_point_are_no_repeats():
    points = POINTS.copy()
    points[1] = np.nan
    some = Session(np.zeros((6, 2)), points, position=list("AABBCC"), u_common_mm=np.full(6, 0.1))
    np.testing.assert_allclose(common_variance_of_repeats(some)[1], [0, 0, 0.01, 0.01, 0.01, 0.01])


def test_the_error_of_a_scale_is_about_the_mean_point_or_the_origin():
    whole = session(u_scale_ppm=np.full(6, 50.0))
    np.testing.assert_allclose(scale_errors(whole, is_frame_free=True)[:, :3], 5e-5 * (POINTS - POINTS.mean(axis=0)))
    np.testing.assert_allclose(scale_errors(whole, is_frame_free=False)[:, :3], 5e-5 * POINTS)
    assert not scale_errors(session(), is_frame_free=True).any()
