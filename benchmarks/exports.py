"""Exports of the README's UR10: what each file gives on the goal positions held out, how large it is, how fast.

    python benchmarks/exports.py [--json] [--model FILE] [--seed N] [--formats urdf,...]

The physical model is fitted to 70 % of the goal positions of series A (20 s), or read from a file that was fitted to
the same readings. Every format is measured by a function of its own in `FORMATS`.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from machine import Target, arguments_of, print_json, say_machine, say_targets, times_of_each
from truearm import datasets
from truearm.arm import load_arm
from truearm.arm.ur_kinematics import ur_hash, ur_kinematics_text
from truearm.compensation.export import (
    c_source,
    constants,
    deltas,
    es_module,
    joint_offsets,
    json_model,
    onnx_graph,
    urdf,
)
from truearm.compensation.export.constants_table import constants_table
from truearm.compensation.export.reduced_covariance import sample_trained_region
from truearm.compensation.export.rigid_arm import best_rigid_arm
from truearm.compensation.models import KinematicModel, PhysicalModel, load_model
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.targets.manifest import Manifest, check_joints
from truearm.readings import Session, hold_out, point_errors
from truearm.typing import FloatArray


class Work(NamedTuple):
    """A model, the readings of its training and those held out, and a folder for files."""

    model: Compensator
    train: Session
    test: Session
    folder: Path


class Found(NamedTuple):
    """What a format gives: numbers by name for the reader, and targets."""

    numbers: dict[str, Any]
    targets: list[Target]


def measure_urdf(work: Work) -> Found:
    """Errors of the nominal arm, the exported URDF and the model on the positions held out.

    The bound is the stand-in of the same readings that judge it: no rigid arm is much better there.
    """
    model, test, file = work.model, work.test, work.folder / "ur10.urdf"
    rigid = urdf.write(model, file)
    R, t = rigid.T_reference_base[:3, :3], rigid.T_reference_base[:3, 3]
    all_poses = best_rigid_arm(model, work.train.angles, region="all training readings")
    bound = best_rigid_arm(model, test.angles, region="readings held out")
    tips = {
        "nominal": model.predict_nominal(test.angles),
        "exported URDF": urdf.tips(file, test.angles) @ R.T + t,
        "refitted at all training readings": all_poses.in_reference_frame().chain.tip_in_base(test.angles),
        "refitted at the readings held out (bound)": bound.in_reference_frame().chain.tip_in_base(test.angles),
        "constants of the model alone": constants_alone(model, test.angles),
        "model": model.predict_readings(test),
    }
    errors = {name: point_errors(points, test.points) for name, points in tips.items()}
    numbers = {
        f"{name}, mean / p95 / max [mm]": " / ".join(f"{found[f]:.3f}" for f in ("mean_mm", "p95_mm", "max_mm"))
        for name, found in errors.items()
    }
    numbers["loss stated in the file [mm]"] = rigid.loss.model_dump()
    return Found(
        numbers, [Target("URDF, mean error on positions held out [mm]", errors["exported URDF"]["mean_mm"], 0.385)]
    )


def constants_alone(model: Compensator, angles: FloatArray) -> FloatArray:
    """Tips of the constants that were identified beside the model's other terms."""
    assert isinstance(model, PhysicalModel)
    return model.fit_.chain.tip_in_base(angles)


def measure_onnx(work: Work) -> Found:
    """Size of the graph, its agreement with the model and the time of onnxruntime on one thread."""
    import onnxruntime

    model, test, file = work.model, work.test, work.folder / "ur10.onnx"
    begun = time.perf_counter()
    onnx_graph.write(model, Manifest.of(model, "onnx"), file)
    write_s = time.perf_counter() - begun
    states = {} if test.temperature_degC is None else {"temperature_degC": test.temperature_degC}
    off = relative_difference(model, onnx_graph.tips(file, test.angles, **states), model.predict_readings(test))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = 1, 4
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    many = np.resize(test.angles, (10_000, test.n_joints))
    one, all_of_them = ({"joints": rows} for rows in (many[:1], many))
    times = times_of_each({"one": lambda: session.run(None, one), "many": lambda: session.run(None, all_of_them)})
    numbers = {
        "file [MB]": file.stat().st_size / 1e6,
        "writing [s]": write_s,
        "one reading a call [us]": times["one"].shortest * 1e6,
        "one of 10,000 readings [us]": times["many"].shortest * 1e6 / len(many),
    }
    return Found(numbers, [Target("ONNX, points against Python, relative to the reach", off, 1e-12)])


def measure_json(work: Work) -> Found:
    """Size of the document and the agreement of the independent reader with the model."""
    model, test, file = work.model, work.test, work.folder / "ur10.json"
    begun = time.perf_counter()
    json_model.write(model, Manifest.of(model, "json"), file)
    write_s = time.perf_counter() - begun
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
    import json_reader

    some = test.angles[:200]
    begun = time.perf_counter()
    got = json_reader.tips(file, some)
    numbers = {
        "file [MB]": file.stat().st_size / 1e6,
        "writing [s]": write_s,
        "independent reader, file and 200 readings [s]": time.perf_counter() - begun,
    }
    off = relative_difference(model, got, model.predict(some))
    return Found(numbers, [Target("JSON reader, points against Python, relative to the reach", off, 1e-12)])


def measure_constants(work: Work) -> Found:
    """Errors of the tables of constants on the positions held out, and what a controller without beta loses."""
    model, test = work.model, work.test
    numbers: dict[str, Any] = {}
    errors = {}
    for name, module, file in (
        ("constants", constants, "ur10.csv"),
        ("deltas", deltas, "deltas.json"),
        ("joint offsets", joint_offsets, "offsets.yaml"),
    ):
        path = work.folder / file
        begun = time.perf_counter()
        module.write(model, path, frame="reference")
        numbers[f"{name}, writing [s]"] = time.perf_counter() - begun
        errors[name] = point_errors(module.tips(path, test.angles), test.points)["mean_mm"]
    numbers["without beta, mean displacement [mm]"] = json.loads((work.folder / "deltas.json").read_text())["frames"][
        "without_beta_mm"
    ]
    numbers |= {
        f"{one.place} {one.name} [{one.unit}], change and u": f"{one.change:.3g}, {one.std:.2g}, {one.status}"
        for one in constants_table(model, best_rigid_arm(model)).constants
        if one.place not in ("base", "tip")
    }
    return Found(
        numbers, [Target(f"{name}, mean error on positions held out [mm]", e, 0.385) for name, e in errors.items()]
    )


def measure_ur_kinematics(work: Work) -> Found:
    """Kinematics of a UR's file after import and export, and the errors of the README's UR10 in such a file."""
    R, t, q = np.zeros(1), np.zeros(1), np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 6))
    for source in sorted(Path(os.environ.get("TRUEARM_DATA", ".")).glob("ur_factory/*.yaml")):
        arm, again = load_arm(source), work.folder / source.name
        again.write_text(ur_kinematics_text(list(arm.chain.fixed[:6]), ur_hash(arm) or "calib_0"))
        before, after = arm.chain.pose(q), load_arm(again).chain.pose(q)
        t = np.append(t, np.abs(before.tip_in_base - after.tip_in_base).max() / 1000)
        R = np.append(R, np.abs(before.R_base_tip - after.R_base_tip).max())
    return Found(
        {"files": len(t) - 1},
        [
            Target("UR file after import and export, position [m]", float(t.max()), 1e-9),
            Target("UR file after import and export, orientation [rad]", float(R.max()), 1e-9),
        ],
    )


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


def microseconds_of_c(model: Compensator, folder: Path) -> tuple[float, float, float]:
    """Shortest times of thirty of a reading, a reading with covariance and a correction in C, gcc -O2 [us]."""
    c_source.write(model, Manifest.of(model, "c"), folder / "ur10.c")
    joints = ", ".join(map(str, check_joints(model)[0].tolist()))
    (folder / "timer.c").write_text(TIMER.replace("{Q}", f"{{{joints}}}"))
    program, source = str(folder / "timer"), str(folder / "timer.c")
    subprocess.run(["cc", *c_source.FLAGS, "-o", program, source, "-lm"], check=True)
    done = subprocess.run([program], check=True, capture_output=True, text=True)
    point, covariance, correction = map(float, done.stdout.split())
    return point, covariance, correction


def measure_c(work: Work) -> Found:
    """Size of the C file, its agreement with the model, uncertainties at poses of the trained region, and times."""
    model, test, file = work.model, work.test, work.folder / "ur10.c"
    assert isinstance(model, PhysicalModel)
    begun = time.perf_counter()
    c_source.write(model, Manifest.of(model, "c"), file)
    write_s = time.perf_counter() - begun
    library = ctypes.CDLL(str(c_source.compile_library(file, work.folder)))
    angles = np.ascontiguousarray(sample_trained_region(model, 10_000, np.random.default_rng(2026)).angles)
    points, covariances = model.predict(angles, return_cov=True)
    own, u = np.empty((len(angles), 3)), np.empty((len(angles), 3, 3))
    for q, xyz, cov in zip(angles, own, u, strict=True):
        library.truearm_predict(*(ctypes.c_void_p(a) for a in (q.ctypes.data, None, xyz.ctypes.data, cov.ctypes.data)))
    variances = (np.diagonal(c, axis1=1, axis2=2) for c in (u, covariances))
    ratio = np.sqrt(np.divide(*variances))
    point, with_covariance, correction = microseconds_of_c(model, work.folder)
    kinematic = KinematicModel(load_arm("ur10")).fit_readings(work.train)
    numbers = {
        "writing [s]": write_s,
        "a correction [us]": correction,
        "standard uncertainties, 99.9 % of them within": float(np.quantile(np.abs(ratio - 1), 0.999)),
    }
    off = max(
        relative_difference(model, own, points),
        relative_difference(model, c_source.tips(file, test.angles[:500]), model.predict(test.angles[:500])),
    )
    return Found(
        numbers,
        [
            Target("C, points against Python, relative to the reach", off, 1e-12),
            Target(
                "C, largest relative error of a standard uncertainty, 10,000 poses", float(abs(ratio - 1).max()), 0.01
            ),
            Target("C, file [MB]", file.stat().st_size / 1e6, 2.0),
            Target("C, a reading, kinematic [us]", microseconds_of_c(kinematic, work.folder)[0], 0.5),
            Target("C, a reading, physical [us]", point, 3.0),
            Target("C, a reading with covariance, physical [us]", with_covariance, 300.0),
        ],
    )


def measure_js(work: Work) -> Found:
    """Size of the ES module and its agreement with the model."""
    model, some, file = work.model, work.test.angles[:500], work.folder / "ur10.mjs"
    es_module.write(model, Manifest.of(model, "js"), file)
    off = relative_difference(model, es_module.tips(file, some), model.predict(some))
    numbers = {"file [MB]": file.stat().st_size / 1e6}
    return Found(numbers, [Target("JavaScript, points against Python, relative to the reach", off, 1e-12)])


def relative_difference(model: Compensator, points: FloatArray, expected: FloatArray) -> float:
    """Largest distance of points from those of Python, relative to the reach of the arm."""
    return float(np.linalg.norm(points - expected, axis=1).max() / model.arm_.chain.reach)


FORMATS: dict[str, Callable[[Work], Found]] = {
    "urdf": measure_urdf,
    "c": measure_c,
    "js": measure_js,
    "onnx": measure_onnx,
    "json": measure_json,
    "constants": measure_constants,
    "ur-kinematics": measure_ur_kinematics,
}


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--model", type=Path, help="a fitted physical model in place of a fit")
    parser.add_argument("--seed", type=int, default=1, help="of the split, 1 by default as in the README")
    parser.add_argument("--formats", default=",".join(FORMATS), help=f"{','.join(FORMATS)} by default")
    options = parser.parse_args()
    train, test = hold_out(datasets.load_readings("ur10-a"), by="position", fraction=0.3, seed=options.seed)
    if options.model is None:
        model: Compensator = PhysicalModel(load_arm("ur10")).fit_readings(train)
    else:
        model = load_model(options.model)
        trained, of_split = model.angle_ranges_, np.stack([train.angles.min(axis=0), train.angles.max(axis=0)], axis=1)
        if model.n_train_ != len(train) or not np.allclose(trained, of_split):
            parser.error(f"{options.model} was not fitted to the training readings of seed {options.seed}")
    with tempfile.TemporaryDirectory() as folder:
        work = Work(model, train, test, Path(folder))
        found = {name: FORMATS[name](work) for name in options.formats.split(",")}
    targets = [target for one in found.values() for target in one.targets]
    if options.json:
        print_json({name: one.numbers for name, one in found.items()}, targets)
        return
    say_machine()
    print(f"\n{len(train)} training readings, {len(test)} held out")
    for name, one in found.items():
        print(f"\n{name}")
        for what, number in one.numbers.items():
            print(f"  {what}: {number}")
    say_targets(targets)


if __name__ == "__main__":
    main()
