"""The whole path of a technician: simulate, split, fit, predict, evaluate, report; and what each verb says."""

import gc
import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from truearm import __version__
from truearm.command_line import COMMANDS, run
from truearm.models.model_file import load_model
from truearm.readings import read_session

pytestmark = pytest.mark.usefixtures("undrawn")

ERROR_KEYS = {
    *("mean_mm", "rms_mm", "p95_mm", "max_mm", "mean_abs_coordinate_mm", "max_abs_coordinate_mm"),
    *("removed_percent", "n"),
}
EVALUATION_KEYS = ERROR_KEYS | {
    *("summary", "nominal", "coverage", "coverage_99", "repeatability_coverage", "conditions", "n_training"),
    *("outliers", "remarks"),
}
FIT_KEYS = {
    *("summary", "model", "arm", "file", "fit_seconds", "n_readings", "n_poses", "held_out", "training"),
    *("comparison", "outliers", "length_outliers", "frame_changes", "held_out_distances", "remarks", "accepted"),
}
MODELS = ("nominal", "kinematic", "network")


# What there is -------------------------------------------------------------------------------------------------------


def test_a_program_that_calls_the_command_keeps_its_own_rule_of_garbage():
    before = gc.get_threshold()
    with pytest.raises(SystemExit):
        run(["--version"])
    assert gc.get_threshold() == before


@pytest.fixture(scope="module")
def overview(truearm):
    return truearm("--help").out


@pytest.mark.parametrize("verb", COMMANDS)
def test_every_verb_says_what_it_does(truearm, overview, verb):
    ran = truearm(verb, "--help").done()
    assert ran.out.startswith(f"Usage: truearm {verb} [OPTIONS]")
    # A sentence of its own below the usage, and a help text at every option.
    assert ran.out.split("\n\n")[1].strip().endswith(".")
    listed = [line for line in overview.splitlines() if line.startswith(f"  {verb} ")]
    assert len(listed) == 1
    assert listed[0].endswith(".")
    assert "..." not in listed[0]  # the sentence fits the list
    assert truearm(verb, "-h").out == ran.out


def test_the_program_alone_and_its_version(truearm, overview):
    assert truearm().done().out == overview
    assert truearm("--version").out == f"truearm {__version__}\n"
    module = subprocess.run([sys.executable, "-m", "truearm", "--version"], capture_output=True, text=True, check=True)
    assert module.stdout == f"truearm {__version__}\n"


def test_the_same_faults_and_answers_as_a_program_of_its_own(made, tmp_path):
    def program(*arguments):
        return subprocess.run([sys.executable, "-m", "truearm", *map(str, arguments)], capture_output=True, text=True)

    done = program("evaluate", made / "kinematic.truearm", made / "test.csv", "--json")
    assert (done.returncode, done.stderr) == (0, "")  # nothing of a bar where nobody watches
    assert set(json.loads(done.stdout)) == EVALUATION_KEYS
    wrong = program("predict", made / "kinematic.truearm", made / "no.csv", "--out", tmp_path / "p.csv")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr == f"truearm: {made / 'no.csv'}: the file does not exist\n"


# The path ------------------------------------------------------------------------------------------------------------


def test_split_parts_every_reading_once(made):
    whole, train, test = (read_session(made / f"{name}.csv") for name in ("session", "train", "test"))
    assert (len(train), len(test)) == (300, 100)
    rows = {tuple(row) for part in (train, test) for row in part.angles}
    assert rows == {tuple(row) for row in whole.angles}


@pytest.mark.parametrize("model", MODELS)
def test_evaluate_prints_json_with_the_promised_keys(truearm, made, model):
    ran = truearm("evaluate", made / f"{model}.truearm", made / "test.csv", "--json").done()
    errors = json.loads(ran.out)
    assert set(errors) == EVALUATION_KEYS
    test = read_session(made / "test.csv")
    off = load_model(made / f"{model}.truearm").predict(test.angles) - test.points
    distances = np.linalg.norm(off, axis=1)
    assert errors["n"] == 100
    for key, value in {
        "mean_mm": distances.mean(),
        "rms_mm": np.sqrt((distances**2).mean()),
        "max_mm": distances.max(),
        "mean_abs_coordinate_mm": np.abs(off).mean(),
        "max_abs_coordinate_mm": np.abs(off).max(),
    }.items():
        assert errors[key] == pytest.approx(value, rel=1e-12)
    assert distances.min() < errors["p95_mm"] < errors["max_mm"]


def test_the_kinematic_model_is_far_better_than_the_drawing(truearm, made):
    errors = {
        model: json.loads(truearm("evaluate", made / f"{model}.truearm", made / "test.csv", "--json").out)
        for model in MODELS
    }
    # The drawing errs by about 0.45 mm a coordinate, the noise floor is 0.007 mm.
    assert errors["nominal"]["mean_abs_coordinate_mm"] > 0.3
    assert errors["nominal"]["removed_percent"] == 0
    assert errors["kinematic"]["mean_abs_coordinate_mm"] < 0.015
    assert errors["kinematic"]["removed_percent"] > 95
    # 300 readings are too few for a network, and it shows.
    assert errors["network"]["removed_percent"] < 0


def test_evaluate_prints_a_table_for_people(truearm, made):
    first, *lines = truearm("evaluate", made / "kinematic.truearm", made / "test.csv").out.splitlines()
    assert first.startswith("Mean error 0.0")
    assert first.endswith(" smaller than the nominal arm.")
    assert lines[0].split() == ["100", "readings", "nominal", "model"]
    table = {line.split()[0]: [float(v) for v in line.split()[1:]] for line in lines[1:7]}
    assert set(table) == {key for key in ERROR_KEYS if key.endswith("_mm")}
    assert all(after < before for before, after in table.values())
    assert lines[7].endswith("% of the mean absolute coordinate error removed")
    assert "training readings" not in lines[-1]
    nominal = truearm("evaluate", made / "nominal.truearm", made / "test.csv").out.splitlines()
    assert nominal[1].split() == ["100", "readings", "nominal"]
    assert not any("removed" in line for line in nominal)
    network = truearm("evaluate", made / "network.truearm", made / "test.csv").out
    assert "worse than the nominal arm: " in network


def test_an_evaluation_on_the_training_readings_has_a_remark(truearm, made):
    said = truearm("evaluate", made / "kinematic.truearm", made / "train.csv").out.splitlines()[-1]
    assert said == "300 of 300 are training readings of the model: a fair test needs others (split)."


def test_predict_writes_points_with_uncertainties_and_a_flag(truearm, made, tmp_path):
    ran = truearm("predict", made / "kinematic.truearm", made / "angles.csv", "--out", tmp_path / "points.csv").done()
    assert ran.out.startswith("40 points, standard uncertainty of a coordinate 0.0")
    assert ran.out.endswith(f"points written to {tmp_path / 'points.csv'}\n")
    table = pd.read_csv(tmp_path / "points.csv")
    points, flags = ["x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm"], ["outside_training", "serial_number"]
    assert table.columns.tolist() == points + flags
    model, session = load_model(made / "kinematic.truearm"), read_session(made / "angles.csv")
    points, covariance = model.predict_readings(session, return_cov=True)
    # Written to 1e-6 mm.
    np.testing.assert_allclose(table[["x_mm", "y_mm", "z_mm"]], points, rtol=0, atol=0.6e-6)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(table[["sx_mm", "sy_mm", "sz_mm"]], std, rtol=0, atol=0.6e-6)
    np.testing.assert_array_equal(table["outside_training"] == 1, model.outside_training(session))


def test_predict_keeps_the_names_of_the_readings_and_warns_of_a_network(truearm, made, tmp_path):
    session, out = tmp_path / "far.csv", tmp_path / "p.csv"
    session.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,position\n90,0,0,90,0,0,left\n95,0,0,90,0,0,right\n")
    assert ": do not rely on their points.\n" in truearm("predict", made / "network.truearm", session, "--out", out).out
    assert pd.read_csv(out)["position"].tolist() == ["left", "right"]
    assert pd.read_csv(out)["outside_training"].tolist() == [1, 1]


def test_report_compares_models_on_one_page(truearm, made, tmp_path):
    page = tmp_path / "report.html"
    models = [made / f"{model}.truearm" for model in MODELS]
    ran = truearm("report", *models, made / "test.csv", "--page", page, "--title", "Arm 7 <in May>").done()
    assert ran.out.startswith("3 models compared on 100 readings: mean error ")
    assert ran.out.endswith(f"\npage written to {page}\n")
    html = page.read_text()
    assert "Arm 7 &lt;in May&gt;" in html
    for word in (
        *(*MODELS, "100 readings of test.csv", load_model(models[1]).data_fingerprint_, f"truearm {__version__}"),
        *(">Uncertainty</h2>", "(k = 2)", ">Terms of the arm</h2>", "lengths and offsets", "held out"),
    ):
        assert word in html
    assert "Error of each joint" not in html  # a kinematic model has none
    assert html.count("<svg") > 5
    errors = json.loads(truearm("evaluate", models[1], made / "test.csv", "--json").out)
    assert f"{errors['mean_mm']:.4f}" in html


def test_fit_tells_its_training_error_as_json_too(truearm, made, tmp_path):
    out = tmp_path / "k.truearm"
    arguments = ["fit", made / "train.csv", "--arm", "gao2017", "--model", "kinematic", "--out", out]
    told = json.loads(truearm(*arguments, "--json").out)
    identified = {"residual_std_mm", "residual_process", "groups", "skipped_terms", "identifiability", "length_scale"}
    assert set(told) == FIT_KEYS | identified
    assert (told["model"], told["file"]) == ("kinematic", str(out))
    assert set(told["training"]) == ERROR_KEYS
    said = truearm(*arguments).out
    assert "(kinematic model of gao2017, 300 readings)." in said.splitlines()[0]
    assert said.endswith(f"model written to {out}\n")
    assert f"training error: mean {told['training']['mean_mm']:.4f} mm" in said


def test_fit_tells_of_every_networks_training(truearm, made, tmp_path):
    out = tmp_path / "n.truearm"
    arguments = ["fit", made / "train.csv", "--arm", "gao2017", "--model", "network", "--hidden", "6", "--epochs", 15]
    arguments += ["--trainer", "trainlm", "--members", 2, "--restarts", 2, "--validation", 0.2, "--goal", 1e-3]
    arguments += ["--free", "none", "--out", out]
    told = json.loads(truearm(*arguments, "--json").out)
    assert set(told) == FIT_KEYS | {"network"}
    assert told["network"]["trainer"] == "trainlm"
    model = load_model(out)
    options = {"trainer": "trainlm", "n_members": 2, "n_restarts": 2, "validation": 0.2, "goal": 1e-3, "epochs": 15}
    assert options.items() <= model.get_params().items()
    for told_of, member in zip(told["network"]["members"], model.members_, strict=True):
        record = member.record
        assert told_of == {
            "start": member.start + 1,
            "epochs": record.num_epochs,
            "best_epoch": record.best_epoch,
            "stop": record.stop,
            "seconds": record.time[-1],
        }
    said = truearm(*arguments).out
    for number, facts in enumerate(told["network"]["members"], 1):
        assert f"member {number}, start {facts['start']}: {facts['stop'][:-1]} after {facts['epochs']} epochs" in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["n.truearm"]
    points = tmp_path / "p.csv"
    assert truearm("predict", out, made / "test.csv", "--out", points).code == 0
    _, covariance = model.predict(read_session(made / "test.csv").angles, return_cov=True)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(pd.read_csv(points)[["sx_mm", "sy_mm", "sz_mm"]], std, rtol=0, atol=0.6e-6)


def test_fit_offers_the_models_trainers(truearm):
    from truearm.models.network import TRAINERS

    assert "|".join(TRAINERS) in truearm("fit", "--help").out


def test_the_same_seed_gives_the_same_files(truearm, made, tmp_path):
    truearm("simulate", "gao2017", "--poses", 400, "--seed", 1, "--out", tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (made / "session.csv").read_bytes()


def test_parquet_goes_the_same_way(truearm, made, tmp_path):
    pytest.importorskip("pyarrow")
    session = tmp_path / "s.parquet"
    assert truearm("simulate", "gao2017", "--poses", 400, "--seed", 1, "--out", session).code == 0
    ran = truearm("evaluate", made / "kinematic.truearm", session, "--json")
    assert json.loads(ran.out)["n"] == 100  # those that it was not fitted to


# Arms, foreign tables, published sets --------------------------------------------------------------------------------


def test_arms_lists_shows_and_writes(truearm, tmp_path):
    listed = truearm("arms").out
    for name in ("gao2017", "gen3lite", "measuring7", "panda", "ur10", "ur5", "wam"):
        assert any(f" {name} " in line for line in listed.splitlines())
    assert set(json.loads(truearm("arms", "--json").out)["ur10"]) >= {"title", "n_joints", "reach_mm"}
    assert "376.0000" in truearm("arms", "gao2017").out
    assert json.loads(truearm("arms", "gao2017", "--json").out)["dh"]["d_mm"][0] == 376
    out = tmp_path / "mine.toml"
    assert truearm("arms", "gao2017", "--out", out).code == 0
    assert truearm("simulate", out, "--poses", 10, "--out", tmp_path / "s.csv").code == 0


def test_simulate_tells_what_it_did_as_json(truearm, tmp_path):
    ran = truearm("simulate", "gao2017", "--poses", 20, "--out", tmp_path / "s.csv", "--json")
    told = json.loads(ran.out)
    assert set(told) == {
        *("summary", "file", "arm", "preset", "arm_seed", "strategy", "seed", "n", "rejected"),
        *("nominal_error", "noise_floor"),
    }
    assert (told["n"], told["arm"], told["strategy"]) == (20, "gao2017", "box")


def test_an_imported_table_is_fitted_and_evaluated(truearm, made, tmp_path):
    table, session = tmp_path / "table.txt", tmp_path / "session.csv"
    readings = read_session(made / "session.csv")
    rows = np.hstack([np.degrees(readings.angles) * 10, readings.points / 1000])  # tenths of a degree as counts, m
    text = "\n".join(";".join(f"{v:.9f}".replace(".", ",") for v in row) for row in rows)
    table.write_text("E1;E2;E3;E4;E5;E6;mx;my;mz\n" + text + "\n", encoding="cp1252")
    ran = truearm(
        *("import", table, "--separator", ";", "--decimal", ",", "--angles", "E1,E2,E3,E4,E5,E6"),
        *("--angle-unit", "counts", "--counts-per-turn", 3600, "--point", "mx,my,mz", "--point-unit", "m"),
        *("--encoding", "cp1252", "--out", session),
    ).done()
    assert ran.out.startswith(f"{session}: 400 readings of 6 joints from table.txt\n")
    np.testing.assert_allclose(read_session(session).points, readings.points, rtol=0, atol=1e-6)
    errors = json.loads(truearm("evaluate", made / "kinematic.truearm", session, "--json").out)
    assert errors["mean_mm"] < 0.03


def test_fetch_lists_what_there_is(truearm):
    listed = truearm("fetch")
    assert listed.out == truearm("fetch").out
    assert [line.split()[0] for line in listed.out.splitlines()[1:5]] == ["ur10-a", "ur10-b", "ur5", "wam"]


@pytest.mark.slow
def test_a_real_arm_goes_the_whole_path(truearm, tmp_path):
    """UR10 series A, split by goal position: nominal about 0.74 mm, kinematic about 0.40 mm."""
    from truearm.wings.importing import datasets

    if datasets.find_local("ur10-a") is None:
        pytest.skip("the UR10 data set is not at hand (TRUEARM_DATA)")
    session, train, test = (tmp_path / f"{name}.csv" for name in ("session", "train", "test"))
    said = truearm("fetch", "ur10-a", "--out", session).out
    assert said.startswith("11911 readings of 6 joints, nominal arm ur10.\n")
    assert said.endswith(f"session written to {session}\n")
    assert "Cite: Landgraf" in said
    truearm(
        *("import", datasets.find_local("ur10-a"), "--separator", ";", "--decimal", ",", "--angle-unit", "rad"),
        *("--angles", "8,9,10,11,12,13", "--point", "15,16,17"),
        *("--column", "temperature_degC=14", "--column", "position=2,3,4"),
        *("--session-name", "series A", "--out", tmp_path / "imported.csv"),
    ).done()
    assert (tmp_path / "imported.csv").read_bytes() == session.read_bytes()
    assert truearm("split", session, "--train", train, "--test", test).code == 0
    out = tmp_path / "kinematic.truearm"
    assert truearm("fit", train, "--arm", "ur10", "--model", "kinematic", "--out", out).code == 0
    errors = json.loads(truearm("evaluate", out, test, "--json").out)
    # Which positions are held out moves both by some 0.03 mm.
    assert errors["nominal"]["mean_mm"] == pytest.approx(0.74, abs=0.06)
    assert errors["mean_mm"] == pytest.approx(0.40, abs=0.03)


# The demo ------------------------------------------------------------------------------------------------------------


def test_the_demo_writes_a_page_and_a_summary(truearm, tmp_path, monkeypatch):
    """The demo with a small network: seconds, where --quick takes ten."""
    from truearm.wings.gao2017 import demo

    # The fits of these take seconds, and what they do is tested elsewhere.
    monkeypatch.setattr(demo, "PhysicalModel", demo.NominalModel)
    monkeypatch.setattr(demo, "HybridModel", lambda arm, *, seed, **options: demo.NominalModel(arm, **options))
    monkeypatch.setattr(demo, "QUICK_SETTINGS", demo.Settings(n_train=150, n_test=50, hidden=(8,), epochs=15))
    out = tmp_path / "new" / "demo"
    ran = truearm("demo", "--quick", "--seed", 3, "--out", out).done()
    assert sorted(p.name for p in out.iterdir()) == ["before_after.png", "report.html", "summary.json"]
    summary = json.loads((out / "summary.json").read_text())
    trainers = {"network_trainer", "network_by_papers_trainer"}
    assert set(summary) == {"arm", "seed", "noise_floor", "models"} | trainers
    assert (summary["arm"], summary["seed"]) == ("gao2017", 3)
    assert set(summary["models"]) == {"nominal", "network", "kinematic", "hybrid", "physical"}
    for errors in summary["models"].values():
        assert set(errors) == ERROR_KEYS | {"fit_seconds", "fit_cpu_seconds", "n_train", "outside"}
        assert set(errors["outside"]) == ERROR_KEYS
        assert (errors["n_train"], errors["n"], errors["outside"]["n"]) == (150, 50, 50)
    assert set(summary["noise_floor"]) >= {"mean_abs_coordinate_mm", "max_abs_coordinate_mm"}
    outside = {name: m["outside"]["mean_mm"] for name, m in summary["models"].items()}
    assert outside["kinematic"] < outside["nominal"] < outside["network"]
    for line in ("nominal", "network", "kinematic", "noise floor"):
        assert f"\n{line} " in ran.out
    assert "Outside the trained range" in (out / "report.html").read_text()
    ran = truearm("demo", "--quick", "--seed", 3, "--out", out, "--json").done()
    again = json.loads(ran.out)
    for found in (summary, again):
        for model in found["models"].values():
            del model["fit_seconds"], model["fit_cpu_seconds"]
    assert again == summary


def test_the_identified_arm_is_shown_and_its_constants_are_exported(truearm, refused, made, tmp_path):
    """Constants that were identified beside other terms mean little alone: arms writes none of a model."""
    shown = truearm("arms", made / "kinematic.truearm").done()
    assert shown.out.startswith("gao2017-identified: ")
    assert "before J1: " in shown.out
    refused(
        ["arms", made / "kinematic.truearm", "--out", tmp_path / "i.urdf"],
        "mean little without its other terms",
        f"truearm export {made / 'kinematic.truearm'} --out {tmp_path / 'i.urdf'}",
    )
    assert list(tmp_path.iterdir()) == []
    assert "identifies no arm" in truearm("arms", made / "network.truearm").err


def test_a_branching_robot_is_read_between_the_links_that_are_named(truearm, refused, made, tmp_path):
    """From the message to a command that runs, and the file is not overwritten under its name with links."""
    from truearm.arm import load_arm, write_arm

    urdf = tmp_path / "robot.urdf"
    write_arm(load_arm("gao2017"), urdf)
    camera = '<link name="camera"/><joint name="c" type="fixed"><parent link="link_{}"/><child link="camera"/></joint>'
    urdf.write_text(urdf.read_text().replace("</robot>", f"{camera.format(6)}</robot>"))
    fit = ["fit", made / "train.csv", "--model", "nominal", "--free", "none", "--out", tmp_path / "m.truearm"]
    said = "tip: tip, of tip, camera; robot.urdf::LINK takes another."
    assert said in truearm(*fit, "--arm", urdf).out
    assert said in truearm("arms", urdf).out
    assert said not in truearm(*fit, "--arm", f"{urdf}::tip", "--force").out
    assert truearm("arms", f"{urdf}:link_1:camera").out.splitlines()[1].startswith("joint")
    refused(["arms", f"{urdf}::tip", "--out", urdf], "would be overwritten")


def test_evaluate_and_report_remark_on_what_spoils_a_test(truearm, made, tmp_path):
    """Training readings, and readings of another arm: said in both, not only in one."""
    train = truearm("evaluate", made / "kinematic.truearm", made / "train.csv")
    assert "are training readings of the model: a fair" in train.out
    assert truearm("report", made / "kinematic.truearm", made / "train.csv", "--page", tmp_path / "r.html").code == 0
    assert "These are the training readings of the model" in (tmp_path / "r.html").read_text()
    foreign = tmp_path / "foreign.csv"
    assert truearm("simulate", "ur10", "--poses", 30, "--strategy", "box", "--out", foreign).code == 0
    assert "another arm, unit, sign or zero" in truearm("evaluate", made / "kinematic.truearm", foreign).out


def test_a_model_file_named_nominal_does_not_pass_for_the_drawing(truearm, made, tmp_path):
    """Each model's share is of its own nominal arm; the row `nominal` is the drawing, whatever a file is called."""
    (tmp_path / "nominal.truearm").write_bytes((made / "kinematic.truearm").read_bytes())
    page = tmp_path / "r.html"
    assert truearm("report", tmp_path / "nominal.truearm", made / "test.csv", "--page", page).code == 0
    assert "nominal.truearm" in page.read_text()
    own = json.loads(truearm("evaluate", made / "kinematic.truearm", made / "test.csv", "--json").out)
    assert f"{own['removed_percent']:.1f}" in page.read_text()


def test_models_with_other_free_parts_are_not_compared_on_one_page(truearm, refused, made, tmp_path):
    free = tmp_path / "free.truearm"
    assert truearm("fit", made / "train.csv", "--arm", "gao2017", "--model", "kinematic", "--out", free).code == 0
    refused(
        ["report", made / "kinematic.truearm", free, made / "test.csv", "--page", tmp_path / "r.html"], "same --free"
    )


def test_nothing_that_is_read_is_overwritten(truearm, refused, made, tmp_path):
    arm = tmp_path / "my.toml"
    assert truearm("arms", "gao2017", "--out", arm).code == 0
    before = arm.read_bytes()
    for arguments in (
        ("fit", made / "train.csv", "--arm", arm, "--model", "nominal", "--free", "none", "--out", arm),
        ("arms", arm, "--out", arm),
    ):
        refused(arguments, "would be overwritten")
    assert arm.read_bytes() == before


def test_import_refuses_encodings_that_are_not_of_text(truearm, made, tmp_path):
    ran = truearm(
        "import", made / "test.csv", "--encoding", "hex", "--angles", "1,2", "--angle-unit", "deg", "--out",
        tmp_path / "z.csv",
    )  # fmt: skip
    assert ran.code == 2
    assert "unknown encoding" in ran.err


def test_a_fit_that_has_not_converged_has_a_remark(truearm, made, tmp_path, monkeypatch):
    arguments = ["fit", made / "train.csv", "--arm", "gao2017", "--model", "kinematic", "--out", tmp_path / "m.truearm"]
    assert "has not converged" not in truearm(*arguments).out
    monkeypatch.setattr("truearm.identification.estimation.identification.MOST_ROUNDS", 1)
    assert "has not converged" in truearm(*arguments).out
