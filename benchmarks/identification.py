"""Identification of real and virtual arms: errors held out, coverage, transfer, evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scipy.stats import chi2

from benchmarks.held_out import (
    HELD_OUT,
    LEVEL,
    MODELS,
    SPLITS,
    over_splits,
    split,
    squared_lengths,
    three_figures,
    told,
)
from benchmarks.rows import RowResult, Rows, Target
from truearm.arm import Arm, load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.references.alignment import align
from truearm.identification.references.reading_references import place_base_coarsely, references_of, state_of
from truearm.identification.terms import Term, candidate_terms, constants
from truearm.models import PhysicalModel
from truearm.models.refit import refit
from truearm.readings import Session, point_errors
from truearm.readings.lengths import Lengths
from truearm.readings.point_errors import length_errors, seat_errors
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.importing import datasets
from truearm.wings.planning.designs.sampling import STRATEGIES
from truearm.wings.planning.virtual import Measurement, VirtualArm, load_preset

ROWS = Rows()
ONE = {"seeds": 1}
# A held-out reading is an outlier where its squared Mahalanobis length, by the uncertainty that the model states and
# that of the reference, is one that a Gaussian reading passes once in a thousand million (6.7 standard deviations).
OUTLIER = float(chi2.isf(1e-9, 3))
QUARTERS = 4
FIRST_LINE = 2  # of a set's first reading in its file

# Arms that a laser tracker measured ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Seen:
    """Readings held out of a split as a model sees them; `session` of `test` is each reading's number, from 0.

    Squared Mahalanobis lengths of the deviations, seconds of the fit, quarters by the distance of the angles from their
    training mean and by the sides of the training medians on which joints 2 and 3 are.
    """

    points: FloatArray
    squares: FloatArray
    seconds: float
    test: Session
    ring: IntArray
    quadrant: IntArray


@cache
def seen(name: str, seed: int, label: str) -> Seen:
    """Fit a model to what one split trains on, once."""
    readings = datasets.load_readings(name)
    numbered = replace(readings, session=np.arange(len(readings)).astype(np.str_))
    train, test = numbered.split(by=SPLITS[name], hold_out=HELD_OUT, seed=seed)
    model = MODELS[label](load_arm(datasets.DATASETS[name].arm)).fit_readings(replace(train, session=None))
    points, covariance = model.predict_readings(test, return_cov=True)
    lengths = squared_lengths(points, covariance, test)
    return Seen(points, lengths, model.fit_seconds_, test, *quarters(train.angles, test.angles))


def held_out(name: str, limits: dict[str, float], seeds: int) -> RowResult:
    """Errors on what the splits hold out, of the three models; `limits` of the physical model's figures."""
    table, figures = [], {}
    for label in MODELS:
        each = [seen(name, seed, label) for seed in range(seeds)]
        figures[label] = over_splits([three_figures(one.points, one.test.points) for one in each])
        seconds = float(np.median([one.seconds for one in each]))
        table.append({"model": label, "mean / p95 / max [mm]": told(figures[label]), "fit [s]": seconds})
    targets = [
        Target(f"{name}: {figure.removesuffix('_mm')} of held-out errors [mm]", figures["physical"][figure], limit)
        for figure, limit in limits.items()
    ]
    return RowResult(table, targets, [f"{HELD_OUT:.0%} held out by {SPLITS[name]} (max: largest of all splits)"])


@ROWS.row("ur10-b", quick=ONE)
def ur10_b(seeds: int = 5) -> RowResult:
    """UR10 series B: held-out errors."""
    row = held_out("ur10-b", {"mean_mm": 0.080, "p95_mm": 0.17, "max_mm": 0.45}, seeds)
    return with_outliers_named(row, "ur10-b", {"mean": 0.080, "max": 0.45}, seeds)


@ROWS.row("ur10-a", quick=ONE)
def ur10_a(seeds: int = 5) -> RowResult:
    """UR10 series A: held-out errors; bad readings are named, and the others judged."""
    row = held_out("ur10-a", {"mean_mm": 0.075, "p95_mm": 0.15}, seeds)
    return with_outliers_named(row, "ur10-a", {"max": 0.6}, seeds)


def with_outliers_named(row: RowResult, name: str, limits: dict[str, float], seeds: int) -> RowResult:
    """Add to a row the held-out readings that the physical model's uncertainty rules out, and the errors of the rest.

    `limits` are of their `mean` over all splits and of the largest, `max` [mm].
    """
    bad: dict[int, float] = {}
    means, largest = [], []
    for one in (seen(name, seed, "physical") for seed in range(seeds)):
        errors = np.linalg.norm(one.points - one.test.points, axis=1)
        is_bad = one.squares > OUTLIER
        bad |= {int(one.test.session[i]): float(errors[i]) for i in np.flatnonzero(is_bad)}
        means.append(float(errors[~is_bad].mean()))
        largest.append(float(errors[~is_bad].max()))
    rest = {"mean": float(np.mean(means)), "max": max(largest)}
    targets = [Target(f"{name}: {what} of those not named outliers [mm]", rest[what], limits[what]) for what in limits]
    notes = [
        (
            f"Outliers are held-out readings whose squared Mahalanobis length is beyond {OUTLIER:.1f} (chi-squared of 3"
            " degrees of freedom, probability 1e-9 for a Gaussian reading), by the model's stated uncertainty alone."
        ),
        (
            f"{len(bad)} of {len(datasets.load_readings(name))} readings were named in a split or more, by line of the"
            f" file (error [mm]): {', '.join(f'{i + FIRST_LINE} ({bad[i]:.2f})' for i in sorted(bad))}"
        ),
        f"Of the others the mean is {rest['mean']:.4f}, the largest {rest['max']:.3f} mm.",
    ]
    return RowResult(row.table, [*row.targets, *targets], [*row.notes, *notes])


@ROWS.row("ur5", quick=ONE)
def ur5(seeds: int = 5) -> RowResult:
    """UR5 on a grid: held-out errors."""
    return held_out("ur5", {"mean_mm": 0.052, "max_mm": 0.20}, seeds)


@ROWS.row("wam", quick=ONE)
def wam(seeds: int = 5) -> RowResult:
    """Barrett WAM on a grid: held-out errors."""
    return held_out("wam", {"mean_mm": 2.3}, seeds)


@ROWS.row("constants", quick={"seeds": 1, "sets": ("wam",)})
def of_constants(seeds: int = 5, sets: tuple[str, ...] = tuple(SPLITS)) -> RowResult:
    """Nominal and kinematic model of all sets with points, split by split: mean / p95 / max [mm]."""
    table, targets = [], []
    for name in sets:
        each: dict[str, list[dict[str, float]]] = {"nominal": [], "kinematic": []}
        for seed in range(seeds):
            arm, train, test = split(name, seed)
            for label, figures in each.items():
                model = MODELS[label](arm).fit_readings(train)
                figures.append(three_figures(model.predict(test.angles), test.points))
        means = {label: {f: np.mean([one[f] for one in each[label]]) for f in each[label][0]} for label in each}
        for seed in range(seeds):
            table.append({"set": name, "seed": seed, **{label: told(each[label][seed]) for label in each}})
        table.append({"set": name, "seed": "mean", **{label: told(means[label]) for label in each}})
        if name == "ur10-a":
            limits = {"nominal": 0.76, "kinematic": 0.41}
            targets = [Target(f"{name}, {m}, mean [mm]", means[m]["mean_mm"], limits[m]) for m in limits]
    return RowResult(table, targets)


@ROWS.row("coverage", quick={"seeds": 1, "sets": ("wam",)})
def coverage(seeds: int = 5, sets: tuple[str, ...] = tuple(SPLITS)) -> RowResult:
    """Points held out inside the 95 % ellipsoids of the physical model, and by quarter of the joint space [%]."""
    table, targets = [], []
    for name in sets:
        each = [seen(name, seed, "physical") for seed in range(seeds)]
        inside = np.concatenate([one.squares <= LEVEL for one in each])
        parts = [np.concatenate([getattr(one, by) for one in each]) for by in ("ring", "quadrant")]
        rings, quadrants = (
            [100 * float(inside[part == k].mean()) for k in range(QUARTERS) if (part == k).any()] for part in parts
        )
        whole = 100 * float(inside.mean())
        shares = {by: " ".join(f"{s:.1f}" for s in of) for by, of in (("rings", rings), ("quadrants", quadrants))}
        table.append({"set": name, "points": len(inside), "all": f"{whole:.1f}", **shares})
        targets += [
            Target(f"{name}: inside, all, less [%]", whole, 93, good="above"),
            Target(f"{name}: inside, all, more [%]", whole, 97),
            Target(f"{name}: inside, the emptiest quarter [%]", min(rings + quadrants), 93, good="above"),
            Target(f"{name}: inside, the fullest quarter [%]", max(rings + quadrants), 97),
        ]
    notes = [
        (
            "Rings: quarters of the test poses by the distance of their angles from the training mean, in units of"
            " every joint's spread, the inner one first. Quadrants: joints 2 and 3 below or above training medians."
        ),
        (
            f"Pooled over {seeds} splits. Of m independent points a share of 95 % has a standard error of"
            " 22 % / sqrt(m): 1 % of 475, 2.5 % of 76."
        ),
    ]
    return RowResult(table, targets, notes)


def quarters(train: FloatArray, test: FloatArray) -> tuple[IntArray, IntArray]:
    """Give the quarters of the joint space that test poses are in: by distance from the middle, by joints 2 and 3."""
    away = np.linalg.norm((test - train.mean(axis=0)) / train.std(axis=0), axis=1)
    ring = np.searchsorted(np.quantile(away, [0.25, 0.5, 0.75]), away)
    above = test[:, 1:3] > np.median(train[:, 1:3], axis=0)
    return ring.astype(np.intp), (2 * above[:, 0] + above[:, 1]).astype(np.intp)


# Transfer of series A of the UR10 to the set-up of series B ----------------------------------------------------------

TRANSFER_ROWS = 20
# Readings of B whose point was taken at another pose: the publisher's file repeats a neighbour's point, to the last
# digit in the first of them, with the elbow on the other side (lines 534, 856 and 857).
MISPAIRED = (532, 854, 855)


@ROWS.row("transfer", quick=ONE)
def transfer(seeds: int = 5) -> RowResult:
    """UR10: learned from series A, base and tip refitted on a few rows of B, tested on the others of B."""
    b = datasets.load_readings("ur10-b")
    good = b.rows(np.setdiff1d(np.arange(len(b)), MISPAIRED))
    of_a = {label: MODELS[label](load_arm("ur10")) for label in ("kinematic", "physical")}
    for model in of_a.values():
        model.fit_readings(datasets.load_readings("ur10-a"))
    figures: dict[tuple[str, str], list[dict[str, float]]] = {}
    near, far, shares = "where A has readings", "all other rows, flagged", []
    for seed in range(seeds):
        chosen = np.random.default_rng(seed).permutation(len(good))
        few, rest = (good.rows(np.sort(part)) for part in np.split(chosen, [TRANSFER_ROWS]))
        alone = of_a["physical"].inputs_outside_training(rest.angles)
        alone.pop("joints together", None)  # all rows of B are
        away = np.logical_or.reduce(list(alone.values()))
        shares.append(float(away.mean()))
        for label, model in of_a.items():
            points = refit(model, few).predict(rest.angles)
            for where, rows in (("all", np.ones_like(away)), (near, ~away), (far, away)):
                figures.setdefault((where, label), []).append(three_figures(points[rows], rest.points[rows]))
    means = {key: over_splits(each) for key, each in figures.items()}
    table = [{"rows": where, **{label: told(means[where, label]) for label in of_a}} for where in ("all", near, far)]
    ratios = {name: means[far, "physical"][name] / means[far, "kinematic"][name] for name in ("mean_mm", "p95_mm")}
    targets = [
        Target("A to B, where A has readings: mean [mm]", means[near, "physical"]["mean_mm"], 0.20),
        Target("A to B, all other rows: mean over that of geometry alone", ratios["mean_mm"], 1.0),
        Target("A to B, all other rows: p95 over that of geometry alone", ratios["p95_mm"], 1.0),
    ]
    notes = [
        (
            f"{TRANSFER_ROWS} random rows of B, {seeds} draws, mean / p95 / max [mm] (max: largest of all). Flagged"
            f" by the model itself: a joint alone away from where A has readings, {np.mean(shares):.0%} of the rows."
        ),
        "Not tested: lines 534, 856 and 857 of B, whose points were taken at a neighbouring pose.",
    ]
    return RowResult(table, targets, notes)


# Arms whose ball was held in sockets: tool positions left out ---------------------------------------------------------


def figures_of(points: FloatArray, seat: NameArray, lengths: Lengths) -> dict[str, float]:
    """Distances of points to the mean of their seat, and between the means [mm]."""
    errors = seat_errors(points, seat)
    here = lengths.between(np.unique(seat).tolist())
    return {
        "mean_mm": errors["seat_mean_mm"],
        "rms_mm": errors["seat_rms_mm"],
        "max_mm": errors["seat_max_mm"],
        "sockets_mm": float((here.length_mm + length_errors(points, seat, here))[0]),
    }


def tool_positions(robot: str) -> tuple[str, ...]:
    """The tool positions of a robot."""
    readings = datasets.load_readings(f"mukca-{robot}")
    return tuple(name.rpartition("/")[2] for name in np.unique(readings.position).tolist())


@cache
def left_out(robot: str, train: tuple[str, ...], test: tuple[str, ...]) -> dict[str, dict[str, dict[str, float]]]:
    """Fit all models to some tool positions; figures of the models, and of the arm as drawn, at others."""
    name = f"mukca-{robot}"
    readings, lengths = datasets.load_readings(name), datasets.load_lengths(name)
    arm = load_arm(datasets.DATASETS[name].arm)
    learned = readings.rows(np.isin(readings.position, [f"{robot}/{position}" for position in train]))
    models = {label: kind(arm).fit_readings(learned, lengths=lengths) for label, kind in MODELS.items()}
    found = {}
    for position in test:
        part = readings.rows(readings.position == f"{robot}/{position}")
        tips = {"as drawn": arm.chain.tip_in_base(part.angles)}
        tips |= {label: model.predict_readings(part) for label, model in models.items()}
        found[position] = {label: figures_of(points, part.seat, lengths) for label, points in tips.items()}
    return found


def each_left_out(robot: str) -> dict[str, dict[str, dict[str, float]]]:
    """Every tool position as the others predict it."""
    names = tool_positions(robot)
    return {name: left_out(robot, tuple(n for n in names if n != name), (name,))[name] for name in names}


def of_positions(found: dict[str, dict[str, dict[str, float]]], targets: list[Target]) -> RowResult:
    """A table of tool positions, its targets and one on every position: no worse than nominal."""
    table = [
        {
            "position": name,
            "as drawn": f"{of['as drawn']['mean_mm']:.2f}",
            **{m: " ".join(f"{of[m][f]:.3f}" for f in ("mean_mm", "rms_mm", "max_mm")) for m in MODELS},
            "sockets [mm]": f"{of['physical']['sockets_mm']:.2f}",
        }
        for name, of in found.items()
    ]
    worst = max(of["physical"]["mean_mm"] / of["nominal"]["mean_mm"] for of in found.values())
    note = "Distances to the mean of the seat: mean rms max [mm]; as drawn: mean. Nominal: the tip fitted."
    return RowResult(table, [*targets, Target("mean over nominal's, the worst position", worst, 1.0)], [note])


@ROWS.row("panda-1")
def panda_1() -> RowResult:
    """Franka panda_1: one tool position in front to learn from (two seats, one length), two to test on."""
    found = left_out("panda_1", ("front",), ("right", "back-high"))
    targets = []
    for name, of in found.items():
        targets.append(Target(f"panda_1, {name}: mean [mm]", of["physical"]["mean_mm"], 0.35))
        off = abs(of["physical"]["sockets_mm"] - 50)
        targets.append(Target(f"panda_1, {name}: sockets off 50 mm [mm]", off, 0.3))
    return of_positions(found, targets)


@ROWS.row("panda-2")
def panda_2() -> RowResult:
    """Franka panda_2, every tool position left out."""
    found = each_left_out("panda_2")
    means = [of["physical"]["mean_mm"] for of in found.values()]
    targets = [
        Target("panda_2: mean, the median position [mm]", float(np.median(means)), 0.22),
        Target("panda_2: mean, the worst position [mm]", max(means), 0.7),
    ]
    return of_positions(found, targets)


@ROWS.row("panda-3")
def panda_3() -> RowResult:
    """Franka panda_3, every tool position left out."""
    found = each_left_out("panda_3")
    worst = max(of["physical"]["mean_mm"] for of in found.values())
    return of_positions(found, [Target("panda_3: mean, the worst position [mm]", worst, 0.28)])


@ROWS.row("dinova-1")
def dinova_1() -> RowResult:
    """Kinova Gen3 lite dinova_1, every tool position left out."""
    return of_positions(each_left_out("dinova_1"), [])


# Virtual arms, whose truth is known -----------------------------------------------------------------------------------

ARM = "gao2017"
LIMITS = {50: 1.30, 200: 1.10, 3000: 1.03}
STRATEGY = "box"  # uniform, as in the founding paper's simulations
OTHER = "measuring"  # as a person measures parts
N_TEST = 2000
# Seeds of poses and noise; the arms' own are 0, 1, ...
TRAIN, TEST = 1000, 2000
SEATS, POSES_IN_SEAT = 10, 20
BAR_U_MM = 0.002  # standard uncertainty of the bar's length


@cache
def virtual_arm(seed: int) -> VirtualArm:
    """Draw an arm of the preset `research`."""
    return VirtualArm.draw(load_arm(ARM), load_preset("research"), seed=seed)


def measured(seed: int, strategy: str, n: int, session: int) -> Measurement:
    """Measure with a virtual arm; poses and noise follow from both seeds."""
    both = session + seed
    return virtual_arm(seed).measure(STRATEGIES[strategy](load_arm(ARM), n, seed=both).angles, seed=both)


@cache
def test_of(seed: int, strategy: str) -> tuple[Measurement, float]:
    """Poses to test on, and the noise floor there: mean absolute error of a coordinate [mm]."""
    test = measured(seed, strategy, N_TEST, TEST)
    return test, virtual_arm(seed).noise_floor(test)["mean_abs_coordinate_mm"]


def over_floor(seed: int, strategy: str, n: int) -> dict[str, float]:
    """Mean absolute error of a coordinate of every model over the noise floor, and the floor [mm]."""
    train = measured(seed, strategy, n, TRAIN).readings
    test, floor = test_of(seed, strategy)
    found = {"floor": floor}
    for label, kind in MODELS.items():
        points = kind(load_arm(ARM)).fit_readings(train).predict_readings(test.readings)
        found[label] = point_errors(points, test.readings.points)["mean_abs_coordinate_mm"] / floor
    return found


@ROWS.row("virtual", quick={"seeds": 1, "poses": (50,)})
def virtual(seeds: int = 5, poses: tuple[int, ...] = tuple(LIMITS)) -> RowResult:
    """Virtual arm `research` of gao2017, points of a tracker, few to many."""
    table, targets = [], []
    for strategy in (STRATEGY, OTHER):
        for n in poses:
            each = [over_floor(seed, strategy, n) for seed in range(seeds)]
            medians = {name: float(np.median([one[name] for one in each])) for name in each[0]}
            physical = [one["physical"] for one in each]
            spread = f"{min(physical):.3f} to {max(physical):.3f}"
            table.append({"poses": strategy, "n": n, **medians, "physical, all arms": spread})
            if strategy == STRATEGY:
                what = f"virtual, {n} poses: coordinate error over the floor"
                targets.append(Target(what, medians["physical"], LIMITS[n]))
    note = (
        f"Median of {seeds} arms, {N_TEST} test poses each; floor: mean absolute coordinate error of the true function"
        " [mm]; the models: theirs over it. Judged: the box."
    )
    return RowResult(table, targets, [note])


def seats_and_bar(seed: int) -> tuple[Session, Lengths]:
    """Readings in seats, and a bar between the two that are farthest apart."""
    arm = load_arm(ARM)
    poses = STRATEGIES["seat"](arm, SEATS * POSES_IN_SEAT, seed=TRAIN + seed, seats=SEATS)
    readings = (
        virtual_arm(seed)
        .measure(poses.angles, seed=TRAIN + seed, seat=poses.seat, seat_points=poses.seat_points, reference=False)
        .readings
    )
    names, first = np.unique(poses.seat, return_index=True)
    at = poses.seat_points[first]
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    a, b = np.unravel_index(int(apart.argmax()), apart.shape)
    length = apart[a, b] + BAR_U_MM * np.random.default_rng(TRAIN + seed).standard_normal()
    return readings, Lengths(names[[a]], names[[b]], np.array([length]), np.array([BAR_U_MM]))


def from_seats(seed: int, strategy: str) -> dict[str, float]:
    """Errors of an arm identified from seats and a bar, over those of the true function.

    Seats say nothing of where the base stands: the frame is fitted to the test points. Lengths are between the tips of
    one test pose and the next, against the true ones.
    """
    readings, bar = seats_and_bar(seed)
    model = PhysicalModel(load_arm(ARM)).fit_readings(readings, lengths=bar)
    test, floor = test_of(seed, strategy)
    found = model.predict(test.readings.angles)
    T = align(found, test.readings.points)
    placed = found @ T[:3, :3].T + T[:3, 3]
    best = virtual_arm(seed).true_tip(test.readings.angles)
    truth = test.true_tips
    return {
        "coordinate": point_errors(placed, test.readings.points)["mean_abs_coordinate_mm"] / floor,
        "length": length_error(found, truth) / length_error(best, truth),
        "length_mm": length_error(found, truth),
        "length_floor_mm": length_error(best, truth),
    }


def length_error(tips: FloatArray, truth: FloatArray) -> float:
    """Mean absolute error of the lengths between tips of one pose and the next [mm]."""
    lengths, true = (np.linalg.norm(np.diff(points, axis=0)[::2], axis=1) for points in (tips, truth))
    return float(np.abs(lengths - true).mean())


@ROWS.row("virtual-seats", quick=ONE)
def virtual_seats(seeds: int = 5) -> RowResult:
    """Virtual arm `research` from 10 seats x 20 poses and one bar (u 0.002 mm) alone."""
    table, targets = [], []
    for strategy in (OTHER, STRATEGY):
        each = [from_seats(seed, strategy) for seed in range(seeds)]
        median = {name: float(np.median([one[name] for one in each])) for name in each[0]}
        spread = {
            f"{name} / floor": f"{median[name]:.3f} ({min(one[name] for one in each):.3f} to "
            f"{max(one[name] for one in each):.3f})"
            for name in ("coordinate", "length")
        }
        lengths = {"length [mm]": median["length_mm"], "its floor [mm]": median["length_floor_mm"]}
        table.append({"test poses": strategy, **spread, **lengths})
        if strategy == OTHER:
            targets = [
                Target("virtual, seats and a bar: coordinate error over the floor", median["coordinate"], 1.5),
                Target("virtual, seats and a bar: length error over the floor", median["length"], 2.0),
            ]
    note = (
        f"Median of {seeds} arms (least to most); the bar spans the two seats farthest apart. Judged: poses in which a"
        " person measures parts."
    )
    return RowResult(table, targets, [note])


# Evidence: all candidate terms at once against the best subset chosen by hand -----------------------------------------

ORDERS = (0, 2, 8, 40, 80)
ALL = "all candidates"
SEEDS_OF_LARGE = 2  # splits of the set of 11,911 readings
FAMILIES: dict[str, tuple[str, ...]] = {
    "constants": (),
    "+ gravity": ("gravity",),
    "+ wobble": ("wobble",),
    "+ gravity + wobble": ("gravity", "wobble"),
}
# Training and test readings of an arm, and the lengths known at the training.
Task = tuple[Arm, Session, Session, Lengths | None]


def family(term: Term) -> str:
    """Of a candidate: gravity, wobble, own axis, constants, or something else that no subset has."""
    if "angle error" in term.name:
        return "own axis"
    if "wobble" in term.name:
        return "wobble"
    if "by the weight" in term.name:
        return "gravity"
    return "other"


def subsets() -> dict[str, tuple[tuple[str, ...], int]]:
    """Give the subsets by name: families beside the constants, and the highest order about the joints' own axes."""
    return {
        f"{name}{f' + own axis to {highest}' if highest else ''}": (chosen, highest)
        for name, chosen in FAMILIES.items()
        for highest in ORDERS
    }


def error_of(task: Task, terms_of: Callable[[Session, tuple[str, ...]], list[Term]]) -> float:
    """Mean error on the test readings [mm]: to their points, or to the means of their seats."""
    arm, train, test, lengths = task
    free = ("base", "tip") if train.has_point.any() else ("tip",)
    state = state_of(arm, train)
    fit = identify(
        place_base_coarsely(arm.chain, train, free), state, terms_of(train, free), references_of(train, lengths)
    )
    tips = fit.tips(state_of(arm, test))
    if test.points is not None:
        return float(np.linalg.norm(tips - test.points, axis=1).mean())
    return seat_errors(tips, test.seat)["seat_mean_mm"]


def chosen_terms(
    arm: Arm, families: tuple[str, ...], highest: int, train: Session, free: tuple[str, ...]
) -> list[Term]:
    """Constants and the candidates of some families."""
    offered = candidate_terms(state_of(arm, train), free=free, highest=max(highest, 1))[0]
    wanted = {*families, *(["own axis"] if highest else [])}
    return [*constants(arm.chain, free=free), *(term for term in offered if family(term) in wanted)]


def all_terms(arm: Arm, train: Session, free: tuple[str, ...]) -> list[Term]:
    """All candidates, as the physical model takes them."""
    return candidate_terms(state_of(arm, train), free=free)[0]


def socket_tasks(robot: str) -> list[Task]:
    """Tool positions left out."""
    name = f"mukca-{robot}"
    readings, lengths, arm = (
        datasets.load_readings(name),
        datasets.load_lengths(name),
        load_arm(datasets.DATASETS[name].arm),
    )
    held = [readings.position == f"{robot}/{position}" for position in tool_positions(robot)]
    return [(arm, readings.rows(~here), readings.rows(here), lengths) for here in held]


def virtual_tasks(strategy: str, n: int, seeds: int) -> list[Task]:
    """Virtual arms."""
    return [
        (
            load_arm("gao2017"),
            measured(seed, strategy, n, TRAIN).readings,
            measured(seed, strategy, 1000, TEST).readings,
            None,
        )
        for seed in range(seeds)
    ]


def tracker_tasks(name: str, seeds: int) -> list[Task]:
    """Splits of a set with points."""
    return [(*split(name, seed), None) for seed in range(seeds)]


def tasks(seeds: int) -> dict[str, Callable[[], list[Task]]]:
    """All sets."""
    return {
        "ur10-b": partial(tracker_tasks, "ur10-b", seeds),
        "ur10-a": partial(tracker_tasks, "ur10-a", min(seeds, SEEDS_OF_LARGE)),
        "ur5": partial(tracker_tasks, "ur5", seeds),
        "wam": partial(tracker_tasks, "wam", seeds),
        "panda_2": partial(socket_tasks, "panda_2"),
        "panda_3": partial(socket_tasks, "panda_3"),
        "dinova_1": partial(socket_tasks, "dinova_1"),
        **{
            f"virtual {strategy} {n}": partial(virtual_tasks, strategy, n, seeds)
            for strategy in (STRATEGY, OTHER)
            for n in (50, 200)
        },
    }


@ROWS.row("pruning", quick={"seeds": 1, "sets": ("wam",)})
def pruning(seeds: int = 5, sets: tuple[str, ...] = ()) -> RowResult:
    """All candidate terms at once against the best subset chosen by hand, with the same test readings."""
    table, targets = [], []
    for name, make in tasks(seeds).items():
        if sets and name not in sets:
            continue
        given = make()
        arm = given[0][0]
        errors = {
            label: float(np.mean([error_of(task, partial(chosen_terms, arm, *subset)) for task in given]))
            for label, subset in subsets().items()
        }
        best = min(errors, key=errors.__getitem__)
        everything = float(np.mean([error_of(task, partial(all_terms, arm)) for task in given]))
        ratio = everything / errors[best]
        table.append({
            "set": name, ALL: everything, "best subset": errors[best], "%": 100 * (ratio - 1), "which": best
        })  # fmt: skip
        targets.append(Target(f"{name}: all candidates over the best subset, mean error", ratio, 1.03))
    note = f"Mean errors of test readings [mm]. {len(subsets())} subsets, the best by the same test readings."
    return RowResult(table, targets, [note])
