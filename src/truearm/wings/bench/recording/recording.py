"""`record`: readings of a connected arm, latched at standstill and written at once."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import nullcontext, suppress
from datetime import UTC, datetime
from math import degrees, isfinite, radians
from pathlib import Path
from typing import TypedDict, TypeGuard

import numpy as np

from truearm.arm import Arm
from truearm.errors import Contradiction, InputError
from truearm.files.delimited import MAX_NAME, escape_formula
from truearm.identification.terms.type_prior import kinematics_sha256
from truearm.models import Compensator
from truearm.number_format import format_count
from truearm.readings import Session
from truearm.readings.checks import check_temperature
from truearm.readings.readings import DIRECTION, LOAD
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import ModelLike, to_arm, to_model_of_tip
from truearm.wings.bench.recording import TakeOn
from truearm.wings.bench.recording.learning import Learning, PosesToMeasure, learned_event
from truearm.wings.bench.recording.model_in_force import CorrectedTip, ModelInForce, corrected_tip
from truearm.wings.bench.recording.reference_point import TYPED, ReferencePoint, typed_numbers
from truearm.wings.bench.recording.session_log import Event, SessionLog, check_log_path
from truearm.wings.bench.sources import Sample, Source, StandstillRule, open_source
from truearm.wings.bench.sources.standstill import Standstill, TakenReading
from truearm.wings.planning.designs.planned_readings import PlannedReadings, read_planned

# A standstill that is farther is taken by key only, and without the name of what the tip touches.
FAR_FROM_AIM = 20.0  # deg, or mm, from the plan's pose
BESIDE_SEAT = 0.05  # of the arm's reach, from the other readings in the seat
JUMP_S = 1.0  # between two samples by the clock of a device
ODD_S = 1.0  # between two notices of odd samples
CLOCK_STANDS_S = 2.0  # samples of one time for so long are of a device that hangs; some clocks count seconds


class RecordingOptions(TypedDict, total=False):
    """The options of a recording, for the verbs that take them; `ta.record` explains them."""

    arm: Arm | str | Path | None
    plan: str | Path | None
    reference: Source | str | None
    rule: StandstillRule | None
    on: TakeOn
    seat: str
    model: ModelLike | None
    rank: bool
    out_model: str | Path | None


class Recording:
    """Samples and commands in, readings in a session file and events out.

    Its parameters are described in `truearm.wings.bench.recording.record_readings.record`.

    Raises
    ------
    InputError
        If the source, the plan or the file cannot be used, or they are of different arms.
    """

    def __init__(
        self,
        source: str | Source,
        out: str | Path,
        *,
        arm: Arm | str | Path | None = None,
        plan: str | Path | None = None,
        reference: Source | str | None = None,
        rule: StandstillRule | None = None,
        on: TakeOn = "still",
        seat: str = "",
        model: ModelLike | None = None,
        rank: bool = False,
        out_model: str | Path | None = None,
        samples_hz: float = 0.0,
    ) -> None:
        self.reference = open_source(reference) if isinstance(reference, str) and reference != TYPED else reference
        if isinstance(self.reference, Source) and not self.reference.has_points:
            name = self.reference.name
            raise InputError(f"{name} measures no points", hint="--reference names an instrument, or is typed")
        self.source = open_source(source) if isinstance(source, str) else source
        # Of two clocks, that of a device is none that the samples of the other can be paired by.
        self.is_timed_by_arrival = (
            isinstance(self.reference, Source) and self.reference.has_own_clock != self.source.has_own_clock
        )
        self.out, self.seat, self.on = Path(out), seat, on
        known = None if model is None else to_model_of_tip(model)
        self.arm = to_arm(arm) if arm is not None else None if known is None else known.arm_
        self.arm_given = str(arm) if isinstance(arm, str | Path) else ""
        if _is_known(self.arm) and known is not None and _is_known(known.arm_):
            _check_same(self.arm, known.arm_)
        check_log_path(self.out)
        if plan is not None and self.arm is None:
            raise InputError("a plan needs the arm that it is for", file=plan, hint="--arm ARM")
        self.plan_file = None if plan is None else Path(plan)
        self.plan: PlannedReadings | None = None if plan is None or self.arm is None else read_planned(plan, self.arm)
        if rank and not _is_known(self.arm):
            raise InputError("the next pose cannot be ranked: the arm's kinematics are not known", hint="--arm ARM")
        self._poses = PosesToMeasure(self.arm, self.plan, is_ranked=rank)
        prismatic = self.source.prismatic
        if self.arm is not None:
            prismatic = tuple(int(joint) + 1 for joint in np.flatnonzero(self.arm.chain.is_prismatic))
        self._prismatic = prismatic
        self._rule = rule or StandstillRule()
        self._standstill = Standstill(self._rule, prismatic)
        self._point = ReferencePoint(self.reference)
        self._asked, self._was_pressed, self._said, self._question = False, False, "", ""
        self._still_since_s, self._samples_hz, self._streamed_s = 0.0, samples_hz, -np.inf
        self._step_s, self._odd, self._odd_said_s, self._clock_moved_s = np.inf, "", -np.inf, time.monotonic()
        self.out_model, self.rank = None if out_model is None else Path(out_model), rank
        self._in_force = ModelInForce(self.arm, known, self.out, self.out_model)
        self._learning: Learning | None = None
        if _is_known(self.arm):
            # An arm that takes none of the usual poses is recorded, too.
            with nullcontext() if rank else suppress(InputError):
                trained_on = self._in_force.trained_on
                self._learning = Learning(self.arm, known, trained_on=trained_on, has_points=self._has_points)
        self._log: SessionLog | None = None
        self.sample: Sample | None = None

    @property
    def n_readings(self) -> int:
        """Number of readings in the file."""
        return 0 if self._log is None else len(self._log.rows)

    @property
    def rows(self) -> list[dict[str, str]]:
        """The cells of the readings in the file."""
        return [] if self._log is None else self._log.rows

    @property
    def model(self) -> Compensator | None:
        """The model in force."""
        return self._in_force.model

    @property
    def is_fitting(self) -> bool:
        """Whether a fit is under way."""
        return self._in_force.is_fitting

    def corrected(self) -> CorrectedTip | str | None:
        """The tip at the last sample by the model, or why there is none; None without a model or a sample."""
        if self.model is None or self.sample is None:
            return None
        return corrected_tip(self.model, self.sample, self._standstill.directions)

    @property
    def is_still(self) -> bool:
        """Whether the arm stands still."""
        return self._standstill.is_still

    @property
    def _has_points(self) -> bool:
        return self.source.has_points or self.reference is not None

    @property
    def units(self) -> list[str]:
        """Unit in which people read each joint: deg, or mm of one that slides."""
        n = 0 if self.sample is None else len(self.sample.joint_angles_rad)
        return ["mm" if joint in self._prismatic else "deg" for joint in range(1, n + 1)]

    @property
    def joint_columns(self) -> list[str]:
        """Name of each joint's column in the session file."""
        return [f"q{joint}_{unit}" for joint, unit in enumerate(self.units, start=1)]

    @property
    def factors(self) -> FloatArray:
        """(n_joints,) What takes joint angles in the units in which people read them to rad, or mm."""
        return np.array([1.0 if unit == "mm" else radians(1) for unit in self.units])

    def displayed(self, angles_rad: FloatArray) -> list[float]:
        """Joint angles in the units in which people read them."""
        shown = zip(angles_rad.tolist(), self.units, strict=True)
        return [angle if unit == "mm" else degrees(angle) for angle, unit in shown]

    @property
    def next_pose(self) -> int | None:
        """Number of the plan's next pose, counted from 1; None without a plan or after its last."""
        return self._poses.number

    @property
    def aim_rad(self) -> FloatArray | None:
        """(n_joints,) angles of the next pose [rad, or mm]; None where there is none."""
        return self._poses.aim_rad

    def to_go(self) -> list[float] | None:
        """How far each joint is from the next pose, in the units in which people read them."""
        if self.aim_rad is None or self.sample is None:
            return None
        return self.displayed(self.aim_rad - self.sample.joint_angles_rad)

    def on_sample(self, sample: Sample) -> Iterator[Event]:
        """Take in a sample of the arm."""
        if self.sample is not None:
            if (n := len(sample.joint_angles_rad)) != (before := len(self.sample.joint_angles_rad)):
                self._odd = f"{self.source.name} gives {n} joints in place of {before}; ignored"
                yield from self._say_odd()
                return
            self._watch_clock(sample.time_s - self.sample.time_s)
        self._standstill.add(sample)
        self.sample = sample  # from now on a view, in another thread, asks for its corrected tip
        if self._log is None:
            yield from self._start(sample)
        yield from self._say_odd()
        self._asked |= sample.is_button_pressed and not self._was_pressed
        self._was_pressed = sample.is_button_pressed
        yield from self._stream(sample)
        if not self._standstill.is_still:
            self._still_since_s, self._said, self._question = sample.time_s, "", ""
            self._point.forget()
        elif self._asked or (self.on == "still" and self._standstill.is_new):
            problem = "" if self._asked else self._unlikely(self._standstill.mean_rad)
            if problem := problem or self._point.missing(self._standstill.window_s):
                yield from self._say_once(problem, sample.time_s)
            else:
                yield from self._take(self._standstill.taken())

    def _watch_clock(self, step_s: float) -> None:
        """Note a step from a sample to the next that no clock makes."""
        before_s, self._step_s = self._step_s, step_s
        is_late = self.source.has_own_clock and not self.is_timed_by_arrival and step_s > max(JUMP_S, 2 * before_s)
        if step_s != 0:
            self._clock_moved_s = time.monotonic()
        elif self.source.has_own_clock and time.monotonic() - self._clock_moved_s > CLOCK_STANDS_S:
            self._odd = f"the clock of {self.source.name} stands still: start the device, or its sending, again"
        if step_s < 0 or is_late:
            self._odd = f"the clock of {self.source.name} jumps by {step_s:+.3g} s; the standstill begins again"

    def _say_odd(self) -> Iterator[Event]:
        """Say what was odd about a sample, once a second at most."""
        if self._odd and time.monotonic() - self._odd_said_s > ODD_S:
            yield Event("notice", self._odd)
            self._odd, self._odd_said_s = "", time.monotonic()

    def _stream(self, sample: Sample) -> Iterator[Event]:
        """The angles as they arrive, no more often than asked for."""
        since, period = sample.time_s - self._streamed_s, 1.0 / self._samples_hz if self._samples_hz else np.inf
        if self._samples_hz and not 0 <= since < 0.999 * period:
            # From one due time to the next: the rate is kept on average, whatever that of the samples.
            self._streamed_s = self._streamed_s + period if period <= since < 2 * period else sample.time_s
            shown = dict(zip(self.joint_columns, self.displayed(sample.joint_angles_rad), strict=True))
            state: dict[str, object] = {
                "time_s": sample.time_s,
                "is_still": self.is_still,
                "tip_mm": sample.tip_in_reference_mm,
            }
            tip = self.corrected()
            if isinstance(tip, CorrectedTip):
                state |= {"corrected_mm": tip.tip_in_reference_mm, "U_mm": tip.U_mm, "is_trained": tip.is_trained}
            elif tip is not None:
                state["not_corrected"] = tip
            text = "still" if self.is_still else "moving"
            yield Event("sample", text if tip is None else f"{text}: {tip}", {**state, **shown})

    def on_reference(self, sample: Sample) -> None:
        """Take in a sample of the second instrument."""
        self._point.add(sample)

    def on_command(self, text: str) -> Iterator[Event]:
        """Do what a person asks for.

        Parameters
        ----------
        text : str
            ``take``, ``take moving``, ``undo``, ``seat NAME``, ``point X Y Z``, ``skip``, ``refit``, ``save``;
            ``steer Q1 Q2 ..`` of a virtual arm [deg, or mm].
        """
        word, _, rest = text.strip().partition(" ")
        if text.strip() == "take":
            self._asked = True
            if not self.is_still:
                yield Event("notice", "the reading is taken when the arm stands still")
        elif text.strip() == "take moving":
            yield from self._take_moving()
        elif text.strip() == "undo":
            yield from self._undo()
        elif word == "seat":
            yield from self._name_seat(rest.strip())
        elif word == "point":
            yield self._point.type(rest, is_still=self.is_still)
        elif text.strip() == "skip":
            yield from self._skip()
        elif word == "steer":
            yield from self._steer(rest)
        elif text.strip() == "refit":
            yield self._in_force.refit(self.n_readings)
        elif text.strip() == "save":
            yield self._in_force.save()
        else:
            known = "take, take moving, undo, seat, point, skip, refit, save or end"
            yield Event("refused", f"unknown command {text[:40]!a}: {known}")

    def news_of_fit(self) -> Iterator[Event]:
        """What a fit under way says; learning goes on from the model that it puts in force."""
        for event in self._in_force.news():
            yield event
            if event.kind == "model" and self._learning is not None:
                before_mm, trained_on = self._learning.uncertainty_mm, self._in_force.trained_on
                self._learning = Learning(
                    self._learning.arm, self.model, trained_on=trained_on, has_points=self._has_points
                )
                yield from self._learn()
                yield learned_event(before_mm, self._learning.uncertainty_mm)
                yield from self._next()

    def settle(self) -> float | None:
        """See `SessionLog.settle`."""
        return None if self._log is None else self._log.settle()

    def close(self) -> None:
        """Close the file, and end a fit that is under way."""
        self._in_force.close()
        if self._log is not None:
            self._log.close()

    def end(self) -> Event:
        """What is said at the end, whatever ended it."""
        count = format_count(self.n_readings, "reading")
        return Event("end", f"{count} in {self.out}", {"readings": self.n_readings, "file": str(self.out)})

    def _start(self, sample: Sample) -> Iterator[Event]:
        """Open the file; its columns depend on what the device gives."""
        n = len(sample.joint_angles_rad)
        if n == 0:
            raise InputError(f"{self.source.name} gives no joint angles", hint="give it as --reference")
        if self.arm is not None and self.arm.n_joints != n:
            raise InputError(
                f"{self.source.name} gives {n} joints, arm {self.arm.name!r} has {self.arm.n_joints}",
                hint="give the arm that is connected",
            )
        self._log = SessionLog(self.out, self._columns(sample))
        self._check_numbers()
        if self._log.repaired:
            yield Event("notice", f"{self.out}: {self._log.repaired}")
        if self.is_timed_by_arrival:
            yield Event("notice", "one device states its time and the other does not: both are paired by arrival")
        text = f"recording {self.source.name} to {self.out}"
        if self.n_readings:
            text += f", after {format_count(self.n_readings, 'reading')} before"
        if not (self._has_points or self.plan or self.seat):
            text += "; fit needs the seat's name (--seat NAME, key s, or command seat NAME) or the tip (--reference)"
        yield Event("ready", text, {"readings": self.n_readings})
        yield from self._learn()
        yield from self._next()

    def _check_numbers(self) -> None:
        """Refuse a file in which a person has edited a number into something else."""
        point, n = ("x_mm", "y_mm", "z_mm"), len(self.joint_columns)
        needed = {*self.joint_columns, *(f"{DIRECTION}{joint}" for joint in range(1, n + 1))}
        for line, row in enumerate(self.rows, start=2):
            has_point = any(row.get(name) for name in point)
            for name, cell in row.items():
                is_needed = name in needed or (has_point and name in point)
                if (is_needed or (cell and self._is_number(name))) and not _is_finite(cell):
                    raise InputError(f"expected a number, got {cell!r:.40}", file=self.out, line=line, column=name)

    def _columns(self, sample: Sample) -> list[str]:
        joints = self.joint_columns
        planned = [] if self.plan is None else ["sphere", "position"]
        return [
            *joints,
            *(("x_mm", "y_mm", "z_mm") if self._has_points else ()),
            "seat",
            *(name for name in planned if getattr(self.plan, name) is not None),
            *(("serial_number",) if self.arm is not None and self.arm.serial_number else ()),
            *(("temperature_degC",) if sample.temperature_degC is not None else ()),
            *(f"{DIRECTION}{joint}" for joint in range(1, len(joints) + 1)),
            *sample.columns,
            *(("note_pose",) if self.plan is not None else ()),
            "note_samples",
            *(f"note_std_{joint}" for joint in joints),
            "note_time",
        ]

    def _say_once(self, problem: str, time_s: float) -> Iterator[Event]:
        """Say in a standstill why no reading is taken, once the second instrument had its time."""
        if problem != self._said and self._point.is_late(time_s - self._still_since_s):
            self._said = problem
            yield Event("notice", problem)

    def _unlikely(self, angles_rad: FloatArray) -> str:
        """Why a standstill is probably not meant to be a reading: the arm rests, or hangs beside the seat."""
        if self.plan is not None and self.next_pose is None:
            return "still, and not taken: the plan is done; take further readings by key"
        if far := self._far_from_pose(angles_rad):
            return f"still, and not taken: {far}; take it by key, or skip the pose"
        if beside := self._beside_seat(angles_rad):
            return f"still, and not taken: {beside}; take it by key, or name another seat"
        return ""

    def _far_from_pose(self, angles_rad: FloatArray) -> str:
        """How far the joints are from the plan's next pose, if that is too far."""
        if self.plan is None or (number := self.next_pose) is None:
            return ""
        away = np.abs(self.displayed(self.plan.angles[number - 1] - angles_rad))
        joint = int(np.argmax(away))
        far = f"J{joint + 1} is {away[joint]:.0f} {self.units[joint]} from pose {number}"
        return far if away[joint] > FAR_FROM_AIM else ""

    def _beside_seat(self, angles_rad: FloatArray) -> str:
        """How far the tip is from the other readings in the next one's seat, if that is too far."""
        if not _is_known(self.arm) or not len(others := self._angles_in_seat()):
            return ""
        tips = self.arm.forward(others).tip_in_base
        away_mm, *among_mm = np.linalg.norm(
            np.vstack([self.arm.forward([angles_rad]).tip_in_base, tips]) - tips.mean(axis=0), axis=1
        )
        # Of an arm whose zeros are far off, the readings that a person has named show how far the tips differ.
        beside = f"the tip of the nominal arm is {away_mm:.0f} mm from the readings in seat {self._seat_now()}"
        return beside if away_mm > max(BESIDE_SEAT * self.arm.chain.reach, 2 * max(among_mm)) else ""

    def _seat_now(self) -> str:
        """Seat of the next reading: the one that a person named, else the plan's; empty if there is none."""
        return self.seat or self._poses.seat

    def _angles_in_seat(self) -> FloatArray:
        """(n, n_joints) joint angles of the readings in the seat of the next one [rad, or mm]."""
        seat = self._seat_now()
        rows = [row for row in self._log.rows if row["seat"] == seat] if self._log is not None and seat else []
        columns = self.joint_columns
        joints = np.array([[float(row[name]) for name in columns] for row in rows]).reshape(-1, len(columns))
        return joints * self.factors

    def _take(self, reading: TakenReading) -> Iterator[Event]:
        assert self._log is not None  # opened at the first sample
        try:
            _check_states(reading)
        except Contradiction as doubt:
            yield Event("notice", f"{doubt.problem}; {doubt.hint}")
        except InputError as error:
            self._asked = False
            yield Event("refused", f"no reading: {error.problem}; {error.hint}")
            return
        far, beside = self._far_from_pose(reading.joint_angles_rad), self._beside_seat(reading.joint_angles_rad)
        number, plan = None if far or beside else self.next_pose, self.plan
        self._question = beside or (far if not self.seat and self._poses.seat else "")
        seat = "" if self._question else self._seat_now()
        point = self._point.of(reading)
        row: dict[str, float | str] = {"seat": seat, "note_samples": str(reading.n), **reading.columns}
        mean, std = self.displayed(reading.joint_angles_rad), self.displayed(reading.joint_std_rad)
        for name, angle, scatter in zip(self.joint_columns, mean, std, strict=True):
            row |= {name: angle, f"note_std_{name}": f"{scatter:.2g}" if reading.n > 1 else ""}
        row |= {f"{DIRECTION}{joint}": f"{sign:.0f}" for joint, sign in enumerate(reading.directions, start=1)}
        if point is not None:
            row |= zip(("x_mm", "y_mm", "z_mm"), point.tolist(), strict=True)
        if reading.temperature_degC is not None:
            row["temperature_degC"] = reading.temperature_degC
        if self.arm is not None:
            row["serial_number"] = self.arm.serial_number
        if plan is not None and number is not None:
            row["note_pose"] = str(number)
            for name in ("sphere", "position"):
                if (names := getattr(plan, name)) is not None:
                    row[name] = str(names[number - 1])
        row["note_time"] = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._log.append(row)
        self._asked, self._said = False, ""
        self._point.forget()
        text = self._describe(row, number, reading)
        if self._question:
            text += f"; kept without a seat: {self._question}. Name the seat that the tip touched, or undo the reading"
        elif far:
            text += f"; kept without the names of the plan: {far}"
        yield Event("reading", text, {"reading": self.n_readings, **row})
        yield from self._learn()
        yield from self._next()

    def _describe(self, row: Mapping[str, float | str], number: int | None, reading: TakenReading) -> str:
        where = f", seat {row['seat']}" if row["seat"] else ""
        pose = f", pose {number} of {len(self.plan)}" if self.plan is not None and number is not None else ""
        text = f"reading {self.n_readings}{pose}{where}: mean of {format_count(reading.n, 'sample')}"
        if self.arm is not None:
            lower, upper = self.arm.limits.T
            beyond = np.flatnonzero((reading.joint_angles_rad < lower) | (reading.joint_angles_rad > upper))
            text += "".join(f"; J{joint + 1} is beyond its limit" for joint in beyond)
        return text

    def _take_moving(self) -> Iterator[Event]:
        if self._log is None:
            yield Event("refused", "nothing was received from the arm yet")
        elif isinstance(self.reference, Source):
            yield Event("refused", "from a moving arm, arm and second instrument cannot be paired")
        else:
            yield from self._take(self._standstill.last())

    def _undo(self) -> Iterator[Event]:
        row = None if self._log is None else self._log.undo()
        if row is None:
            yield Event("refused", "there is no reading to undo")
            return
        self._question = ""
        self._in_force.undone(self.n_readings)
        number = self.n_readings + 1
        numbers = {name: float(text) for name, text in row.items() if text and self._is_number(name)}
        yield Event("undone", f"reading {number} removed", {"reading": number, **row, **numbers})
        yield from self._learn()
        yield from self._next()

    def _skip(self) -> Iterator[Event]:
        if self._poses.skip():
            yield from self._next()
        elif self.plan is not None:
            yield Event("refused", "the plan is done")
        else:
            yield Event("refused", "there is no next pose to skip: start with --plan PLAN, or --rank")

    def _is_number(self, column: str) -> bool:
        """Whether an event of a reading has a column as a number."""
        known = (*self.joint_columns, "x_mm", "y_mm", "z_mm", "temperature_degC")
        return column in known or LOAD.fullmatch(column) is not None

    def _name_seat(self, name: str) -> Iterator[Event]:
        """Name the seat of the next readings; or of the last one, of which that was asked."""
        if len(name) > MAX_NAME or not name.isprintable():
            yield Event("refused", f"expected a name of at most {MAX_NAME} characters, got {name[:40]!a}")
        elif self._question and self._log is not None and name:
            self._question = ""
            self._log.name_seat(escape_formula(name))
            yield Event("notice", f"reading {self.n_readings} is in seat {name}", {"reading": self.n_readings})
            yield from self._learn()
        else:
            self.seat, self._question = name, ""
            yield Event("notice", f"seat {name}" if name else "no seat")

    def _steer(self, text: str) -> Iterator[Event]:
        """Move a virtual arm; nothing is said of it: one sees it move."""
        wanted, factors = typed_numbers(text), self.factors
        if self.source.steer is None:
            yield Event("refused", f"{self.source.name} cannot be steered: only a virtual arm can")
        elif len(wanted) != len(factors) or not len(wanted):
            yield Event("refused", f"expected {len(factors)} joint angles, got {text[:40]!a}")
        else:
            aim = wanted * factors
            self.source.steer(aim if self.arm is None else np.clip(aim, *self.arm.limits.T))

    def _learn(self) -> Iterator[Event]:
        """What the readings of the file say of the arm, or why that cannot be said: to undo one may mend it."""
        if self._learning is None:
            return
        if self._log is None or not self.n_readings:
            self._learning.forget()
            return
        try:
            with one_blas_thread():
                yield from self._learning.learn(self._log.session())
        except InputError as error:
            yield Event("notice", f"what the readings say of the arm is not known: {error}")

    def _next(self) -> Iterator[Event]:
        """What comes next."""
        if self.plan is None and not self.rank:
            return
        assert self._log is not None
        assert self.sample is not None  # the file is opened at the first
        done = {row.get("note_pose", "") for row in self._log.rows}
        with one_blas_thread():
            yield from self._poses.choose(done, self._learning, self._seat_now(), self.sample.joint_angles_rad)
        yield self._poses.event(None if self.aim_rad is None else self.displayed(self.aim_rad), self.units)


def _is_known(arm: Arm | None) -> TypeGuard[Arm]:
    return arm is not None and arm.has_kinematics


def _check_same(arm: Arm, of_model: Arm) -> None:
    """Refuse an arm with other kinematics than that of the model; base and tip may differ."""
    if kinematics_sha256(arm) != kinematics_sha256(of_model):
        raise InputError(
            f"the arm {arm.name!r} has other kinematics than the arm of the model, {of_model.name!r}",
            hint="give the model alone, which has its arm, or a model of this arm",
        )


def _is_finite(cell: str) -> bool:
    try:
        return isfinite(float(cell))
    except ValueError:
        return False


def _check_states(reading: TakenReading) -> None:
    """Refuse a temperature or a load that a session file could not have, by the same rules."""
    degC = None if reading.temperature_degC is None else np.array([reading.temperature_degC])
    columns = {name: np.array([value]) for name, value in reading.columns.items()}
    check_temperature(Session(reading.joint_angles_rad[None], temperature_degC=degC, columns=columns))
