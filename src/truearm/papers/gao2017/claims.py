"""What the founding paper's claims on settings are worth: learning rate, scatter of starts, the box of joint angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from truearm.papers.gao2017.tables import N_TEST, TABLES
from truearm.papers.gao2017.training import EVALUATION_STREAM, N_EVALUATION_POSES, TEST_STREAM, Training, TrainingResult
from truearm.papers.gao2017.training_plan import Effort, box_rows, box_training, equivalent_rows, trainings


def first_row_networks(effort: Effort, done: Mapping[Training, TrainingResult]) -> list[TrainingResult]:
    """The faithful networks of Table 2, row 1."""
    return [done[one] for one in trainings(2, TABLES[2][0], "faithful", effort) if one in done]


def learning_rate(networks: Sequence[TrainingResult]) -> dict[str, Any] | None:
    """Table 2, row 1, beside the rows that differ in nothing but the learning rate, which ``trainlm`` does not take."""
    if not networks:
        return None
    first = TABLES[2][0]
    rows = [row for row in equivalent_rows(2, first, "faithful") if row.goal == first.goal]
    return {
        "rates": [float(row.learning_rate) for row in rows],
        "rows": [row.row for row in rows],
        "mean_mm": median(float(one.errors(N_EVALUATION_POSES, EVALUATION_STREAM).mean()) for one in networks),
        "paper_mean_mm": [row.mean_mm for row in rows],
    }


def scatter(networks: Sequence[TrainingResult]) -> dict[str, Any] | None:
    """Table 2, row 1, from many starts, beside the paper's rows that differ only in what has no effect."""
    if len(networks) < 2:
        return None
    few = [float(one.errors(N_TEST[2], TEST_STREAM).mean()) for one in networks]
    many = [float(one.errors(N_EVALUATION_POSES, EVALUATION_STREAM).mean()) for one in networks]
    rows = equivalent_rows(2, TABLES[2][0], "faithful")
    return {
        "what": f"Table 2, row 1, from {len(networks)} starts, each tested on {N_TEST[2]} poses of its own",
        "mean_mm": few,
        "mean_many_mm": many,
        "relative_spread": relative_spread(few),
        "paper_rows": [row.row for row in rows],
        "paper_rows_mean_mm": [row.mean_mm for row in rows],
        "paper_relative_spread": relative_spread([row.mean_mm for row in rows]),
    }


def relative_spread(values: Sequence[float]) -> float:
    """From the least to the largest, by the median."""
    return (max(values) - min(values)) / median(values)


def box_study(effort: Effort, done: Mapping[Training, TrainingResult]) -> dict[str, Any]:
    """Rows 1 and 15 of Table 2 in boxes of several half-widths, one start each."""
    rows = box_rows()
    means = {
        row.row: [
            float(done[box_training(row, h, effort)].errors(N_EVALUATION_POSES, EVALUATION_STREAM).mean())
            for h in effort.half_widths_deg
        ]
        for row in rows
    }
    return {
        "half_width_deg": list(effort.half_widths_deg),
        **{f"row{number}_mean_mm": found for number, found in means.items()},
        **{f"paper_row{row.row}": row.mean_mm for row in rows},
    }
