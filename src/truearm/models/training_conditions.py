"""The conditions under which a model was trained, and which inputs of a session lie outside them.

The readings that it was fitted to are recognised in other files by what was measured: joint angles and reference.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from scipy.spatial import cKDTree

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.findings import Finding
from truearm.identification.judgement.expansion_prior import LAG_K
from truearm.identification.judgement.thermal_lag import TIME_CONSTANTS, lagging_temperatures, most_lag_K
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.readings.checks import MAX_SKIPPED_SHARE
from truearm.readings.lengths import Lengths
from truearm.readings.readings import DIRECTION, LOAD, PAYLOAD
from truearm.readings.repeats import LEAST_VALUES, MOST_OFF, merge_repeats, rounding_steps
from truearm.readings.session import Session
from truearm.readings.thermal_expansion import REFERENCE_DEGC, UNSTATED_U_K
from truearm.typing import BoolArray, FloatArray

# Copies of a reading differ by the rounding of their files [rad, mm]: 3 decimals of a degree, micrometres. A pose that
# is measured again has another reference point by more.
SAME_ANGLE, SAME_MM = 1e-5, 1e-3
# Coarser rounding of a copy, which its numbers show, is followed up to these steps [rad, mm]: 2 decimals of each.
COARSEST_ANGLE, COARSEST_MM = 2e-4, 0.011
# Repeats of a pose are nearer than this to their mean [rad, mm]; without any so near there is nothing to merge.
REPEAT_ANGLE, REPEAT_MM = 5e-4, 50.0
# Readings that are kept, evenly spaced in their order: of a fit 40 kB of a model file, of each refit ten times as many.
MOST_OF_FIT, MOST_OF_REFIT = 500, 5000
# Numbers of the reference: a point, a distance; 0 where none was measured.
N_OF_REFERENCE = 4


@dataclass(frozen=True, eq=False)
class KnownReadings:
    """What was measured at the readings from which a model learned.

    Attributes
    ----------
    numbers : (k, n_joints + 4) array
        Joint angles [rad, or mm], point and distance [mm], of the fit first.
    n_refit : int
        How many of them, the last, are of transfers to a new set-up.
    """

    numbers: FloatArray
    n_refit: int = 0

    def __post_init__(self) -> None:
        if self.numbers.ndim != 2 or not 0 <= self.n_refit <= len(self.numbers):
            raise InputError("expected known readings as rows of numbers, those of a refit among them")

    @classmethod
    def of(cls, readings: Session) -> Self:
        """Those of a fit."""
        return cls(_spaced(_numbers(readings), MOST_OF_FIT))

    @classmethod
    def after_refit(cls, before: KnownReadings | None, readings: Session) -> Self:
        """Those of before, if they are known, and of a transfer."""
        numbers, n_refit = _spaced(_numbers(readings), MOST_OF_REFIT), 0
        n_new = len(numbers)
        if before is not None:
            numbers, n_refit = np.concatenate([before.numbers, numbers]), before.n_refit
        return cls(numbers, n_refit + n_new)

    @property
    def n_of_fit(self) -> int:
        """How many readings of the fit are kept."""
        return len(self.numbers) - self.n_refit

    @property
    def of_refits(self) -> KnownReadings:
        """Those of transfers alone."""
        return KnownReadings(self.numbers[self.n_of_fit :], self.n_refit)

    def among(self, readings: Session, prismatic: BoolArray) -> BoolArray:
        """(n,) which readings are known, as they are or as one of the repeats that the fit merged into their mean."""
        slides = np.concatenate([prismatic, np.ones(N_OF_REFERENCE, dtype=bool)])
        numbers = _numbers(readings)
        if not self._near(numbers, np.where(slides, REPEAT_MM, REPEAT_ANGLE)).any():
            return np.zeros(len(readings), dtype=bool)
        known = self._have(numbers, slides)
        if not known.all() and len((merged := merge_repeats(readings)).readings) < len(readings):
            known |= self._have(_numbers(merged.readings), slides)[merged.member]
        return known

    def _have(self, numbers: FloatArray, slides: BoolArray) -> BoolArray:
        same = np.where(slides, SAME_MM, SAME_ANGLE)
        coarsest = np.where(slides, COARSEST_MM, COARSEST_ANGLE)
        known, near = self._near(numbers, same), self._near(numbers, coarsest)
        if (known == near).all():
            return known
        steps = rounding_steps(numbers, slides)  # takes longer, and seldom matters
        return self._near(numbers, np.maximum(same, np.where(steps <= coarsest, 0.51 * steps, 0.0)))

    def _near(self, numbers: FloatArray, tolerance: FloatArray) -> BoolArray:
        tree = cKDTree(self.numbers / tolerance)
        distance = np.asarray(tree.query(numbers / tolerance, p=np.inf, distance_upper_bound=1.0)[0])
        return np.asarray(distance <= 1)


def _numbers(readings: Session) -> FloatArray:
    out = np.zeros((len(readings), readings.n_joints + N_OF_REFERENCE))
    out[:, : readings.n_joints] = readings.angles
    if readings.points is not None:
        out[:, -4:-1] = np.nan_to_num(readings.points)
    if readings.distance_mm is not None:
        out[:, -1] = np.nan_to_num(readings.distance_mm)
    return out


def _spaced(numbers: FloatArray, most: int) -> FloatArray:
    rows = np.linspace(0, len(numbers) - 1, min(len(numbers), most)).round().astype(int)
    return np.asarray(numbers[rows])


# An angle this near to a training angle counts as a training angle [rad; of a sliding joint as a share of its range]:
# a gear's errors of order 80 change by a quarter of their period in 1.1 degrees.
LEAST_TURN = float(np.radians(1.0))
LEAST_SLIDE = 0.01
TOGETHER = "joints together"
"""Name of `TrainingConditions.outside` for poses whose joints are each inside but together far from all training."""
USUAL_SHARE = 0.99
# A sample this small has no usual distance.
LEAST_SAMPLE = 20
# Consecutive readings of which one is compared with the sample first.
STRIDE = 16
LEAST_TRAVEL_MM = 1.0
# Angles of joints without limits may be this far outside the trained ones [rad]: ten turns. Degrees read as radians are
# more, from 63 degrees on.
MAX_FURTHER_ANGLE = 20 * np.pi
# Angles are rounded if as many of `LEAST_VALUES` or more are within `MOST_OFF` of whole steps: of exact ones, where one
# joint is rounded, a fifth are.
ROUNDED_SHARE = 0.95
# Training readings that are kept: ten a constant of a six-axis arm, 24 kB of a model file.
MAX_SAMPLE = 500


@dataclass(frozen=True)
class InputRange:
    """One number per reading (a temperature, a load) over the training readings.

    Attributes
    ----------
    mean, variance : float
        In the unit of the number, and its square.
    lower, upper : float
        Smallest and largest value.
    """

    mean: float
    variance: float
    lower: float
    upper: float

    def __post_init__(self) -> None:
        if not (self.lower <= self.upper and self.variance >= 0):
            raise InputError("expected a range whose lower end is not above its upper end, and a variance of 0 or more")

    @classmethod
    def of(cls, values: FloatArray) -> Self:
        """Range of values (n,)."""
        return cls(float(values.mean()), float(values.var()), float(values.min()), float(values.max()))

    @property
    def std(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(self.variance))

    def distance(self, values: FloatArray) -> FloatArray:
        """(n,) distances of values (n,) from the range; 0 inside."""
        return np.maximum(np.maximum(values - self.upper, self.lower - values), 0.0)


@dataclass(frozen=True, eq=False)
class TrainingConditions:
    """A summary of the readings from which a model learned: their number, joint angles, temperatures and loads.

    Attributes
    ----------
    n_readings : int
    angle_ranges : (n_joints, 2) array
        Smallest and largest angle of every joint [rad, or mm].
    angle_gaps : (k, 3) array
        Wide gaps between the angles: joint (counted from 0), lower and upper end (see `find_angle_gaps`).
    temperature_degC : InputRange, optional
        None where the readings state no temperature.
    columns : dict of str to InputRange
        Further columns of numbers, such as loads, by names as a session has them.
    has_directions : bool
        Whether the readings state the joints' directions of movement.
    fingerprint : str
        SHA-256 of the readings from which the model was fitted last, by `fit` or by a transfer (see `fingerprint`).
    lengths_fingerprint : str
        SHA-256 of the known lengths between their seats; empty without.
    angle_sample : (k, n_joints) array, optional
        Angles of training readings, at most `MAX_SAMPLE`, evenly spaced in their order [rad, or mm]; None in files of
        models that were trained before it was kept.
    direction_ranges : (n_joints, 2) array, optional
        Smallest and largest direction of movement of every joint; None where the readings state none, and in files of
        models that were trained before they were kept.
    slow_links_degC : InputRange, optional
        Temperatures of links that follow slowly, where the air drifted faster than they do; None where it did not.
    angle_std : (n_joints,) array, optional
        Standard uncertainty of the training angles by rounding, where the readings show it [rad, or mm].
    sessions : tuple of str
        Names of the sessions of the readings from which the model was fitted last; empty where one has none, and in
        files of models that were trained before they were kept.
    known : KnownReadings, optional
        What was measured at the readings of the fit and of transfers; None in files of models that were trained before
        it was kept.
    """

    # A temperature this far outside the trained ones is not reported [K]: thermometers on an arm agree to about this.
    temperature_tolerance_K: ClassVar[float] = 1.0
    # Turns of a joint that are looked at.
    most_turns: ClassVar[int] = 20
    # Few angles are rounded if they are off whole steps by this share of one, as two in a hundred of exact ones are.
    most_off_alone: ClassVar[float] = 0.01
    n_readings: int
    angle_ranges: FloatArray
    angle_gaps: FloatArray
    temperature_degC: InputRange | None
    columns: dict[str, InputRange]
    has_directions: bool
    fingerprint: str
    lengths_fingerprint: str
    angle_sample: FloatArray | None = None
    direction_ranges: FloatArray | None = None
    slow_links_degC: InputRange | None = None
    angle_std: FloatArray | None = None
    sessions: tuple[str, ...] = ()
    known: KnownReadings | None = None

    def __post_init__(self) -> None:
        n_joints, gaps = len(self.angle_ranges), self.angle_gaps
        if self.n_readings < 1 or self.angle_ranges.shape != (n_joints, 2) or gaps.shape != (len(gaps), 3):
            raise InputError("expected one reading or more, a range of every joint, and gaps as joint, begin and end")
        if not (self.angle_ranges[:, 0] <= self.angle_ranges[:, 1]).all() or not (gaps[:, 1] < gaps[:, 2]).all():
            raise InputError("expected ranges and gaps of training angles that begin before they end")
        if bad := [name for name in self.columns if not LOAD.fullmatch(name)]:
            raise InputError(f"expected names of further columns such as load_1_Nm, got {bad[0][:40]!r}")
        sample = self.angle_sample
        if sample is not None and not (
            sample.ndim == 2 and 1 <= len(sample) <= MAX_SAMPLE and sample.shape[1] == n_joints
        ):
            raise InputError(f"expected 1 to {MAX_SAMPLE} training readings as a sample of {n_joints} angles")
        directions = self.direction_ranges
        if directions is not None and (
            directions.shape != (n_joints, 2) or not (directions[:, 0] <= directions[:, 1]).all()
        ):
            raise InputError(f"expected ranges of {n_joints} directions of movement that begin before they end")
        std = self.angle_std
        if std is not None and not (std.shape == (n_joints,) and (std >= 0).all()):
            raise InputError(f"expected {n_joints} uncertainties of angles of 0 or more")
        if not np.isin(gaps[:, 0], np.arange(n_joints)).all():
            raise InputError(f"expected gaps of joints 0 to {n_joints - 1}")

    @classmethod
    def of(cls, session: Session, prismatic: BoolArray, lengths: Lengths | None = None) -> Self:
        """Conditions of a session of an arm whose joints slide where `prismatic` (n_joints,) is True."""
        n, temperature = len(session), session.temperature_degC
        return cls(
            n_readings=n,
            angle_ranges=np.stack([session.angles.min(axis=0), session.angles.max(axis=0)], axis=1),
            angle_gaps=find_angle_gaps(session.angles, prismatic),
            angle_sample=session.angles[np.linspace(0, n - 1, min(n, MAX_SAMPLE)).round().astype(int)],
            temperature_degC=None if temperature is None else InputRange.of(temperature),
            columns={name: InputRange.of(values) for name, values in session.columns.items()},
            has_directions=session.directions is not None,
            fingerprint=fingerprint(session),
            lengths_fingerprint="" if lengths is None else fingerprint(lengths),
            direction_ranges=None
            if session.directions is None
            else np.stack([session.directions.min(axis=0), session.directions.max(axis=0)], axis=1),
            slow_links_degC=_slow_links(session),
            sessions=session_names(session),
            known=KnownReadings.of(session),
        )

    def after_transfer(self, session: Session, lengths: Lengths | None) -> TrainingConditions:
        """Conditions after base and tip were identified from another session.

        What the arm's terms learned keeps its ranges. Readings without a temperature or a load are expected to be those
        of the new set-up, so its mean replaces the one before. Where the arm was fitted without a temperature, the
        session's temperatures are the only ones known.
        """
        temperature = self.temperature_degC
        if session.temperature_degC is not None:
            new = InputRange.of(session.temperature_degC)
            temperature = new if temperature is None else replace(temperature, mean=new.mean)
        columns = {
            name: replace(known, mean=float(session.columns[name].mean())) if name in session.columns else known
            for name, known in self.columns.items()
        }
        return replace(
            self,
            temperature_degC=temperature,
            columns=columns,
            sessions=session_names(session),
            fingerprint=fingerprint(session),
            lengths_fingerprint="" if lengths is None else fingerprint(lengths),
            known=KnownReadings.after_refit(self.known, session),
        )

    def conditions_of(self, session: Session) -> Conditions | None:
        """The conditions of readings: repeatability in a session of the training, reproducibility in another.

        A session is a day in one set-up: base and reference unmoved. None where either does not name its sessions.
        """
        names = session_names(session)
        if not names or not self.sessions:
            return None
        return "repeatability" if set(names) <= set(self.sessions) else "reproducibility"

    def outside(self, session: Session, prismatic: BoolArray) -> dict[str, BoolArray]:
        """Inputs of a session outside the trained range.

        A revolute joint that is counted on by a full turn is where it was. Each joint may be inside its range while all
        of them together are far from every training reading: farther than 99 of 100 poses of those are from each
        other, and than a degree.

        Parameters
        ----------
        session : Session
        prismatic : (n_joints,) bool array
            Which joints slide.

        Returns
        -------
        dict of str to (n,) bool array
            By input (``J1`` to ``Jn``, ``joints together``, ``temperature``, ``direction_1`` to ``direction_n``, the
            name of a further column) True at the readings whose value lies outside the range in training or in one of
            its gaps. Inputs that lie inside at all readings are not in it, nor are those that training or session do
            not state; a temperature that the training does not state is assumed near 20 degC (`temperature_range`),
            and its payload zero (`ignores_payload`).
        """
        outside = ~self.inside_by_joint(session.angles, prismatic)
        found = {f"J{joint}": column for joint, column in enumerate(outside.T, 1)}
        found[TOGETHER] = ~outside.any(axis=1) & self._is_far(session.angles, prismatic)
        found["temperature"] = self.kelvin_outside(session) > self.temperature_tolerance_K
        if self.ignores_payload(session):
            found[PAYLOAD] = session.columns[PAYLOAD] > 0
        for name, known in self.columns.items():
            if name in session.columns:
                found[name] = known.distance(session.columns[name]) > 0
        if session.directions is not None and self.direction_ranges is not None:
            signs, (lower, upper) = session.directions, self.direction_ranges.T
            # A direction that is not known (0) has its own uncertainty.
            beyond = ((signs < lower) | (signs > upper)) & (signs != 0) & (lower == upper) & (lower != 0)
            found |= {f"{DIRECTION}{joint}": column for joint, column in enumerate(beyond.T, 1)}
        return {name: rows for name, rows in found.items() if rows.any()}

    def poses_outside(self, angles: FloatArray, prismatic: BoolArray) -> BoolArray:
        """(n,) whether angles (n, n_joints) are outside, each joint alone or all together."""
        inside = np.asarray(self.inside_by_joint(angles, prismatic).all(axis=1))
        return ~inside | self._is_far(angles, prismatic)

    def ignores_payload(self, session: Session) -> bool:
        """Whether a session states a payload and the training stated none: the model has no term of it."""
        return PAYLOAD not in self.columns and bool(session.columns.get(PAYLOAD, np.zeros(0)).any())

    def among(self, readings: Session, prismatic: BoolArray) -> BoolArray:
        """(n,) which readings the model was fitted to; of older files all, if they are the very same, or none."""
        if self.known is None:
            same = self.fingerprint in (fingerprint(readings), fingerprint(merge_repeats(readings).readings))
            return np.full(len(readings), same)
        return self.known.among(readings, prismatic)

    def all_among(self, readings: Session, prismatic: BoolArray) -> BoolArray:
        """(n,) the same, of a fit of which but a sample is known those of transfers alone."""
        if self.known is None or self.readings_per_known == 1:
            return self.among(readings, prismatic)
        return self.known.of_refits.among(readings, prismatic)

    def still_joints(self, chain: Chain) -> Iterator[Finding]:
        """Joints that moved too little in the training for their own errors to be identified."""
        for joint, travel in enumerate(np.ptp(self.angle_ranges, axis=1)):
            slides = chain.is_prismatic[joint]
            if travel >= (LEAST_TRAVEL_MM if slides else LEAST_TURN) or not chain.is_read[joint]:
                continue
            least = f"{LEAST_TRAVEL_MM:g} mm" if slides else f"{np.degrees(LEAST_TURN):.0f} degree"
            said = (
                f"J{joint + 1} moves by less than {least} (if it did move, its column is wrong): its own errors are "
                "not identified, and points with it elsewhere are as uncertain as the drawing."
            )
            yield Finding("still joint", said, {"joint": joint + 1, "travel": float(travel)})

    @property
    def readings_per_known(self) -> float:
        """Readings of the fit for each that can be recognised: 1 where all of them are kept."""
        return 1.0 if self.known is None or not self.known.n_of_fit else self.n_readings / self.known.n_of_fit

    def is_rounded(self, angles: FloatArray) -> BoolArray:
        """(n,) whether angles (n, n_joints) are whole steps from those of the training, which were rounded to them.

        Many are judged together, a few one by one.
        """
        if self.angle_std is None or self.angle_sample is None:
            return np.zeros(len(angles), dtype=bool)
        rounded = self.angle_std > 0
        steps = (angles - self.angle_sample[0])[:, rounded] / (np.sqrt(12) * self.angle_std[rounded])
        off = np.abs(steps - np.round(steps)).max(axis=1)
        if len(angles) < LEAST_VALUES:
            return np.asarray(off < self.most_off_alone)
        return np.full(len(angles), (off < MOST_OFF).mean() >= ROUNDED_SHARE)

    def refuse_far(self, readings: Session, prismatic: BoolArray) -> None:
        """Refuse a session of which many joints are ten turns or more outside the trained range: degrees, as a rule.

        Raises
        ------
        InputError
        """
        excess = np.abs(readings.angles) - self._largest_angles
        far = (excess > MAX_FURTHER_ANGLE) & ~prismatic
        if far.any() and far.any(axis=1).mean() > MAX_SKIPPED_SHARE:
            row, joint = (int(i) for i in np.argwhere(far)[0])
            readings.contradict(
                f"J{joint + 1} is at {readings.angles[row, joint]:.4g} rad, ten turns outside the trained range",
                row,
                column=None if readings.angle_columns is None else readings.angle_columns[joint],
                hint="check the unit of the angles: radians, not degrees",
            )

    @cached_property
    def _largest_angles(self) -> FloatArray:
        """(n_joints,) largest magnitudes of the training angles."""
        return np.asarray(np.abs(self.angle_ranges).max(axis=1))

    def inside_by_joint(self, angles: FloatArray, prismatic: BoolArray) -> BoolArray:
        """(n, n_joints) whether an angle, or one some full turns from it, is in the range and in none of its gaps.

        An end of the range is inside with its rounding: a training angle that is calculated again may be beyond it.
        """
        inside = self._are_in_range(angles)
        if inside.all():
            return inside
        lower, upper = self.angle_ranges.T
        start = lower - Session.limit_tolerance
        first = start + np.mod(angles - start, 2 * np.pi)
        turns = np.where(prismatic, -1, np.minimum((upper - lower) // (2 * np.pi), self.most_turns))
        for k in range(int(turns.max()) + 1):
            inside |= (k <= turns) & self._are_in_range(first + 2 * np.pi * k)
        return inside

    def _are_in_range(self, angles: FloatArray) -> BoolArray:
        """(n, n_joints) whether an angle, as it is counted, is in the range and in none of its gaps."""
        lower, upper = self.angle_ranges.T
        found = (angles >= lower - Session.limit_tolerance) & (angles <= upper + Session.limit_tolerance)
        for joint in set(self.angle_gaps[:, 0].astype(int).tolist()):
            gaps, at = self.angle_gaps[self.angle_gaps[:, 0] == joint, 1:], angles[:, joint, None]
            found[:, joint] &= ~((at > gaps[:, 0]) & (at < gaps[:, 1])).any(axis=1)
        return np.asarray(found)

    def _is_far(self, angles: FloatArray, prismatic: BoolArray) -> BoolArray:
        """(n,) whether angles are farther from every training reading of the sample than those are from each other.

        Consecutive readings are near each other: what every `STRIDE`-th one keeps from the sample decides most others.
        """
        far, (tree, limit) = np.zeros(len(angles), dtype=bool), self._sample_of(prismatic)
        if tree is None or np.isinf(limit) or angles.shape[1] < 2:
            return far
        around = self._around(angles, prismatic)
        if len(angles) < STRIDE:
            return np.asarray(tree.query(around, distance_upper_bound=limit)[0] > limit)
        probe = np.arange(len(angles)) // STRIDE
        distance = np.asarray(tree.query(around[::STRIDE])[0])[probe]
        moved = np.linalg.norm(around - around[::STRIDE][probe], axis=1)
        far = np.asarray(distance - moved > limit)
        open_ = np.flatnonzero(~far & (distance + moved > limit))
        far[open_] = tree.query(around[open_], distance_upper_bound=limit)[0] > limit
        return far

    def _sample_of(self, prismatic: BoolArray) -> tuple[cKDTree | None, float]:
        """Where the training poses of the sample are, and the distance that they keep; prepared once."""
        known, key = self._samples, prismatic.tobytes()
        if key not in known:
            sample = self.angle_sample
            known[key] = None if sample is None else cKDTree(self._around(sample, prismatic)), self._usual(prismatic)
        return known[key]

    @cached_property
    def _samples(self) -> dict[bytes, tuple[cKDTree | None, float]]:
        return {}

    def _usual(self, prismatic: BoolArray) -> float:
        """The distance from the nearest other one that 99 of 100 training poses of the sample keep; infinite of few."""
        if self.angle_sample is None:
            return np.inf
        around = self._around(self.angle_sample, prismatic)
        # A pose that was read several times is one: its nearest other pose is no repeat.
        poses = around[np.unique(np.round(around / LEAST_TURN), axis=0, return_index=True)[1]]
        if len(poses) < LEAST_SAMPLE:
            return np.inf
        nearest = np.asarray(cKDTree(poses).query(poses, k=2)[0], dtype=float)[:, 1]
        return max(float(np.quantile(nearest, USUAL_SHARE)), LEAST_TURN)

    def _around(self, angles: FloatArray, prismatic: BoolArray) -> FloatArray:
        """(n, ..) coordinates with distances between poses: on circles for joints that turn, 2 for the whole travel."""
        travel = np.maximum(np.ptp(self.angle_ranges, axis=1), LEAST_TRAVEL_MM)
        turning, sliding = angles[:, ~prismatic], 2 * (angles / travel)[:, prismatic]
        return np.hstack([np.cos(turning), np.sin(turning), sliding])

    def with_nearest(self, session: Session, name: str) -> Session:
        """The session with an input of `outside` other than an angle at the nearest value of the training."""
        if name == "temperature":
            assert session.temperature_degC is not None
            known = self.temperature_range
            return replace(session, temperature_degC=np.clip(session.temperature_degC, known.lower, known.upper))
        if name in self.columns:
            known = self.columns[name]
            nearest = np.clip(session.columns[name], known.lower, known.upper)
            return replace(session, columns={**session.columns, name: nearest})
        if name == PAYLOAD:
            return replace(session, columns={k: values for k, values in session.columns.items() if k != PAYLOAD})
        assert session.directions is not None
        assert self.direction_ranges is not None
        directions, joint = session.directions.copy(), int(name.removeprefix(DIRECTION)) - 1
        directions[:, joint] = np.clip(directions[:, joint], *self.direction_ranges[joint])
        return replace(session, directions=directions)

    @property
    def temperature_range(self) -> InputRange:
        """Temperatures of the training; without any 20 degC, as far as thermometers agree."""
        if self.temperature_degC is not None:
            return self.temperature_degC
        lower, upper = REFERENCE_DEGC - self.temperature_tolerance_K, REFERENCE_DEGC + self.temperature_tolerance_K
        return InputRange(REFERENCE_DEGC, UNSTATED_U_K**2, lower, upper)

    def kelvin_outside(self, session: Session) -> FloatArray:
        """(n,) distances of the session's temperatures from `temperature_range` [K]; 0 where it states none."""
        if session.temperature_degC is None:
            return np.zeros(len(session))
        return self.temperature_range.distance(session.temperature_degC)

    @property
    def links_range(self) -> InputRange:
        """Temperatures that all links had in training: they may lag behind the thermometer."""
        return self.temperature_range if self.slow_links_degC is None else self.slow_links_degC

    def kelvin_beyond_links(self, session: Session) -> FloatArray:
        """(n,) the same from `links_range` [K]."""
        if session.temperature_degC is None:
            return np.zeros(len(session))
        return self.links_range.distance(session.temperature_degC)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingReadings(PreparedReadings):
    """Readings that a model learns from.

    Attributes
    ----------
    conditions : TrainingConditions
    """

    conditions: TrainingConditions

    @classmethod
    def of(cls, arm: Arm, readings: Session, lengths: Lengths | None, *, free: tuple[str, ...], robust: bool) -> Self:
        """See `PreparedReadings.of`."""
        prepared = PreparedReadings.of(arm, readings, lengths, free=free, robust=robust)
        conditions = TrainingConditions.of(readings, arm.chain.is_prismatic, prepared.lengths)
        return cls(**vars(prepared), conditions=conditions)


def find_angle_gaps(angles: FloatArray, prismatic: BoolArray) -> FloatArray:
    """Gaps between a joint's training angles that are wide for their number.

    Of n angles drawn evenly from a range, the largest gap is about ``range * ln(n) / n``. A gap counts from three times
    that on; an angle within half as much of a training angle is not in it.

    Parameters
    ----------
    angles : (n, n_joints) array
        [rad, or mm].
    prismatic : (n_joints,) bool array
        Which joints slide.

    Returns
    -------
    (k, 3) array
        Joint, counted from 0, and where its gap begins and ends [rad, or mm].
    """
    gaps = [np.zeros((0, 3))]
    n = len(angles)
    for joint, slides in enumerate(prismatic):
        values = np.unique(angles[:, joint])
        span = float(values[-1] - values[0])
        near = max(LEAST_SLIDE * span if slides else LEAST_TURN, 1.5 * span * np.log(n) / n)
        wide = np.flatnonzero(np.diff(values) > 2 * near)
        gaps.append(np.stack([np.full(len(wide), float(joint)), values[wide] + near, values[wide + 1] - near], axis=1))
    return np.concatenate(gaps)


def session_names(session: Session) -> tuple[str, ...]:
    """Names of the sessions of readings; none where a reading names none."""
    names = () if session.session is None else tuple(np.unique(session.session).tolist())
    return () if "" in names else names


def _slow_links(session: Session) -> InputRange | None:
    """Temperatures of the slowest links, if they may have lagged far behind the thermometer."""
    degC = session.temperature_degC
    if degC is None or most_lag_K(degC, session.session, session.stride) <= LAG_K:
        return None
    return InputRange.of(lagging_temperatures(degC, TIME_CONSTANTS[-1:], session.session, session.stride)[:, 0])


def fingerprint(data: Session | Lengths) -> str:
    """SHA-256 of all columns of a session, or of lengths.

    Columns in the order of their names, each with its name and its shape before it; numbers as little-endian doubles,
    row by row, names of things as UTF-8 with a zero byte after each.
    """
    columns: dict[str, Any] = {field.name: getattr(data, field.name) for field in fields(data)}
    further: Mapping[str, FloatArray] = columns.pop("columns", {})
    digest = hashlib.sha256()
    for name, values in sorted({**columns, **further}.items()):
        # Neither a line nor the number of its repeats says what was measured.
        if not isinstance(values, np.ndarray) or name in ("numbers", "n_repeats"):
            continue
        digest.update(f"{name} {values.shape}\0".encode())
        if values.dtype.kind == "U":
            digest.update("\0".join([*values.tolist(), ""]).encode())
        else:
            settled = np.where(np.isnan(values), np.nan, values) + 0.0  # one NaN and one zero of the many there are
            digest.update(np.ascontiguousarray(settled, dtype="<f8").tobytes())
    return digest.hexdigest()
