"""``truearm refit``: the arm in a new set-up, and tests that leave out what it learned from."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from truearm.models.model_file import load_model
from truearm.readings import read_session

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def moved(made, tmp_path_factory):
    """The test readings as a tracker saw them that stands elsewhere: 100 rows at 50 positions."""
    table = pd.read_csv(made / "test.csv")
    points = table[["x_mm", "y_mm", "z_mm"]].to_numpy()
    table[["x_mm", "y_mm", "z_mm"]] = points @ Rotation.from_rotvec([0.3, 2.0, -1.0]).as_matrix().T + [900, -2000, 400]
    table["position"] = [f"P{i // 2}" for i in range(100)]
    path = tmp_path_factory.mktemp("moved") / "moved.csv"
    table.to_csv(path, index=False)
    return path


@pytest.fixture
def refit(truearm, made, moved, tmp_path):
    """Refit the kinematic model to the moved session."""

    def run(*more, model="kinematic", session=moved):
        return truearm("refit", made / f"{model}.truearm", session, "--out", tmp_path / "new.truearm", *more)

    return run


def test_twenty_rows_are_used_and_the_others_test(truearm, made, moved, refit, tmp_path):
    out = tmp_path / "new.truearm"
    ran = refit("--rows", 20, "--seed", 3)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[0].startswith("Standard uncertainty of a coordinate 0.0")
    assert lines[0].endswith(" in the new set-up (median; base and tip of gao2017 from 20 of 100 readings).")
    assert lines[1].startswith("residual standard deviation: 0.0")
    assert lines[2] == "evaluate skips these 20 readings and tests on the others of this session."
    assert lines[3] == f"model written to {out}"
    session, model = read_session(moved), load_model(out)
    used = model.trained_on(session)
    assert used.sum() == 20
    assert len(np.unique(session.position[used])) == 20
    said = truearm("evaluate", out, moved).out.splitlines()
    assert "20 of 100 are training readings of the model and are skipped: all figures are of others." in said
    assert said[1].split()[:2] == ["80", "readings"]
    told = json.loads(truearm("evaluate", out, moved, "--json").out)
    assert (told["n"], told["n_training"]) == (80, 20)
    off = np.linalg.norm(model.predict(session.angles) - session.points, axis=1)[~used]
    assert told["mean_mm"] == pytest.approx(off.mean(), rel=1e-12)
    # As good as the arm was in its own set-up, but for what 20 readings of 0.012 mm of noise leave open.
    alone = json.loads(truearm("evaluate", made / "kinematic.truearm", made / "test.csv", "--json").out)
    assert told["mean_mm"] < 1.3 * alone["mean_mm"]
    page = truearm("report", out, moved, "--page", tmp_path / "r.html")
    assert page.out.startswith("1 model compared on 80 readings: mean error ")
    assert "\n20 of 100 are training readings of the model and are " in page.out
    assert page.out.endswith(f"page written to {tmp_path / 'r.html'}\n")


def test_the_seed_chooses(refit, moved, tmp_path):
    session, chosen = read_session(moved), []
    for seed in (1, 2, 1):
        assert refit("--rows", 6, "--seed", seed).code == 0
        chosen.append(np.flatnonzero(load_model(tmp_path / "new.truearm").trained_on(session)).tolist())
    assert chosen[0] == chosen[2] != chosen[1]


def test_all_rows_by_default_and_then_no_test_is_left(truearm, refit, moved, tmp_path):
    assert "base and tip of gao2017 from 100 readings)." in refit().out
    said = truearm("evaluate", tmp_path / "new.truearm", moved).out.splitlines()
    assert said[1].split()[:2] == ["100", "readings"]
    assert said[-1] == "100 of 100 are training readings of the model: a fair test needs others (split)."


def test_json_tells_what_was_found(refit, made, moved, tmp_path):
    table = pd.read_csv(moved)
    table.loc[57, "y_mm"] += 3
    table.to_csv(tmp_path / "s.csv", index=False)
    told = json.loads(refit("--json", session=tmp_path / "s.csv").out)
    known = load_model(made / "kinematic.truearm")
    new = load_model(tmp_path / "new.truearm")
    assert told.pop("fit_seconds") > 0
    assert told.pop("median_u_mm") < 0.03
    assert told.pop("summary").startswith("Standard uncertainty of a coordinate 0.0")
    (outlier,) = told.pop("outliers")
    assert (outlier["row"], outlier["line"]) == (57, 59)
    assert told == {
        "file": str(tmp_path / "new.truearm"),
        "free": ["base", "tip"],
        "n_used": 100,
        "n_readings": 100,
        "residual_std_mm": new.residual_std_,
        "residual_std_before_mm": known.residual_std_,
        "residual_process": None,
        "accepted": [],
        "remarks": [],
    }
    said = refit(session=tmp_path / "s.csv").out
    assert "outlier: line 59, " in said  # the header is line 1


def test_readings_that_scatter_more_are_said(refit, made, moved, tmp_path):
    table = pd.read_csv(moved)
    table[["x_mm", "y_mm", "z_mm"]] += np.random.default_rng(0).normal(0, 0.2, (100, 3))
    table.to_csv(tmp_path / "s.csv", index=False)
    said = refit(session=tmp_path / "s.csv").out
    assert " mm before: the new readings scatter more\n" in said
    table[["x_mm", "y_mm", "z_mm"]] = load_model(tmp_path / "new.truearm").predict(read_session(moved).angles)
    table.to_csv(tmp_path / "s.csv", index=False)
    before = load_model(made / "kinematic.truearm").residual_std_
    said = refit(session=tmp_path / "s.csv").out
    assert (
        f"residual standard deviation: {before:.4f} mm of a coordinate, unexplained by the model, as before\n" in said
    )


def test_seats_without_points_tell_the_tip(truearm, refused, made, tmp_path):
    session = tmp_path / "held.csv"
    truearm(
        "simulate", "gao2017", "--strategy", "seat", "--seats", 3, "--poses", 45, "--no-reference", "--out", session
    ).done()
    out = tmp_path / "new.truearm"
    ran = truearm("refit", made / "kinematic.truearm", session, "--rows", 20, "--out", out).done()
    assert "; tip of gao2017 from 20 of 45 readings)." in ran.out
    assert "The base stays where it was: only reference points determine it.\n" in ran.out
    told = json.loads(truearm("evaluate", out, session, "--json").out)
    assert (told["n_in_seats"], told["n_training"]) == (25, 20)
    told_before = json.loads(truearm("evaluate", made / "kinematic.truearm", session, "--json").out)
    # The true tip is where it was.
    assert told["seat_mean_mm"] < 1.2 * told_before["seat_mean_mm"]
    refused(
        ["refit", made / "kinematic.truearm", session, "--free", "base", "--out", out],
        "the position of the base needs reference points",
    )


def test_known_lengths_go_along(truearm, refused, made, tmp_path):
    session, lengths = tmp_path / "p.csv", tmp_path / "l.csv"
    truearm("simulate", "gao2017", "--strategy", "seat", "--seats", 2, "--poses", 30, "--out", session)
    table = pd.read_csv(session)
    apart = np.linalg.norm(np.diff(table.groupby("seat")[["x_mm", "y_mm", "z_mm"]].mean().to_numpy(), axis=0))
    table.drop(columns=[name for name in table.columns if name.endswith("_mm")]).to_csv(session, index=False)
    lengths.write_text(f"seat_a,seat_b,length_mm,u_mm\nS1,S2,{apart:.4f},0.01\n")
    arguments = ["refit", made / "kinematic.truearm", session, "--lengths", lengths, "--out", tmp_path / "m.truearm"]
    assert truearm(*arguments).code == 0
    lengths.write_text("seat_a,seat_b,length_mm,u_mm\nS1,T,100,0.01\n")
    refused(arguments, "l.csv, line 2, column 'seat_b': the session has no seat 'T'")


def test_lengths_are_of_the_whole_session_and_those_between_rows_taken_serve(truearm, refused, made, tmp_path):
    """Nine readings are in three of six seats (of this seed); of the last one there is no other."""
    session, lengths, out = tmp_path / "p.csv", tmp_path / "l.csv", tmp_path / "m.truearm"
    truearm(
        "simulate", "gao2017", "--strategy", "seat", "--seats", 6, "--poses", 30, "--no-reference", "--out", session
    )
    table = pd.read_csv(session)
    table = table.drop(index=table.index[table["seat"] == "S6"][1:])
    table.to_csv(session, index=False)
    points = read_session(session)
    tips = load_model(made / "kinematic.truearm").predict(points.angles)
    where = [tips[points.seat == f"S{i}"].mean(axis=0) for i in range(1, 7)]
    apart = [np.linalg.norm(where[i] - where[i + 1]) for i in (0, 2, 4)]
    rows = [f"S{i},S{i + 1},{length:.4f},0.05" for i, length in zip((1, 3, 5), apart, strict=True)]
    lengths.write_text("\n".join(["seat_a,seat_b,length_mm,u_mm", *rows]) + "\n")
    arguments = ["refit", made / "kinematic.truearm", session, "--rows", 9, "--seed", 2,
                 "--lengths", lengths, "--out", out]  # fmt: skip
    ran = truearm(*arguments).done()
    assert set(points.seat[load_model(out).trained_on(points)].tolist()) == {"S3", "S4", "S6"}
    assert "2 of 3 lengths refer to a seat without a reading that is used; ignored.\n" in ran.out
    ran = truearm("evaluate", out, session, "--lengths", lengths, "--json")
    told = json.loads(ran.out)
    assert (told["n_training"], len(told["lengths"])) == (9, 2)
    gone = "1 of 3 lengths refer to a seat without a reading that is used; ignored."
    assert gone in told["remarks"]
    ran = truearm("report", out, session, "--lengths", lengths, "--page", tmp_path / "r.html")
    assert (ran.code, gone in ran.out) == (0, True)
    lengths.write_text("seat_a,seat_b,length_mm,u_mm\nS1,T,100,0.01\n")
    refused(arguments, "the session has no seat 'T'")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--rows", 3], "expected 4 or more readings with a reference, got 3"),
        (["--rows", 101], "expected a number of rows from 1 to the 100 readings with reference points, got 101"),
        (["--rows", 0], "--rows"),
        (["--free", "none"], "expected base or tip to be free"),
        (["--free", "elbow"], "--free expects base, tip"),
        (["--lengths", "none.csv"], "lengths are between seats, and the session has none"),
    ],
)
def test_what_is_asked_wrongly_is_refused(refit, tmp_path, snapshot, more, said):
    ran = refit(*more)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err
    assert ran.err.count("\n") == 1
    assert snapshot(tmp_path) == {}


def test_what_does_not_fit_is_refused(refit, made, moved, tmp_path):
    for more, said in (
        ({"model": "network"}, "expected a nominal, kinematic or physical model, got a NetworkModel"),
        ({"session": made / "angles.csv"}, "expected reference points, seats or 4 distances to an anchor to refit to"),
        ({"session": made / "wam.csv"}, "expected 6 joints, got 7"),
        ({"session": made / "none.csv"}, "does not exist"),
    ):
        ran = refit(**more)
        assert (ran.code, ran.out) == (2, ""), more
        assert said in ran.err
    assert not (tmp_path / "new.truearm").exists()
    table = pd.read_csv(moved)
    table[["q2_deg", "q3_deg"]] = table[["q3_deg", "q2_deg"]].to_numpy()
    table.to_csv(tmp_path / "swapped.csv", index=False)
    ran = refit(session=tmp_path / "swapped.csv")
    assert (ran.code, "the readings are of another arm" in ran.err) == (2, True)


def test_readings_are_not_written_over(refused, made, moved):
    before = moved.read_bytes()
    refused(["refit", made / "kinematic.truearm", moved, "--out", moved], "would be overwritten")
    assert moved.read_bytes() == before
