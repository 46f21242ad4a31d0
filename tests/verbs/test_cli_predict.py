"""``truearm predict``: what a session does not state is said."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from truearm.arm import load_arm
from truearm.models import PhysicalModel
from truearm.readings import write_session
from truearm.wings.planning.virtual import PRESETS, VirtualArm

SAYS = "Missing in some readings: directions of movement (0."


@pytest.fixture(scope="module")
def hysteretic(tmp_path_factory):
    """A folder with the model of an arm with hysteresis, a session with directions and one without."""
    arm, folder = load_arm("gao2017"), tmp_path_factory.mktemp("predict")
    preset = replace(PRESETS["perfect"], hysteresis_std_arcsec=20.0, reference_std_mm=0.01)
    virtual = VirtualArm.draw(arm, preset, seed=5)
    angles = arm.working + 0.8 * np.random.default_rng(6).uniform(-1, 1, (121, 6))
    readings = virtual.measure(angles, seed=7).readings.rows(slice(1, None))  # the first did not come from anywhere
    PhysicalModel(arm, highest=1).fit_readings(readings).save(folder / "m.truearm")
    write_session(readings, folder / "all.csv")
    write_session(replace(readings, directions=None), folder / "none.csv")
    return folder


def test_missing_directions_are_named_once_with_the_uncertainty_they_add(truearm, hysteretic, tmp_path):
    std = {}
    for name, times in (("all", 0), ("none", 1)):
        ran = truearm("predict", hysteretic / "m.truearm", hysteretic / f"{name}.csv", "--out", tmp_path / "p.csv")
        assert ran.code == 0, ran.err
        assert ran.out.count(SAYS) == times
        assert "Missing" not in ran.out.replace(SAYS, "")
        std[name] = pd.read_csv(tmp_path / "p.csv")[["sx_mm", "sy_mm", "sz_mm"]].to_numpy()
    assert (std["none"] > std["all"]).all()


def test_figures_for_machines_are_those_of_the_table(truearm, hysteretic, tmp_path):
    asked = ["predict", hysteretic / "m.truearm", hysteretic / "none.csv", "--out", tmp_path / "p.csv"]
    told, table = json.loads(truearm(*asked, "--json").out), pd.read_csv(tmp_path / "p.csv")
    std, outside = table[["sx_mm", "sy_mm", "sz_mm"]].to_numpy(), table["outside_training"] == 1
    assert told["file"] == str(tmp_path / "p.csv")
    assert told["n_readings"] == len(table)
    assert told["n_outside_training"] == outside.sum()
    assert told["n_in_unknown_session"] == 0
    assert told["median_u_mm"] == pytest.approx(np.median(std), abs=1e-6)  # mm, the table's digits
    assert told["unstated_u_mm"].keys() == {"directions of movement"}
    assert f"({told['unstated_u_mm']['directions of movement']:.4f} mm)" in truearm(*asked).out


def test_a_prediction_loads_no_package_that_it_does_not_need(hysteretic, tmp_path):
    """A short command is over in the time in which scikit-learn alone would be imported."""
    asked = ["predict", str(hysteretic / "m.truearm"), str(hysteretic / "none.csv"), "--out", str(tmp_path / "p.csv")]
    listed = (
        "import sys, truearm.command_line as m\n"
        "try:\n m.run(sys.argv[1:])\nexcept SystemExit as end:\n assert not end.code\n"
        "print('loaded', *sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", listed, *asked], capture_output=True, text=True, check=True)
    loaded = ran.stdout.rpartition("loaded")[2].split()
    assert not {"sklearn", "pandas", "scipy.stats", "scipy.optimize", "matplotlib", "jinja2", "rich"} & set(loaded)
