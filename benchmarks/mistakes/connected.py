"""Connected arms: readings taken elsewhere than planned, frozen controllers, rehearsals; and what others may write."""

from __future__ import annotations

import itertools
import re
import unicodedata
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

import truearm as ta
from benchmarks.mistakes import mistake, right, seen
from benchmarks.rows import scratch
from truearm.typing import FloatArray
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Sample, Source
from truearm.wings.bench.sources.datagrams import decode_egm, decode_rsi
from truearm.wings.bench.sources.sample import Repeats

_NUMBERS = itertools.count(1)


def new_file(ending: str) -> Path:
    """A file that no case has yet."""
    return scratch() / f"connected-{next(_NUMBERS)}{ending}"


def plan_file() -> tuple[Path, FloatArray]:
    """A plan of six poses of a UR10 in two seats, in each of which the hand turns, and its joint angles [rad]."""
    poses = [[60 * (k // 3), -90, 90, 0, 90, 20 * (k % 3)] for k in range(6)]
    joints = [f"q{joint}_deg" for joint in range(1, 7)]
    rows = [[*joints, "seat", *(f"note_{joint}" for joint in joints)]]
    rows += [[*[""] * 6, f"B1{'ab'[k // 3]}", *map(str, pose)] for k, pose in enumerate(poses)]
    file = new_file(".csv")
    file.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return file, np.radians(np.array(poses, dtype=float))


def taken_by_key(*poses: FloatArray, plan: Path | None = None, seat: str = "", answer: str = "") -> str:
    """What a recording says of readings that a person takes by key, and the seats in the file."""
    out = new_file(".csv")
    recording = Recording(Source("arm", lambda: iter(())), out, arm="ur10", plan=plan, seat=seat, on="key")
    said = []
    for number, pose in enumerate(poses):
        said += [event.text for event in recording.on_command("take")]
        for k in range(12):
            said += [event.text for event in recording.on_sample(Sample(number + k / 20, pose))]
        said += [event.text for event in recording.on_command(answer)] if answer else []
    seats = [row["seat"] for row in recording.rows]
    recording.close()
    return " ".join([*said, f"seats {seats}"])


@mistake("a reading by key with the arm at another pose than the plan's", said=r"kept without a seat.*'B1a', '', 'B1a'")
def another_pose() -> str:
    plan, poses = plan_file()
    return taken_by_key(poses[0], poses[3], poses[1], plan=plan)


@mistake("a reading by key beside the seat, with the joints near the plan", said="kept without a seat: the tip of the")
def beside_the_seat() -> str:
    plan, poses = plan_file()
    return taken_by_key(poses[0], poses[1] + np.radians([12.0, 0, 0, 0, 0, 0]), plan=plan)


@mistake("readings by key 1.5 m apart in a seat named by hand", said=r"seats \['B1a', '', ''\]")
def seat_by_hand() -> str:
    at = ta.load_arm("ur10").working
    return taken_by_key(*(at + np.radians([turn, 0, 0, 0, 0, 0]) for turn in (0, 60, -60)), seat="B1a")


@right("a plan carried out by key in its order, a few degrees off", unsaid="kept without|'', |''\\]")
def plan_in_order() -> str:
    plan, poses = plan_file()
    return taken_by_key(*(poses + np.radians([1.0, -1.0, 1.0, 3.0, -2.0, 8.0])), plan=plan)


@right("a reading elsewhere whose seat a person names", unsaid="''")
def named_afterwards() -> str:
    plan, poses = plan_file()
    said = taken_by_key(poses[0], poses[3], plan=plan, answer="seat B1b")
    return said.partition("seats ")[2]


@right("an arm without a plan that is lifted from seat to seat by name", unsaid="kept without")
def seats_by_name() -> str:
    at = ta.load_arm("ur10").working
    said = taken_by_key(at, at + np.radians([0, 0, 0, 0, 0, 30.0]), seat="A")
    return said + taken_by_key(at + np.radians([60.0, 0, 0, 0, 0, 0]), seat="B")


def _egm(number: int, ms: int) -> bytes:
    """A datagram of EGM whose six joints are at 0 deg."""
    header = bytes([0x08, number, 0x10, ms])
    joints = b"".join(b"\x09" + bytes(8) for _ in range(6))
    feedback = bytes([0x0A, len(joints)]) + joints
    return bytes([0x0A, len(header)]) + header + bytes([0x12, len(feedback)]) + feedback


def _rsi(ipoc: int) -> bytes:
    return f'<Rob><AIPos A1="1" A2="2"/><IPOC>{ipoc}</IPOC></Rob>'.encode()


def _new_datagrams(decode: object, datagrams: list[bytes]) -> int:
    """How many datagrams repeat none."""
    repeats = Repeats()
    return sum(not repeats(angles, *stamps) for angles, stamps in map(decode, datagrams))  # type: ignore[call-overload]


@mistake("42 copies of one datagram of EGM, of a controller that is frozen")
def frozen_egm() -> bool:
    return _new_datagrams(decode_egm, [_egm(7, 28)] * 42) == 1


@mistake("42 copies of one datagram of RSI, of a controller that is frozen")
def frozen_rsi() -> bool:
    return _new_datagrams(decode_rsi, [_rsi(4208163634)] * 42) == 1


@mistake("datagrams of EGM counted on, all of one time")
def frozen_time_of_egm() -> bool:
    return _new_datagrams(decode_egm, [_egm(number, min(4 * number, 20)) for number in range(1, 43)]) == 5


@right("an arm at rest whose controller sends on")
def resting_arm() -> bool:
    datagrams = [_egm(number, number) for number in range(1, 43)]
    return _new_datagrams(decode_egm, datagrams) == 42 == _new_datagrams(decode_rsi, [_rsi(4 * k) for k in range(42)])


@right("a controller of EGM that dates nothing")
def undated_egm() -> bool:
    return _new_datagrams(decode_egm, [_egm(number, 0) for number in range(1, 43)]) == 42


@right("the ball of a rehearsed interim check has its diameter, 25 mm and a tip of 6 mm")
def rehearsed_ball() -> bool:
    from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere

    plan = new_file(".csv")
    ta.plan_check("ur10", sphere_mm=25.0).save(plan)
    rehearsal = ta.rehearse("ur10", plan, preset="perfect")
    on_ball = rehearsal.session.sphere == "ball"
    return abs(2 * fit_sphere(rehearsal.measurement.true_tips[on_ball]).radius_mm - 31.0) < 0.02


def arm_file(name: str, title: str) -> Path:
    """The file of a UR10 with another name and title, as TOML writes them."""
    text = (files("truearm.arm") / "arms" / "ur10.toml").read_text(encoding="utf-8")
    text = re.sub("(?m)^name = .*$", lambda _: f'name = "{name}"', text, count=1)
    file = new_file(".toml")
    file.write_text(re.sub("(?m)^title = .*$", lambda _: f'title = "{title}"', text, count=1), encoding="utf-8")
    return file


def _acts(text: str) -> bool:
    """Whether a terminal obeys a part of the text, or turns the direction of its letters."""
    return any(unicodedata.category(one) in ("Cc", "Cs") or "\u202a" <= one <= "\u202e" for one in text)


@mistake("an arm file whose name and title clear the screen and turn the direction of writing")
def evil_title() -> bool:
    evil = r"\u001b[2J\u202egnp.\u0000\u009b31m"
    return not _acts(seen("arms", arm_file(evil, evil)))


@mistake("an arm file whose title brings a verdict of its own on a second line", said=r"UR10\\nconform")
def second_line() -> str:
    return seen("arms", arm_file("ur10", r"UR10\nconform"))


@mistake("a seat whose name clears the screen, in a table for others")
def evil_seat() -> bool:
    file = new_file(".csv")
    readings = ta.simulate("ur10", poses=4, seed=1).session
    replace(readings, seat=np.array(["\x1b[2J\u202egnp", "", "", ""])).save(file)
    return not _acts(file.read_text(encoding="utf-8").replace("\n", ""))


@right("an arm with a title in Greek, Chinese and Hebrew")
def other_scripts() -> bool:
    title = "\u03b1\u03b2 \u4e2d\u6587 \u05d0\u05d1"
    return title in seen("arms", arm_file("ur10", title))


@mistake("an arm file with a key of 50,000 parts", said="more than 32 parts")
def deep_key() -> str:
    file = new_file(".toml")
    file.write_text("a." * 50_000 + "a = 1\n")
    return seen("arms", file)


@right("an arm file whose title has numbers of standards with many dots", unsaid="parts")
def dots_in_texts() -> str:
    return seen("arms", arm_file("ur10", "drawing 1.2.840.113549.1.9.16.2.14 " * 5))
