"""A reproduction, made up: plausible shapes, no number measured."""

import numpy as np

from truearm.wings.gao2017.reproduction import arm_pose
from truearm.wings.gao2017.results import (
    Boxes,
    BoxStudy,
    Claims,
    FigureData,
    FinalTestResult,
    FinalTestRun,
    LearningRate,
    OutsideErrors,
    Predictions,
    Reproduction,
    RowResult,
    Run,
    Scatter,
    TrainerResult,
)
from truearm.wings.gao2017.tables import FINAL_TEST, TABLES, ModelErrors


def made_up_trainer(random, trainer, seeds, paper_mm, paper_s, *, factor):
    """Starts with about `factor` times the paper's error."""
    runs = []
    for seed in seeds:
        mean = paper_mm * factor * random.lognormal(0, 0.12)
        seconds = paper_s / 20 * random.lognormal(0, 0.3)
        reached = mean <= paper_mm
        runs.append(
            Run(
                seed=seed,
                epochs=int(random.integers(100, 1000)),
                seconds=seconds,
                stop="goal" if reached else "max_epochs",
                mean_mm=mean * random.lognormal(0, 0.1),
                max_mm=3.2 * mean,
                mean_many_mm=mean,
                max_many_mm=5.0 * mean,
                seconds_to_paper=0.7 * seconds if reached else None,
                epochs_to_paper=70 if reached else None,
                curve=tuple((k, seconds * k / 200, 60 * mean * (1 + k) ** -0.7) for k in range(0, 201, 10)),
            )
        )
    return TrainerResult.of(trainer, runs, time_limit_s=None)


def made_up_row(random, table, row, seeds):
    mean = row.mean_mm
    by_lm = row.trainer == "trainlm"
    results = {
        "trainlm": made_up_trainer(random, row.trainer, seeds, mean, row.seconds, factor=1.02),
        "varpro": made_up_trainer(random, "varpro", seeds, mean, row.seconds / 3, factor=0.8) if by_lm else None,
    }
    repeated = table == 2 and 6 <= row.row <= 11
    return RowResult(
        paper=row,
        activation="logsig" if (table, row.row) == (3, 9) else "tansig",
        same_training_as=1 if repeated else None,
        results=results,
        ratio={name: one and one.median["mean_many_mm"] / mean for name, one in results.items()},
        verdict={
            "trainlm": None if repeated else "reproduced",
            "varpro": None if repeated else "better" if by_lm else "skipped",
        },
        note="Made up: a reading of the paper." if (table, row.row) == (3, 9) else None,
    )


def made_up_final_test(seeds):
    fits = {
        "nominal": (0.4492, 0.9, 0.0, None),
        "trainlm": (0.0142, 0.13, 96.8, 80.0),
        "varpro": (0.0095, 0.061, 97.9, 45.0),
        "kinematic": (0.0078, 0.034, 98.3, 0.4),
    }
    paper = {"nominal": FINAL_TEST["nominal"], "network": FINAL_TEST["network"]}
    runs = [
        FinalTestRun(
            seed,
            {
                name: ModelErrors(mean + 0.0001 * seed, largest, {0.05: 5, 0.08: 1}, removed, seconds)
                for name, (mean, largest, removed, seconds) in fits.items()
            },
            0.0067,
        )
        for seed in seeds
    ]
    return FinalTestResult(200, paper, tuple(runs))


def made_up_claims(random):
    widths = np.array([15.0, 20, 25, 30, 35, 40, 45, 60])
    distance = np.array([0.0, 2, 5, 10, 15, 20, 30, 45])
    return Claims(
        LearningRate((0.1, 1.0, 0.01), (1, 8, 9), 8.61, (8.511, 8.7369, 8.1551)),
        Scatter(
            what="Table 2, row 1, from 30 starts",
            mean_mm=tuple((8.6 * random.lognormal(0, 0.06, 30)).tolist()),
            mean_many_mm=tuple((8.6 * random.lognormal(0, 0.03, 30)).tolist()),
            relative_spread=0.25,
            paper_rows=(1, 6, 7, 8, 9, 10, 11),
            paper_rows_mean_mm=(8.511, 8.8126, 8.1825, 8.7369, 8.1551, 8.8921, 10.1348),
            paper_relative_spread=0.23,
        ),
        BoxStudy(
            tuple(widths),
            {1: tuple(8.5 * (widths / 34) ** 2.7), 15: tuple(2.5 * (widths / 39) ** 4)},
            {1: 8.511, 15: 2.5537},
        ),
        OutsideErrors(
            tuple(distance),
            {
                "varpro": tuple(0.015 * np.exp(0.2 * distance)),
                "nominal": tuple(0.75 + 0 * distance),
                "kinematic": tuple(0.013 * np.exp(0.02 * distance)),
            },
            tuple(0.05 * np.exp(0.22 * distance)),
        ),
    )


def made_up_figures(random, poses):
    points = np.array([600.0, 20.0, 300.0]) + 300 * random.uniform(-1, 1, (poses, 3))
    wave = 0.4 * np.sin(points / 150) + np.array([0.3, -0.2, 0.2])
    networks = {
        name: points[:10] + random.normal(0, std, (10, 3)) for name, std in (("trainlm", 0.1), ("varpro", 0.06))
    }
    angles = arm_pose().angles_deg + random.uniform(-20, 20, (poses, 6))
    final = Predictions(angles, points, {"varpro": points + random.normal(0, 0.015, (poses, 3))})
    return FigureData(
        arm=arm_pose(),
        network=(6, 30, 30, 3),
        figure_4=Predictions(angles[:10], points[:10], networks),
        figure_6=Predictions(angles, points, {"nominal": points + wave}),
        figure_7=final,
        figure_8=final,
    )


def made_up_results(seeds=3, poses=40):
    """All parts of a reproduction."""
    random = np.random.default_rng(1)
    seeds = range(seeds)
    return Reproduction(
        truearm="0.1.0",
        machines=[{"cpu": "made-up CPU", "cores": 2, "python": "3.11.7", "numpy": "2.4.6"}],
        trained=("2001-01-01T00:00:00+00:00", "2001-01-01T01:00:00+00:00"),
        quick=False,
        skipped=[],
        training_seconds=3300.0,
        rule="reproduced: the median is within a factor of 1.5 of the paper's mean error",
        boxes=Boxes(38.0, 20.0, "Made up: the width at which row 15 has the paper's value."),
        tables={table: tuple(made_up_row(random, table, row, seeds) for row in rows) for table, rows in TABLES.items()},
        final_test=made_up_final_test(seeds),
        claims=made_up_claims(random),
        figures=made_up_figures(random, poses),
    )
