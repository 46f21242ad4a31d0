"""Findings of a reproduction, made up: plausible shapes, no number measured."""

import numpy as np

from truearm.arm.catalogue import load_arm
from truearm.arm.transforms import screw_x, screw_z
from truearm.papers.gao2017.tables import TABLES

KEYS = ("epochs", "seconds", "mean_mm", "max_mm", "mean_many_mm", "max_many_mm")


def made_up_trained(random, trainer, seeds, paper_mm, paper_s, *, factor):
    """Starts about `factor` times the paper's error."""
    runs = []
    for seed in seeds:
        mean = paper_mm * factor * random.lognormal(0, 0.12)
        seconds = paper_s / 20 * random.lognormal(0, 0.3)
        there = mean <= paper_mm
        runs.append(
            {
                "seed": seed,
                "epochs": int(random.integers(100, 1000)),
                "seconds": seconds,
                "stop": "goal" if there else "max_epochs",
                "mean_mm": mean * random.lognormal(0, 0.1),
                "max_mm": 3.2 * mean,
                "mean_many_mm": mean,
                "max_many_mm": 5.0 * mean,
                "seconds_to_paper": 0.7 * seconds if there else None,
                "epochs_to_paper": 70 if there else None,
            }
        )
    values = {key: [run[key] for run in runs] for key in KEYS}
    return {
        "trainer": trainer,
        "seeds": list(seeds),
        "time_limit_s": None,
        "runs": runs,
        "median": {key: float(np.median(v)) for key, v in values.items()},
        "range_mm": [min(values["mean_many_mm"]), max(values["mean_many_mm"])],
    }


def made_up_row(random, table, row, seeds):
    trainer, mean = row.trainer, row.mean_mm
    faithful = made_up_trained(random, trainer, seeds, mean, row.seconds, factor=1.02)
    ours = None if trainer != "trainlm" else made_up_trained(random, "lm", seeds, mean, row.seconds / 3, factor=0.8)
    repeated = table == 2 and 6 <= row.row <= 11
    return {
        "row": row.row,
        "n_train": row.n_train,
        "hidden": list(row.hidden),
        "activation": "logsig" if (table, row.row) == (3, 9) else "tansig",
        "learning_rate": row.learning_rate,
        "goal": row.goal,
        "same_training_as": 1 if repeated else None,
        "paper": {
            "trainer": trainer,
            "epochs": row.epochs,
            "seconds": row.seconds,
            "mean_mm": mean,
            "max_mm": row.max_mm,
        },
        "faithful": faithful,
        "ours": ours,
        "ratio": {
            "faithful": faithful["median"]["mean_many_mm"] / mean,
            "ours": None if ours is None else ours["median"]["mean_many_mm"] / mean,
        },
        "verdict": None if repeated else "reproduced",
        "verdict_ours": None if repeated else "left out" if ours is None else "better",
        "note": "Made up: a reading of the paper." if (table, row.row) == (3, 9) else None,
    }


def made_up_arm():
    """The founding paper's arm at its working pose, by Denavit and Hartenberg."""
    arm = load_arm("gao2017")
    table = [(0, 376, -90), (62, 0, -90), (0, 751, -90), (62, 0, -90), (0, 500, -90), (0, 15, 90)]
    frame, frames = np.eye(4), [np.eye(4)]
    for angle, (a, d, alpha) in zip(arm.working, table, strict=True):
        frame = frame @ screw_z(angle, d) @ screw_x(np.radians(alpha), a)
        frames.append(frame)
    return {
        "angles_deg": np.degrees(arm.working).tolist(),
        "frames": [f.tolist() for f in frames],
        "tip_mm": (frame @ [0, 0, 98, 1])[:3].tolist(),
    }


def made_up_findings(seeds=3, poses=40):
    """All parts of ``reproduction.json``."""
    random = np.random.default_rng(1)
    seeds = range(seeds)
    points = np.array([600.0, 20.0, 300.0]) + 300 * random.uniform(-1, 1, (poses, 3))
    wave = 0.4 * np.sin(points / 150) + np.array([0.3, -0.2, 0.2])
    noise = random.normal(0, 0.015, (poses, 3))
    fits = {
        "faithful": {"mean_mm": 0.0142, "max_mm": 0.13, "removed_percent": 96.8, "seconds": 80.0},
        "ours": {"mean_mm": 0.0095, "max_mm": 0.061, "removed_percent": 97.9, "seconds": 45.0},
        "kinematic": {"mean_mm": 0.0078, "max_mm": 0.034, "removed_percent": 98.3, "seconds": 0.4},
    }
    widths = np.array([15.0, 20, 25, 30, 35, 40, 45, 60])
    distance = np.array([0.0, 2, 5, 10, 15, 20, 30, 45])
    return {
        "truearm": "0.1.0",
        "machines": [{"cpu": "made-up CPU", "cores": 2, "python": "3.11.7", "numpy": "2.4.6"}],
        "trained": ["2001-01-01T00:00:00+00:00", "2001-01-01T01:00:00+00:00"],
        "quick": False,
        "left_out": [],
        "training_seconds": 3300.0,
        "rule": "reproduced: the median lies within a factor of 1.5 of the paper's mean error",
        "boxes": {
            "simulation_deg": 38,
            "experiment_deg": 20,
            "how": "made up: the width at which row 15 meets the paper's value",
        },
        "tables": {
            str(table): [made_up_row(random, table, row, seeds) for row in rows] for table, rows in TABLES.items()
        },
        "final_test": {
            "poses": 200,
            "paper": {
                "nominal": {"mean_mm": 0.4492, "max_mm": 0.8978},
                "network": {
                    "mean_mm": 0.0136,
                    "max_mm": 0.0873,
                    "over_0.08": 3,
                    "over_0.05": 13,
                    "removed_percent": 97,
                },
            },
            "runs": [
                {
                    "seed": seed,
                    "nominal": {"mean_mm": 0.4492 + 0.003 * seed, "max_mm": 0.9 + 0.01 * seed},
                    "noise_floor_mm": 0.0067,
                    **{
                        name: {**fit, "mean_mm": fit["mean_mm"] + 0.0001 * seed, "over_0.05": 5, "over_0.08": 1}
                        for name, fit in fits.items()
                    },
                }
                for seed in seeds
            ],
        },
        "claims": {
            "learning_rate": {
                "rates": [0.1, 1.0, 0.01],
                "rows": [1, 8, 9],
                "mean_mm": 8.61,
                "paper_mean_mm": [8.511, 8.7369, 8.1551],
            },
            "scatter": {
                "what": "Table 2 row 1 over 30 starts",
                "mean_mm": (8.6 * random.lognormal(0, 0.06, 30)).tolist(),
                "mean_many_mm": (8.6 * random.lognormal(0, 0.03, 30)).tolist(),
                "relative_spread": 0.25,
                "paper_relative_spread": 0.23,
                "paper_rows": [1, 6, 7, 8, 9, 10, 11],
                "paper_rows_mean_mm": [8.511, 8.8126, 8.1825, 8.7369, 8.1551, 8.8921, 10.1348],
            },
            "boxes": {
                "half_width_deg": widths.tolist(),
                "row1_mean_mm": (8.5 * (widths / 34) ** 2.7).tolist(),
                "row15_mean_mm": (2.5 * (widths / 39) ** 4).tolist(),
                "paper_row1": 8.511,
                "paper_row15": 2.5537,
            },
            "outside": {
                "distance_deg": distance.tolist(),
                "lm_median_mm": (0.015 * np.exp(0.2 * distance)).tolist(),
                "lm_p95_mm": (0.05 * np.exp(0.22 * distance)).tolist(),
                "nominal_median_mm": (0.75 + 0 * distance).tolist(),
                "kinematic_median_mm": (0.013 * np.exp(0.02 * distance)).tolist(),
            },
        },
        "figures": {
            "arm": made_up_arm(),
            "network": {"sizes": [6, 30, 30, 3]},
            "4": {
                "points_mm": points[:10].tolist(),
                "predicted_mm": {
                    "faithful": (points[:10] + random.normal(0, 0.1, (10, 3))).tolist(),
                    "ours": (points[:10] + random.normal(0, 0.06, (10, 3))).tolist(),
                },
            },
            "6": {"deviation_mm": wave.tolist()},
            "7": {"points_mm": points.tolist(), "predicted_mm": {"ours": (points + noise).tolist()}},
            "8": {"deviation_mm": noise.tolist()},
        },
    }
