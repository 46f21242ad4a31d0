"""The wrong session, or the right one read wrongly: training as a test, another arm, another unit, order or sign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

import truearm as ta
from benchmarks.mistakes import mistake, right
from benchmarks.rows import scratch
from truearm.models import Compensator
from truearm.readings import Session
from truearm.wings.bench.recording.record_readings import record
from truearm.wings.bench.sources import Sample, Source, StandstillRule

N = 59
Change = Callable[[Session], Session]


@cache
def readings(*, poses: int = N, seed: int = 1, arm_seed: int = 3) -> Session:
    """Readings of a virtual UR10 that states no serial number."""
    return replace(ta.simulate("ur10", poses=poses, seed=seed, arm_seed=arm_seed).session, serial_number=None)


@cache
def model() -> Compensator:
    """A kinematic model of 59 of them."""
    return ta.fit("ur10", readings(), model="kinematic").model


def mixed() -> Session:
    """The training readings and forty others."""
    return ta.Session.from_frame(
        readings().to_frame().merge(readings(poses=40, seed=2).to_frame(), how="outer", sort=False)
    )


def one_row_changed(session: Session) -> Session:
    points = session.points.copy()
    points[3] += 0.1
    return replace(session, points=points)


# Training as a test --------------------------------------------------------------------------------------------------

COPIES: dict[str, Change] = {
    "the very same": lambda session: session,
    "in another order": lambda session: session.rows(np.random.default_rng(1).permutation(N)),
    "a millionth off": lambda session: replace(session, points=session.points + 1e-6),
    "without one row": lambda session: session.rows(np.arange(N - 1)),
    "one row changed": one_row_changed,
    "with a temperature": lambda session: replace(session, temperature_degC=np.full(N, 21.0)),
    "rounded to 0.001 mm": lambda session: replace(session, points=session.points.round(3)),
    "with 40 new readings": lambda _: mixed(),
}
for name, change in COPIES.items():

    @mistake(f"training readings as a test, {name}", said=r"(59 of 59|58 of 5[89]|59 of 99) are training readings")
    def training_as_a_test(change: Change = change) -> str:
        return str(ta.evaluate(model(), change(readings())))


@right("a test of 40 other readings of the arm", unsaid="training readings|another arm")
def fair_test() -> str:
    return str(ta.evaluate(model(), readings(poses=40, seed=2)))


@right("the training poses, measured a second time by the tracker", unsaid="training readings")
def same_poses_again() -> str:
    noise = np.random.default_rng(2).normal(0, 0.01, (N, 3))
    return str(ta.evaluate(model(), replace(readings(), points=readings().points + noise)))


# Another arm in a refit ----------------------------------------------------------------------------------------------


@mistake("a refit to another arm of the type", said="constants of the model would have to move by")
def refit_of_another_arm() -> str:
    return str(ta.refit(model(), readings(poses=15, seed=7, arm_seed=4)))


CHANGES: dict[str, Change] = {
    "with the tracker elsewhere": lambda session: replace(session, points=session.points[:, [1, 0, 2]] * [1, -1, 1]),
    "with J3 worn by 20 arcsec": lambda session: replace(session, angles=session.angles + [0, 0, 1e-4, 0, 0, 0]),
    "to a camera of 0.3 mm": lambda session: replace(
        session, points=session.points + np.random.default_rng(1).normal(0, 0.3, session.points.shape)
    ),
    "to five readings": lambda session: session.rows([0, 4, 8, 12, 14]),
}
for name, change in CHANGES.items():

    @right(f"a refit of the same arm {name}", unsaid="another arm|would have to move")
    def refit_of_the_same_arm(change: Change = change) -> str:
        return str(ta.refit(model(), change(readings(poses=15, seed=7))))


# Angles read wrongly by predict --------------------------------------------------------------------------------------

ANGLES: dict[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "radians as degrees": ("in rad", np.radians),
    "degrees as radians": ("unit", np.degrees),
    "the joints in reverse order": ("in reverse order", lambda q: q[:, ::-1]),
    "J2 and J3 exchanged": ("J2 and J3 were exchanged", lambda q: q[:, [0, 2, 1, 3, 4, 5]]),
    "the sign of J2": ("J2 turned the other way", lambda q: q * [1, -1, 1, 1, 1, 1]),
    "the signs of J2 and J3": ("J2 and J3 turned the other way", lambda q: q * [1, -1, -1, 1, 1, 1]),
}
for name, (said, angles) in ANGLES.items():

    @mistake(f"predict with {name}", said=said)
    def predicted_from_wrong_angles(angles: Callable[[np.ndarray], np.ndarray] = angles) -> str:
        return next(iter(ta.predict(model(), ta.Session(angles(readings().angles))).blocks()))


@mistake("predict far outside the training: the uncertainty contains the error of the drawing")
def uncertainty_far_outside() -> bool:
    beyond = readings().angles + [0, 1.3, 0, 0, 0, 0]
    return bool(np.median(ta.predict(model(), ta.Session(beyond)).u_mm) > model().nominal_error() / np.sqrt(3))


@right("predict at new poses of the trained region", unsaid="would be inside|check the unit")
def predicted_in_the_region() -> str:
    return str(ta.predict(model(), ta.Session(readings(poses=40, seed=2).angles)))


@right("predict with J1 counted on by a full turn", unsaid="outside the trained range")
def predicted_a_turn_on() -> str:
    turned = readings().angles.copy()
    turned[:, 0] -= 2 * np.pi * np.sign(turned[:, 0])
    return str(ta.predict(model(), ta.Session(turned)))


# A sign that the tip hardly shows -----------------------------------------------------------------------------------


def fitted_with_j6(sign: int, strategy: str) -> str:
    session = ta.simulate("ur10", poses=40, strategy=strategy, seed=1, arm_seed=4).session
    return str(ta.fit("ur10", replace(session, angles=session.angles * [1, 1, 1, 1, 1, sign]), model="kinematic"))


@mistake("the sign of J6, whose axis meets the tip of a UR10", said="J6 seems to turn the other way")
def reversed_at_the_tip() -> str:
    return fitted_with_j6(-1, "box")


@right("a UR10 that turned J6, whose axis meets the tip, all around", unsaid="the other way|sign of J6")
def shown_at_the_tip() -> str:
    return fitted_with_j6(1, "uniform")


# Temperatures and loads ----------------------------------------------------------------------------------------------


def at(degC: float) -> Session:
    return replace(readings(), temperature_degC=np.full(N, degC))


VERBS: dict[str, Callable[[Session], object]] = {
    "fit": lambda session: ta.fit("ur10", session, model="nominal"),
    "evaluate": lambda session: ta.evaluate(model(), session),
    "predict": lambda session: ta.predict(model(), session),
    "refit": lambda session: ta.refit(model(), session),
}
for name, verb in VERBS.items():

    @mistake(f"degrees Fahrenheit in temperature_degC, in {name}", said="68 degrees Fahrenheit are 20.0 degC")
    def fahrenheit(verb: Callable[[Session], object] = verb) -> str:
        return str(verb(at(68.0)))


@right("readings of a hot hall, at 44 degC", unsaid="Fahrenheit")
def hot_hall() -> str:
    return str(ta.fit("ur10", at(44.0), model="nominal"))


def recorded(file: str, **stated: object) -> str:
    """What is said while a still arm is recorded."""
    samples = [Sample(k / 20, np.array([10.0, 20.0]), **stated) for k in range(10)]
    source = Source("test", lambda: iter(samples))
    events = record(source, scratch() / file, rule=StandstillRule(window_s=0.2))
    return " ".join(event.text for event in events)


@mistake("a payload of -5 kg in a record", said="no reading: expected a payload of 0 to")
def negative_payload() -> str:
    return recorded("payload.csv", columns={"payload_kg": -5.0})


@mistake("900 degC in a record", said="no reading: expected a temperature of -50 to 100 degC")
def absurd_temperature() -> str:
    return recorded("hot.csv", temperature_degC=900.0)


@right("a record at 21 degC with 3 kg", unsaid="no reading|Fahrenheit")
def plain_record() -> str:
    return recorded("plain.csv", temperature_degC=21.0, columns={"payload_kg": 3.0})
