"""Campaigns of a verification that were not measured as the plan asks: copies, other layouts, exchanged artefacts."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import truearm as ta
from benchmarks.mistakes import mistake, right
from benchmarks.rows import scratch
from truearm.typing import FloatArray
from truearm.verification.certificate.certificate import check_no_copies
from truearm.verification.standards.artefacts import example_artefacts
from truearm.verification.standards.layout import Placement, lay_out_tests
from truearm.verification.standards.measured_points import PointGroup
from truearm.verification.standards.points_form import fill_points_form, write_points_form
from truearm.verification.standards.positions import about_z, hemisphere
from truearm.verification.standards.verification import Verification

ISO, ASME = "iso10360-12", "asme-b89.4.22"
RANGE_MM = 2500.0
DAY = datetime.date(2026, 11, 3)
Change = Callable[[PointGroup, dict[tuple[str, ...], PointGroup]], FloatArray]


@cache
def _simulated(plan: str, seed: int = 1) -> ta.SimulatedVerification:
    return ta.simulate_verification("shop", plan=plan, n_arms=1, seed=seed)


def verified(
    plan: str, test: str = "", change: Change | None = None, *, decimals: int = 5, seed: int = 1
) -> Verification:
    """The verification of a file of points, those of one test changed: a group, and all groups of the test by keys."""
    simulated = _simulated(plan, seed)
    points = simulated.points(0)
    tests = dict(points.tests)
    if change is not None:
        by_keys = {tuple(one.keys.values()): one for one in tests[test]}
        tests[test] = tuple(replace(one, points=change(one, by_keys)) for one in tests[test])
    rounded = {
        name: tuple(replace(one, points=one.points.round(decimals)) for one in groups) for name, groups in tests.items()
    }
    measured = replace(points, tests=rounded, file=Path("points.csv"))
    return ta.verify(
        measured, plan=plan, artefacts=simulated.artefacts, specification=simulated.specification
    ).verification


def said(plan: str, test: str = "", change: Change | None = None, **options: int) -> str:
    """What is refused of such a file, or nothing but the verdict."""
    return str(verified(plan, test, change, **options).verdict)


# Copies --------------------------------------------------------------------------------------------------------------


@mistake("repeats that are the first run 5 mm farther", said="a copy")
def moved_repeats() -> str:
    def first_run(one: PointGroup, of: dict[tuple[str, ...], PointGroup]) -> FloatArray:
        length, position, repeat, end = one.keys.values()
        return of[length, position, "1", end].points + [5.0 * (int(repeat) - 1), 0, 0]

    return said(ISO, "uni", first_run)


@mistake("repeats that are the first run turned by half a degree, with 1 nm of noise", said="a copy")
def turned_repeats() -> str:
    rng = np.random.default_rng(1)

    def first_run(one: PointGroup, of: dict[tuple[str, ...], PointGroup]) -> FloatArray:
        length, position, repeat, end = one.keys.values()
        points = of[length, position, "1", end].points @ about_z(0.5 * (int(repeat) - 1))
        return points + 1e-6 * rng.normal(size=points.shape)

    return said(ISO, "uni", first_run)


@mistake("a second sphere that is the first one moved and turned", said="a copy")
def moved_sphere() -> str:
    return said(ISO, "probing", lambda one, of: of[("1",)].points @ about_z(40.0 * (one.keys["position"] == "2")))


@mistake("runs on a ball that are one run 1 mm aside", said="a copy")
def moved_runs() -> str:
    return said(ASME, "effective_diameter", lambda one, of: of[("1",)].points + float(one.keys["repeat"]))


@mistake("points as found that are those as left, 5 mm aside", said="as left: a copy")
def as_found_moved() -> str:
    left = verified(ISO)
    tests = {
        name: tuple(replace(one, points=one.points + [5.0, 0, 0]) for one in groups)
        for name, groups in left.measured.tests.items()
    }
    check_no_copies(left, replace(left, measured=replace(left.measured, tests=tests)))
    return "passed"


@right("a campaign as the plan lays it out", unsaid="copy")
def plain_campaign() -> str:
    return said(ISO) + said(ASME)


@right("a campaign of coordinates with three decimals", unsaid="copy")
def three_decimals() -> str:
    return said(ISO, decimals=3) + said(ASME, decimals=3)


@right("as found and as left by the same arm on the same stands", unsaid="copy")
def both_states() -> str:
    left = verified(ISO)
    rng = np.random.default_rng(2)
    tests = {
        name: tuple(
            replace(one, points=(one.points + 0.005 * rng.normal(size=one.points.shape)).round(5)) for one in groups
        )
        for name, groups in left.measured.tests.items()
    }
    check_no_copies(left, replace(left, measured=replace(left.measured, tests=tests)))
    return "passed"


# Layouts -------------------------------------------------------------------------------------------------------------


def on_ball(normals: FloatArray) -> Change:
    """The points of a group at these places of its ball, with its noise."""

    def change(one: PointGroup, _: dict[tuple[str, ...], PointGroup]) -> FloatArray:
        n = len(one.points)
        pattern = hemisphere(n)
        centre = (one.points - 12.5 * pattern).mean(axis=0)
        off = one.points - centre - 12.5 * pattern
        return centre + 12.5 * normals[:n] + off

    return change


def _cap(n: int, half_deg: float, turn_deg: float = 0.0) -> FloatArray:
    """Points over a cap about a pole that is so far from the z axis."""
    z, turn = np.linspace(1, np.cos(np.radians(half_deg)), n), 2.4 * np.arange(n)
    level, (c, s) = np.sqrt(1 - z * z), (np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)))
    x = level * np.cos(turn)
    return np.column_stack([x * c + z * s, level * np.sin(turn), z * c - x * s])


@mistake("a ball touched in two patches of 10 degrees", said="the points (leave most|lie so close)")
def two_patches() -> str:
    return said(ISO, "probing", on_ball(np.concatenate([_cap(13, 10), _cap(12, 10, 90)])))


@mistake("21 of 25 points within 2 degrees of the pole", said="leave most of the ball untouched")
def about_the_pole() -> str:
    return said(ISO, "probing", on_ball(np.concatenate([_cap(21, 2), hemisphere(5)[1:]])))


@right("a ball touched by hand, 10 degrees beside the pattern", unsaid="ball")
def by_hand() -> str:
    near = hemisphere(25) + 0.17 * np.random.default_rng(3).normal(size=(25, 3))
    return said(ISO, "probing", on_ball(near / np.linalg.norm(near, axis=1, keepdims=True)))


@right("a ball on a stem, touched to 70 degrees from its pole", unsaid="ball")
def on_a_stem() -> str:
    polar, azimuth = np.arccos(hemisphere(25)[:, 2]) * 7 / 9, np.arctan2(*hemisphere(25)[:, 1::-1].T)
    level = np.sin(polar)
    return said(
        ISO, "probing", on_ball(np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(polar)]))
    )


def parallel(apart_mm: float, name: str) -> Change:
    """All bars along y, so far apart."""
    rng = np.random.default_rng(5)

    def change(one: PointGroup, of: dict[tuple[str, ...], PointGroup]) -> FloatArray:
        keys = list(one.keys.values())
        a, b = (of[(*keys[:-1], end)].points for end in "AB")
        at = np.array([[-300.0 + apart_mm * int(one.keys[name]), -900.0, 200.0]])
        at = at + 0.005 * rng.normal(size=(1, 3))
        return at if one.keys["end"] == "A" else at + [[0, float(np.linalg.norm(b - a)), 0]]

    return change


@mistake("seven positions of each bar along y, 15 mm apart", said="the plan asks for 4 directions")
def bars_along_y() -> str:
    return said(ISO, "uni", parallel(15.0, "position"))


@mistake("20 parallel bars 11 mm apart", said="the plan asks for 4 directions")
def parallel_bars() -> str:
    return said(ASME, "volumetric", parallel(11.0, "position"))


@mistake("three seats 11 mm apart in place of near, middle and far", said="the farthest two positions are 22 mm apart")
def near_seats() -> str:
    def change(one: PointGroup, of: dict[tuple[str, ...], PointGroup]) -> FloatArray:
        at = int(one.keys["position"])
        return one.points - one.points.mean(axis=0) + of[("2",)].points.mean(axis=0) + [11.0 * (at - 2), 0, 0]

    return said(ASME, "single_point", change)


# Exchanged artefacts -------------------------------------------------------------------------------------------------


def filled(exchanged: tuple[Callable[[Placement], bool], Callable[[Placement], bool]] | None, by_mm: float) -> str:
    """A form filled in with artefacts so far from their places, two of them exchanged, in another frame."""
    layout = lay_out_tests(ta.load_verification_plan(ASME), example_artefacts(RANGE_MM), RANGE_MM)
    rng = np.random.default_rng(4)
    by = {(one.test, one.keys.get("position")): by_mm * rng.normal(size=3) for one in layout}
    each = [one.points + by[one.test, one.keys.get("position")] for one in layout]
    if exchanged is not None:
        first, second = ([i for i, one in enumerate(layout) if is_one(one)] for is_one in exchanged)
        for i, j in zip(first, second, strict=True):
            each[i], each[j] = each[j], each[i]
    path = scratch() / f"form_{by_mm}_{exchanged is None}.csv"
    path.unlink(missing_ok=True)
    write_points_form(layout, path, tip_diameter_mm=0.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return str(fill_points_form(path, np.concatenate(each) @ turn, day=DAY, artefact_degC=20.0))


def _at(test: str, position: int) -> Callable[[Placement], bool]:
    return lambda one: one.test == test and one.keys["position"] == str(position)


@mistake("two seats measured in each other's place of the form", said="exchanged with")
def exchanged_seats() -> str:
    return filled((_at("single_point", 1), _at("single_point", 3)), 20.0)


@mistake("two bars of one length measured in each other's place of the form", said="exchanged with")
def exchanged_bars() -> str:
    return filled((_at("volumetric", 2), _at("volumetric", 6)), 20.0)


@right("a form filled in with artefacts a hand beside their places", unsaid="exchanged")
def hand_beside() -> str:
    return filled(None, 40.0)


@right("a form filled in where artefacts stand half a metre elsewhere", unsaid="exchanged")
def elsewhere() -> str:
    return filled(None, 300.0)
