"""Two sessions in one file, tracker and arm metres apart: fit, evaluate and predict find each in its frame."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from truearm.readings import read_session, write_session


def test_a_file_of_two_sessions_is_learned_from_and_found_again(truearm, made, tmp_path):
    readings = read_session(made / "test.csv")  # 100 readings of a virtual arm
    later = np.arange(100) >= 60
    points = readings.points.copy()
    points[later] = Rotation.from_rotvec([0.5, -2.0, 1.0]).apply(points[later]) + [30_000.0, -500, 80]
    session = np.where(later, "June", "May")
    write_session(replace(readings, points=points, session=session), tmp_path / "s.csv")

    ran = truearm("fit", tmp_path / "s.csv", "--arm", "gao2017", "--model", "kinematic", "--out", tmp_path / "m").done()
    assert "Each session has a frame of its own: coordinates are in that of session May, those of " in ran.out
    errors = json.loads(truearm("evaluate", tmp_path / "m", tmp_path / "s.csv", "--json").out)
    assert errors["max_mm"] < 0.5
    assert errors["removed_percent"] > 80
    ran = truearm("predict", tmp_path / "m", tmp_path / "s.csv", "--out", tmp_path / "p.csv").done()
    assert "no session that the model knows" not in ran.out
    ran = truearm("predict", tmp_path / "m", made / "angles.csv", "--out", tmp_path / "q.csv")
    assert "40 readings are in no session that the model knows: their points are in the frame of May" in ran.out
    table = pd.read_csv(tmp_path / "p.csv")
    assert table["session"].tolist() == session.tolist()
    assert np.abs(table[["x_mm", "y_mm", "z_mm"]] - points).max(axis=None) < 0.5

    again = truearm("refit", tmp_path / "m", tmp_path / "s.csv", "--out", tmp_path / "m2")
    assert again.code != 0
    assert "refit identifies one frame" in again.err
    assert "truearm split --by session" in again.err


def test_names_that_a_model_without_names_cannot_compare_are_said(truearm, made, tmp_path):
    """Points of the old stylus, or in the frame of another day, look as good as any."""
    truearm("fit", made / "session.csv", "--arm", "gao2017", "--model", "kinematic", "--out", tmp_path / "m").done()
    table, known = pd.read_csv(made / "angles.csv"), made / "kinematic.truearm"  # its base is known

    def predicted(model, **names):
        table.assign(**names).to_csv(tmp_path / "s.csv", index=False)
        return truearm("predict", model, tmp_path / "s.csv", "--out", tmp_path / "p.csv").done().out

    assert (
        predicted(tmp_path / "m", tip="long").count("The readings are of the tip long, and the tip of the model") == 1
    )
    assert (
        predicted(tmp_path / "m", session="May").count("The readings are of session May, and the model knows no") == 1
    )
    assert "The readings are of 2 sessions" in predicted(tmp_path / "m", session=["May", "June"] * (len(table) // 2))
    assert "The readings are of " not in predicted(tmp_path / "m") + predicted(known, session="May")
