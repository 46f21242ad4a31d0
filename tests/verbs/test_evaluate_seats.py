"""Evaluation without a reference instrument: seats, known lengths, and sessions of both kinds."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import truearm as ta
from truearm.arm import load_arm
from truearm.models import KinematicModel, NominalModel
from truearm.readings import Session, seat_errors, write_session

pytestmark = pytest.mark.usefixtures("undrawn")

POINT_KEYS = {
    *("mean_mm", "rms_mm", "p95_mm", "max_mm", "mean_abs_coordinate_mm", "max_abs_coordinate_mm"),
    *("removed_percent", "n"),
}
EVERY_KEY = {
    *("summary", "nominal", "coverage", "coverage_99", "repeatability_coverage", "conditions", "n_training"),
    *("outliers", "remarks"),
}
SEAT_KEYS = {"seat_mean_mm", "seat_rms_mm", "seat_max_mm", "n_in_seats", "seats"}
SEATS = np.array([""] * 4 + ["A"] * 5 + ["B"] * 3)
LENGTHS = "seat_a,seat_b,length_mm,u_mm\nA,B,{},0.05\n"


@pytest.fixture(scope="module")
def arm():
    return load_arm("gao2017")


@pytest.fixture(scope="module")
def angles(arm):
    low, high = arm.working + np.array([[-0.3], [0.3]])
    return np.random.default_rng(5).uniform(low, high, (12, 6))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, arm, angles):
    """The arm as drawn, and one that was identified from readings with noise, as model files."""
    folder = tmp_path_factory.mktemp("models")
    rng = np.random.default_rng(6)
    training = arm.working + rng.uniform(-0.3, 0.3, (40, 6))
    tips = arm.chain.tip_in_base(training)
    NominalModel(arm, free=()).fit(training, tips).save(folder / "nominal.truearm")
    off = tips + rng.normal(scale=0.5, size=tips.shape)
    KinematicModel(arm, free=()).fit(training, off).save(folder / "kinematic.truearm")
    return folder


@pytest.fixture
def session(tmp_path):
    """Write a session file."""

    def write(angles, *, name="s.csv", **fields):
        write_session(Session(angles, **fields), tmp_path / name)
        return tmp_path / name

    return write


def test_a_session_of_seats_alone(truearm, folder, session, arm, angles):
    path = session(angles[4:], seat=SEATS[4:])
    ran = truearm("evaluate", folder / "nominal.truearm", path, "--json").done()
    found = json.loads(ran.out)
    assert set(found) - EVERY_KEY == SEAT_KEYS
    by_hand = seat_errors(arm.chain.tip_in_base(angles[4:]), SEATS[4:])
    assert found["n_in_seats"] == 8
    # Angles in degrees come back to 1e-15 of them: 1e-9 mm at this arm's reach is far above that.
    assert found["seat_mean_mm"] == pytest.approx(by_hand["seat_mean_mm"], abs=1e-9)
    assert found["seats"]["B"]["max_mm"] == pytest.approx(by_hand["seats"]["B"]["max_mm"], abs=1e-9)
    table = [line.split() for line in truearm("evaluate", folder / "kinematic.truearm", path).out.splitlines()]
    assert table[1] == ["8", "readings", "in", "2", "seats", "nominal", "model"]
    assert table[2][:2] == ["seat_mean_mm", f"{by_hand['seat_mean_mm']:.4f}"]
    assert [row[0] for row in table[2:5]] == ["seat_mean_mm", "seat_rms_mm", "seat_max_mm"]


def test_a_known_length_is_compared_with_that_between_the_mean_points(truearm, folder, session, arm, angles, tmp_path):
    tips = arm.chain.tip_in_base(angles)
    between = np.linalg.norm(tips[4:9].mean(axis=0) - tips[9:].mean(axis=0))
    path, lengths = session(angles[4:], seat=SEATS[4:]), tmp_path / "lengths.csv"
    lengths.write_text(LENGTHS.format(between + 0.25))
    arguments = ["evaluate", folder / "nominal.truearm", path, "--lengths", lengths]
    found = json.loads(truearm(*arguments, "--json").out)
    assert set(found) - EVERY_KEY == {*SEAT_KEYS, "lengths"}
    assert found["lengths"][0] == {
        "seat_a": "A",
        "seat_b": "B",
        "length_mm": between + 0.25,
        "u_mm": 0.05,
        "length_error_mm": pytest.approx(-0.25, abs=1e-9),
    }
    ran = truearm(*arguments)
    assert ran.err == ""
    lines = [line.split() for line in ran.out.splitlines()]
    assert ["A", "to", "B", f"{between + 0.25:.4f}", "0.0500", "-0.2500"] in lines


def test_points_and_seats_in_one_session(truearm, folder, session, arm, angles):
    """Each kind is counted by itself: points where there are points, seats where there are seats."""
    tips = arm.chain.tip_in_base(angles)
    points = np.where((np.arange(12) < 4)[:, None], tips + [0.3, 0, 0], np.nan)
    path = session(angles, points=points, seat=SEATS)
    found = json.loads(truearm("evaluate", folder / "nominal.truearm", path, "--json").out)
    assert set(found) - EVERY_KEY == POINT_KEYS | SEAT_KEYS
    assert (found["n"], found["n_in_seats"]) == (4, 8)
    assert found["mean_mm"] == pytest.approx(0.3, abs=1e-9)
    by_hand = seat_errors(tips, SEATS)
    assert found["seat_rms_mm"] == pytest.approx(by_hand["seat_rms_mm"], abs=1e-9)
    said = truearm("evaluate", folder / "kinematic.truearm", path).out
    assert said.splitlines()[1].startswith("4 readings")
    assert "8 readings in 2 seats" in said


def test_a_column_of_seats_used_once_each_changes_nothing(truearm, folder, session, arm, angles):
    points = arm.chain.tip_in_base(angles) + 0.1
    names = np.array([f"seat {i}" for i in range(12)])
    found = truearm("evaluate", folder / "nominal.truearm", session(angles, points=points, seat=names), "--json").out
    assert set(json.loads(found)) - EVERY_KEY == POINT_KEYS


def test_lengths_of_held_out_seats_are_ignored_with_a_remark(truearm, folder, session, angles, tmp_path):
    lengths = tmp_path / "lengths.csv"
    lengths.write_text(LENGTHS.format(100) + "P,Q,100,0.1\n")
    path = session(angles[4:], seat=SEATS[4:])
    ran = truearm("evaluate", folder / "nominal.truearm", path, "--lengths", lengths, "--json")
    assert len(json.loads(ran.out)["lengths"]) == 1
    assert "1 of 2 lengths refer to seats that are not in this session; ignored." in json.loads(ran.out)["remarks"]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("A,Bb,100,0.1", ["lengths.csv, line 2, column 'seat_b': the session has no seat 'Bb'", "Try: B"]),
        ("P,Q,100,0.1", ["lengths.csv, line 2, column 'seat_a': the session has no seat 'P'"]),
        ("A,B,100,0", ["lengths.csv, line 2, column 'u_mm': expected a positive standard uncertainty"]),
    ],
)
def test_lengths_that_do_not_fit_are_refused(truearm, folder, session, angles, tmp_path, rows, said):
    (tmp_path / "lengths.csv").write_text("seat_a,seat_b,length_mm,u_mm\n" + rows + "\n")
    path = session(angles[4:], seat=SEATS[4:])
    ran = truearm("evaluate", folder / "nominal.truearm", path, "--lengths", tmp_path / "lengths.csv").refused()
    assert all(piece in ran.err for piece in said)


def test_what_cannot_be_evaluated_is_refused(truearm, refused, folder, session, arm, angles, tmp_path):
    (tmp_path / "lengths.csv").write_text(LENGTHS.format(100))
    model = folder / "nominal.truearm"
    bare = session(angles, name="bare.csv")
    unnamed = session(angles, name="unnamed.csv", seat=np.full(12, ""))
    once = session(angles[:2], name="once.csv", seat=np.array(["A", "B"]))
    seen = session(angles, name="seen.csv", points=arm.chain.tip_in_base(angles))
    for path in (bare, unnamed):
        refused(
            ["evaluate", model, path],
            "expected reference points, seats or 8 distances to an anchor to evaluate against, the session has none",
        )
    refused(["evaluate", model, once], "expected a seat with two or more readings")
    assert truearm("evaluate", model, once, "--lengths", tmp_path / "lengths.csv").code == 0
    refused(["evaluate", model, seen, "--lengths", tmp_path / "lengths.csv"], "the session has none")


def test_comparisons_use_the_readings_with_a_point_and_say_so(truearm, refused, folder, session, arm, angles, tmp_path):
    points = arm.chain.tip_in_base(angles)
    points[4:] = np.nan
    mixed = session(angles, points=points, seat=SEATS)
    ran = truearm("report", folder / "kinematic.truearm", mixed, "--page", tmp_path / "r.html").done()
    assert "8 of 12 readings have no reference point and are skipped." in ran.out
    assert "compared on 4 readings" in ran.out
    seats = session(angles, name="seats.csv", seat=SEATS)
    ran = truearm("report", folder / "kinematic.truearm", seats, "--page", tmp_path / "r.html")
    assert (ran.code, "compared on 8 readings" in ran.out) == (0, True)
    assert "4 of 12 readings are in no seat and are skipped." in ran.out
    refused(
        ["fit", mixed, "--arm", "gao2017", "--model", "network", "--out", tmp_path / "m.truearm"],
        "line 6: 8 of 12 readings have no reference point",
    )


def test_predictions_keep_every_name(truearm, folder, session, angles, tmp_path):
    given = {"seat": SEATS, "sphere": SEATS[::-1], "position": SEATS}
    path = session(angles, **given, quaternion=np.tile([1.0, 0, 0, 0], (12, 1)), columns={"load_1": np.ones(12)})
    assert truearm("predict", folder / "nominal.truearm", path, "--out", tmp_path / "p.csv").code == 0
    table = pd.read_csv(tmp_path / "p.csv", keep_default_na=False)
    assert set(given) <= set(table.columns)
    for name, words in given.items():
        assert table[name].tolist() == words.tolist()


def test_warm_lengths(truearm, folder, session, angles, tmp_path):
    """100 mm of steel at 30 degC are 100.0115 mm; without a temperature or a coefficient that is said."""
    lengths, bare, warm = tmp_path / "lengths.csv", tmp_path / "bare.csv", np.full(8, 30.0)
    lengths.write_text(
        "seat_a,seat_b,length_mm,u_mm,expansion_per_K,u_expansion_per_K\nA,B,100,0.001,0.0000115,0.000001\n"
    )
    bare.write_text("seat_a,seat_b,length_mm,u_mm\nA,B,100,0.001\n")
    found = {}
    for name, file, more in (("warm", lengths, {"temperature_degC": warm}), ("bare", bare, {"temperature_degC": warm}),
                             ("cold", lengths, {})):  # fmt: skip
        path = session(angles[4:], seat=SEATS[4:], **more)
        ran = truearm("evaluate", folder / "nominal.truearm", path, "--lengths", file, "--json")
        result = json.loads(ran.out)
        found[name] = (result["lengths"][0]["length_error_mm"], "".join(r for r in result["remarks"] if "engths" in r))
    assert found["bare"][0] - found["warm"][0] == pytest.approx(0.0115, abs=1e-9)
    assert found["cold"][0] == pytest.approx(found["bare"][0], abs=1e-9)
    assert found["warm"][1] == ""
    assert found["bare"][1].startswith(
        "1 of 1 lengths are used as at 20 degC; at the readings' 30.0 degC steel differs by 0.0115 mm."
    )
    assert found["cold"][1] == "Lengths are used as at 20 degC: the session states no temperature."


def test_an_uncertainty_that_may_be_in_micrometres_is_named(truearm, folder, session, angles, tmp_path):
    (tmp_path / "um.csv").write_text("seat_a,seat_b,length_mm,u_mm\nA,B,100,5\n")
    ran = truearm(
        "evaluate", folder / "nominal.truearm", session(angles[4:], seat=SEATS[4:]), "--lengths", tmp_path / "um.csv"
    ).done()
    assert "The standard uncertainty of the length in line 2, 5 mm, is 5.0% of it" in ran.out


def test_seats_that_are_missed_by_decimetres_have_the_likely_mistake(folder):
    """Of another arm, or with J3 turned round: without a serial number nothing else would say so."""
    held = ta.simulate("gao2017", strategy="seat", reference=False, poses=40, seed=3).session
    said = " ".join(ta.evaluate(folder / "kinematic.truearm", replace(held, serial_number=None)).remarks)
    assert "misses these seats" not in said
    turned = replace(held, angles=held.angles * [1, 1, -1, 1, 1, 1], serial_number=None)
    said = " ".join(ta.evaluate(folder / "kinematic.truearm", turned).remarks)
    assert "The nominal arm misses these seats by " in said
    assert "sign of J3 reversed" in said
