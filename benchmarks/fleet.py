"""Many arms: what a run costs beyond its fits, how far constants drift that did not change, and a page of 10,000 arms.

The page needs the extra ``browser`` and Chromium.
"""

from __future__ import annotations

import shutil
import time
from itertools import cycle
from pathlib import Path

import numpy as np

import truearm as ta
from benchmarks.rows import RowResult, Rows, Target, scratch
from truearm.pages.html import write_page
from truearm.solve.executors import Processes
from truearm.wings.fleet import fit_task, fleet
from truearm.wings.fleet.fit_task import FitRow
from truearm.wings.fleet.fleet_page import ArmState, What, fleet_page
from truearm.wings.fleet.fleet_status import constant_drifts

ROWS = Rows()
STATES: tuple[What, ...] = ("in force", "in force", "in force", "due", "failed", "recalibrate", "to be fitted")


def fleet_of(folder: Path, *, arms: int, poses: int, model: str, sessions: int = 1) -> fleet.Fleet:
    """A fleet of virtual UR10, with its sessions added one after the other; all but the last are fitted."""
    made = fleet.Fleet.create(folder)
    for session in range(sessions):
        if session:
            made.run()
        for i in range(arms):
            file = folder / f"{session}-{i}.csv"
            ta.simulate("ur10", poses=poses, seed=1000 * session + i, arm_seed=i).save(file)
            made.add(f"virtual-research-{i}", "ur10", session=file, model=model)
    return made


@ROWS.row("overhead", quick={"arms": 2, "poses": 12, "model": "nominal"})
def overhead(arms: int = 20, poses: int = 300, model: str = "physical") -> RowResult:
    """What a run costs beyond its fits, in CPU time, and in two processes."""
    cpu: dict[str, float] = {"fits": 0.0, "fits and their rows": 0.0}

    def counted(name: str, function):
        def measured(*args, **options):
            started = time.process_time()
            try:
                return function(*args, **options)
            finally:
                cpu[name] += time.process_time() - started

        return measured

    made = fleet_of(scratch() / "serial", arms=arms, poses=poses, model=model)
    beside = fleet.Fleet.create(scratch() / "processes")
    beside.add_all(made.registry.arms())
    first = fleet_of(scratch() / "first", arms=1, poses=12, model=model)
    first.run()  # what a program loads once
    plain, plain_task = fit_task.fit, fleet.fit_arm
    fit_task.fit, fleet.fit_arm = counted("fits", plain), counted("fits and their rows", plain_task)
    try:
        started, wall = time.process_time(), time.perf_counter()
        made.run()
        whole, serial = time.process_time() - started, time.perf_counter() - wall
    finally:
        fit_task.fit, fleet.fit_arm = plain, plain_task
    wall = time.perf_counter()
    beside.run(Processes(2))
    two = time.perf_counter() - wall
    table = [
        {"what": "fits", "CPU [s]": cpu["fits"], "share of the fits [%]": 100.0},
        {
            "what": "their rows: constants, model file",
            "CPU [s]": (rows := cpu["fits and their rows"] - cpu["fits"]),
            "share of the fits [%]": 100 * rows / cpu["fits"],
        },
        {
            "what": "registry and data set",
            "CPU [s]": (rest := whole - cpu["fits and their rows"]),
            "share of the fits [%]": 100 * rest / cpu["fits"],
        },
    ]
    return RowResult(
        table,
        [
            Target("registry and overhead, share of the fits [%]", 100 * (whole / cpu["fits"] - 1), 3),
            Target("serial over two processes, wall time", serial / two, 1.9, "above"),
        ],
        [f"models of both runs are {'the same' if hashes(made) == hashes(beside) else 'different'}"],
    )


def hashes(made: fleet.Fleet) -> dict[str, str]:
    """SHA-256 of the models, by the keys of their fits."""
    return {key: row.model_sha256 for key, row in made.registry.fits().items()}


@ROWS.row("drift", quick={"arms": 2, "poses": 12})
def drift(arms: int = 16, poses: int = 40) -> RowResult:
    """Drift of the constants of arms that did not change, from two sessions each, in combined uncertainties."""
    made = fleet_of(scratch() / "drift", arms=arms, poses=poses, model="kinematic", sessions=2)
    made.run()
    fits, found = made.registry.fits(), []
    for history in made.registry.histories().values():
        models: list[FitRow] = [fits[key] for _, key in history]
        found.append([one.own for one in constant_drifts(models, {}) if one.own is not None])
    drifts = np.array(found)
    largest = np.abs(drifts).max(axis=1)
    row = {
        "constants": drifts.shape[1],
        "standard deviation": float(drifts.std()),
        "largest of an arm, least": float(largest.min()),
        "median": float(np.median(largest)),
        "greatest": float(largest.max()),
    }
    return RowResult([row], [Target("standard deviation of a drift", row["standard deviation"], 1.1)])


@ROWS.row("page", quick={"arms": 50, "runs": 1})
def page(arms: int = 10_000, runs: int = 5) -> RowResult:
    """The overview in a headless Chromium: size, how soon it is there, how soon a typed word filters it."""
    from playwright.sync_api import sync_playwright

    states = [
        ArmState(
            f"virtual-research-{i}",
            "ur10",
            site,
            what,
            message="" if what == "in force" else "a value has changed since check 15 of 2026-01-15",
            model="kinematic",
            since="2026-11-27",
            due="2027-11-27",
            recalibrate="no",
            held_out_mm=0.05,
            of_type=1.0,
            moved_mm=0.01,
            drift_u=1.8,
            from_type_u=1.2,
            certified="conform",
            page=f"overview-arms/{i:016x}.html",
        )
        for i, what, site in zip(range(arms), cycle(STATES), cycle(("Turin", "Oslo")), strict=False)
    ]
    file, opened, filtered = scratch() / "overview.html", [], []
    write_page(fleet_page(states, summary=f"{arms} arms."), file)
    with sync_playwright() as steer:
        chromium = steer.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        for _ in range(runs):
            tab = chromium.new_page(viewport={"width": 1400, "height": 900})
            tab.goto(file.as_uri())
            opened.append(tab.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd") / 1000)
            started = time.perf_counter()
            tab.locator("input[type=search]").fill("turin failed")
            tab.locator("output").inner_text()
            filtered.append(time.perf_counter() - started)
            tab.close()
        chromium.close()
    row = {"size [MB]": file.stat().st_size / 1e6, "opened [s]": min(opened), "filtered [s]": min(filtered)}
    return RowResult([row], [Target(f"page of {arms} arms, opened [s]", row["opened [s]"], 1.0)])
