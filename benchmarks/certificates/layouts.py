"""Campaigns that were laid out otherwise than the plan asks: patterns on a ball, directions, places, sizes, counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import ASME, ISO, RANGE_MM, Change, Groups, at, campaign, in_test
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards.measured_points import PointGroup
from truearm.wings.laboratory.standards.positions import hemisphere

RADIUS_MM = 12.5
BALLS = {"probing": ISO, "effective_diameter": ASME, "articulation": ISO}
LENGTHS = {"uni": ISO, "bi": ISO, "volumetric": ASME}
UNTOUCHED = r"points (leave most|lie so close|in one plane)|of \d+ points are apart"


# Patterns on a ball --------------------------------------------------------------------------------------------------


def on_ball(normals: FloatArray) -> Change:
    """The points of a group at these places of its ball, with its noise."""

    def change(one: PointGroup, _: Groups) -> PointGroup:
        n = len(one.points)
        flat = np.linalg.lstsq(np.column_stack([2 * one.points, np.ones(n)]), (one.points**2).sum(axis=1), rcond=None)[
            0
        ]
        away = one.points - flat[:3]
        size = np.linalg.norm(away, axis=1)
        return at(one, flat[:3] + normals[:n] * size[:, None])

    return change


def cap(n: int, half_deg: float, turn_deg: float = 0.0) -> FloatArray:
    """Points over a cap about a pole that is so far from the z axis."""
    z, turn = np.linspace(1, np.cos(np.radians(half_deg)), n), 2.4 * np.arange(n)
    level, (c, s) = np.sqrt(1 - z * z), (np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)))
    x = level * np.cos(turn)
    return np.column_stack([x * c + z * s, level * np.sin(turn), z * c - x * s])


def row(n: int, polar_deg: float, begin_deg: float = 0.0, end_deg: float = 360.0) -> FloatArray:
    """Points on a circle about the pole, or on a part of it."""
    turn, polar = np.radians(np.linspace(begin_deg, end_deg, n, endpoint=False)), np.radians(polar_deg)
    return np.column_stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.full(n, np.cos(polar))])


def meridian(n: int) -> FloatArray:
    """Points on an arc through the pole, from equator to equator, alternately 2 degrees beside it."""
    polar, beside = np.radians(np.linspace(-90, 90, n)), np.radians(2.0) * (-1.0) ** np.arange(n)
    return np.column_stack([np.sin(polar) * np.cos(beside), np.sin(beside), np.cos(polar) * np.cos(beside)])


WRONG_PATTERNS = {
    "in two patches of 10 degrees": lambda n: np.concatenate([cap(n - n // 2, 10), cap(n // 2, 10, 90)]),
    "in a cap of 30 degrees": lambda n: cap(n, 30),
    "with all points but four within 2 degrees of the pole": lambda n: np.concatenate([cap(n - 4, 2), row(4, 90)]),
    "around its equator alone": lambda n: row(n, 90),
    "along one meridian": meridian,
    "on a quarter of it": lambda n: np.concatenate([cap(1, 0), row(n // 2, 45, 0, 60), row(n - n // 2 - 1, 90, 0, 60)]),
}
for _test, _standard in BALLS.items():
    for _how, _pattern in WRONG_PATTERNS.items():
        if _test == "articulation" and "all points but four" in _how:
            continue  # of five points that is the pattern of the plan
        mistake(f"a ball of {_test} touched {_how}", said=UNTOUCHED)(
            lambda test=_test, standard=_standard, pattern=_pattern: campaign(
                standard, points=in_test(test, lambda one, of: on_ball(pattern(len(one.points)))(one, of))
            ).stated()
        )


@mistake("a ball of probing touched in three patches of 10 degrees", said=UNTOUCHED)
def three_patches() -> str:
    patches = np.concatenate([cap(9, 10), cap(8, 10, 80), cap(8, 10, -80)])
    return campaign(points=in_test("probing", on_ball(patches))).stated()


@right("a ball touched by hand, 10 degrees beside the pattern", unsaid="untouched")
def by_hand() -> str:
    near = hemisphere(25) + 0.17 * np.random.default_rng(3).normal(size=(25, 3))
    pattern = near / np.linalg.norm(near, axis=1, keepdims=True)
    return campaign(points=in_test("probing", on_ball(pattern))).stated()


@right("a ball on a stem, touched to 70 degrees from its pole", unsaid="untouched")
def on_a_stem() -> str:
    polar, azimuth = np.arccos(hemisphere(25)[:, 2]) * 7 / 9, np.arctan2(*hemisphere(25)[:, 1::-1].T)
    level = np.sin(polar)
    pattern = np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.cos(polar)])
    return campaign(points=in_test("probing", on_ball(pattern))).stated()


@right("a ball touched from the side: the half towards the arm", unsaid="untouched")
def from_the_side() -> str:
    turned = hemisphere(25)[:, [2, 1, 0]] * [-1, 1, 1]
    return campaign(points=in_test("probing", on_ball(turned))).stated()


@right("25 points in a spiral from the pole to the equator", unsaid="untouched")
def in_a_spiral() -> str:
    return campaign(points=in_test("probing", on_ball(hemisphere(26)[:25]))).stated()


@right("25 points anywhere on the half of the ball, as they came", unsaid="untouched")
def anywhere() -> str:
    rng = np.random.default_rng(6)
    z, turn = rng.uniform(0, 1, 25), rng.uniform(0, 2 * np.pi, 25)
    level = np.sqrt(1 - z * z)
    return campaign(
        points=in_test("probing", on_ball(np.column_stack([level * np.cos(turn), level * np.sin(turn), z])))
    ).stated()


@right("nine points with two rows of four, 40 and 80 degrees from the pole", unsaid="untouched")
def two_rows() -> str:
    pattern = np.concatenate([cap(1, 0), row(4, 40), row(4, 80, 45, 405)])
    return campaign(ASME, points=in_test("effective_diameter", on_ball(pattern))).stated()


# Directions and places -----------------------------------------------------------------------------------------------


def noise_of(one: PointGroup) -> FloatArray:
    """Some micrometres that are another number in each point."""
    return 0.1 * (one.points - one.points.round(1))


def bars_along(directions: FloatArray, apart_mm: float) -> Change:
    """Each position of a bar along one of some directions, so far from the one before."""
    units = np.asarray(directions, dtype=float)
    units /= np.linalg.norm(units, axis=1, keepdims=True)

    def change(one: PointGroup, of: Groups) -> PointGroup:
        *place, end = one.keys.values()
        ends = [of[(*place, each)].points.mean(axis=0) for each in "AB"]
        between = round(float(np.linalg.norm(ends[1] - ends[0])))
        number = int(one.keys["position"])
        begin = np.array([-300.0 + apart_mm * number, -900.0, 200.0]) + noise_of(one)
        return at(one, begin + (end == "B") * between * units[number % len(units)])

    return change


for _test, _standard in LENGTHS.items():
    mistake(f"all positions of the bars of {_test} along y, 15 mm apart", said="asks for 4 directions")(
        lambda test=_test, standard=_standard: campaign(
            standard, points=in_test(test, bars_along([[0, 1, 0]], 15.0))
        ).stated()
    )
    mistake(f"bars of {_test} that turn in one plane, by 40 degrees in all", said="asks for 4 directions")(
        lambda test=_test, standard=_standard: campaign(
            standard,
            points=in_test(
                test, bars_along([[np.sin(a), np.cos(a), 0] for a in np.radians(np.arange(0, 41, 10))], 40.0)
            ),
        ).stated()
    )
    mistake(f"bars of {_test} turned end for end and called another position", said="one position, not two")(
        lambda test=_test, standard=_standard: campaign(standard, points=in_test(test, _turned)).stated()
    )


def _turned(one: PointGroup, of: Groups) -> PointGroup:
    """Positions 2 and 3 of a length as position 1, with its ends exchanged, and their own noise."""
    places = [key for key in of if key[0] == one.keys["length"] and (len(key) < 4 or key[2] == one.keys.get("repeat"))]
    first, *others = dict.fromkeys(key[1] for key in places)
    if one.keys["position"] != others[0]:
        return one
    keys = list(one.keys.values())
    keys[1], keys[-1] = first, "BA"[keys[-1] == "B"]
    return at(one, of[tuple(keys)].points + noise_of(one))


@mistake("19 of 20 positions with the short bar, one with the long one", said="asks for 4 directions")
def one_with_the_long_bar() -> str:
    def change(one: PointGroup, of: Groups) -> PointGroup:
        longest = [key for key in of if key[0] == "1700"]
        if one.keys["length"] != "1700" or one.keys["position"] == longest[0][1]:
            return one
        ends = [of[("1700", one.keys["position"], end)].points for end in "AB"]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        points = ends[0] + [0, 0, 37.0] + (one.keys["end"] == "B") * along * (900.0 + ends[1][0, 0] % 0.01)
        return at(replace(one, keys={**one.keys, "length": "900"}), points)

    return campaign(ASME, points=in_test("volumetric", change)).stated()


def moved_to(places_mm: dict[str, FloatArray | list[float]]) -> Change:
    """Groups of some positions moved to a place near that of position 1."""

    def change(one: PointGroup, of: Groups) -> PointGroup:
        if (by := places_mm.get(one.keys["position"])) is None:
            return one
        first = next(group for group in of.values() if group.keys["position"] == "1")
        own = next(group for group in of.values() if group.keys["position"] == one.keys["position"])
        return at(one, one.points - own.points.mean(axis=0) + first.points.mean(axis=0) + by)

    return change


@mistake("three seats 11 mm apart in place of near, middle and far", said="the farthest two positions are 22 mm apart")
def near_seats() -> str:
    return campaign(ASME, points=in_test("single_point", moved_to({"2": [11, 0, 0], "3": [22, 0, 0]}))).stated()


@mistake("one seat that was named near, middle and far", said="one position, not two")
def one_seat() -> str:
    return campaign(ASME, points=in_test("single_point", moved_to({"2": [0, 0, 0], "3": [1, 0, 0]}))).stated()


for _test in ("probing", "articulation"):
    mistake(f"one place of the ball that is called two positions of {_test}", said="one position, not two")(
        lambda test=_test: campaign(points=in_test(test, moved_to({"2": [2.0, 0, 0]}))).stated()
    )


@mistake("groups of an articulation on two balls", said="more than its diameter")
def two_balls() -> str:
    def change(one: PointGroup, _: Groups) -> PointGroup:
        return at(one, one.points + [0, 300.0 * (one.keys["group"] == "C"), 0])

    return campaign(points=in_test("articulation", change)).stated()


@mistake("runs of a length at other places than the first", said="away from its place in the first run")
def wandering_bar() -> str:
    def change(one: PointGroup, _: Groups) -> PointGroup:
        return at(one, one.points + [0, 0, 80.0 * (int(one.keys["repeat"]) - 1)])

    return campaign(points=in_test("uni", change)).stated()


@right("bars in three directions and one oblique, seven positions", unsaid="asks for")
def four_directions() -> str:
    along = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]
    return campaign(points=in_test("uni", bars_along(along, 40.0))).stated()


@right("directions of 31 degrees apart, in two planes", unsaid="asks for")
def near_directions() -> str:
    turns = np.radians([0, 31, 62])
    along = [*([np.cos(a), np.sin(a), 0] for a in turns), [0, 0, 1]]
    return campaign(points=in_test("uni", bars_along(along, 40.0))).stated()


@right("a bar that was set down again between runs, 20 mm beside", unsaid="first run")
def set_down_again() -> str:
    def change(one: PointGroup, _: Groups) -> PointGroup:
        return at(one, one.points + [20.0 * (one.keys["repeat"] == "2"), 0, 0])

    return campaign(points=in_test("uni", change)).stated()


@right("runs that began at the other end of the bar", unsaid="asks for|refus")
def other_end_first() -> str:
    def change(one: PointGroup, of: Groups) -> PointGroup:
        if one.keys["repeat"] != "2":
            return one
        return at(one, of[(*list(one.keys.values())[:-1], "BA"[one.keys["end"] == "B"])].points)

    return campaign(points=in_test("uni", change)).stated()


@right("14 positions with the short bar, 6 with the long one", unsaid="asks for")
def fourteen_and_six() -> str:
    def change(one: PointGroup, of: Groups) -> PointGroup:
        places = list(dict.fromkeys(key[1] for key in of if key[0] == "1700"))
        if one.keys["length"] != "1700" or one.keys["position"] not in places[6:]:
            return one
        ends = [of[("1700", one.keys["position"], end)].points for end in "AB"]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        points = ends[0] + [0, 0, 37.0] + (one.keys["end"] == "B") * along * (900.0 + ends[1][0, 0] % 0.01)
        return at(replace(one, keys={**one.keys, "length": "900"}), points)

    return campaign(ASME, points=in_test("volumetric", change)).stated()


@right("seats at a quarter, half and three quarters and more of the reach", unsaid="asks for")
def spread_seats() -> str:
    return campaign(ASME, points=in_test("single_point", moved_to({"2": [400.0, 0, 0], "3": [760.0, 0, 0]}))).stated()


# Sizes of the lengths ------------------------------------------------------------------------------------------------


def sizes(standard: str, *lengths_mm: float) -> str:
    """The certificate of a campaign that is laid out with other lengths of the bar, by the plan as it is."""
    loose = [
        (rf"({key} = {{ value = )[\d.]+", rf"\g<1>{value}")
        for key, value in (
            ("longest_share", 0),
            ("shortest_most_share", 1),
            *([("gap_ratio", 100)] if standard == ISO else [("shortest_share", 0), ("longest_most_share", 1)]),
        )
    ]
    names = ",\n".join(f'{{ name = "{one:g}", length_mm = {one:g}, u_mm = 0.001 }}' for one in lengths_mm)
    bar = [(r"lengths = \[.*?\n\]", f"lengths = [\n{names}\n]")]
    laid = campaign(standard, plan=loose, artefacts=bar, laid_out=True)
    return replace(laid, plan=campaign(standard).plan).stated()


WRONG_SIZES = {
    "five lengths within 50 mm of the longest": (ISO, (1650, 1660, 1670, 1685, 1700), "the shortest length is 1650"),
    "no length between a short one and four long ones": (ISO, (150, 1550, 1600, 1650, 1700), "the widest gap"),
    "four short lengths and a long one": (ISO, (150, 200, 250, 300, 1700), "the widest gap"),
    "five lengths of half a bar": (ISO, (150, 300, 450, 600, 850), "the longest length is 850"),
    "two long bars": (ASME, (1650, 1700), "the shortest length is 1650"),
    "two short bars": (ASME, (800, 900), "the longest length is 900"),
    "a bar of a tenth of the reach beside the long one": (ASME, (125, 1700), "the shortest length is 125"),
    "a bar far over the zone of the longest": (ASME, (900, 2000), "the longest length is 2000"),
    "lengths between the two zones": (ASME, (1200, 1400), "the longest length is 1400"),
}
for _what, (_standard, _sizes, _said) in WRONG_SIZES.items():
    mistake(f"{_what}, as lengths of {_standard}", said=_said)(
        lambda standard=_standard, given=_sizes: sizes(standard, *given)
    )
for _what, (_standard, _sizes) in {
    "lengths of a step gauge, unevenly spread": (ISO, (100, 500, 1000, 1200, 1700)),
    "a shortest length of 20 mm": (ISO, (20, 450, 900, 1300, 1700)),
    "a longest length of exactly 66 % of the range": (ISO, (150, 450, 900, 1300, 1650)),
    "bars of exactly half the reach and 120 %": (ASME, (625, 1500)),
    "bars of exactly 75 and 150 % of the reach": (ASME, (937.5, 1875)),
}.items():
    right(f"{_what}, by {_standard}", unsaid="asks for")(
        lambda standard=_standard, given=_sizes: sizes(standard, *given)
    )


# Counts --------------------------------------------------------------------------------------------------------------


def without(key: str, value: str) -> Change:
    """Without the groups of one position, run, length .."""
    return lambda one, _: None if one.keys[key] == value else one


def fewer_points(one: PointGroup, _: Groups) -> PointGroup:
    """Without the last point: one that was rejected."""
    return at(one, one.points[:-1])


def only(key: str, value: str, change: Change) -> Change:
    """A change of the groups with one key."""
    return lambda one, of: change(one, of) if one.keys[key] == value else one


def renumbered(key: str, before: str, after: str) -> Change:
    return lambda one, _: replace(one, keys={**one.keys, key: after}) if one.keys[key] == before else one


def counted_anew(one: PointGroup, _: Groups) -> PointGroup | None:
    """Without the first run, the others numbered from 1."""
    number = int(one.keys["repeat"]) - 1
    return replace(one, keys={**one.keys, "repeat": str(number)}) if number else None


def worst_left_out(one: PointGroup, _: Groups) -> PointGroup:
    """Without the point that lies farthest from the others."""
    off = np.linalg.norm(one.points - one.points.mean(axis=0), axis=1)
    return at(one, np.delete(one.points, int(off.argmax()), axis=0))


WRONG_COUNTS = {
    "a rejected point of a ball left out": (ISO, "probing", only("position", "1", fewer_points), "25 points at"),
    "one position of the ball": (ISO, "probing", without("position", "2"), "asks for 2 positions, got 1"),
    "a rejected point of an articulation left out": (
        ISO,
        "articulation",
        only("group", "B", fewer_points),
        "5 points at",
    ),
    "the worst group of an articulation left out": (ISO, "articulation", without("group", "E"), "asks for 5 groups"),
    "an articulation at one position": (ISO, "articulation", without("position", "2"), "asks for 2 positions"),
    "a length of E_Uni left out": (ISO, "uni", without("length", "1300"), "asks for 5 lengths, got 4"),
    "the worst position of E_Uni left out": (ISO, "uni", without("position", "5"), "asks for 7 positions"),
    "the worst run of E_Uni left out": (ISO, "uni", without("repeat", "2"), "expected repeats 1 to 3, got 1, 3"),
    "the worst run left out and the others counted anew": (
        ISO,
        "uni",
        counted_anew,
        "expected repeats 1 to 3, got 1, 2",
    ),
    "a run of E_Uni measured again under number 4": (
        ISO,
        "uni",
        renumbered("repeat", "2", "4"),
        "expected repeats 1 to 3, got 1, 3, 4",
    ),
    "an end of a length left out": (ISO, "uni", without("end", "B"), "end B is missing"),
    "one set of E_Uni left out": (
        ISO,
        "uni",
        lambda one, _: None if (one.keys["length"], one.keys["position"]) == ("900", "3") else one,
        "asks for 7 positions of length 900",
    ),
    "a length of E_Bi left out": (ISO, "bi", without("length", "450"), "asks for 5 lengths, got 4"),
    "the worst position of E_Bi left out": (ISO, "bi", without("position", "7"), "asks for 7 positions"),
    "the worst run of E_Bi left out": (ISO, "bi", without("repeat", "1"), "expected repeats 1 to 3, got 2, 3"),
    "a rejected point of an effective diameter left out": (
        ASME,
        "effective_diameter",
        only("repeat", "1", worst_left_out),
        "asks for 9 points",
    ),
    "the worst run of an effective diameter left out": (
        ASME,
        "effective_diameter",
        without("repeat", "2"),
        "asks for 3 repeats, got 2",
    ),
    "the worst point in a seat left out": (
        ASME,
        "single_point",
        only("position", "3", worst_left_out),
        "asks for 10 points",
    ),
    "the far seat left out": (ASME, "single_point", without("position", "3"), "asks for 3 positions, got 2"),
    "the worst length of the volumetric test left out": (
        ASME,
        "volumetric",
        without("position", "11"),
        "asks for 20 measured lengths, got 19",
    ),
    "one bar in the volumetric test": (ASME, "volumetric", without("length", "1700"), "asks for 2 lengths, got 1"),
}
for _what, (_standard, _test, _change, _said) in WRONG_COUNTS.items():
    mistake(_what, said=_said)(
        lambda standard=_standard, test=_test, change=_change: campaign(standard, points=in_test(test, change)).stated()
    )
for _test, _standard in {**BALLS, **LENGTHS, "single_point": ASME}.items():
    mistake(f"the whole test {_test} left out", said=f"the points of test '{_test}' are missing")(
        lambda test=_test, standard=_standard: campaign(standard, points=in_test(test, lambda *_: None)).stated()
    )


@mistake("a test deleted from the plan, and the certificate still after the standard", said="own plan: .*no standard")
def deleted_test() -> str:
    return campaign(
        plan=[(r"\[articulation\].*?(?=\[uni\])", "")], points=in_test("articulation", lambda *_: None)
    ).stated()


FEWER = {
    "9 points on the ball": (ISO, ("probing", "points", 25, 9)),
    "three positions of each length": (ISO, ("uni", "positions", 7, 3)),
    "one run of each length": (ISO, ("uni", "repeats", 3, 1)),
    "one direction": (ISO, ("uni", "directions", 4, 1)),
    "a longest length of a third of the range": (ISO, ("uni", "longest_share", 0.66, 0.33)),
    "any sizes of the lengths": (ISO, ("uni", "gap_ratio", 2, 100)),
    "one bad value of each length tolerated": (ISO, ("uni", "tolerated_sets", 0, 35)),
    "a ball touched as the operator chose": (
        ISO,
        ("probing", "pattern", '"evenly over half of the sphere"', '"as the operator chose"'),
    ),
    "a smaller ball than allowed": (ISO, ("probing", "smallest_sphere_mm", 10, 3)),
    "three points in a seat": (ASME, ("single_point", "points", 10, 3)),
    "seats anywhere": (ASME, ("single_point", "spread_share", 0.3, 0)),
    "five positions of the bars": (ASME, ("volumetric", "positions", 20, 8)),
    "a short bar that may be a long one": (ASME, ("volumetric", "shortest_most_share", 0.375, 1)),
    "a long bar of any size": (ASME, ("volumetric", "longest_most_share", 0.75, 1)),
}
for _what, (_standard, (_test, _key, _before, _after)) in FEWER.items():
    mistake(f"a plan that asks for less, {_what}, and is named after the standard", said="own plan: .*no standard")(
        lambda standard=_standard, test=_test, key=_key, before=_before, after=_after: campaign(
            standard, plan=[(rf"(\[{test}\].*?\n{key} = {{ value = ){before}", rf"\g<1>{after}")], laid_out=True
        ).stated()
    )


@right("a campaign as the plan asks, ISO 10360-12", unsaid="own plan|not confirmed")
def iso_as_planned() -> str:
    return campaign().stated()


@right("a campaign as the plan asks, ASME B89.4.22", unsaid="own plan|not confirmed")
def asme_as_planned() -> str:
    return campaign(ASME).stated()


@right("the optional test of opposite faces not agreed, and not made", unsaid="own plan|refus")
def without_opposite_faces() -> str:
    return campaign(
        plan=[(r"(\[bi\][^\n]*\nrequired = )true", r"\1false")], points=in_test("bi", lambda *_: None)
    ).stated()


for _what, (_standard, _edits) in {
    "more points on the ball than planned by the standard": (ISO, ("probing", "points", 25, 50)),
    "more positions of each length": (ISO, ("uni", "positions", 7, 9)),
    "more points in each seat": (ASME, ("single_point", "points", 10, 20)),
    "more positions of the bars": (ASME, ("volumetric", "positions", 20, 30)),
}.items():
    right(f"an own plan with {_what}", unsaid="refus|expected")(
        lambda standard=_standard, e=_edits: campaign(
            standard, plan=[(rf"(\[{e[0]}\].*?\n{e[1]} = {{ value = ){e[2]}", rf"\g<1>{e[3]}")], laid_out=True
        ).stated()
    )


@right("a smaller arm of 1.2 m with its own bars", unsaid="asks for|own plan")
def smaller_arm() -> str:
    bar = [
        (
            r"lengths = \[.*?\n\]",
            "lengths = [\n"
            + ",\n".join(f'{{ name = "{one}", length_mm = {one}, u_mm = 0.001 }}' for one in (70, 220, 430, 620, 820))
            + "\n]",
        )
    ]
    return campaign(artefacts=bar, limits=[("= 2500", "= 1200")], laid_out=True).stated()


@right("a large arm of 4 m with bars in both zones", unsaid="asks for|own plan")
def large_arm() -> str:
    bar = [
        (
            r"lengths = \[.*?\n\]",
            "lengths = [\n"
            + ",\n".join(f'{{ name = "{one}", length_mm = {one}, u_mm = 0.002 }}' for one in (1200, 2600))
            + "\n]",
        )
    ]
    return campaign(ASME, artefacts=bar, limits=[("= 2500", "= 4000")], laid_out=True).stated()


@right("an arm that reaches 2 % beyond its range, which the maker rounds", unsaid="more than the measuring range")
def rounded_range() -> str:
    places = [group.points.mean(axis=0) for group in campaign().points.tests["uni"]]
    farthest = max(float(np.linalg.norm(one - other)) for one in places for other in places)
    return campaign(limits=[("measuring_range_mm = 2500", f"measuring_range_mm = {farthest / 1.02:.1f}")]).stated()


for _what, _range in {"of a toy arm": 250, "too small for its bars": 1500}.items():
    mistake(f"a measuring range {_what}", said="more than the measuring range of")(
        lambda mm=_range: campaign(limits=[("= 2500", f"= {mm}")]).stated()
    )


@mistake("a measuring range stated too large for the bars that were measured", said="the longest length is 1700 mm")
def range_too_large() -> str:
    return campaign(limits=[("= 2500", f"= {2 * RANGE_MM:g}")]).stated()
