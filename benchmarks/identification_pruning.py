"""Row of `identification.py` on evidence: all candidate terms at once against the best subset chosen by hand.

The subsets are judged on the test readings themselves, so that the best of them is better than a user could choose.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from identification_points import HELD_OUT, SPLITS
from identification_row import Row
from identification_seats import tool_positions
from identification_virtual import OTHER, STRATEGY, TEST, TRAIN, measured
from machine import Target
from truearm import datasets
from truearm.arm import Arm, load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.references.alignment import place_base_coarsely
from truearm.identification.references.reading_references import references_of, state_of
from truearm.identification.terms import Term, candidate_terms, constants
from truearm.readings import Session, hold_out
from truearm.readings.lengths import Lengths
from truearm.readings.seats import seat_errors

ORDERS = (0, 2, 8, 40, 80)
SEEDS_OF_LARGE = 2  # splits of the set of 11,911 readings
FAMILIES: dict[str, tuple[str, ...]] = {
    "constants": (),
    "+ gravity": ("gravity",),
    "+ wobble": ("wobble",),
    "+ gravity + wobble": ("gravity", "wobble"),
}
ALL = "all candidates"

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
    assert test.seat is not None
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


def tracker_tasks(name: str, seeds: int) -> list[Task]:
    """Splits of a set with points."""
    readings, arm = datasets.load_readings(name), load_arm(datasets.DATASETS[name].arm)
    splits = (
        hold_out(readings, by=SPLITS[name], fraction=HELD_OUT, seed=seed)  # type: ignore[arg-type]
        for seed in range(seeds)
    )
    return [(arm, train, test, None) for train, test in splits]


def socket_tasks(robot: str) -> list[Task]:
    """Tool positions left out."""
    name = f"mukca-{robot}"
    readings, lengths, arm = (
        datasets.load_readings(name),
        datasets.load_lengths(name),
        load_arm(datasets.DATASETS[name].arm),
    )
    assert readings.position is not None
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


def pruning(seeds: int) -> Row:
    """All candidates against every subset, on every set."""
    cells, targets, found = [], [], {}
    for name, make in tasks(seeds).items():
        given = make()
        arm = given[0][0]
        errors = {
            label: float(np.mean([error_of(task, partial(chosen_terms, arm, *subset)) for task in given]))
            for label, subset in subsets().items()
        }
        best = min(errors, key=errors.__getitem__)
        everything = float(np.mean([error_of(task, partial(all_terms, arm)) for task in given]))
        found[name] = errors | {ALL: everything}
        ratio = everything / errors[best]
        cells.append([name, f"{everything:.4f}", f"{errors[best]:.4f}", f"{100 * (ratio - 1):+.1f}", best])
        targets.append(Target(f"{name}: all candidates over the best subset, mean error", ratio, 1.03))
    columns = ["set", ALL, "best subset", "%", "which"]
    note = f"Mean errors of test readings [mm]. {len(subsets())} subsets, the best by the same test readings."
    return Row(
        "All candidate terms at once against the best subset chosen by hand", columns, cells, targets, found, [note]
    )
