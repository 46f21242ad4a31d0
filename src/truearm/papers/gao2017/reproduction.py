"""The founding paper's tables and figures, computed anew beside what it prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from truearm import __version__
from truearm.arm import load_arm
from truearm.arm.chain import Chain
from truearm.papers.gao2017.claims import box_study, first_row_networks, learning_rate, scatter
from truearm.papers.gao2017.final_test import errors_outside_box, final_test, networks_by_seed, run_final_tests
from truearm.papers.gao2017.tables import FINAL_TEST, N_TEST, TABLES, PaperRow
from truearm.papers.gao2017.training import (
    ARM,
    EVALUATION_STREAM,
    FINAL_TEST_STREAM,
    GRADIENT_TRAINERS,
    N_EVALUATION_POSES,
    TEST_STREAM,
    ProgressCallback,
    Training,
    TrainingResult,
    machine_data,
    run_training,
)
from truearm.papers.gao2017.training_plan import (
    ACTIVATIONS,
    BOX_FITTING_ROWS,
    EXPERIMENT,
    METHODS,
    SIMULATION,
    Effort,
    Method,
    activations_of,
    equivalent_rows,
    plan_trainings,
    training_of,
    trainings,
)

HOW = (
    "The paper does not give the joint ranges. The simulations' box is the one in which the distinct rows of Table 2 "
    "with 10000 poses (1 and 12 to 17, networks of 3 to 100 units, trained faithfully) err by the paper's averages, "
    "as the geometric mean of their ratios has it; no box fits every row. The experiment's box is the one of truearm "
    "demo, in which lm comes below the paper's average of row 4 of Table 4; no criterion singles it out. Were the "
    "paper's ranges wider, its networks would be better than ours, and worse were they narrower: errors grow steeply "
    "with the box."
)

FACTORS = {2: 1.5, 3: 1.5, 4: 1.2}
RULE = (
    f"reproduced: the median of our starts, each tested on {N_EVALUATION_POSES} further poses, is within a factor of the paper's "
    f"average, {FACTORS[2]:g} in Tables 2 and 3 and {FACTORS[4]:g} in Table 4; better: it is smaller than that; not "
    "reached: it is larger. The factors are what chance makes of the paper's few test poses: 95 % of the averages "
    "over 10 poses lie within 0.64 and 1.53 times that over all, over 100 poses within 0.87 and 1.15. Not counted "
    "are rows that were used to fix the box, for they would agree by construction; rows stopped by our limit, in "
    "which a training was cut short; and rows that repeat the training of another, which have no verdict"
)
LEFT_OUT, USED_TO_FIX_BOX, CUT_SHORT = "left out", "used to fix the box", "stopped by our limit"
GOAL_MET, TIME_OVER = "Performance goal met.", "Maximum time elapsed."
RUN_KEYS = ("epochs", "seconds", "mean_mm", "max_mm", "mean_many_mm", "max_many_mm")


def reproduce(
    parts: Sequence[str], *, effort: Effort, folder: Path, tell: ProgressCallback | None = None
) -> dict[str, Any]:
    """Run what is not yet in `folder`, and put the findings together.

    Parameters
    ----------
    parts : sequence of str
        Of `PARTS`.
    effort : Effort
    folder : path
        Holds a file for every finished training, and a checkpoint of the one that was stopped.
    tell : callable, optional
        Told the share of the estimated time that is done, and what is being trained.

    Returns
    -------
    dict
        As ``reproduction.json`` holds it: lengths in mm, times in s, None for what was not run.
    """
    wanted, left_out = plan_trainings(parts, effort)
    done = _run_all(wanted, folder, tell or _silent)
    experiments = run_final_tests(effort, done) if "table 4" in parts else []
    ended = [one.ended for one in done.values()]
    first = first_row_networks(effort, done) if "table 2" in parts else []
    machines = [one.machine for one in done.values()] or [machine_data()]
    return {
        "truearm": __version__,
        "machines": [one for k, one in enumerate(machines) if one not in machines[:k]],
        "trained": [min(ended), max(ended)] if ended else None,
        "quick": effort.quick,
        "left_out": left_out,
        "training_seconds": sum(one.seconds for one in done.values()),
        "rule": RULE,
        "boxes": {
            "simulation_deg": SIMULATION.half_width_deg,
            "experiment_deg": EXPERIMENT.half_width_deg,
            "how": HOW,
        },
        "tables": {
            str(table): [_row_found(table, row, effort, done) for row in rows] if f"table {table}" in parts else None
            for table, rows in TABLES.items()
        },
        "final_test": final_test(experiments),
        "claims": {
            "learning_rate": learning_rate(first),
            "scatter": scatter(first),
            "boxes": box_study(effort, done) if "boxes" in parts else None,
            "outside": errors_outside_box(effort, done) if "table 4" in parts else None,
        },
        "figures": _figures(parts, effort, done),
    }


def _silent(share: float, note: str) -> None:
    """Tell nobody."""


def _tell_part(tell: ProgressCallback, begun: float, share: float, what: str, part: float, note: str) -> None:
    tell(begun + share * part, f"{what}, {note}")


def _run_all(wanted: Sequence[Training], folder: Path, tell: ProgressCallback) -> dict[Training, TrainingResult]:
    done: dict[Training, TrainingResult] = {}
    total, before = sum(one.estimated_seconds for one in wanted), 0.0
    for number, training in enumerate(wanted, start=1):
        share = training.estimated_seconds / total
        what = f"{number}/{len(wanted)}: {'-'.join(map(str, training.hidden))} {training.trainer} seed {training.seed}"

        done[training] = run_training(training, folder, partial(_tell_part, tell, before, share, what))
        before += share
    return done


# The tables ----------------------------------------------------------------------------------------------------------


def _row_found(table: int, row: PaperRow, effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any]:
    found: dict[str, Any] = {side: _side_found(table, row, side, effort, done) for side in METHODS}
    medians = {side: None if one is None else one["median"]["mean_many_mm"] for side, one in found.items()}
    first = equivalent_rows(table, row, "faithful")[0]
    activations = activations_of(table, row)
    return {
        "row": row.row,
        "n_train": row.n_train,
        "hidden": list(row.hidden),
        "activation": activations[0] if len(set(activations)) == 1 else ", ".join(activations),
        "learning_rate": row.learning_rate,
        "goal": row.goal,
        "same_training_as": None if first is row else first.row,
        "paper": {
            "trainer": row.trainer,
            "epochs": row.epochs,
            "seconds": row.seconds,
            "mean_mm": row.mean_mm,
            "max_mm": row.max_mm,
        },
        **found,
        "ratio": {side: None if m is None else m / row.mean_mm for side, m in medians.items()},
        "verdict": verdict(table, row, "faithful", found["faithful"]),
        "verdict_ours": verdict(table, row, "ours", found["ours"]),
        "note": _note(table, row, first, found),
    }


def _side_found(
    table: int, row: PaperRow, side: Method, effort: Effort, done: Mapping[Training, TrainingResult]
) -> dict[str, Any] | None:
    wanted = trainings(table, row, side, effort)
    if not wanted:
        return None
    level = None if row.trainer in GRADIENT_TRAINERS else row.mean_mm
    runs = [_run_found(done[one], N_TEST[table], level) for one in wanted]
    many = [run["mean_many_mm"] for run in runs]
    limited = any(run["stop"] == TIME_OVER for run in runs)
    return {
        "trainer": wanted[0].trainer,
        "seeds": [one.seed for one in wanted],
        "time_limit_s": wanted[0].time_limit_s if limited else None,
        "runs": runs,
        "median": {key: float(median(run[key] for run in runs)) for key in RUN_KEYS},
        "range_mm": [min(many), max(many)],
    }


def _run_found(done: TrainingResult, n_test: int, level_mm: float | None) -> dict[str, Any]:
    few, many = done.errors(n_test, TEST_STREAM), done.errors(N_EVALUATION_POSES, EVALUATION_STREAM)
    epoch, seconds = (None, None) if level_mm is None else done.reached.get(level_mm, (None, None))
    return {
        "seed": done.training.seed,
        "epochs": done.epochs,
        "seconds": done.seconds,
        "stop": done.stop,
        "mean_mm": float(few.mean()),
        "max_mm": float(few.max()),
        "mean_many_mm": float(many.mean()),
        "max_many_mm": float(many.max()),
        "seconds_to_paper": seconds,
        "epochs_to_paper": epoch,
    }


def verdict(table: int, row: PaperRow, side: Method, found: Mapping[str, Any] | None) -> str | None:
    """What a row's trainings come to, by `RULE`; None where another row's training serves it.

    Parameters
    ----------
    table : int
    row : PaperRow
        Of `TABLES`.
    side : str
        ``"faithful"`` or ``"ours"``.
    found : mapping or None
        With ``median`` and ``time_limit_s``; None for a row that was left out.
    """
    if equivalent_rows(table, row, side)[0] is not row:
        return None
    if found is None:
        return LEFT_OUT
    if (table, row.row) in BOX_FITTING_ROWS:
        return USED_TO_FIX_BOX
    ratio, factor = found["median"]["mean_many_mm"] / row.mean_mm, FACTORS[table]
    if ratio <= factor:
        return "reproduced" if ratio >= 1 / factor else "better"
    return "not reached" if found["time_limit_s"] is None else CUT_SHORT


def _note(table: int, row: PaperRow, first: PaperRow, found: Mapping[str, Any]) -> str | None:
    notes = []
    if (table, row.row) in ACTIVATIONS:
        notes.append(
            "The table does not tell this row from row 6; the text speaks of activation functions. These are our "
            "inference: with a linear layer the network is worth one hidden layer of 50 units, which errs as much as "
            "the paper's."
        )
    if table == 3 and row.row == 1:
        notes.append(
            "Goal 4e-9 in all rows, by the paper's text; its table says 4e-5, which is about 3 mm of mean error in "
            "this box."
        )
    if first is not row:
        notes.append(f"The same training as row {first.row}: {_same(row, first, found['faithful'])}.")
    if row.trainer in GRADIENT_TRAINERS or (table, row.row) in ACTIVATIONS:
        notes.append("Ours is that of row 6: the same network and poses.")
    return " ".join(notes) or None


def _same(row: PaperRow, first: PaperRow, faithful: Mapping[str, Any] | None) -> str:
    """Why two rows are one training: nothing that differs has a part in it."""
    if row.goal == first.goal:
        return "trainlm takes no learning rate"
    if faithful is None:
        return "only the goal differs"
    met = sum(run["stop"] == GOAL_MET for run in faithful["runs"])
    return f"only the goal differs, and {met or 'no'} start{'s' * (met > 1)} met that of row {first.row}"


# The figures ---------------------------------------------------------------------------------------------------------


def _figures(parts: Sequence[str], effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any]:
    def asked(*numbers: int) -> bool:
        tables = {4: "table 2", 6: "table 4", 7: "table 4", 8: "table 4"}
        return any(f"figure {n}" in parts or tables.get(n) in parts for n in numbers)

    drawn = {"arm": _arm_frames() if asked(1, 2) else None}
    drawn["network"] = {"sizes": [6, *TABLES[4][-1].hidden, 3]} if asked(3) else None
    return {
        **drawn,
        "4": _ten_poses(effort, done) if asked(4) else None,
        **(_final_figures(effort, done) if asked(6, 7, 8) else {"6": None, "7": None, "8": None}),
    }


def _arm_frames() -> dict[str, Any]:
    """The frames of Denavit and Hartenberg at the working pose, the base first."""
    arm = load_arm(ARM)
    chain, angles = arm.chain, arm.working
    frames = [chain.fixed[0]]
    for i in range(1, chain.n_joints + 1):
        pose = Chain(chain.fixed[: i + 1], np.zeros(3), chain.is_prismatic[:i]).pose(angles[None, :i])
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = pose.R_base_tip[0], pose.tip_in_base[0]
        frames.append(frame)
    return {
        "angles_deg": np.degrees(angles).tolist(),
        "frames": [frame.tolist() for frame in frames],
        "tip_mm": chain.tip_in_base(angles[None])[0].tolist(),
    }


def _ten_poses(effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any] | None:
    networks = {side: done.get(training_of(2, TABLES[2][0], side, effort, seed=0)) for side in METHODS}
    if not any(networks.values()):
        return None
    angles, points = SIMULATION.data(N_TEST[2], seed=0, stream=TEST_STREAM)
    return {
        "points_mm": points.tolist(),
        "predicted_mm": {
            side: None if network is None else network.predict(angles).tolist() for side, network in networks.items()
        },
    }


def _final_figures(effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any]:
    angles, points = EXPERIMENT.data(FINAL_TEST.poses, seed=0, stream=FINAL_TEST_STREAM)
    found: dict[str, Any] = {
        "6": {"deviation_mm": (load_arm(ARM).chain.tip_in_base(angles) - points).tolist()},
        "7": None,
        "8": None,
    }
    network = networks_by_seed(effort, done, "ours").get(0)
    if network is not None:
        predicted = network.predict(angles)
        found["7"] = {"points_mm": points.tolist(), "predicted_mm": {"ours": predicted.tolist()}}
        found["8"] = {"deviation_mm": (predicted - points).tolist()}
    return found
