"""Arm files and columns that are described wrongly; arms and columns that only look so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import truearm as ta
from benchmarks.arm_files import planted
from benchmarks.mistakes import mistake, right
from truearm.arm.description_mistakes import likely_mistakes
from truearm.readings import Session

ARM, POSES = "ur10", 60
# Of the many that the doctor knows, one of each kind; `benchmarks arm_files mistakes` plants all of them.
PLANTED = (
    "sign of J4 reversed",
    "zero of J2 off by 90 deg: add 90 deg to its theta",
    "J3 is in rad, stated in deg",
    "J2 and J3 exchanged",
    "angle of J3 contains that of J2 (coupled joints)",
    "joints in reverse order",
    "all angles are in rad, stated in deg",
    "lengths of the arm are in cm, stated in mm",
    "a and d of J2 exchanged",
    "reference points are in inch, stated in mm",
    "frame of the reference points is left-handed (an axis mirrored, or two axes exchanged)",
    "references stand one row later than their readings",
)
# What is said of them in other words.
WORDS = {
    "lengths of the arm are in cm, stated in mm": "check the unit",
    "reference points are in inch, stated in mm": "the points may be in inch",
}


def readings(arm: str = ARM, *, poses: int = POSES, seed: int = 5, preset: str = "shop") -> Session:
    return ta.simulate(arm, poses=poses, strategy="uniform", preset=preset, seed=seed, arm_seed=seed).session


def planted_fit(name: str) -> str:
    arm = replace(ta.load_arm(ARM), lower=None, upper=None)
    found = next(one for one in likely_mistakes(arm, has_points=True, has_lengths=False) if one.description == name)
    wrong, session, _ = planted(arm, readings(), None, found)
    return str(ta.fit(wrong, session, model="kinematic"))


for _name in PLANTED:
    mistake(_name, said=WORDS.get(_name, _name.partition(" (")[0].partition(":")[0]))(
        lambda name=_name: planted_fit(name)
    )


@mistake("readings of a UR5e fitted as those of a UR10", said="another arm|UR5e|ur5e")
def another_arm() -> str:
    return str(ta.fit("ur10", readings("ur5e"), model="kinematic"))


@mistake("readings of a UR10e fitted as those of a UR10", said="the arm is ur10e")
def a_later_series() -> str:
    return str(ta.fit("ur10", readings("ur10e"), model="kinematic"))


@mistake("points sorted by x, poses not", said="another arm|rows|order")
def sorted_points() -> str:
    session = readings()
    points = session.points[np.argsort(session.points[:, 0])]
    return str(ta.fit(ARM, replace(session, points=points), model="kinematic"))


@mistake("two columns of angles are one column copied", said="described wrongly")
def copied_column() -> str:
    session = readings()
    angles = session.angles.copy()
    angles[:, 3] = angles[:, 2]
    return str(ta.fit(ARM, replace(session, angles=angles), model="kinematic"))


@mistake("the tracker was moved by 3 mm after half of the readings", said="moved|changed")
def moved_tracker() -> str:
    session = readings()
    points = session.points.copy()
    points[POSES // 2 :, 0] += 3.0
    return str(ta.fit(ARM, replace(session, points=points), model="kinematic"))


@mistake("a probe longer by 40 mm after half of the readings", said="tip (moved|changed)")
def another_probe() -> str:
    session = readings()
    along_tip = ta.load_arm(ARM).chain.pose(session.angles).R_base_tip[:, :, 2]
    points = session.points.copy()
    points[POSES // 2 :] += 40.0 * along_tip[POSES // 2 :]
    return str(ta.fit(ARM, replace(session, points=points), model="kinematic"))


@right("one zero of 12 degrees in a UR5")
def large_zero() -> str:
    session = readings("ur5")
    angles = session.angles + np.radians([0, 12, 0, 0, 0, 0])
    return str(ta.fit("ur5", replace(session, angles=angles), model="kinematic", limits="ignore"))


for _arm, _preset in (
    ("ur10", "worn"), ("ur5e", "research"), ("panda", "shop"), ("iiwa7", "shop"), ("measuring7", "worn"),
    ("gao2017", "shop"), ("wam", "shop"), ("irb120", "worn"), ("so101", "printed"), ("gen3", "shop"),
):  # fmt: skip
    right(f"{POSES} readings of {_arm}, errors as {_preset}", unsaid="another arm|contradict|described wrongly")(
        lambda arm=_arm, preset=_preset: str(ta.fit(arm, readings(arm, preset=preset), model="kinematic"))
    )
