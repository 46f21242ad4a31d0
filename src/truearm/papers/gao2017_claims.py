"""What the founding paper's claims on settings are worth: learning rate, scatter of starts, the box of joint angles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from truearm.papers.gao2017_plan import Effort, alike, box_rows, box_training, training_of, trainings
from truearm.papers.gao2017_tables import N_TEST, TABLES
from truearm.papers.gao2017_training import FURTHER, MANY, N_MANY, Trained, Training


def learning_rate(effort: Effort, done: Mapping[Training, Trained]) -> dict[str, Any] | None:
    """Table 2, row 1, at the learning rates of the rows that differ in nothing else, from one start.

    MATLAB's ``trainlm`` has no learning rate, nor has ours: the rows are one training.
    """
    rows = [row for row in alike(2, TABLES[2][0], "faithful") if row.goal == TABLES[2][0].goal]
    runs = [done.get(training_of(2, row, "faithful", effort, seed=0)) for row in rows]
    means = [float(run.errors(N_MANY, MANY).mean()) for run in runs if run is not None]
    if len(means) < len(rows):
        return None
    return {
        "rows": [row.row for row in rows],
        "rates": [float(row.learning_rate) for row in rows],
        "mean_mm": means,
        "identical": len(set(means)) == 1,
        "paper_mean_mm": [row.mean_mm for row in rows],
    }


def scatter(effort: Effort, done: Mapping[Training, Trained]) -> dict[str, Any] | None:
    """Table 2, row 1, from many starts, beside the paper's rows that differ only in what has no effect."""
    row = TABLES[2][0]
    errors = [done[one].errors(N_TEST[2], FURTHER) for one in trainings(2, row, "faithful", effort) if one in done]
    if not errors:
        return None
    rows = alike(2, row, "faithful")
    return {
        "what": f"Table 2, row {row.row}, over {len(errors)} starts, each tested on {N_TEST[2]} poses of its own",
        "mean_mm": [float(one.mean()) for one in errors],
        "max_mm": [float(one.max()) for one in errors],
        "paper_rows": [one.row for one in rows],
        "paper_rows_mean_mm": [one.mean_mm for one in rows],
    }


def boxes(effort: Effort, done: Mapping[Training, Trained]) -> dict[str, Any]:
    """Rows 1 and 15 of Table 2 in boxes of several half-widths, one start each."""
    rows = box_rows()
    means = {
        row.row: [float(done[box_training(row, h, effort)].errors(N_MANY, MANY).mean()) for h in effort.half_widths_deg]
        for row in rows
    }
    return {
        "half_width_deg": list(effort.half_widths_deg),
        **{f"row{number}_mean_mm": found for number, found in means.items()},
        **{f"paper_row{row.row}": row.mean_mm for row in rows},
    }
