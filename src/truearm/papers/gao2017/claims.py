"""Experiments on the paper's claims about settings: learning rate, scatter of starts, the box of joint angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

from truearm.papers.gao2017.results import BoxStudy, LearningRate, Scatter
from truearm.papers.gao2017.tables import N_TEST, TABLES
from truearm.papers.gao2017.training import EVALUATION_STREAM, N_EVALUATION_POSES, TEST_STREAM, Training, TrainingResult
from truearm.papers.gao2017.training_plan import Effort, box_rows, box_training, equivalent_rows, trainings


def first_row_networks(effort: Effort, results: Mapping[Training, TrainingResult]) -> list[TrainingResult]:
    """The trainlm networks of Table 2, row 1."""
    return [results[one] for one in trainings(2, TABLES[2][0], "trainlm", effort) if one in results]


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
