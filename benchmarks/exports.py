"""Exports of the guide's UR10: what each file gives on the goal positions held out, how large it is, how fast.

The physical model is fitted to 70 % of the goal positions of series A (20 s), or read from a file (``--model``) that
was fitted to the same readings. ``--seed`` is that of the split, 1 as in docs/ur10.md by default.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.held_out import split, three_figures
from benchmarks.rows import ROOT, RowResult, Rows, Target, scratch, times_of_each
from truearm.arm import load_arm
from truearm.arm.kinematics_yaml import ur_hash
from truearm.models import KinematicModel, PhysicalModel, load_model
from truearm.models.compensator import Compensator
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.exports.formats import c_source, constants, es_module, joint_offsets, json_model, onnx_graph, urdf
from truearm.wings.exports.formats.reduced_covariance import sample_trained_region
from truearm.wings.exports.formats.rigid_arm import best_rigid_arm
from truearm.wings.exports.formats.ur_kinematics import ur_kinematics_text
from truearm.wings.exports.targets.manifest import Manifest, check_joints

ROWS = Rows()
LIMIT_MM, AGREE = 0.385, 1e-12


@cache
def work(model: str | None, seed: int) -> tuple[Compensator, Session, Session]:
    """A model, the readings of its training and those held out."""
    arm, train, test = split("ur10-a", seed)
    fitted = PhysicalModel(arm).fit_readings(train) if model is None else load_model(Path(model))
    ranges = np.stack([train.angles.min(axis=0), train.angles.max(axis=0)], axis=1)
    if fitted.n_train_ != len(train) or not np.allclose(fitted.angle_ranges_, ranges):
        raise SystemExit(f"{model} was not fitted to the training readings of seed {seed}")
    return fitted, train, test


def written(file: Path, write: Callable[[], object]) -> dict[str, float]:
    """Write a file: seconds and size."""
    begun = time.perf_counter()
    write()
    return {"writing [s]": time.perf_counter() - begun, "file [MB]": file.stat().st_size / 1e6}


def agrees(what: str, model: Compensator, points: FloatArray, expected: FloatArray) -> Target:
    """Largest distance of points from those of Python, relative to the reach of the arm."""
    off = float(np.linalg.norm(points - expected, axis=1).max() / model.arm_.chain.reach)
    return Target(f"{what}, points against Python, relative to the reach", off, AGREE)


@ROWS.row("urdf")
def of_urdf(model: str | None = None, seed: int = 1) -> RowResult:
    """URDF: errors of the nominal arm, the exported file and the model on the positions held out [mm].

    The bound is the stand-in of the same readings that judge it: no rigid arm is much better there.
    """
    fitted, train, test = work(model, seed)
    file = scratch() / "ur10.urdf"
    rigid = urdf.write(fitted, file)
    R, t = rigid.T_reference_base[:3, :3], rigid.T_reference_base[:3, 3]
    all_poses = best_rigid_arm(fitted, train.angles, region="all training readings")
    bound = best_rigid_arm(fitted, test.angles, region="readings held out")
    tips = {
        "nominal": fitted.predict_nominal(test.angles),
        "exported URDF": urdf.tips(file, test.angles) @ R.T + t,
        "refitted at all training readings": all_poses.in_reference_frame().chain.tip_in_base(test.angles),
        "refitted at the readings held out (bound)": bound.in_reference_frame().chain.tip_in_base(test.angles),
        "constants of the model alone": fitted.fit_.chain.tip_in_base(test.angles),
        "model": fitted.predict_readings(test),
    }
    errors = {name: three_figures(points, test.points) for name, points in tips.items()}
    limit = Target("URDF, mean error on positions held out [mm]", errors["exported URDF"]["mean_mm"], LIMIT_MM)
    table = [{"arm": name, **found} for name, found in errors.items()]
    return RowResult(table, [limit], [f"loss stated in the file [mm]: {rigid.loss.model_dump()}"])


@ROWS.row("onnx")
def of_onnx(model: str | None = None, seed: int = 1) -> RowResult:
    """ONNX: size of the graph, its agreement with the model and the time of onnxruntime on one thread."""
    import onnxruntime

    fitted, _, test = work(model, seed)
    file = scratch() / "ur10.onnx"
    row = written(file, lambda: onnx_graph.write(fitted, Manifest.of(fitted, "onnx"), file))
    states = {} if test.temperature_degC is None else {"temperature_degC": test.temperature_degC}
    target = agrees("ONNX", fitted, onnx_graph.tips(file, test.angles, **states), fitted.predict_readings(test))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = 1, 4
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    many = np.resize(test.angles, (10_000, test.n_joints))
    one, all_of_them = ({"joints": rows} for rows in (many[:1], many))
    times = times_of_each({"one": lambda: session.run(None, one), "many": lambda: session.run(None, all_of_them)})
    row["one reading a call [us]"] = times["one"].shortest * 1e6
    row["one of 10,000 readings [us]"] = times["many"].shortest * 1e6 / len(many)
    return RowResult([row], [target])


@ROWS.row("json")
def of_json(model: str | None = None, seed: int = 1) -> RowResult:
    """JSON: size of the document and the agreement of the independent reader with the model."""
    fitted, _, test = work(model, seed)
    file = scratch() / "ur10.json"
    row = written(file, lambda: json_model.write(fitted, Manifest.of(fitted, "json"), file))
    sys.path.insert(0, str(ROOT / "examples"))
    import json_reader

    some, begun = test.angles[:200], time.perf_counter()
    got = json_reader.tips(file, some)
    row["independent reader, file and 200 readings [s]"] = time.perf_counter() - begun
    return RowResult([row], [agrees("JSON reader", fitted, got, fitted.predict(some))])


@ROWS.row("constants")
def of_constants(model: str | None = None, seed: int = 1) -> RowResult:
    """Tables of constants: errors on the positions held out, and the time to write them."""
    fitted, _, test = work(model, seed)
    table, targets = [], []
    for name, module, suffix in (("constants", constants, "csv"), ("joint offsets", joint_offsets, "yaml")):
        file = scratch() / f"{name}.{suffix}"
        row = written(file, lambda module=module, file=file: module.write(fitted, file, frame="reference"))
        mean = three_figures(module.tips(file, test.angles), test.points)["mean_mm"]
        table.append({"table": name, **row, "mean_mm": mean})
        targets.append(Target(f"{name}, mean error on positions held out [mm]", mean, LIMIT_MM))
    return RowResult(table, targets)


@ROWS.row("ur-kinematics")
def of_ur_kinematics() -> RowResult:
    """Kinematics of UR files after import and export."""
    R, t, q = np.zeros(1), np.zeros(1), np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 6))
    for source in sorted(Path(os.environ.get("TRUEARM_DATA", ".")).glob("ur_factory/*.yaml")):
        arm, again = load_arm(source), scratch() / source.name
        again.write_text(ur_kinematics_text(list(arm.chain.fixed[:6]), ur_hash(arm) or "calib_0"))
        before, after = arm.chain.pose(q), load_arm(again).chain.pose(q)
        t = np.append(t, np.abs(before.tip_in_base - after.tip_in_base).max() / 1000)
        R = np.append(R, np.abs(before.R_base_tip - after.R_base_tip).max())
    targets = [
        Target("UR file after import and export, position [m]", float(t.max()), 1e-9),
        Target("UR file after import and export, orientation [rad]", float(R.max()), 1e-9),
    ]
    return RowResult(targets=targets, notes=[f"{len(t) - 1} files"])


TIMER = """
#include "ur10.c"
#include <stdio.h>
#include <time.h>
static double us_of(int function, int n)
{
    double best = 1e9, q[] = {Q}, xyz[3], cov[9], out[TRUEARM_JOINTS];
    truearm_state s = truearm_unknown();
    int i, round;
    s.temperature_degC = TEMPERATURE[0];
    for (round = 0; round < 30; round++) {
        const clock_t begun = clock();
        for (i = 0; i < n; i++) {
            q[i % TRUEARM_JOINTS] += 1e-7;
            if (function == 0) truearm_predict(q, &s, xyz, NULL);
            if (function == 1) truearm_predict(q, &s, xyz, cov);
            if (function == 2) truearm_correct(q, &s, out);
        }
        best = fmin(best, 1e6 * (double)(clock() - begun) / CLOCKS_PER_SEC / n);
    }
    return best;
}
int main(void)
{
    printf("%g %g %g\\n", us_of(0, 10000), us_of(1, 200), us_of(2, 100));
    return 0;
}
"""


def microseconds_of_c(model: Compensator) -> tuple[float, float, float]:
    """Shortest times of thirty of a reading, a reading with covariance and a correction in C, gcc -O2 [us]."""
    folder = scratch()
    c_source.write(model, Manifest.of(model, "c"), folder / "ur10.c")
    joints = ", ".join(map(str, check_joints(model)[0].tolist()))
    (folder / "timer.c").write_text(TIMER.replace("{Q}", f"{{{joints}}}"))
    program, source = str(folder / "timer"), str(folder / "timer.c")
    subprocess.run(["cc", *c_source.FLAGS, "-o", program, source, "-lm"], check=True)
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    point, covariance, correction = map(float, done.stdout.split())
    return point, covariance, correction


@ROWS.row("c", quick={"poses": 100})
def of_c(model: str | None = None, seed: int = 1, poses: int = 10_000) -> RowResult:
    """C: size, agreement with the model, uncertainties at poses of the trained region, and times."""
    fitted, train, test = work(model, seed)
    file = scratch() / "ur10.c"
    row = written(file, lambda: c_source.write(fitted, Manifest.of(fitted, "c"), file))
    library = ctypes.CDLL(str(c_source.compile_library(file, scratch())))
    angles = np.ascontiguousarray(sample_trained_region(fitted, poses, np.random.default_rng(2026)).angles)
    points, covariances = fitted.predict(angles, return_cov=True)
    own, u = np.empty((len(angles), 3)), np.empty((len(angles), 3, 3))
    for q, xyz, cov in zip(angles, own, u, strict=True):
        library.truearm_predict(*(ctypes.c_void_p(a) for a in (q.ctypes.data, None, xyz.ctypes.data, cov.ctypes.data)))
    variances = (np.diagonal(c, axis1=1, axis2=2) for c in (u, covariances))
    off = np.abs(np.sqrt(np.divide(*variances)) - 1)
    some = test.angles[:500]
    agreement = [agrees("C", fitted, own, points), agrees("C", fitted, c_source.tips(file, some), fitted.predict(some))]
    point, with_covariance, correction = microseconds_of_c(fitted)
    kinematic = KinematicModel(load_arm("ur10")).fit_readings(train)
    row |= {"a correction [us]": correction, "99.9 % of the standard uncertainties within": np.quantile(off, 0.999)}
    targets = [
        max(agreement, key=lambda target: target.reached),
        Target(f"C, largest relative error of a standard uncertainty, {poses} poses", float(off.max()), 0.01),
        Target("C, file [MB]", row["file [MB]"], 2.0),
        Target("C, a reading, kinematic [us]", microseconds_of_c(kinematic)[0], 0.5),
        Target("C, a reading, physical [us]", point, 3.0),
        Target("C, a reading with covariance, physical [us]", with_covariance, 300.0),
    ]
    return RowResult([row], targets)


@ROWS.row("js")
def of_js(model: str | None = None, seed: int = 1) -> RowResult:
    """ES module: its size and its agreement with the model."""
    fitted, _, test = work(model, seed)
    some, file = test.angles[:500], scratch() / "ur10.mjs"
    row = written(file, lambda: es_module.write(fitted, Manifest.of(fitted, "js"), file))
    return RowResult([row], [agrees("JavaScript", fitted, es_module.tips(file, some), fitted.predict(some))])
