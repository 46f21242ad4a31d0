"""Findings of a reproduction, made up: plausible shapes, no number measured."""

import numpy as np

from truearm.arm.catalogue import load
from truearm.arm.frames import screw_x, screw_z

ROWS = {
    "2": [
        (10000, [10], 0.1, 4e-5, 1000, 124, 25.908, 8.511, None),
        (8000, [10], 0.1, 4e-5, 516, 51, 20.4858, 8.6132, None),
        (5000, [10], 0.1, 4e-5, 1000, 64, 22.6937, 9.4585, None),
        (20000, [10], 0.1, 4e-5, 586, 253, 22.3574, 8.9189, None),
        (9000, [10], 0.1, 4e-5, 1000, 115, 20.6444, 8.3117, None),
        (10000, [10], 0.1, 1e-5, 1000, 127, 26.887, 8.8126, 1),
        (10000, [10], 0.1, 4e-6, 1000, 126, 25.8964, 8.1825, 1),
        (10000, [10], 1.0, 4e-5, 360, 123, 21.5603, 8.7369, 1),
        (10000, [10], 0.01, 4e-5, 1000, 125, 18.1312, 8.1551, 1),
        (10000, [10], 0.001, 4e-5, 1000, 125, 27.6223, 8.8921, 1),
        (10000, [10], 10.0, 4e-5, 136, 17, 31.2093, 10.1348, 1),
        (10000, [3], 0.1, 4e-5, 1000, 93, 90.7123, 34.1409, None),
        (10000, [4], 0.1, 4e-5, 293, 25, 68.0939, 26.4297, None),
        (10000, [13], 0.1, 4e-5, 589, 89, 14.8641, 6.3235, None),
        (10000, [50], 0.1, 4e-5, 40, 21, 6.1157, 2.5537, None),
        (10000, [100], 0.1, 4e-5, 17, 12, 9.4408, 2.8841, None),
        (10000, [20, 20], 0.1, 4e-5, 38, 23, 11.5531, 2.4639, None),
    ],
    "3": [
        (9000, [100], 0.01, 4e-9, 1000, 922, 2.5544, 0.2452, None),
        (9000, [200], 0.01, 4e-9, 1000, 2298, 0.6351, 0.0967, None),
        (9000, [300], 0.01, 4e-9, 1000, 4161, 0.5994, 0.0629, None),
        (9000, [10, 10], 0.01, 4e-9, 738, 43, 17.1128, 2.6204, None),
        (9000, [30, 30], 0.01, 4e-9, 1000, 1289, 0.4888, 0.0833, None),
        (9000, [50, 50], 0.01, 4e-9, 582, 6431, 0.2071, 0.0315, None),
        (9000, [40, 40], 0.01, 4e-9, 1000, 2177, 0.5525, 0.0467, None),
        (9000, [80, 80], 0.01, 4e-9, 150, 2769, 0.7598, 0.0497, None),
        (9000, [50, 50], 0.01, 4e-9, 1000, 4237, 6.4022, 0.6042, None),
        (9000, [50, 50], 0.01, 4e-9, 1000, 4237, 4.3345, 0.6983, None),
        (9000, [50, 50], 0.01, 4e-9, 1000, 24, 633.8425, 119.36, None),
        (9000, [50, 50], 0.01, 4e-9, 119, 3, 383.9885, 105.247, None),
    ],
    "4": [
        (3000, [50, 50], 0.01, 4e-9, 100, 176, 0.3199, 0.0293, None),
        (3000, [40, 40], 0.01, 4e-9, 704, 625, 0.1735, 0.0201, None),
        (3000, [300], 0.01, 4e-9, 911, 1662, 0.4059, 0.0503, None),
        (3000, [30, 30], 0.01, 4e-9, 1000, 404, 0.1428, 0.0149, None),
    ],
}
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
        "range": {key: [min(v), max(v)] for key, v in values.items()},
    }


def made_up_row(random, table, number, settings, seeds):
    n_train, hidden, rate, goal, epochs, seconds, largest, mean, same = settings
    trainer = {("3", 11): "traingd", ("3", 12): "traingdx"}.get((table, number), "trainlm")
    faithful = made_up_trained(random, trainer, seeds, mean, seconds, factor=1.02)
    ours = None if trainer != "trainlm" else made_up_trained(random, "lm", seeds, mean, seconds / 3, factor=0.8)
    return {
        "row": number,
        "n_train": n_train,
        "hidden": hidden,
        "activation": {("3", 9): "logsig", ("3", 10): "purelin"}.get((table, number), "tansig"),
        "learning_rate": rate,
        "goal": goal,
        "max_epochs": 1000,
        "same_training_as": same,
        "paper": {"trainer": trainer, "epochs": epochs, "seconds": seconds, "mean_mm": mean, "max_mm": largest},
        "faithful": faithful,
        "ours": ours,
        "ratio": {
            "mean": {
                "faithful": faithful["median"]["mean_many_mm"] / mean,
                "ours": None if ours is None else ours["median"]["mean_many_mm"] / mean,
            }
        },
        "verdict": "reproduced",
        "verdict_ours": "left out" if ours is None else "better",
        "note": "Made up: a reading of the paper." if (table, number) == ("3", 9) else None,
        "rule": "reproduced: the faithful median lies within a factor of 1.5 of the paper's mean error",
    }


def made_up_arm():
    """The founding paper's arm at its working pose, by Denavit and Hartenberg."""
    arm = load("gao2017")
    table = [(0, 376, -90), (62, 0, -90), (0, 751, -90), (62, 0, -90), (0, 500, -90), (0, 15, 90)]
    frame, frames = np.eye(4), [np.eye(4)]
    for angle, (a, d, alpha) in zip(arm.working, table, strict=True):
        frame = frame @ screw_z(angle, d) @ screw_x(np.radians(alpha), a)
        frames.append(frame)
    return {
        "angles_deg": np.degrees(arm.working).tolist(),
        "frames": [f.tolist() for f in frames],
        "origins_mm": [f[:3, 3].tolist() for f in frames],
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
        "machine": {"cpu": "made-up CPU", "cores": 2, "python": "3.11.7", "numpy": "2.4.6"},
        "quick": False,
        "left_out": [],
        "seconds": 3300.0,
        "boxes": {
            "simulation_deg": 38,
            "experiment_deg": 20,
            "how": "made up: the width at which row 15 meets the paper's value",
        },
        "tables": {
            table: [made_up_row(random, table, i, settings, seeds) for i, settings in enumerate(rows, start=1)]
            for table, rows in ROWS.items()
        },
        "final_test": {
            "poses": 200,
            "paper": {
                "nominal": {"mean_mm": 0.4492, "max_mm": 0.8978},
                "network": {"mean_mm": 0.0136, "max_mm": 0.0873, "over_0.08": 3, "over_0.05": 13},
                "removed_percent": 97,
            },
            "seeds": list(seeds),
            "runs": [
                {
                    "seed": seed,
                    "nominal_mean_mm": 0.4492 + 0.003 * seed,
                    "nominal_max_mm": 0.9 + 0.01 * seed,
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
                "mean_mm": [8.61, 8.61, 8.61],
                "identical": True,
                "paper_mean_mm": [8.511, 8.7369, 8.1551],
            },
            "scatter": {
                "what": "Table 2 row 1 over 30 starts",
                "mean_mm": (8.6 * random.lognormal(0, 0.06, 30)).tolist(),
                "max_mm": (24 * random.lognormal(0, 0.1, 30)).tolist(),
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
                "median_mm": (0.015 * np.exp(0.2 * distance)).tolist(),
                "p95_mm": (0.05 * np.exp(0.22 * distance)).tolist(),
                "nominal_mm": 0.75,
                "kinematic_mm": (0.013 * np.exp(0.02 * distance)).tolist(),
            },
            "percent": {
                "nominal_mean_mm": 0.4492,
                "network_mean_mm": 0.0095,
                "floor_mm": 0.0067,
                "removed_percent": 97.9,
                "text": "",
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
            "7": {"points_mm": points.tolist(), "predicted_mm": (points + noise).tolist()},
            "8": {"deviation_mm": noise.tolist()},
        },
    }
