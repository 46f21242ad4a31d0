"""Reproduction of the paper's tables and figures: trainings, verdicts, notes.

Experiments test the paper's claims about settings: learning rate, scatter of starts, the box of joint angles.

The final test of the paper on virtual arms, and the errors of the network outside its box.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

from truearm import __version__
from truearm.arm import load_arm
from truearm.arm.rigid_motions import screw_x, screw_z
from truearm.models import Compensator, HybridModel, KinematicModel, PhysicalModel
from truearm.models.network import GRADIENT_TRAINERS
from truearm.typing import FloatArray
from truearm.wings.gao2017.results import (
    CUT_SHORT,
    FITTED_BOX,
    GOAL_MET,
    METHODS,
    MODELS,
    SKIPPED,
    ArmPose,
    Boxes,
    BoxStudy,
    Claims,
    FigureData,
    FinalTestResult,
    FinalTestRun,
    LearningRate,
    Method,
    OutsideErrors,
    Predictions,
    Reproduction,
    RowResult,
    Run,
    Scatter,
    TrainerResult,
)
from truearm.wings.gao2017.tables import (
    FINAL_TEST,
    N_FINAL_TEST,
    N_TEST,
    TABLE_1,
    TABLES,
    TIP_MM,
    ModelErrors,
    PaperRow,
)
from truearm.wings.gao2017.training import (
    ARM,
    EVALUATION_STREAM,
    FINAL_TEST_STREAM,
    N_EVALUATION_POSES,
    OUTSIDE_STREAM,
    TEST_STREAM,
    TRAINING_STREAM,
    ProgressCallback,
    Training,
    TrainingResult,
    machine_data,
    run_training,
    stream_seed,
    virtual_arm,
)
from truearm.wings.gao2017.training_plan import (
    ACTIVATIONS,
    BOX_FITTING_ROWS,
    EXPERIMENT,
    SIMULATION,
    Effort,
    activations_of,
    box_rows,
    box_training,
    equivalent_rows,
    plan_trainings,
    training_of,
    trainings,
)

DISTANCES_DEG = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)
N_OUTSIDE = 500

Results = Mapping[Training, TrainingResult]


def networks_by_seed(
    effort: Effort, results: Results, method: Method, *, table: int = 4, place: int = -1
) -> dict[int, TrainingResult]:
    """The networks of a row of a table, the last of Table 4 unless stated, by seed."""
    wanted = trainings(table, TABLES[table][place], method, effort)
    return {one.seed: results[one] for one in wanted if one in results}


@lru_cache(maxsize=16)
def _models(n: int, seed: int) -> dict[str, tuple[Compensator, float]]:
    """The models of the arm, identified from the readings of the networks, each with the CPU time of its fit [s]."""
    readings = EXPERIMENT.measurement(n, seed=seed, stream=TRAINING_STREAM).readings
    fitted: dict[str, tuple[Compensator, float]] = {}
    for name, kind in zip(MODELS, (KinematicModel, HybridModel, PhysicalModel), strict=True):
        begun = process_time()
        model = kind(load_arm(ARM), free=()).fit_readings(readings)
        fitted[name] = model, process_time() - begun
    return fitted


def final_test(effort: Effort, results: Results) -> FinalTestResult | None:
    """The final test on every arm that a network of Table 4, row 4, was trained for; None without any."""
    networks = {method: networks_by_seed(effort, results, method) for method in METHODS}
    seeds = sorted(set().union(*networks.values()))
    if not seeds:
        return None
    runs = tuple(
        _final_test_run(seed, {method: found[seed] for method, found in networks.items() if seed in found})
        for seed in seeds
    )
    return FinalTestResult(N_FINAL_TEST, FINAL_TEST, runs)


def _final_test_run(seed: int, networks: Mapping[Method, TrainingResult]) -> FinalTestRun:
    measurement = EXPERIMENT.measurement(N_FINAL_TEST, seed=seed, stream=FINAL_TEST_STREAM)
    angles, points = measurement.readings.angles, measurement.readings.points
    assert points is not None  # a virtual reference measures every pose
    models = _models(TABLES[4][-1].n_train, seed)
    nominal = float(np.abs(load_arm(ARM).chain.tip_in_base(angles) - points).mean())

    def errors(predicted: FloatArray, seconds: float | None = None, *, was_cut: bool = False) -> ModelErrors:
        errors = np.abs(predicted - points)
        return ModelErrors(
            float(errors.mean()),
            float(errors.max()),
            {level: int((errors > level).sum()) for level in FINAL_TEST["network"].over_mm},
            100 * (1 - float(errors.mean()) / nominal),
            seconds,
            was_cut,
        )

    return FinalTestRun(
        seed,
        {
            "nominal": errors(load_arm(ARM).chain.tip_in_base(angles)),
            **{
                method: errors(network.predict(angles), network.seconds, was_cut=network.was_cut)
                for method, network in networks.items()
            },
            **{
                name: errors(model.predict_readings(measurement.readings), seconds)
                for name, (model, seconds) in models.items()
            },
        },
        virtual_arm(seed).noise_floor(measurement)["mean_abs_coordinate_mm"],
    )


def final_test_predictions(effort: Effort, results: Results) -> dict[str, Predictions]:
    """Predictions of the nominal arm, and of varpro where it was run, on the poses of the final test of seed 0."""
    angles, points = EXPERIMENT.data(N_FINAL_TEST, seed=0, stream=FINAL_TEST_STREAM)
    predicted = {"nominal": load_arm(ARM).chain.tip_in_base(angles)}
    network = networks_by_seed(effort, results, "varpro").get(0)
    if network is not None:
        predicted["varpro"] = network.predict(angles)
    return {name: Predictions(np.degrees(angles), points, {name: values}) for name, values in predicted.items()}


def poses_outside(n: int, *, half_width_deg: float, distance_deg: float, seed: int) -> FloatArray:
    """Angles (n, 6) [rad] whose farthest joint is `distance_deg` outside a box about the working pose.

    That joint is drawn uniformly among the six, and its end among the two; the others are uniform in the larger box.
    At distance 0 the poses are uniform in the box.
    """
    rng = np.random.default_rng([*b"outside", seed, round(1000 * distance_deg)])
    arm, half = load_arm(ARM), np.radians(half_width_deg + distance_deg)
    offsets = rng.uniform(-half, half, (n, arm.n_joints))
    if distance_deg > 0:
        offsets[np.arange(n), rng.integers(arm.n_joints, size=n)] = half * rng.choice([-1.0, 1.0], n)
    return np.asarray(arm.working + offsets)


def errors_outside_box(effort: Effort, results: Results) -> OutsideErrors | None:
    """Absolute coordinate errors of row 4 of Table 4 (varpro) by the distance outside its box, over all its seeds."""
    networks = networks_by_seed(effort, results, "varpro")
    if not networks:
        return None
    errors: dict[str, list[FloatArray]] = {name: [] for name in ("varpro", "nominal", *MODELS)}
    for seed, network in networks.items():
        models, arm = _models(TABLES[4][-1].n_train, seed), virtual_arm(seed)
        for distance in DISTANCES_DEG:
            poses = poses_outside(N_OUTSIDE, half_width_deg=EXPERIMENT.half_width_deg, distance_deg=distance, seed=seed)
            readings = arm.measure(poses, seed=stream_seed(seed, OUTSIDE_STREAM)).readings
            assert readings.points is not None  # a virtual reference measures every pose
            predicted = {
                "varpro": network.predict(readings.angles),
                "nominal": arm.nominal.chain.tip_in_base(readings.angles),
                **{name: model.predict_readings(readings) for name, (model, _) in models.items()},
            }
            for name, points in predicted.items():
                errors[name].append(np.abs(points - readings.points))
    # (seeds, distances, coordinates) to a row of errors for each distance.
    rows = len(DISTANCES_DEG)
    by_distance = {
        name: np.array(values).reshape(-1, rows, 3 * N_OUTSIDE).swapaxes(0, 1).reshape(rows, -1)
        for name, values in errors.items()
    }
    return OutsideErrors(
        DISTANCES_DEG,
        {name: tuple(np.median(values, axis=1).tolist()) for name, values in by_distance.items()},
        tuple(np.percentile(by_distance["varpro"], 95, axis=1).tolist()),
        n_cut=sum(network.was_cut for network in networks.values()),
    )


def learning_rate(networks: Sequence[TrainingResult]) -> LearningRate | None:
    """Table 2, row 1, beside the rows that differ only in the learning rate, which ``trainlm`` does not have."""
    if not networks:
        return None
    first = TABLES[2][0]
    rows = [row for row in equivalent_rows(2, first, "trainlm") if row.goal == first.goal]
    return LearningRate(
        rates=tuple(float(row.learning_rate) for row in rows),
        rows=tuple(row.row for row in rows),
        mean_mm=median(_mean_error(one) for one in networks),
        paper_mean_mm=tuple(row.mean_mm for row in rows),
        n_cut=sum(one.was_cut for one in networks),
    )


def scatter(networks: Sequence[TrainingResult]) -> Scatter | None:
    """Table 2, row 1, from many starts, beside the paper's rows that differ only in settings without effect."""
    if len(networks) < 2:
        return None
    few = tuple(float(one.errors(N_TEST[2], TEST_STREAM).mean()) for one in networks)
    rows = equivalent_rows(2, TABLES[2][0], "trainlm")
    return Scatter(
        what=f"Table 2, row 1, from {len(networks)} starts, each tested on {N_TEST[2]} poses of its own",
        mean_mm=few,
        mean_many_mm=tuple(_mean_error(one) for one in networks),
        relative_spread=relative_spread(few),
        paper_rows=tuple(row.row for row in rows),
        paper_rows_mean_mm=tuple(row.mean_mm for row in rows),
        paper_relative_spread=relative_spread([row.mean_mm for row in rows]),
        n_cut=sum(one.was_cut for one in networks),
    )


def relative_spread(values: Sequence[float]) -> float:
    """Range by the median."""
    return (max(values) - min(values)) / median(values)


def box_study(effort: Effort, results: Mapping[Training, TrainingResult]) -> BoxStudy:
    """Rows 1 and 15 of Table 2 in boxes of several half-widths, one start each."""
    widths = effort.half_widths_deg
    by_row = {row.row: [results[box_training(row, width, effort)] for width in widths] for row in box_rows()}
    return BoxStudy(
        half_width_deg=widths,
        mean_mm={number: tuple(map(_mean_error, networks)) for number, networks in by_row.items()},
        paper_mean_mm={row.row: row.mean_mm for row in box_rows()},
        n_cut=sum(one.was_cut for networks in by_row.values() for one in networks),
    )


def _mean_error(network: TrainingResult) -> float:
    return float(network.errors(N_EVALUATION_POSES, EVALUATION_STREAM).mean())


HOW = (
    "The paper does not give the joint ranges. The simulations' box is the one in which the distinct rows of Table 2 "
    "with 10000 poses (1 and 12 to 17, networks of 3 to 100 units, trained by trainlm) have the paper's mean errors, "
    "by the geometric mean of their ratios; no box fits every row. The experiment's box follows from the stop of row 4 "
    "of Table 4. The paper's training did not meet its goal in 1000 epochs. In this box a training by trainlm that "
    "just meets it errs as the paper's network does; in a wider box it errs more, so that a training with the paper's "
    "error would have met the goal. A narrower box is possible. If the paper's ranges were wider, its networks would "
    "be better than ours, and if they were narrower, worse: errors grow steeply with the box."
)

FACTORS = {2: 1.5, 3: 1.5, 4: 1.2}
RULE = (
    f"reproduced: the median of our starts, each tested on {N_EVALUATION_POSES} further poses, is within a factor of "
    f"the paper's mean error, {FACTORS[2]:g} in Tables 2 and 3 and {FACTORS[4]:g} in Table 4; better: it is smaller; "
    "not reached: it is larger. The factors correspond to the chance in the paper's few test poses: 95 % of the "
    "averages over 10 poses are within 0.64 and 1.53 times that over all, over 100 poses within 0.87 and 1.15. Not "
    "judged are rows that were used to fit the box, which agree by construction; rows stopped by the time limit; and "
    "rows that repeat the training of another row, which have no verdict"
)

ODDITIES: Mapping[tuple[int, int], str] = {
    (2, 8): "The paper states 123 s for 360 epochs here and 124 s for the 1000 epochs of row 1, the same network and "
    "poses: one of the four numbers cannot be right.",
    (2, 10): "The paper's text calls this learning rate the best; its own row 9 has a smaller mean and largest error.",
    (2, 13): "Of our starts most end at 19 to 20 mm and about one in twelve near 28 mm: the paper's 26.43 mm is that "
    "of a rare minimum, not of four units.",
    (3, 8): "The paper's training ended after 150 epochs, short of its goal if row 6 met it; a validation stop would "
    "explain that.",
}
"""What the paper's numbers show about themselves, by (table, row)."""


def reproduce(
    parts: Sequence[str], *, effort: Effort, folder: Path, progress: ProgressCallback | None = None
) -> Reproduction:
    """Run the trainings that are not yet in `folder`, and summarize the results.

    Parameters
    ----------
    parts : sequence of str
        Of `PARTS`.
    effort : Effort
    folder : path
        Has a file for every finished training.
    progress : callable, optional
        Called with the share of the estimated time that is over, and the training that runs.

    Raises
    ------
    InputError
        If a file in `folder` is damaged, or of another training.
    """
    wanted, skipped = plan_trainings(parts, effort)
    results = _run_all(wanted, folder, progress)
    ended = [one.ended for one in results.values()]
    of_row_1 = networks_by_seed(effort, results, "trainlm", table=2, place=0) if "table 2" in parts else {}
    first = [*of_row_1.values()]
    machines = [one.machine.model_dump() for one in results.values()] or [machine_data().model_dump()]
    return Reproduction(
        truearm=__version__,
        machines=[one for k, one in enumerate(machines) if one not in machines[:k]],
        trained=(min(ended), max(ended)) if ended else None,
        quick=effort.quick,
        skipped=skipped,
        training_seconds=sum(one.seconds for one in results.values()),
        rule=RULE,
        boxes=Boxes(SIMULATION.half_width_deg, EXPERIMENT.half_width_deg, HOW),
        tables={
            table: tuple(_row_result(table, row, effort, results) for row in rows)
            if f"table {table}" in parts
            else None
            for table, rows in TABLES.items()
        },
        final_test=final_test(effort, results) if "table 4" in parts else None,
        claims=Claims(
            learning_rate=learning_rate(first),
            scatter=scatter(first),
            boxes=box_study(effort, results) if "boxes" in parts else None,
            outside=errors_outside_box(effort, results) if "table 4" in parts else None,
        ),
        figures=_figures(parts, effort, results),
    )


def _run_all(
    wanted: Sequence[Training], folder: Path, progress: ProgressCallback | None
) -> dict[Training, TrainingResult]:
    results: dict[Training, TrainingResult] = {}
    total, before = sum(one.estimated_seconds for one in wanted), 0.0
    for number, training in enumerate(wanted, start=1):
        share = training.estimated_seconds / total
        name = f"{number}/{len(wanted)}: {'-'.join(map(str, training.hidden))} {training.trainer} seed {training.seed}"

        def report(part: float, note: str, before: float = before, share: float = share, name: str = name) -> None:
            if progress is not None:
                progress(before + share * part, f"{name}, {note}")

        results[training] = run_training(training, folder, report)
        before += share
    return results


# The tables ----------------------------------------------------------------------------------------------------------


def _row_result(table: int, row: PaperRow, effort: Effort, results: Results) -> RowResult:
    by_method = {method: _trainer_result(table, row, method, effort, results) for method in METHODS}
    first = equivalent_rows(table, row, "trainlm")[0]
    activations = activations_of(table, row)
    return RowResult(
        paper=row,
        activation=activations[0] if len(set(activations)) == 1 else ", ".join(activations),
        same_training_as=None if first is row else first.row,
        results=by_method,
        ratio={
            method: None if one is None else one.median["mean_many_mm"] / row.mean_mm
            for method, one in by_method.items()
        },
        verdict={method: verdict(table, row, method, one) for method, one in by_method.items()},
        note=_note(table, row, first, by_method["trainlm"]),
    )


def _trainer_result(
    table: int, row: PaperRow, method: Method, effort: Effort, results: Results
) -> TrainerResult | None:
    wanted = trainings(table, row, method, effort)
    if not wanted:
        return None
    level = None if row.trainer in GRADIENT_TRAINERS else row.mean_mm
    runs = [_run(results[one], N_TEST[table], level) for one in wanted]
    limited = any(run.was_cut for run in runs)
    return TrainerResult.of(wanted[0].trainer, runs, time_limit_s=wanted[0].time_limit_s if limited else None)


def _run(result: TrainingResult, n_test: int, level_mm: float | None) -> Run:
    few, many = result.errors(n_test, TEST_STREAM), result.errors(N_EVALUATION_POSES, EVALUATION_STREAM)
    epoch, seconds = next(((epoch, s) for level, epoch, s in result.reached if level == level_mm), (None, None))
    return Run(
        seed=result.training.seed,
        epochs=result.epochs,
        seconds=result.seconds,
        stop=result.stop,
        mean_mm=float(few.mean()),
        max_mm=float(few.max()),
        mean_many_mm=float(many.mean()),
        max_many_mm=float(many.max()),
        seconds_to_paper=seconds,
        epochs_to_paper=epoch,
        curve=result.curve,
    )


def verdict(table: int, row: PaperRow, method: Method, result: TrainerResult | None) -> str | None:
    """Judge the trainings of a row by `RULE`; None if the row shares the training of another row."""
    if equivalent_rows(table, row, method)[0] is not row:
        return None
    if result is None:
        return SKIPPED
    if (table, row.row) in BOX_FITTING_ROWS:
        return FITTED_BOX
    ratio, factor = result.median["mean_many_mm"] / row.mean_mm, FACTORS[table]
    if ratio <= factor:
        return "reproduced" if ratio >= 1 / factor else "better"
    return "not reached" if result.time_limit_s is None else CUT_SHORT


def _note(table: int, row: PaperRow, first: PaperRow, result: TrainerResult | None) -> str | None:
    notes = []
    if (table, row.row) in ACTIVATIONS:
        notes.append(
            "The table does not distinguish this row from row 6; the text mentions activation functions. These are our "
            "inference: with a linear layer the network is equivalent to one hidden layer of 50 units, which has the "
            "paper's error."
        )
    if table == 3 and row.row == 1:
        notes.append(
            "Goal 4e-9 in all rows, by the paper's text; its table says 4e-5, which is about 3 mm of mean error in "
            "this box."
        )
    if (table, row.row) in ODDITIES:
        notes.append(ODDITIES[table, row.row])
    if first is not row:
        notes.append(f"The same training as row {first.row}: {_reason(row, first, result)}.")
    if row.trainer in GRADIENT_TRAINERS or (table, row.row) in ACTIVATIONS:
        notes.append("varpro is that of row 6: the same network and poses.")
    return " ".join(notes) or None


def _reason(row: PaperRow, first: PaperRow, result: TrainerResult | None) -> str:
    """Why two rows are one training: no setting that differs has an effect."""
    if row.goal == first.goal:
        return "trainlm has no learning rate"
    if result is None:
        return "only the goal differs"
    met = sum(run.stop == GOAL_MET for run in result.runs)
    return f"only the goal differs, and {met or 'no'} start{'s' * (met > 1)} met that of row {first.row}"


# The figures ---------------------------------------------------------------------------------------------------------


def _figures(parts: Sequence[str], effort: Effort, results: Results) -> FigureData:
    tables = {4: "table 2", 6: "table 4", 7: "table 4", 8: "table 4"}

    def wanted(*numbers: int) -> bool:
        return any(f"figure {n}" in parts or tables.get(n) in parts for n in numbers)

    final = final_test_predictions(effort, results) if wanted(6, 7, 8) else {}
    return FigureData(
        arm=arm_pose() if wanted(1, 2) else None,
        network=(6, *TABLES[4][-1].hidden, 3) if wanted(3) else None,
        figure_4=_ten_poses(effort, results) if wanted(4) else None,
        figure_6=final.get("nominal"),
        figure_7=final.get("varpro"),
        figure_8=final.get("varpro"),
    )


def arm_pose() -> ArmPose:
    """The arm of Table 1 at its working pose: the frames by Denavit and Hartenberg, the base first."""
    angles = load_arm(ARM).working
    frames = [np.eye(4)]
    for joint, angle in zip(TABLE_1, angles, strict=True):
        turn = screw_z(np.radians(joint.theta_deg) + angle, joint.d_mm)
        frames.append(frames[-1] @ turn @ screw_x(np.radians(joint.alpha_deg), joint.a_mm))
    return ArmPose(np.degrees(angles), np.array(frames), (frames[-1] @ [*TIP_MM, 1])[:3])


def _ten_poses(effort: Effort, results: Results) -> Predictions | None:
    networks = {method: results.get(training_of(2, TABLES[2][0], method, effort, seed=0)) for method in METHODS}
    angles, points = SIMULATION.data(N_TEST[2], seed=0, stream=TEST_STREAM)
    predicted: dict[str, FloatArray] = {m: one.predict(angles) for m, one in networks.items() if one is not None}
    return Predictions(np.degrees(angles), points, predicted) if predicted else None
