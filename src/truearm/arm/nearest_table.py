"""Denavit-Hartenberg tables beside the drawing: of all tables of an identified chain, the one nearest to the nominal.

A table has more freedom than an arm. Every angle may be stated from either side of its common normal; between parallel
axes an offset may be at either end; the first joint's offset and height may belong to the base, and the last row to the
tip. Here the drawing decides all of it: angles in its branch, parallel axes with its d and Hayati's beta, the first and
the last joint's own constants with their nominal values. Then every constant changes by little and continuously.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from truearm.arm.chain import Chain
from truearm.arm.denavit_hartenberg import DHTable, motion_across
from truearm.arm.rigid_motions import screw_z
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.typing import FloatArray

# Axes of the drawing within 6 deg of parallel have beta and keep d: an offset to a common normal would change by ten
# times the displacement of an axis, or more.
NEARLY_PARALLEL = 0.1  # rad
# Parallel axes of the drawing nearer than this are on one line: the direction of a between them would be of no meaning.
ON_ONE_LINE_MM = 10.0
# Axes of an identified arm turn by milliradians. Sines of the angle between two neighbours, drawn parallel or not, past
# which the drawing is of another arm.
MAX_SINE_IF_PARALLEL, MIN_SINE_IF_NOT = 0.8, 0.01
# A fixed motion has the form of a row if it misses it by less: arm files print angles to 1e-12 deg.
_FORM, _FORM_MM = 1e-13, 1e-9


class _Own(NamedTuple):
    """A joint's motion along its own axis, ``Rz(theta) Tz(d)``."""

    theta: float
    d: float

    @property
    def motion(self) -> FloatArray:
        return screw_z(*self)


class _Across(NamedTuple):
    """The motion from one axis to the next, ``Tx(a) Ty(b) Rx(alpha) Ry(beta)``."""

    a: float
    alpha: float
    beta: float = 0.0
    b: float = 0.0

    @property
    def motion(self) -> FloatArray:
        return motion_across(self.a, self.alpha, beta=self.beta, b=self.b)

    @property
    def is_parallel(self) -> bool:
        """Whether the axes are nearly parallel."""
        return bool(abs(np.cos(self.alpha) * np.cos(self.beta)) > np.cos(NEARLY_PARALLEL))


class _Rows(NamedTuple):
    """A table by axes: n joints, the n - 1 motions between them, and the motion beyond the last or before the first."""

    own: list[_Own]
    between: list[_Across]
    end: _Across


_NO_MOTION = _Across(0.0, 0.0)


def drawn_convention(chain: Chain) -> Convention:
    """The convention of the table that a chain was built from: modified if it has that form only, else standard."""
    inner = chain.fixed[1:-1]
    standard = all(_read_standard(frame) for frame in inner)
    return "mdh" if not standard and all(_read_modified(frame) for frame in inner) else "dh"


def has_table_form(chain: Chain) -> bool:
    """Whether a chain has the form of a table of either convention, as one built from a table has."""
    inner = chain.fixed[1:-1]
    return all(_read_standard(frame) for frame in inner) or all(_read_modified(frame) for frame in inner)


def drawn_table(chain: Chain, convention: Convention = "dh") -> DHTable:
    """Read the table off a nominal chain, as its arm file has it.

    A chain that was built from a table of this convention gives that table back. Of any other chain the frames of its
    joints decide: where axes are parallel, d is where the next frame is drawn, and |theta| <= 90 deg.

    Parameters
    ----------
    chain : Chain
        The nominal one.
    convention : {"dh", "mdh"}
    """
    read = _read_standard if convention == "dh" else _read_modified
    read_off = [read(frame) for frame in chain.fixed[1:-1]]
    inner = [row for row in read_off if row is not None]
    base, flange = chain.fixed[0], chain.fixed[-1]
    if len(inner) == len(read_off):
        outer = read(flange if convention == "dh" else base)
        end = outer or (_Own(0.0, 0.0), _NO_MOTION)
        if outer is not None:
            base, flange = (base, np.eye(4)) if convention == "dh" else (np.eye(4), flange)
        own = [row[0] for row in ([*inner, end] if convention == "dh" else [end, *inner])]
        rows = _Rows(own, [row[1] for row in inner], end[1])
        return _table(convention, chain, rows, base=base, flange=flange, tip=chain.tip_in_flange)
    carried, own, between = np.eye(4), [], []
    for fixed in chain.fixed[1:-1]:
        frame = carried @ fixed
        # d of the next frame's own height keeps it where it is drawn.
        at = _Own(0.0, float(frame[2, 3]))
        # The sign of alpha with which |theta| <= 90 deg.
        across = _Across(float(np.hypot(frame[0, 3], frame[1, 3])), 1.0 if frame[1, 2] <= 0 else -1.0)
        split = _split_parallel if abs(frame[2, 2]) > np.cos(NEARLY_PARALLEL) else _split_skew
        one, two, carried = split(frame, at, across)
        own.append(one)
        between.append(two)
    rows = _Rows([*own, _Own(0.0, 0.0)], between, _NO_MOTION)
    return _table(convention, chain, rows, base=base, flange=carried @ flange, tip=chain.tip_in_flange)


def nearest_table(
    chain: Chain, nominal: Chain, *, convention: Convention = "dh", free: Sequence[str] = ("base", "tip")
) -> DHTable:
    """Write a chain as a table in the branch nearest to the nominal one's; its tip poses are those of the chain.

    What no reading of the tip separates from the place of the arm in the room, joint 1's theta and d (of a modified
    table its whole row), stays nominal, and `base` takes the difference. What none separates from the tip, the last
    row (of a modified table its theta and d), stays nominal; `flange` then has the orientation of the chain's, and
    `tip_in_flange` the rest.

    Parameters
    ----------
    chain : Chain
        With the joints of the nominal chain, its axes near to those.
    nominal : Chain
        Its table (`drawn_table`) is the drawing.
    convention : {"dh", "mdh"}
    free : sequence of str
        Which of ``"base"`` and ``"tip"`` are unknown. One that is known stays as near to the drawing as the first or
        last joint's own theta and d allow.

    Raises
    ------
    InputError
        If the chain has other joints than the nominal one, or axes far from its.
    """
    n, modified = nominal.n_joints, convention == "mdh"
    if chain.n_joints != n or (chain.is_prismatic != nominal.is_prismatic).any():
        raise InputError(
            f"expected a chain with the {n} joints of the nominal arm, got one of {chain.n_joints}",
            hint="compare an identified arm with the nominal arm that it was identified from",
        )
    drawing = drawn_table(nominal, convention)
    drawn = _rows_of(drawing)
    # A chain built from a modified table has joint 1's own motion before its first joint.
    built = modified and all(_read_modified(frame) for frame in nominal.fixed[1:-1])
    carried = drawn.own[0].motion if built else np.eye(4)
    at_first = chain.fixed[0] @ np.linalg.inv(carried)
    own, between = list(drawn.own), []
    for i, fixed in enumerate(chain.fixed[1:-1]):
        own[i], across, carried = _split_near(carried @ fixed, drawn.own[i], drawn.between[i], i + 1)
        between.append(across)
    at_last = carried @ chain.fixed[-1]
    if n == 1 and not modified:  # the only row is the last one
        base = at_first
    else:
        lead = drawn.end.motion @ drawn.own[0].motion if modified else drawn.own[0].motion
        at_first = at_first @ own[0].motion
        shift = _Own(0.0, 0.0) if "base" in free else _own_part(np.linalg.inv(drawing.base @ lead) @ at_first)
        base = at_first @ np.linalg.inv(lead @ shift.motion)
        own[0] = _sum(drawn.own[0], shift)
    trail = drawn.own[-1].motion @ (np.eye(4) if modified else drawn.end.motion)
    if n > 1:
        shift = _Own(0.0, 0.0) if "tip" in free else _tip_part(trail, drawing, at_last, chain.tip_in_flange)
        trail = shift.motion @ trail
        own[-1] = _sum(drawn.own[-1], shift)
    end = np.linalg.inv(trail) @ at_last
    flange = drawing.flange.copy()
    flange[:3, :3] = end[:3, :3]
    tip = _moved(np.linalg.inv(flange) @ end, chain.tip_in_flange)
    return _table(drawing.convention, chain, _Rows(own, between, drawn.end), base=base, flange=flange, tip=tip)


def _read_standard(frame: FloatArray) -> tuple[_Own, _Across] | None:
    """The row of a motion ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``; None if it has another form."""
    theta, alpha = np.arctan2(frame[1, 0], frame[0, 0]), np.arctan2(frame[2, 1], frame[2, 2])
    cos, sin = np.cos(theta), np.sin(theta)
    x, y, z = frame[:3, 3]
    if abs(frame[2, 0]) > _FORM or abs(cos * y - sin * x) > _FORM_MM:
        return None
    return _Own(float(theta), float(z)), _Across(float(cos * x + sin * y), float(alpha))


def _read_modified(frame: FloatArray) -> tuple[_Own, _Across] | None:
    """The row of a motion ``Tx(a) Rx(alpha) Rz(theta) Tz(d)``; None if it has another form."""
    theta, alpha = np.arctan2(-frame[0, 1], frame[0, 0]), np.arctan2(-frame[1, 2], frame[2, 2])
    cos, sin = np.cos(alpha), np.sin(alpha)
    x, y, z = frame[:3, 3]
    if abs(frame[0, 2]) > _FORM or abs(cos * y + sin * z) > _FORM_MM:
        return None
    return _Own(float(theta), float(cos * z - sin * y)), _Across(float(x), float(alpha))


def _split_near(frame: FloatArray, own: _Own, across: _Across, joint: int) -> tuple[_Own, _Across, FloatArray]:
    """Split the motion from a joint to the next in the branch of the nominal `own` and `across`."""
    sine = float(np.hypot(frame[0, 2], frame[1, 2]))
    if across.is_parallel and sine < MAX_SINE_IF_PARALLEL and frame[2, 2] * np.cos(across.alpha) > 0:
        return _split_parallel(frame, own, across)
    if not across.is_parallel and sine > MIN_SINE_IF_NOT:
        return _split_skew(frame, own, across)
    drawn = np.degrees(np.arccos(np.cos(across.alpha) * np.cos(across.beta)))
    found = np.degrees(np.arctan2(sine, frame[2, 2]))
    raise InputError(
        f"the axes of joints {joint} and {joint + 1} are at {found:.1f} deg, in the drawing at {drawn:.1f} deg",
        hint="compare an identified arm with the nominal arm that it was identified from",
    )


def _split_skew(frame: FloatArray, own: _Own, across: _Across) -> tuple[_Own, _Across, FloatArray]:
    """Split at the common normal of two axes that are not parallel; the motion along the second axis remains."""
    # The normal from the one side or the other: alpha changes its sign.
    side = 1.0 if np.sin(across.alpha) >= 0 else -1.0
    theta = _near(np.arctan2(side * frame[0, 2], -side * frame[1, 2]), own.theta, 2 * np.pi)
    left = screw_z(-theta, 0.0) @ frame
    sin, cos = -left[1, 2], left[2, 2]
    alpha = _near(np.arctan2(sin, cos), across.alpha, 2 * np.pi)
    after = -left[1, 3] / sin
    one, two = _Own(theta, float(left[2, 3] - after * cos)), _Across(float(left[0, 3]), alpha)
    # Row by row of Rx(-alpha) left: the remaining turn is where x went.
    turn = float(np.arctan2(np.cos(alpha) * left[1, 0] + np.sin(alpha) * left[2, 0], left[0, 0]))
    return one, two, screw_z(turn, float(after))


def _split_parallel(frame: FloatArray, own: _Own, across: _Across) -> tuple[_Own, _Across, FloatArray]:
    """Split where the second axis crosses the plane at the height d of the first; the motion along it remains."""
    after = (frame[2, 3] - own.d) / frame[2, 2]
    x, y, _ = frame[:3, 3] - after * frame[:3, 2]
    on_one_line = abs(across.a) < ON_ONE_LINE_MM
    theta = own.theta if on_one_line else _near(np.arctan2(y, x), own.theta, np.pi)
    cos, sin = np.cos(theta), np.sin(theta)
    R = screw_z(-theta, 0.0)[:3, :3] @ frame[:3, :3]  # Rx(alpha) Ry(beta) Rz(turn)
    beta = float(np.arctan2(R[0, 2], np.hypot(R[0, 0], R[0, 1])))
    alpha = _near(np.arctan2(-R[1, 2], R[2, 2]), across.alpha, 2 * np.pi)
    turn = float(np.arctan2(-R[0, 1], R[0, 0]))
    b = float(cos * y - sin * x) if on_one_line else 0.0
    return _Own(theta, own.d), _Across(float(cos * x + sin * y), alpha, beta, b), screw_z(turn, float(after))


def _near(angle: float, drawn: float, period: float) -> float:
    """The angle that differs by whole periods and is nearest to the drawn one."""
    return float(angle + period * np.round((drawn - angle) / period))


def _own_part(small: FloatArray) -> _Own:
    """Turn about z and shift along it of a small motion."""
    return _Own(float(np.arctan2(small[1, 0] - small[0, 1], small[0, 0] + small[1, 1])), float(small[2, 3]))


def _tip_part(trail: FloatArray, drawing: DHTable, at_last: FloatArray, tip_in_flange: FloatArray) -> _Own:
    """What the last joint's own theta and d explain of the motion of a tip that is known on its flange."""
    as_drawn = trail @ drawing.flange
    rise = _moved(at_last, tip_in_flange)[2] - _moved(as_drawn, drawing.tip_in_flange)[2]
    return _Own(_own_part(at_last @ np.linalg.inv(as_drawn)).theta, float(rise))


def _sum(one: _Own, other: _Own) -> _Own:
    return _Own(one.theta + other.theta, one.d + other.d)


def _moved(motion: FloatArray, point: FloatArray) -> FloatArray:
    return np.asarray(motion[:3, :3] @ point + motion[:3, 3])


def _rows_of(table: DHTable) -> _Rows:
    own = [_Own(*one) for one in zip(table.theta.tolist(), table.d.tolist(), strict=True)]
    columns = (table.a, table.alpha, table.beta, table.b)
    across = [_Across(*one) for one in zip(*(column.tolist() for column in columns), strict=True)]
    if table.convention == "dh":
        return _Rows(own, across[:-1], across[-1])
    return _Rows(own, across[1:], across[0])


def _table(
    convention: Convention, chain: Chain, rows: _Rows, *, base: FloatArray, flange: FloatArray, tip: FloatArray
) -> DHTable:
    across = [*rows.between, rows.end] if convention == "dh" else [rows.end, *rows.between]
    theta, d = np.array(rows.own).T
    a, alpha, beta, b = np.array(across).T
    return DHTable(convention, a, d, alpha, theta, chain.is_prismatic, base, flange, tip, beta, b)
