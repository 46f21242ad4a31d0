"""Measurements that were not made: copies of others, moved, turned, mirrored, in another order, averaged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import ASME, ISO, Campaign, Change, Groups, at, campaign, edited, in_all, in_test
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.positions import about_z

ADJUSTED = [(r"\Z", 'adjustment = { kind = "adjustment", work = "constants of the arm" }\n')]


def turned(points: FloatArray, number: int) -> FloatArray:
    return points @ about_z(37.0 * number) + [0, 0, 3.0 * number]


def mirrored(points: FloatArray, number: int) -> FloatArray:
    return points * [1, -1, 1] + [0, 5.0 * number, 0]


def with_noise(points: FloatArray, number: int) -> FloatArray:
    return points + [7.0 * number, 0, 0] + 1e-6 * np.random.default_rng(number).normal(size=points.shape)


def in_another_order(points: FloatArray, number: int) -> FloatArray:
    return points[np.random.default_rng(number).permutation(len(points))] + [0, 6.0 * number, 0]


HOW = {
    "moved by some millimetres": lambda points, number: points + [5.0 * number, 2.0, 0],
    "turned about the vertical and lifted": turned,
    "mirrored": mirrored,
    "moved, with noise of 1 nm": with_noise,
    "moved and measured in another order": in_another_order,
}
# Where the copy stands, and whose it is: by the key that names it.
WHAT = {
    "probing": (ISO, "position", "the second ball", 900.0),
    "articulation": (ISO, "group", "groups of an articulation", 0.002),
    "effective_diameter": (ASME, "repeat", "runs on a ball", 1.0),
    "single_point": (ASME, "position", "points in a seat", 400.0),
}


def copied(key: str, how: str, apart_mm: float) -> Change:
    """Groups as a copy of the first one of their kind, each moved on so far."""

    def change(one: PointGroup, of: Groups) -> PointGroup:
        first = "A" if key == "group" else "1"
        number = ord(one.keys[key]) - ord(first)
        if not number:
            return one
        source = of[tuple(first if name == key else value for name, value in one.keys.items())]
        made = HOW[how](source.points, number)
        return at(one, made - made.mean(axis=0) + source.points.mean(axis=0) + [apart_mm * number, 0, 0])

    return change


for _test, (_standard, _key, _what, _apart) in WHAT.items():
    for _how in HOW:
        mistake(f"{_what}: the first {_key}, {_how}", said="a copy")(
            lambda standard=_standard, test=_test, key=_key, how=_how, apart=_apart: campaign(
                standard, points=in_test(test, copied(key, how, apart))
            ).stated()
        )


def runs_of_first(move: str) -> Change:
    """Runs of a length as the first run, moved or turned."""

    def change(one: PointGroup, of: Groups) -> PointGroup:
        length, position, repeat, end = one.keys.values()
        number = int(repeat) - 1
        points = of[length, position, "1", end].points
        if move == "turned by half a degree":
            return at(one, points @ about_z(0.5 * number))
        if move == "with its ends exchanged":
            return at(one, of[length, position, "1", "BA"[end == "B"] if number else end].points)
        if move == "turned, with noise of 1 nm":
            return at(one, points @ about_z(0.4 * number) + 1e-6 * np.random.default_rng(number).normal(size=(1, 3)))
        return at(one, points + [5.0 * number, 0, 0])

    return change


def positions_of_first(one: PointGroup, of: Groups) -> PointGroup:
    """Positions that are the first one, turned about the arm and tilted as the plan asks."""
    keys = list(one.keys.values())
    number = int(keys[1]) - 1
    ends = [of[(keys[0], "1", *keys[2:-1], end)].points.mean(axis=0) for end in "AB"]
    axis = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]][number % 4], dtype=float)
    start = np.array([60.0 * number, -600.0, 100.0])
    along = axis / np.linalg.norm(axis) * np.linalg.norm(ends[1] - ends[0])
    return at(one, (start + (keys[-1] == "B") * along)[None])


def means_of_two(key: str) -> Change:
    """The third run as the mean of the first two."""

    def change(one: PointGroup, of: Groups) -> PointGroup:
        if one.keys[key] != "3":
            return one
        both = [
            of[tuple(number if name == key else value for name, value in one.keys.items())].points for number in "12"
        ]
        return at(one, (both[0] + both[1]) / 2)

    return change


for _test in ("uni", "bi"):
    for _move in ("5 mm beside", "turned by half a degree", "with its ends exchanged", "turned, with noise of 1 nm"):
        mistake(f"runs of {_test} that are the first run, {_move}", said="a copy")(
            lambda test=_test, move=_move: campaign(points=in_test(test, runs_of_first(move))).stated()
        )
    mistake(f"positions of {_test} that are the first one, turned into other directions", said="a copy")(
        lambda test=_test: campaign(points=in_test(test, positions_of_first)).stated()
    )
    mistake(f"a third run of {_test} that is the mean of the first two", said="a copy")(
        lambda test=_test: campaign(points=in_test(test, means_of_two("repeat"))).stated()
    )


@mistake("a third run on a ball that is the mean of the first two", said="a copy")
def mean_of_runs() -> str:
    return campaign(ASME, points=in_test("effective_diameter", means_of_two("repeat"))).stated()


@mistake("20 lengths of which half are others, moved", said="a copy|as another one")
def half_of_the_lengths() -> str:
    def change(one: PointGroup, of: Groups) -> PointGroup:
        length, position, end = one.keys.values()
        places = [key[1] for key in of if key[0] == length and key[2] == "A"]
        number = places.index(position)
        if number < 5:
            return one
        source = [of[length, places[number - 5], each].points[0] for each in "AB"]
        own = [of[length, position, each].points[0] for each in "AB"]
        along = (own[1] - own[0]) / np.linalg.norm(own[1] - own[0])
        return at(one, (own[0] + (end == "B") * along * np.linalg.norm(source[1] - source[0]))[None])

    return campaign(ASME, points=in_test("volumetric", change)).stated()


@mistake("a point in a seat that was sent ten times", said="to the last digit")
def frozen_point() -> str:
    def change(one: PointGroup, _: Groups) -> PointGroup:
        return at(one, np.repeat(one.points[:1], len(one.points), axis=0)) if one.keys["position"] == "2" else one

    return campaign(ASME, points=in_test("single_point", change)).stated()


@mistake("a point on a ball that was sent twice", said="two points on the ball have the same coordinates")
def twice_on_a_ball() -> str:
    def change(one: PointGroup, _: Groups) -> PointGroup:
        return at(one, np.concatenate([one.points[:-1], one.points[:1]]))

    return campaign(points=in_test("probing", change)).stated()


@mistake("lengths of E_Bi that are those of E_Uni, moved", said="a copy")
def opposite_faces_from_balls() -> str:
    uni = {tuple(one.keys.values()): one for one in campaign().points.tests["uni"]}
    return campaign(
        points=in_test("bi", lambda one, _: at(one, uni[tuple(one.keys.values())].points + [3.0, 0, 0]))
    ).stated()


@mistake("the ball of the articulation with the points of the probing", said="a copy")
def articulation_from_probing() -> str:
    probing = {one.keys["position"]: one for one in campaign().points.tests["probing"]}

    def change(one: PointGroup, _: Groups) -> PointGroup:
        rows = np.array([0, 17, 19, 21, 23]) if one.keys["group"] == "A" else None
        return one if rows is None else at(one, probing[one.keys["position"]].points[rows])

    return campaign(points=in_test("articulation", change)).stated()


# As found and as left ------------------------------------------------------------------------------------------------


def both(left: Campaign, found: Campaign) -> str:
    """The certificate of an arm that was adjusted between two campaigns."""
    adjusted = replace(left, about=edited(left.about, [*ADJUSTED, ("received = [0-9-]+\n", "")]))
    return adjusted.stated(as_found=found.verified())


for _how in HOW:
    mistake(f"points as found that are those as left, {_how}", said="as left: a copy")(
        lambda how=_how: both(
            campaign(ASME), campaign(ASME, points=in_all(lambda one: at(one, HOW[how](one.points, 1))))
        )
    )
for _test, _standard in {
    "probing": ISO,
    "articulation": ISO,
    "uni": ISO,
    "single_point": ASME,
    "volumetric": ASME,
}.items():
    mistake(f"points as found of {_test} alone that are those as left", said="as left: a copy")(
        lambda test=_test, standard=_standard: both(campaign(standard), _found(standard, test))
    )


def _found(standard: str, test: str) -> Campaign:
    """A campaign of its own, but for one test of the first one."""
    left = campaign(standard)
    same = {tuple(one.keys.values()): one for one in left.points.tests[test]}
    return campaign(
        standard, seed=2, points=in_test(test, lambda one, _: at(one, same[tuple(one.keys.values())].points))
    )


@right("as found and as left by the same arm on the same stands", unsaid="copy")
def both_states() -> str:
    return both(campaign(ASME), campaign(ASME, seed=2))


@right("as found and as left by ISO 10360-12", unsaid="copy")
def both_states_of_lengths() -> str:
    return both(campaign(), campaign(seed=2))


for _decimals in (3, 4):
    right(f"a campaign of coordinates with {_decimals} decimals", unsaid="copy")(
        lambda n=_decimals: campaign(points=in_all(lambda one: replace(one, points=one.points.round(n)))).stated()
    )
    right(f"a campaign by ASME with {_decimals} decimals", unsaid="copy")(
        lambda n=_decimals: campaign(ASME, points=in_all(lambda one: replace(one, points=one.points.round(n)))).stated()
    )


@right("a very good arm: noise of a micrometre", unsaid="copy")
def good_arm() -> str:
    quiet = campaign(seed=3).points.tests
    nominal = {test: {tuple(one.keys.values()): one for one in groups} for test, groups in quiet.items()}

    def change(test: str) -> Change:
        def of_test(one: PointGroup, _: Groups) -> PointGroup:
            return at(one, 0.5 * (one.points + nominal[test][tuple(one.keys.values())].points))

        return of_test

    points = campaign().points
    for test in points.tests:
        points = in_test(test, change(test))(points)
    return campaign(points=lambda _: points).stated()
