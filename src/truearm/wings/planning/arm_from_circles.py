"""An arm without a drawing, from the circles of its joints (circle point analysis), and the file to measure them."""

from __future__ import annotations

from collections.abc import Iterator
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
from truearm.models.arm_check import arm_of_readings
from truearm.readings import Session
from truearm.readings.checks import serial_number_of
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import SessionLike, to_session, unfilled_rows
from truearm.verbs.record import TableRecord, TextTable, format_fixed
from truearm.verbs.sentences import format_mm, number_of
from truearm.wings.planning.circles.axes import EstimatedAxes, check_directions, estimate_axes
from truearm.wings.planning.circles.joint_circles import JointCircle, joint_circles
from truearm.wings.planning.designs.template import write_aims

# Round values that drawings have: of angles multiples of 90 deg, of lengths 0. They are named within so many standard
# uncertainties, and never put in place of what was measured.
ROUND_DEG, COVERAGE = 90.0, 2.0
# A gain that differs from 1 by more standard uncertainties is said, and by more than this share besides, refused: over
# part of a turn, errors of a printed joint that vary with its angle look like some percent.
SAID_GAIN_STDS, MAX_GAIN_ERROR = 5.0, 0.1
LEAST_SAID_GAIN = 1e-3
LEAST_ARC_PLANNED = 10.0
# Of lengths that are zero by convention.
ROUNDING_MM = 1e-9


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
        If a joint has no circle, or one that does not show its axis; if a joint turns by more or less than its angles.

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
    circles = joint_circles(given, slides)
    estimated = estimate_axes(given, circles, slides)
    said = tuple(_judge_gains(given, estimated))
    check_directions(given, circles, estimated)
    table = _own_frames(drawn_table(estimated.axes.chain(), convention))
    n_points = len(np.unique(np.concatenate([circle.rows for circle in circles])))
    at_joint_1 = replace(table, base=np.eye(4))
    arm = Arm(
        name,
        at_joint_1.chain(),
        title="measured by the circles of its joints",
        working_pose=estimated.axes.pose,
        source="; ".join([_source(given, n_points, len(circles), estimated), *acceptance_remarks(accept)]),
        serial_number=serial_number_of(given),
        table=at_joint_1,
    )
    remarks = [*acceptance_remarks(accept), *map(str, unfilled_rows(given)), *said]
    if unused := len(given) - n_points:
        remarks.append(f"{number_of(unused)} in no circle, ignored.")
    return CircleArm(arm, table, _uncertainty(estimated, convention), circles, estimated, n_points, tuple(remarks))


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


def constants_of(table: DHTable) -> FloatArray:
    """(6 n_joints + 3,) the columns of a table one after the other [mm, rad], and the tip in the last joint's frame."""
    flange = table.flange
    tip = flange[:3, :3] @ table.tip_in_flange + flange[:3, 3]
    return np.concatenate([*(getattr(table, name.partition("_")[0]) for name in COLUMNS), tip])


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
        in the last joint's frame; 0 of what is a convention.
    circles : tuple of JointCircle
    estimated : EstimatedAxes
        The axes in one pose, in the frame of the instrument, with their covariance.
    n_points : int
    remarks : tuple of str
    """

    arm: Arm
    table: DHTable
    std: FloatArray
    circles: tuple[JointCircle, ...]
    estimated: EstimatedAxes
    n_points: int
    remarks: tuple[str, ...]

    def u(self, column: str) -> FloatArray:
        """(n_joints,) standard uncertainties of a column of the table, a, d, alpha, .. [mm, or rad]."""
        names = [name.partition("_")[0] for name in COLUMNS]
        n, at = self.arm.n_joints, names.index(column)
        return self.std[n * at : n * (at + 1)]

    def _u_columns(self) -> dict[str, FloatArray]:
        """The same of every column [mm, or deg] under the names of an arm file: a_mm, .., alpha_deg, .."""
        parts = ((name, self.u(name.partition("_")[0])) for name in COLUMNS)
        return {name: np.degrees(part) if name.endswith("deg") else part for name, part in parts}

    def save(self, path: str | Path) -> None:
        """Write the arm file, .toml or .urdf (see docs/arm-file.md)."""
        write_arm(self.arm, path, convention=self.table.convention)

    def summary(self) -> str:
        """The answer in one sentence."""
        return (
            f"An arm of {number_of(self.arm.n_joints, 'joint')} from {self.n_points} points on "
            f"{number_of(len(self.circles), 'circle')}: residual standard deviation "
            f"{format_mm(self.estimated.residual_std_mm)} of a coordinate."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        yield self._constants_table()
        n = self.arm.n_joints
        tip = ", ".join(_with_u(*one) for one in zip(self.table.tip_in_flange, self.std[6 * n :], strict=True))
        yield f"tip, the target that was seen: {tip} mm"
        yield "The base frame is that of joint 1: z along its axis, x where its angle is zero."
        if round_ones := self.near_round_values():
            yield (
                f"Round values that a drawing may have here, within U (k = 2), not put in place of what was measured: "
                f"{', '.join(round_ones)}."
            )
        yield from self.remarks
        yield self._circles_table()

    def near_round_values(self) -> list[str]:
        """Constants that are a round value within their expanded uncertainty, such as ``J2 alpha 90 deg``."""
        found, u = [], self._u_columns()
        for name, values in self.table.columns().items():
            column, _, unit = name.partition("_")
            for i, (value, uncertainty) in enumerate(zip(values, u[name], strict=True)):
                nearest = ROUND_DEG * round(value / ROUND_DEG) if unit == "deg" else 0.0
                if uncertainty > 0 and value != nearest and abs(value - nearest) <= COVERAGE * uncertainty:
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
        """A row for each joint: its constants and their standard uncertainties, 0 of what is a convention."""
        u = {f"u_{name}": values for name, values in self._u_columns().items()}
        return {"joint": list(self.arm.joint_names), **self.table.columns(), **u}

    def _json(self) -> object:
        n = self.arm.n_joints
        return {
            "summary": self.summary(),
            "convention": self.table.convention,
            **self.table.columns(),
            **{f"u_{name}": u for name, u in self._u_columns().items()},
            "tip_mm": self.table.tip_in_flange,
            "u_tip_mm": self.std[6 * n :],
            "base_in_instrument": self.table.base,
            "residual_std_mm": self.estimated.residual_std_mm,
            "gains": self.estimated.gains,
            "u_gains": self.estimated.gain_std,
            "round_values": self.near_round_values(),
            **self._named("n_points", "remarks"),
        }


def _with_u(value: float, u: float) -> str:
    """A constant with its standard uncertainty to two figures, such as ``612.04 (0.03)``; a convention without."""
    if u <= 0 or not np.isfinite(u):
        return f"{value + 0.0:g}"
    decimals = int(np.clip(1 - np.floor(np.log10(u)), 0, 6))
    return f"{value:.{decimals}f} ({u:.{decimals}f})"


def write_circles_form(
    path: str | Path, n_joints: int, *, points: int = 12, span_deg: float = 60.0, force: bool = False
) -> None:
    """Write a session file to fill in: each joint in turn at equal steps over a span, the others at zero.

    Parameters
    ----------
    path : path
        Ends in ``.csv``; must be new, unless `force` replaces it.
    n_joints : int
    points : int
        Of each circle.
    span_deg : float
        From the first to the last angle of a circle [deg].

    Raises
    ------
    InputError
        If the numbers make no circle, or the file exists.
    """
    if not (1 <= n_joints <= 100 and 5 <= points <= 1000 and LEAST_ARC_PLANNED <= span_deg <= 360):
        raise InputError(
            f"expected 1 to 100 joints, 5 to 1000 points and a span of {LEAST_ARC_PLANNED:.0f} to 360 deg, got "
            f"{n_joints}, {points} and {span_deg:g}"
        )
    check_new_file(path, force=force, endings=(".csv",))
    arm = Arm("unknown arm", Chain(np.tile(np.eye(4), (n_joints + 1, 1, 1)), np.zeros(3)))
    angles = np.zeros((n_joints * points, n_joints))
    notes = []
    for joint in range(n_joints):
        angles[joint * points : (joint + 1) * points, joint] = np.radians(np.linspace(-0.5, 0.5, points) * span_deg)
        notes += [f"move J{joint + 1} alone; the others stand where they are, at 0 or anywhere"] * points
    write_aims(arm, angles, path, names={}, notes=notes, points=True)
