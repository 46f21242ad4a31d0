"""An arm without a drawing, from the circles of its joints (circle point analysis), and the file to measure them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from truearm.acceptance import acceptance_remarks, accepts
from truearm.arm import Arm, Chain, DHTable, drawn_table, nearest_table, write_arm
from truearm.arm.denavit_hartenberg import COLUMNS
from truearm.arm.rigid_motions import screw_z
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.files.atomic_write import check_new_file
from truearm.findings import format_mm
from truearm.models.arm_check import arm_of_readings
from truearm.readings import Session, serial_number_of
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray
from truearm.verbs.inputs import SessionLike, to_session, unfilled_rows
from truearm.verbs.record import TableRecord, TextTable, format_fixed, number_of
from truearm.wings.planning.circles import (
    LEAST_POINTS,
    LEAST_RADIUS_MM,
    MAX_DIRECTION_STD,
    Axes,
    EstimatedAxes,
    JointCircle,
    estimate_axes,
    joint_circles,
    radius_needed,
    uncertain_directions,
)
from truearm.wings.planning.designs.template import write_aims

# Round values that drawings have: of angles multiples of 90 deg, of lengths 0. They are named within so many standard
# uncertainties, and never put in place of what was measured.
ROUND_DEG, COVERAGE = 90.0, 2.0
# A gain that differs from 1 by more standard uncertainties is said, and by more than this share besides, refused: over
# part of a turn, errors of a printed joint that vary with its angle look like some percent.
SAID_GAIN_STDS, MAX_GAIN_ERROR = 5.0, 0.1
LEAST_SAID_GAIN = 1e-3
LEAST_ARC_PLANNED = 10.0
# Standard uncertainties of directions whose radius a plan says, the first in its file; and longer spans.
PLANNED_DEG, DIRECTIONS_DEG, SPANS_DEG = 2.0, (0.5, 1.0, 2.0), (90.0, 120.0, 180.0)
# Of planned angles in JSON [deg].
PLANNED_DECIMALS = 9
MAX_DIRECTION_DEG = float(np.degrees(MAX_DIRECTION_STD))
# Of lengths that are zero by convention.
ROUNDING_MM = 1e-9
# Tilt and shift of an axis that was not measured, to see what depends on it, and what counts as dependence [rad, mm].
TRIED_TILT_RAD, TRIED_SHIFT_MM, DEPENDS = 0.03, 10.0, 1e-6
_NAMES = [name.partition("_")[0] for name in COLUMNS]


@one_blas_thread()
@accepts
def arm_from_circles(
    session: SessionLike, *, name: str = "my-arm", convention: Convention = "dh", accept: str | None = None
) -> CircleArm:
    """Measure an arm without a drawing: the axes of its joints from the circles that they describe one by one.

    Parameters
    ----------
    session : Session, DataFrame, str or Path
        Points of one target on the last link while each joint in turn moves alone: five or more of each, better 12 over
        60 deg and more, in any order. The other joints may stand anywhere, and a circle may be repeated elsewhere.
    name : str
        Of the arm.
    convention : {"dh", "mdh"}
        Of the table of constants.
    accept : str, optional
        Why a joint's angles are right where its circle contradicts them: kept in the source of the arm.

    Returns
    -------
    CircleArm

    Raises
    ------
    InputError
        If no circle shows the axis of a joint; if a joint turns by more or less than its angles.

    Examples
    --------
    >>> import numpy as np
    >>> import truearm as ta
    >>> arm, turns = ta.load_arm("ur10"), np.radians(np.linspace(-40, 40, 12))
    >>> angles = np.tile(arm.working, (72, 1))
    >>> for joint in range(6):
    ...     angles[12 * joint : 12 * joint + 12, joint] += turns
    >>> points = arm.chain.tip_in_base(angles) + arm.forward(angles).R_base_tip @ [100.0, 0.0, 50.0]
    >>> measured = ta.arm_from_circles(ta.Session(angles, points))
    >>> [round(abs(length)) for length in measured.table.a.tolist()]
    [0, 612, 572, 0, 0, 0]
    """
    given = to_session(session)
    slides = arm_of_readings(given).chain.is_prismatic
    found = joint_circles(given, slides)
    circles, estimated = found.circles, estimate_axes(given, found, slides)
    remarks = [*acceptance_remarks(accept), *map(str, unfilled_rows(given)), *_judge_gains(given, estimated)]
    faults = found.failed | uncertain_directions(given, circles, estimated)
    if len(faults) == given.n_joints:
        raise faults[min(faults)]
    failed = {joint: f"{fault.problem}: {fault.hint}" for joint, fault in sorted(faults.items())}
    table = _own_frames(drawn_table(estimated.axes.chain(), convention))
    std, is_base_measured = _uncertainty(estimated, convention), True
    if failed:
        depends, is_base_measured = _depends_on(failed, estimated.axes, convention)
        std = np.where(depends, np.nan, std)
    n_points = len(np.unique(np.concatenate([circle.rows for circle in circles])))
    at_joint_1 = replace(table, base=np.eye(4))
    arm = Arm(
        name,
        at_joint_1.chain(),
        title="measured by the circles of its joints" + _but(failed, std, is_base_measured=is_base_measured),
        working_pose=estimated.axes.pose,
        source="; ".join([_source(given, n_points, len(circles), estimated), *acceptance_remarks(accept)]),
        serial_number=serial_number_of(given),
        table=at_joint_1,
    )
    if unused := len(given) - n_points:
        remarks.append(f"{number_of(unused)} in no circle, ignored.")
    return CircleArm(arm, table, std, circles, estimated, failed, n_points, tuple(remarks), is_base_measured)


def _but(failed: Collection[int], std: FloatArray, *, is_base_measured: bool) -> str:
    """What a title says of joints, tip and base that were not measured."""
    names = [f"J{joint + 1}" for joint in failed]
    names += ["tip"] * bool(np.isnan(std[-3:]).any()) + ["base frame"] * (not is_base_measured)
    return f"; {', '.join(names)} not measured" if names else ""


def _source(given: Session, n_points: int, n_circles: int, estimated: EstimatedAxes) -> str:
    file = "" if given.file is None else f" of {given.file.name}"
    return (
        f"circle point analysis{file}: {n_points} points, {number_of(n_circles, 'circle')}, residual standard "
        f"deviation {estimated.residual_std_mm:.3g} mm"
    )


def _own_frames(table: DHTable) -> DHTable:
    """The table from joint 1's own frame, and without a flange, whose orientation shows in no point."""
    flange, theta, d = table.flange, table.theta.copy(), np.where(np.abs(table.d) < ROUNDING_MM, 0.0, table.d)
    base = table.base @ screw_z(theta[0], d[0])
    theta[0] = d[0] = 0.0
    tip = flange[:3, :3] @ table.tip_in_flange + flange[:3, 3]
    return replace(table, base=base, theta=theta, d=d, flange=np.eye(4), tip_in_flange=tip)


def _uncertainty(estimated: EstimatedAxes, convention: Convention) -> FloatArray:
    """(6 n_joints + 3,) standard uncertainties of `constants_of`, to first order by central differences."""
    axes, nominal = estimated.axes, estimated.axes.chain()

    def constants(step: FloatArray) -> FloatArray:
        return constants_of(nearest_table(axes.moved(step).chain(), nominal, convention=convention))

    # Steps of a standard uncertainty: there the constants are linear, or the uncertainty is of no use.
    std = np.sqrt(estimated.covariance.diagonal())
    steps = np.diag(np.maximum(0.1 * std, 1e-7))
    jacobian = np.stack([(constants(h) - constants(-h)) / (2 * h.sum()) for h in steps], axis=1)
    variance = np.einsum("ip,pq,iq->i", jacobian, estimated.covariance, jacobian)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _depends_on(joints: Collection[int], axes: Axes, convention: Convention) -> tuple[BoolArray, bool]:
    """Which of `constants_of` depend on the axes of these joints, and whether the base frame does not.

    The axes are tilted and shifted by steps without symmetry: a first derivative may vanish where an axis is assumed.
    """
    free = replace(axes, is_measured=np.isin(np.arange(len(axes.pose)), list(joints)))
    nominal = axes.chain()
    sizes = np.array([TRIED_TILT_RAD, TRIED_TILT_RAD, TRIED_SHIFT_MM, TRIED_SHIFT_MM])
    step = np.concatenate([np.zeros(3), *(sizes[:n] for n in free.n_own[::-1].tolist())])
    step *= np.random.default_rng(0).uniform(0.3, 1.0, len(step))
    as_assumed, moved = (nearest_table(one.chain(), nominal, convention=convention) for one in (axes, free.moved(step)))
    depends = np.abs(constants_of(moved) - constants_of(as_assumed)) > DEPENDS
    columns = depends[: 6 * len(axes.pose)].reshape(len(COLUMNS), -1)
    # Whether the axes are parallel, so that there are a beta and a b, is not known either.
    columns[[_NAMES.index("beta"), _NAMES.index("b")]] |= columns[_NAMES.index("alpha")]
    return depends, bool(np.abs(moved.base - as_assumed.base).max() <= DEPENDS)


def constants_of(table: DHTable) -> FloatArray:
    """(6 n_joints + 3,) the columns of a table one after the other [mm, rad], and the tip in the last joint's frame."""
    flange = table.flange
    tip = flange[:3, :3] @ table.tip_in_flange + flange[:3, 3]
    return np.concatenate([*(getattr(table, name) for name in _NAMES), tip])


def _judge_gains(session: Session, estimated: EstimatedAxes) -> Iterator[str]:
    """Say by how much joints turn more or less than their angles; refuse what no encoder errs by."""
    off = estimated.gains - 1
    sure = np.abs(off) > SAID_GAIN_STDS * estimated.gain_std
    for joint in np.argsort(-np.abs(off) / np.maximum(estimated.gain_std, 1e-12)):
        if not sure[joint] or abs(off[joint]) < LEAST_SAID_GAIN:
            continue
        said = (
            f"J{joint + 1} moves by {estimated.gains[joint]:.4g} times its angles (standard uncertainty "
            f"{estimated.gain_std[joint]:.1g})"
        )
        if abs(off[joint]) > MAX_GAIN_ERROR:
            session.contradict(
                f"{said}: its angles are in another unit, count other turns, or are those of another joint",
                column=None if session.angle_columns is None else session.angle_columns[joint],
                hint="truearm import --angle-unit, or a gain of the joint; see docs/describe-your-arm.md",
            )
        yield f"{said}: the gain of an encoder, a unit, or a joint that pulls another along."
        return  # the others follow from the first


@dataclass(frozen=True, eq=False, repr=False)
class CircleArm(TableRecord):
    """An arm measured by the circles of its joints.

    Attributes
    ----------
    arm : Arm
        Its base frame is that of joint 1: z along its axis, x where its angle is zero. Its tip is the target.
    table : DHTable
        Its constants; `base` is the place of joint 1 in the frame of the instrument.
    std : (6 n_joints + 3,) array
        Standard uncertainties of the columns a, d, alpha, theta, beta, b one after the other [mm, rad] and of the tip
        in the last joint's frame; 0 of what is a convention, NaN of what was not measured.
    circles : tuple of JointCircle
    estimated : EstimatedAxes
        The axes in one pose, in the frame of the instrument, with their covariance.
    failed : dict of int to str
        Joints, counted from 0, whose circles do not show their axes: why, and what to do. The file has them through
        the target, across the axis before, or as they are seen; it marks them, and all constants that depend on them.
    n_points : int
    remarks : tuple of str
    is_base_measured : bool
        Whether the base frame depends on measured axes alone.
    """

    arm: Arm
    table: DHTable
    std: FloatArray
    circles: tuple[JointCircle, ...]
    estimated: EstimatedAxes
    failed: Mapping[int, str]
    n_points: int
    remarks: tuple[str, ...]
    is_base_measured: bool = True

    def u(self, column: str) -> FloatArray:
        """(n_joints,) standard uncertainties of a column of the table, a, d, alpha, .. [mm, or rad]."""
        n, at = self.arm.n_joints, _NAMES.index(column)
        return self.std[n * at : n * (at + 1)]

    def _u_columns(self) -> dict[str, FloatArray]:
        """The same of every column [mm, or deg] under the names of an arm file: a_mm, .., alpha_deg, .."""
        parts = zip(COLUMNS, map(self.u, _NAMES), strict=True)
        return {name: np.degrees(part) if name.endswith("deg") else part for name, part in parts}

    @property
    def tip_std(self) -> FloatArray:
        """(3,) standard uncertainties of the tip in the last joint's frame [mm]."""
        return self.std[6 * self.arm.n_joints :]

    def _not_measured(self) -> dict[str, str]:
        """The constants that were not measured, such as ``"d, theta"``, by joint, and the tip's and the base's."""
        u, shown = self._u_columns(), self.table.used_columns()
        found = {}
        for i, joint in enumerate(self.arm.joint_names):
            if names := [name.partition("_")[0] for name in shown if np.isnan(u[name][i])]:
                found[joint] = ", ".join(names)
        if np.isnan(self.tip_std).any():
            found["tip"] = "the tip"
        if not self.is_base_measured:
            found["base"] = "the base frame"
        return found

    def _failed_names(self) -> str:
        return " and ".join(self.arm.joint_names[joint] for joint in self.failed)

    def save(self, path: str | Path) -> None:
        """Write the arm file, .toml or .urdf (see docs/arm-file.md)."""
        why = f"not measured, as {self._failed_names()} is not"
        notes = {name: f"{what}: {why}" for name, what in self._not_measured().items()}
        notes |= {self.arm.joint_names[joint]: f"not measured: {reason}" for joint, reason in self.failed.items()}
        write_arm(self.arm, path, convention=self.table.convention, notes=notes)

    def summary(self) -> str:
        """The answer in one sentence."""
        n = self.arm.n_joints
        joints = number_of(n, "joint") if not self.failed else f"{n - len(self.failed)} of {n} joints"
        first = f"{self._failed_names()} not measured: an" if self.failed else "An"
        return (
            f"{first} arm of {joints} from {self.n_points} points on "
            f"{number_of(len(self.circles), 'circle')}: residual standard deviation "
            f"{format_mm(self.estimated.residual_std_mm)} of a coordinate."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        yield from (
            f"J{joint + 1} is not measured. {reason[0].upper()}{reason[1:]}." for joint, reason in self.failed.items()
        )
        if self.failed:
            parts = [
                what if name in ("tip", "base") else f"{what} of {name}" for name, what in self._not_measured().items()
            ]
            yield (
                f"What depends on {self._failed_names()} is not measured either: {'; '.join(parts)}. The file has "
                "assumed values there, so that it loads. Add the readings of a better circle to the session and repeat "
                "the command."
            )
        yield self._constants_table()
        if np.isnan(self.tip_std).any():
            yield "tip, the target that was seen: not measured"
        else:
            tip = ", ".join(_with_u(*one) for one in zip(self.table.tip_in_flange, self.tip_std, strict=True))
            yield f"tip, the target that was seen: {tip} mm"
        if self.is_base_measured:
            yield "The base frame is that of joint 1: z along its axis, x where its angle is zero."
        elif 0 in self.failed:
            yield "The base frame is not measured: that of the file is on an assumed axis of joint 1."
        else:
            yield "Of the base frame only z is measured, along the axis of joint 1; origin and x are not."
        if round_ones := self.near_round_values():
            yield (
                f"Round values that a drawing may have here, within U (k = 2), not put in place of what was measured: "
                f"{', '.join(round_ones)}."
            )
        yield from self.remarks
        yield self._circles_table()
        yield "All lengths are as long as the points make them: check one with a ruler."

    def near_round_values(self) -> list[str]:
        """Constants that are a round value within their expanded uncertainty, such as ``J2 alpha 90 deg``."""
        found, u = [], self._u_columns()
        for name, values in self.table.columns().items():
            column, _, unit = name.partition("_")
            for i, (value, uncertainty) in enumerate(zip(values, u[name], strict=True)):
                if not uncertainty > 0:
                    continue
                nearest = ROUND_DEG * round(value / ROUND_DEG) if unit == "deg" else 0.0
                if value != nearest and abs(value - nearest) <= COVERAGE * uncertainty:
                    found.append(f"J{i + 1} {column} {nearest:.0f} {unit}")
        return found

    def _constants_table(self) -> TextTable:
        shown, u = self.table.used_columns(), self._u_columns()
        rows = [
            [joint, *(_with_u(values[i], u[name][i]) for name, values in shown.items())]
            for i, joint in enumerate(self.arm.joint_names)
        ]
        heads = [f"{name} (u)" for name in shown]
        return TextTable((f"joint, {self.table.convention}", *heads), rows)

    def _circles_table(self) -> TextTable:
        rows = []
        for circle in self.circles:
            slides = circle.radius_mm == 0
            travel = f"{circle.travel:.0f} mm" if slides else f"{np.degrees(circle.travel):.0f} deg"
            radius = "" if slides else f"{circle.radius_mm:.1f}"
            std = format_fixed(circle.residual_std_mm)
            rows.append((f"J{circle.joint + 1}", str(len(circle.rows)), travel, radius, std))
        return TextTable(("circle", "points", "travel", "radius mm", "scatter mm"), rows)

    def columns(self) -> dict[str, Any]:
        """A row for each joint: its constants and their standard uncertainties, 0 of what is a convention.

        NaN of what was not measured.
        """
        of_columns = self._u_columns()
        u = {f"u_{name}": values for name, values in of_columns.items()}
        values = {name: _if_measured(one, of_columns[name]) for name, one in self.table.columns().items()}
        return {"joint": list(self.arm.joint_names), **values, **u}

    def _json(self) -> object:
        constants = self.columns()
        del constants["joint"]
        return {
            "summary": self.summary(),
            "convention": self.table.convention,
            **constants,
            "tip_mm": _if_measured(self.table.tip_in_flange, self.tip_std),
            "u_tip_mm": self.tip_std,
            "base_in_instrument": self.table.base if self.is_base_measured else None,
            "residual_std_mm": self.estimated.residual_std_mm,
            "gains": _if_measured(self.estimated.gains, self.estimated.gain_std),
            "u_gains": self.estimated.gain_std,
            "round_values": self.near_round_values(),
            "not_measured": {self.arm.joint_names[joint]: reason for joint, reason in self.failed.items()},
            **self._named("n_points", "remarks"),
        }


def _if_measured(values: FloatArray, u: FloatArray) -> FloatArray:
    """Values, NaN where their standard uncertainty is NaN: what was not measured."""
    return np.where(np.isnan(u), np.nan, values)


def _with_u(value: float, u: float) -> str:
    """A constant with its standard uncertainty to two figures, such as ``612.04 (0.03)``; a convention without."""
    if np.isnan(u):
        return "not measured"
    if u <= 0 or not np.isfinite(u):
        return f"{value + 0.0:g}"
    decimals = int(np.clip(1 - np.floor(np.log10(u)), 0, 6))
    return f"{value:.{decimals}f} ({u:.{decimals}f})"


def plan_circles(n_joints: int, *, points: int = 12, span_deg: float = 60.0, noise_mm: float = 1.0) -> CirclesPlan:
    """Plan the readings of `arm_from_circles`: each joint in turn at equal steps over a span, the others at zero.

    Parameters
    ----------
    n_joints : int
    points : int
        Of each circle.
    span_deg : float
        From the first to the last angle of a circle [deg].
    noise_mm : float
        Standard uncertainty of a coordinate of the instrument [mm].

    Raises
    ------
    InputError
        If the numbers make no circle.

    Examples
    --------
    >>> import truearm as ta
    >>> round(ta.plan_circles(5, span_deg=120, noise_mm=1.0).radius_needed(2.0))
    47
    """
    if not (1 <= n_joints <= 100 and LEAST_POINTS <= points <= 1000 and LEAST_ARC_PLANNED <= span_deg <= 360):
        raise InputError(
            f"expected 1 to 100 joints, {LEAST_POINTS} to 1000 points and a span of {LEAST_ARC_PLANNED:.0f} to 360 "
            f"deg, got {n_joints}, {points} and {span_deg:g}"
        )
    if not 0 < noise_mm < np.inf:
        raise InputError(f"expected the standard uncertainty of a coordinate [mm], got {noise_mm:g}")
    return CirclesPlan(n_joints, np.radians(np.linspace(-0.5, 0.5, points) * span_deg), noise_mm)


@dataclass(frozen=True, eq=False, repr=False)
class CirclesPlan(TableRecord):
    """Circles to measure.

    Attributes
    ----------
    n_joints : int
    turns : (m,) array
        Angles of each joint [rad].
    noise_mm : float
        Standard uncertainty of a coordinate of the instrument.
    file : Path, optional
        The session file to fill in, if it was written.
    """

    n_joints: int
    turns: FloatArray
    noise_mm: float
    file: Path | None = None

    def radius_needed(self, direction_std_deg: float, span_deg: float | None = None) -> float:
        """Distance of the target from an axis [mm] at which its direction is known so well [deg]; over another span."""
        turns = self.turns * (1.0 if span_deg is None else np.radians(span_deg) / np.ptp(self.turns))
        return max(radius_needed(turns, self.noise_mm, float(np.radians(direction_std_deg))), LEAST_RADIUS_MM)

    def save(self, path: str | Path, *, force: bool = False) -> CirclesPlan:
        """Write the session file to fill in, .csv, new unless `force` replaces it; return the plan with its `file`."""
        check_new_file(path, force=force, endings=(".csv",))
        n, m = self.n_joints, len(self.turns)
        arm = Arm("unknown arm", Chain(np.tile(np.eye(4), (n + 1, 1, 1)), np.zeros(3)))
        angles, notes = np.zeros((n * m, n)), []
        for joint in range(n):
            angles[joint * m : (joint + 1) * m, joint] = self.turns
            note = (
                f"move J{joint + 1} alone, the target {self.radius_needed(PLANNED_DEG):.0f} mm or more from its axis; "
                "the others stand where they are, at 0 or anywhere"
            )
            notes += [note] * m
        write_aims(arm, angles, path, names={}, notes=notes, points=True)
        return replace(self, file=Path(path))

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        m, span, needed = len(self.turns), self._span_deg, self.radius_needed(PLANNED_DEG)
        yield f"{self.n_joints * m} readings, {m} of each of {number_of(self.n_joints, 'joint')}, over {span:.0f} deg."
        yield (
            f"Keep the target {needed:.0f} mm or more from the axis of the joint that moves: an instrument of "
            f"{self.noise_mm:g} mm a coordinate then finds the axis to {PLANNED_DEG:g} deg; below "
            f"{self.radius_needed(MAX_DIRECTION_DEG):.0f} mm it finds none. For the last joints mount the target at "
            "that distance from their axes; for the first stretch the arm. A longer arc needs less:"
        )
        rows = [tuple(f"{cell:.0f}" for cell in row) for row in zip(*self.columns().values(), strict=True)]
        yield TextTable(("span deg", *(f"radius mm for {u:g} deg" for u in DIRECTIONS_DEG)), rows, left_aligned=())
        if self.file is None:
            yield "Write the file to fill in with save."
        else:
            yield f"Fill in angles and points; then truearm arms --from-circles {self.file} --out my-arm.toml."

    @property
    def _span_deg(self) -> float:
        return round(float(np.degrees(np.ptp(self.turns))), PLANNED_DECIMALS)

    def columns(self) -> dict[str, list[float]]:
        """The distances of the target from an axis that find its direction, by the span of the circle."""
        span = self._span_deg
        spans = [span, *(one for one in SPANS_DEG if one > span + 1)]
        radii = {f"radius_for_{u:g}_deg_mm": [self.radius_needed(u, one) for one in spans] for u in DIRECTIONS_DEG}
        return {"span_deg": spans, **radii}

    def _json(self) -> object:
        return {
            "n_readings": self.n_joints * len(self.turns),
            "turns_deg": np.round(np.degrees(self.turns), PLANNED_DECIMALS),
            "noise_mm": self.noise_mm,
            **self.columns(),
        }
