"""Exports of the README's UR10: what each file gives on the goal positions held out, how large it is, how fast.

    python benchmarks/exports.py [--json] [--model FILE] [--seed N] [--formats urdf,...]

The physical model is fitted to 70 % of the goal positions of series A (20 s), or read from a file that was fitted to
the same readings. Every format is measured by a function of its own in `FORMATS`.
"""

from __future__ import annotations

import json
import os
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
from truearm.compensation.export import constants, deltas, joint_offsets, json_model, onnx_graph, urdf
from truearm.compensation.export.constants_table import constants_table
from truearm.compensation.export.rigid_arm import best_rigid_arm
from truearm.compensation.models import PhysicalModel, load_model
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.targets.manifest import Manifest
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


def relative_difference(model: Compensator, points: FloatArray, expected: FloatArray) -> float:
    """Largest distance of points from those of Python, relative to the reach of the arm."""
    return float(np.linalg.norm(points - expected, axis=1).max() / model.arm_.chain.reach)


FORMATS: dict[str, Callable[[Work], Found]] = {
    "urdf": measure_urdf,
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
