"""``truearm fit`` from points, seats and lengths: the model that is kept, what is said, what is refused."""

import json

import numpy as np
import pandas as pd
import pytest

from truearm.errors import InputError
from truearm.models import MODELS, PhysicalModel
from truearm.models.model_file import load_model

LENGTHS = "seat_a,seat_b,length_mm,u_mm\n"
STILL = "seat_a,seat_b,length_mm,u_mm,expansion_per_K,u_expansion_per_K\n"


@pytest.fixture(scope="module")
def shop(tmp_path_factory, truearm):
    """60 readings of one virtual arm in four seats: with points, without, with a few, and the lengths between seats."""
    folder = tmp_path_factory.mktemp("shop")
    made = truearm("simulate", "gao2017", "--strategy", "seat", "--seats", 4, "--poses", 60, "--out", folder / "p.csv")
    assert made.code == 0, made.err
    table = pd.read_csv(folder / "p.csv")
    reference = [name for name in table.columns if name.endswith("_mm")]
    table.drop(columns=reference).to_csv(folder / "seats.csv", index=False)
    mixed = table.copy()
    mixed.loc[mixed["seat"] == "S4", reference] = np.nan
    mixed.to_csv(folder / "mixed.csv", index=False)
    centres = table.groupby("seat")[["x_mm", "y_mm", "z_mm"]].mean().to_numpy()
    rows = [f"S1,S{i + 1},{np.linalg.norm(centres[0] - centres[i]):.4f},0.005,0,0\n" for i in (1, 2, 3)]
    (folder / "lengths.csv").write_text(STILL + "".join(rows))
    return folder


def fit(truearm, shop, session, out, *more):
    return truearm("fit", shop / session, "--arm", "gao2017", "--out", out, *more)


# What is kept and said -----------------------------------------------------------------------------------------------


def test_the_simplest_within_one_standard_error_is_kept(truearm, made, tmp_path):
    out = tmp_path / "m.truearm"
    ran = truearm("fit", made / "test.csv", "--arm", "gao2017", "--free", "none", "--out", out, "--json").done()
    told = json.loads(ran.out)
    table = told["comparison"]
    assert [row["name"] for row in table] == ["nominal", "kinematic", "physical"]
    best = min(table, key=lambda row: row["mean_mm"])
    most = best["mean_mm"] + best["standard_error_mm"]
    simplest = next(row["name"] for row in table if row["mean_mm"] <= most)
    assert [row["name"] for row in table if row["kept"]] == [simplest] == [told["model"]]
    assert type(load_model(out)) is MODELS[simplest]
    # The drawing errs by 0.87 mm, the noise floor is 0.015 mm: one of the others it must be.
    assert simplest != "nominal"
    assert table[1]["mean_mm"] < 0.05 * table[0]["mean_mm"]


def test_zeros_are_written_to_a_new_arm_file(truearm, refused, made, tmp_path):
    """Which the same arm's readings then fit; nothing is replaced unless that is asked for."""
    out, arm = tmp_path / "m.truearm", tmp_path / "my-arm.toml"
    command = ("fit", made / "test.csv", "--arm", "gao2017", "--model", "kinematic", "--out", out, "--apply", arm)
    assert json.loads(truearm(*command, "--json").done().out)["arm_file"] == str(arm)
    written = arm.read_bytes()
    assert b"joint zeros identified from" in written
    assert truearm("arms", arm).code == 0
    refused(command, "exists already")
    assert arm.read_bytes() == written
    assert truearm(*command, "--force").code == 0
    refused(
        ["fit", made / "test.csv", "--arm", "gao2017", "--model", "network", "--out", out, "--apply", arm],
        "--apply applies to",
    )


def test_no_arm_file_is_written_of_a_nominal_arm_and_no_model_is_lost(truearm, made, tmp_path, monkeypatch):
    out, arm = tmp_path / "m.truearm", tmp_path / "my-arm.toml"
    command = ("fit", made / "test.csv", "--arm", "gao2017", "--out", out, "--apply", arm)
    quick = ("--model", "hybrid", "--arm-model", "nominal", "--hidden", "2", "--epochs", "1", "--members", "2")
    assert f"{arm} is not written: the nominal arm was kept" in " ".join(truearm(*command, *quick).done().out.split())
    assert out.exists()
    assert not arm.exists()
    out.unlink()

    def full(*_):
        raise InputError("the disk is full", hint="another disk")

    monkeypatch.setattr("truearm.arm.write_arm", full)
    refused = truearm(*command, "--model", "kinematic")
    assert refused.code == 2
    assert f"another disk; the model is written to {out}" in " ".join(refused.err.split())
    assert out.exists()
    named = truearm(*command[:-1], tmp_path / "x.txt", "--model", "kinematic")
    assert "ends in .toml or .urdf, got 'x.txt'" in named.err


def test_seats_and_lengths_alone(truearm, shop, tmp_path):
    out = tmp_path / "m.truearm"
    ran = fit(truearm, shop, "seats.csv", out, "--lengths", shop / "lengths.csv")
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[1].startswith("Next: ")
    (table,) = [i for i, line in enumerate(lines) if line.startswith("held-out error [mm]")]
    rows = {line.split()[0]: line for line in lines[table + 1 : table + 4]}
    assert list(rows) == ["nominal", "kinematic", "physical"]
    (kept,) = [name for name, row in rows.items() if row.endswith("selected")]
    assert lines[0].startswith("Mean distance from the mean of the seat 0.0")
    assert " smaller than the nominal arm; largest error of 3 lengths 0.0" in lines[0]
    assert lines[0].endswith(f" ({kept} model of gao2017, 60 readings).")
    assert lines[table + 4].startswith("training error, distance from the mean of the seat: mean 0.0")
    assert any(line.startswith("residual standard deviation: ") for line in lines)
    assert "keeps its nominal size" not in ran.out
    assert lines[-1] == f"model written to {out}"
    told = json.loads(
        truearm("evaluate", out, shop / "seats.csv", "--lengths", shop / "lengths.csv", "--json").out
    )  # fmt: skip
    assert told["seat_mean_mm"] < 0.1
    assert all(abs(one["length_error_mm"]) < 0.03 for one in told["lengths"])
    # The points agree with those of the instrument but for where the base stands.
    model, table = load_model(out), pd.read_csv(shop / "p.csv")
    assert model.free_ == ("tip",)
    points = table[["x_mm", "y_mm", "z_mm"]].to_numpy()
    found = model.predict(np.radians(table[[f"q{i}_deg" for i in range(1, 7)]].to_numpy()))
    from truearm.identification.references.alignment import align

    T = align(found, points)
    off = np.linalg.norm(found @ T[:3, :3].T + T[:3, 3] - points, axis=1)
    assert off.mean() < 0.1


def test_without_a_length_the_arm_keeps_its_nominal_size_and_a_remark_says_so(truearm, shop, tmp_path):
    ran = fit(truearm, shop, "seats.csv", tmp_path / "m.truearm", "--model", "kinematic")
    assert (ran.code, ran.err) == (0, "")
    assert (
        "No reference point and no length is known: the arm keeps its nominal size, as uncertain as its lengths.\n"
        in ran.out
    )
    told = json.loads(
        fit(truearm, shop, "seats.csv", tmp_path / "m.truearm", "--model", "kinematic", "--json").out
    )  # fmt: skip
    assert set(told["training"]) == {"seat_mean_mm", "seat_rms_mm", "seat_max_mm", "n_in_seats"}
    assert set(told) == {
        "summary",
        "model",
        "arm",
        "file",
        "fit_seconds",
        "n_readings",
        "n_poses",
        "length_scale",
        "held_out",
        "training",
    } | {
        *("residual_std_mm", "comparison", "groups", "skipped_terms", "identifiability", "outliers"),
        *("length_outliers", "frame_changes", "held_out_distances", "residual_process", "remarks", "accepted"),
    }
    assert told["length_outliers"] == told["comparison"] == []
    assert told["remarks"] == [
        "No reference point and no length is known: the arm keeps its nominal size, as uncertain as its lengths."
    ]


def test_a_wrong_length_is_refused_or_named_and_a_sphere_of_three_readings_is_ignored(truearm, shop, tmp_path):
    lengths = pd.read_csv(shop / "lengths.csv")
    lengths["length_mm"] *= 1.2
    lengths.to_csv(tmp_path / "long.csv", index=False)
    ran = fit(truearm, shop, "seats.csv", tmp_path / "m.truearm", "--lengths", tmp_path / "long.csv")
    assert ran.code == 2
    assert "as the nominal arm has" in ran.err
    lengths["length_mm"] /= 1.2
    assert len(lengths) > 2
    lengths.loc[1, "length_mm"] += 2.0
    lengths.to_csv(tmp_path / "one.csv", index=False)
    readings = pd.read_csv(shop / "seats.csv", keep_default_na=False)
    readings["sphere"] = ["ball"] * 3 + [""] * (len(readings) - 3)
    readings.loc[:2, "seat"] = ""
    readings.to_csv(tmp_path / "s.csv", index=False)
    ran = truearm(
        *("fit", tmp_path / "s.csv", "--arm", "gao2017", "--out", tmp_path / "m.truearm", "--model", "kinematic"),
        *("--lengths", tmp_path / "one.csv"),
    ).done()
    assert "sphere ball has 3 usable readings; at least 4 are needed. Ignored.\n" in ran.out
    (line,) = [line for line in ran.out.splitlines() if line.startswith("contradictory length: ")]
    a, b = lengths.loc[1, ["seat_a", "seat_b"]]
    assert f"seats {a} and {b}: certificate value exceeds the value implied by the other data by " in line


def test_points_and_seats_together(truearm, refused, shop, tmp_path):
    out = tmp_path / "m.truearm"
    ran = fit(truearm, shop, "mixed.csv", out, "--model", "kinematic")
    assert (ran.code, ran.err) == (0, "")
    model = load_model(out)
    assert [reference.kind for reference in model.fit_.references] == ["point", "seat"]
    assert model.free_ == ("base", "tip")
    told = json.loads(truearm("evaluate", out, shop / "mixed.csv", "--json").out)
    assert (told["n"], told["n_in_seats"]) == (45, 60)
    assert told["mean_mm"] < 0.2
    assert told["seats"]["S4"]["mean_mm"] < 0.2
    # Where the points lie on a line, as in two seats, nobody knows where the base stands.
    table = pd.read_csv(shop / "mixed.csv")
    table.loc[table["seat"] == "S3", ["x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm"]] = np.nan
    table.to_csv(tmp_path / "two.csv", index=False)
    refused(
        ["fit", tmp_path / "two.csv", "--arm", "gao2017", "--out", tmp_path / "two.truearm"],
        "the 30 reference points lie within ",
    )


def test_outliers_are_named_by_their_line(truearm, shop, tmp_path):
    table = pd.read_csv(shop / "p.csv")
    table.loc[[10, 41], "z_mm"] += 5
    table.to_csv(tmp_path / "s.csv", index=False)
    ran = truearm(
        "fit", tmp_path / "s.csv", "--arm", "gao2017", "--model", "kinematic", "--out", tmp_path / "m.truearm"
    )
    far = [line for line in ran.out.splitlines() if line.startswith("outlier: ")]
    assert sorted(line.split(",")[0] for line in far) == ["outlier: line 12", "outlier: line 43"]


def test_terms_that_the_readings_cannot_show_are_named(truearm, made, tmp_path, monkeypatch):
    monkeypatch.setitem(PhysicalModel.__init__.__kwdefaults__, "highest", 4)
    command = "fit", made / "test.csv", "--arm", "gao2017", "--model", "physical", "--out", tmp_path / "m.truearm"
    short, ran = truearm(*command), truearm(*command, "--details")
    assert short.code == ran.code == 0
    details = "not offered: J1 orders 1 to 2, as J1 moved by ", "terms with most determined coefficients: "
    assert all(line in ran.out and line not in short.out for line in details)  # a box of 40 degrees
    added = len(ran.out.splitlines()) - len(short.out.splitlines()) + 1
    assert f"--details adds {added} lines for experts." in short.out.splitlines()


# What is refused -----------------------------------------------------------------------------------------------------


def test_lengths_that_do_not_fit_are_refused(truearm, refused, shop, made, tmp_path):
    lengths = tmp_path / "l.csv"
    for rows, session, said in (
        ("S1,S2,100,0.01\n", made / "test.csv", "lengths are between seats, and the session has none"),
        ("S1,S9,100,0.01\n", shop / "seats.csv", "l.csv, line 2, column 'seat_b': the session has no seat 'S9'"),
        ("S1,S2,100\n", shop / "seats.csv", "l.csv, line 2"),
        ("S1,S2,100,-1\n", shop / "seats.csv", "l.csv, line 2, column 'u_mm'"),
        ("S1,S1,100,0.01\n", shop / "seats.csv", "l.csv, line 2"),
        ("S1,S2,ten,0.01\n", shop / "seats.csv", "l.csv, line 2, column 'length_mm'"),
    ):
        lengths.write_text(LENGTHS + rows)
        refused(["fit", session, "--arm", "gao2017", "--lengths", lengths, "--out", tmp_path / "m.truearm"], said)
    ran = fit(truearm, shop, "seats.csv", tmp_path / "m.truearm", "--lengths", tmp_path / "none.csv")
    assert (ran.code, "none.csv" in ran.err) == (2, True)


def test_readings_that_tell_too_little_are_refused(truearm, shop, tmp_path):
    table = pd.read_csv(shop / "seats.csv")
    out = tmp_path / "m.truearm"

    def refused(rows, *more):
        rows.to_csv(tmp_path / "s.csv", index=False)
        ran = truearm("fit", tmp_path / "s.csv", "--arm", "gao2017", "--out", out, *more).refused()
        assert not out.exists()
        return ran.err

    for model in ("nominal", "kinematic", "auto"):
        few = refused(table.iloc[:3], "--model", model)
        assert "expected at least 4 readings, got 3" in few
        assert "measure more poses" in few
    once = table.copy()
    once["seat"] = [f"S{i}" for i in range(60)]
    assert "seats of two readings or more" in refused(once)
    assert "the readings have no reference at all" in refused(table.drop(columns="seat"))
    assert "reference" in refused(table, "--model", "network", "--hidden", 3)


def test_seats_of_another_arm_are_refused(truearm, shop, tmp_path):
    """A measuring arm's readings are none of a UR10, whose tip they would scatter by decimetres in each seat."""
    ran = truearm("fit", shop / "seats.csv", "--arm", "ur10", "--out", tmp_path / "m.truearm").refused()
    assert "outside its limits" in ran.err or "nominal arm 'ur10' misses its references by" in ran.err
