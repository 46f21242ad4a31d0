"""Right sessions that look unusual: few readings, much noise, rough angles, warm rooms, seats, wires, other tips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import truearm as ta
from benchmarks.mistakes import right, seen
from benchmarks.rows import scratch
from truearm.readings import Session

DOUBT = "contradict|another arm|described wrongly|gross error|longer than drawn|calculated"


def readings(arm: str = "ur10", *, poses: int = 60, seed: int = 11, strategy: str = "uniform") -> Session:
    return ta.simulate(arm, poses=poses, strategy=strategy, preset="shop", seed=seed, arm_seed=7).session


def said(session: Session, arm: str = "ur10", model: str = "kinematic", **options: object) -> str:
    return str(ta.fit(arm, session, model=model, **options))


def noisy(session: Session, std_mm: float) -> Session:
    noise = std_mm * np.random.default_rng(3).standard_normal(session.points.shape)
    return replace(session, points=session.points + noise, point_std=None)


@right("2 mm of noise", unsaid=DOUBT)
def much_noise() -> str:
    return said(noisy(readings(), 2.0))


@right("9 readings", unsaid=DOUBT)
def nine_readings() -> str:
    return said(readings(poses=9, strategy="box"))


@right("J5 was locked", unsaid=DOUBT)
def locked_joint() -> str:
    simulated = ta.simulate("ur10", poses=5)  # an arm's tips at angles of our own
    angles = readings().angles.copy()
    angles[:, 4] = angles[0, 4]
    return said(simulated.virtual.measure(angles, seed=4).readings)


@right("angles rounded to 0.1 deg", unsaid=DOUBT)
def rounded_angles() -> str:
    session = readings()
    return said(replace(session, angles=np.radians(np.round(np.degrees(session.angles), 1))))


@right("points rounded to 0.1 mm", unsaid=DOUBT)
def rounded_points() -> str:
    session = readings()
    return said(replace(session, points=np.round(session.points, 1), point_std=None))


@right("a room of 26 degC throughout", unsaid=DOUBT)
def warm_room() -> str:
    return said(replace(readings(), temperature_degC=np.full(60, 26.0)), model="physical")


@right("a room that warms from 19 to 20 degC", unsaid=DOUBT)
def warming_room() -> str:
    return said(replace(readings(), temperature_degC=np.linspace(19.0, 20.0, 60)), model="physical")


@right("angles that passed two full turns", unsaid=DOUBT)
def turns() -> str:
    session = readings()
    angles = session.angles.copy()
    angles[30:, 5] += 4 * np.pi
    return said(replace(session, angles=angles), limits="ignore")


@right("base of the arm hangs from the ceiling", unsaid=DOUBT)
def from_the_ceiling() -> str:
    session = readings()
    return said(replace(session, points=session.points * (1, -1, -1) + (4000, -2500, 3000)))


@right("a tip of 200 mm that the arm file does not know", unsaid=DOUBT)
def long_tip() -> str:
    session = readings()
    along = ta.load_arm("ur10").chain.pose(session.angles).R_base_tip[:, :, 0]
    return said(replace(session, points=session.points + 200 * along))


@right("every third point was hidden", unsaid=DOUBT)
def hidden_points() -> str:
    session = readings(poses=90)
    points = session.points.copy()
    points[::3] = np.nan
    return said(replace(session, points=points, point_std=None))


@right("two sessions with the base moved between them, named", unsaid=DOUBT)
def two_set_ups() -> str:
    session = readings()
    points = session.points.copy()
    points[30:] = points[30:] * (-1, -1, 1) + (500, 200, 30)
    return said(replace(session, points=points, session=np.repeat(["A", "B"], 30)))


@right("seats and a bar", unsaid=DOUBT)
def seats_and_bar() -> str:
    simulated = ta.simulate("measuring7", poses=120, strategy="seat", seats=3, bars=2, reference=False, seed=2)
    return said(simulated.session, "measuring7", lengths=simulated.lengths)


@right("distances to three pins", unsaid=DOUBT)
def wires() -> str:
    return said(ta.simulate("ur10", poses=40, anchors=3, reference=False, seed=2).session)


@right("30 poses read three times", unsaid=DOUBT)
def repeats() -> str:
    session = readings(poses=30)
    return said(noisy(session.rows(np.repeat(np.arange(30), 3)), 0.01))


@right("a model at other readings of its arm", unsaid="are training readings|[3-9]. of 60 readings are outside|likely")
def other_readings() -> str:
    train, test = readings(seed=21), readings(seed=22)
    model, session, points = (scratch() / f"right{ending}" for ending in (".truearm", ".csv", "_points.csv"))
    ta.fit("ur10", train, model="kinematic").save(model)
    test.save(session)
    return seen("evaluate", model, session) + seen("predict", model, session, "--out", points)


@right("a refit in a new set-up", unsaid=DOUBT)
def new_set_up() -> str:
    model = ta.fit("ur10", readings(seed=21), model="kinematic").model
    moved = readings(seed=23, poses=20)
    return str(ta.refit(model, replace(moved, points=moved.points + (300, 40, -12))))


@right("a table of degrees and metres, with the units in its header", unsaid="expected|asked")
def table_with_units() -> str:
    session = readings(poses=20)
    table = scratch() / "units.csv"
    header = ",".join([*(f"J{i} (deg)" for i in range(1, 7)), "X [m]", "Y [m]", "Z [m]"])
    np.savetxt(
        table, np.hstack([np.degrees(session.angles), session.points / 1000]), "%.7f", ",", header=header, comments=""
    )
    return seen("import", table, "--out", table.with_name("units_session.csv"))
