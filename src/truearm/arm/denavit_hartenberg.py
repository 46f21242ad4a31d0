"""Denavit-Hartenberg tables, standard and modified, to a chain and from a chain.

Standard (Denavit and Hartenberg 1955; Paul 1981): ``T_i = Rz(q_i + theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)``.
Modified (Craig 1986): ``T_i = Rx(alpha_i) Tx(a_i) Rz(q_i + theta_i) Tz(d_i)``; Craig's alpha(i-1), a(i-1)
are in row i here, as in every published table. A sliding joint adds q_i to d_i instead of theta_i.

Between axes that are parallel or nearly so, four such numbers change without bound by a small tilt. There a table may
have a rotation ``Ry(beta)`` right after ``Rx(alpha)`` and keep d (S. A. Hayati, M. Mirmirani, "Improving the absolute
positioning accuracy of robot manipulators", J. Robotic Systems 2 (1985) 397), and between axes on one line a length b
along y beside a, and keep theta.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import screw_x, screw_z
from truearm.choices import Convention as Convention
from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

Kind = Literal["revolute", "prismatic", "fixed"]

# A table states where the common normal of two axes meets them, which goes to infinity as the axes become parallel. A
# longer offset than this is refused: it would be a property of rounding, not of the arm.
MAX_OFFSET_MM = 10_000.0
_PARALLEL = 1e-13  # sine of the angle between axes below which they are parallel: 1e-10 mm at a reach of 1 m
_COINCIDENT_MM = 1e-11
COLUMNS = ("a_mm", "d_mm", "alpha_deg", "theta_deg", "beta_deg", "b_mm")


@dataclass(frozen=True, eq=False)
class DHTable:
    """A Denavit-Hartenberg table, one row a joint.

    Parameters
    ----------
    convention : {"dh", "mdh"}
        Standard or modified, see the module's formulas.
    a, d : (n_joints,) array
        Lengths along x and z [mm].
    alpha, theta : (n_joints,) array
        Angles about x and z [rad]; theta is the constant that is added to the joint's angle.
    prismatic : (n_joints,) bool array
        Which joints slide.
    base : (4, 4) array
        Rigid motion before the first row [mm].
    flange : (4, 4) array
        Rigid motion after the last row [mm].
    tip_in_flange : (3,) array
        The tip after `flange` [mm].
    beta : (n_joints,) array, optional
        Angles about y, right after alpha, between nearly parallel axes [rad]; zeros by default.
    b : (n_joints,) array, optional
        Lengths along y, beside a, between axes nearly on one line [mm]; zeros by default.
    """

    convention: Convention
    a: FloatArray
    d: FloatArray
    alpha: FloatArray
    theta: FloatArray
    prismatic: BoolArray
    base: FloatArray
    flange: FloatArray
    tip_in_flange: FloatArray
    beta: FloatArray = field(default_factory=lambda: np.zeros(0))
    b: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ("beta", "b"):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(len(self.a)))
        for name in (one.name for one in fields(self) if one.name != "convention"):
            value = np.array(getattr(self, name))
            value.flags.writeable = False  # an arm of the catalogue is one for all who load it
            object.__setattr__(self, name, value)

    def columns(self) -> dict[str, FloatArray]:
        """Columns as people read them, with the unit in the name: lengths [mm], angles [deg]."""
        lengths = {"a_mm": self.a, "d_mm": self.d, "b_mm": self.b}
        angles = {name: np.degrees(getattr(self, name.removesuffix("_deg"))) for name in COLUMNS if name not in lengths}
        return {name: (lengths | angles)[name] for name in COLUMNS}

    def used_columns(self) -> dict[str, FloatArray]:
        """`columns` without a beta and b of zeros, which most tables do not have."""
        return {name: one for name, one in self.columns().items() if name not in COLUMNS[4:] or one.any()}

    def chain(self) -> Chain:
        """Build the chain that the table describes."""
        kinds: list[Kind] = ["prismatic" if slides else "revolute" for slides in self.prismatic]
        rows = _rows(self.a, self.d, self.alpha, self.theta, kinds, beta=self.beta, b=self.b)
        return _folded(_links(self.convention, rows), self.base, self.flange, self.tip_in_flange)


def chain_from_dh(
    *,
    a: npt.ArrayLike,
    d: npt.ArrayLike,
    alpha: npt.ArrayLike,
    theta: npt.ArrayLike | None = None,
    kinds: Sequence[Kind] | None = None,
    beta: npt.ArrayLike | None = None,
    b: npt.ArrayLike | None = None,
    base: npt.ArrayLike | None = None,
    flange: npt.ArrayLike | None = None,
    tip_in_flange: npt.ArrayLike = (0.0, 0.0, 0.0),
    convention: Convention = "dh",
) -> Chain:
    """Chain of a Denavit-Hartenberg table, standard by default.

    Parameters
    ----------
    a, d : (n_rows,) array
        Lengths along x and z [mm].
    alpha : (n_rows,) array
        Angles about x [rad].
    theta : (n_rows,) array, optional
        Constants added to the joint angles [rad]; zeros by default.
    kinds : sequence of {"revolute", "prismatic", "fixed"}, optional
        One a row, all revolute by default. A fixed row is folded into its neighbours and is no joint of the chain.
    beta, b : (n_rows,) array, optional
        Angles about y [rad] and lengths along y [mm] between nearly parallel axes (Hayati); zeros by default.
    base : (4, 4) array, optional
        Rigid motion before the first row [mm].
    flange : (4, 4) array, optional
        Rigid motion after the last row [mm].
    tip_in_flange : (3,) array
        The tip after `flange` [mm].
    convention : {"dh", "mdh"}
        See `chain_from_mdh` for modified tables.

    Raises
    ------
    InputError
        If lengths do not fit each other, a kind is unknown, a number is not finite, or no joint moves.
    """
    rows = _rows(a, d, alpha, theta, kinds, beta=beta, b=b)
    return _folded(_links(convention, rows), base, flange, tip_in_flange)


def chain_from_mdh(**table: Any) -> Chain:
    """Chain of a modified (Craig's) Denavit-Hartenberg table.

    Parameters and errors as in `chain_from_dh`; row i holds alpha(i-1) and a(i-1), which act before joint i.
    """
    return chain_from_dh(**table, convention="mdh")


def row_end_frames(convention: Convention, **columns: Any) -> list[tuple[int, FloatArray]]:
    """Frames at the ends of a table's rows, in which the literature gives a link's centre of mass.

    The columns of the table, and the kinds of its rows, are those of `chain_from_dh`.

    Returns
    -------
    list of (int, (4, 4) array)
        For every row the joint that it moves with, counted from 1 (0: it does not move), and the frame at its end in
        the frame of that joint's place [mm]; that of a row that does not move, in the frame where the first row begins.
    """
    ends: list[tuple[int, FloatArray]] = []
    joint, end = 0, np.eye(4)
    for kind, before, after in _links(convention, _rows(**columns)):
        if kind == "fixed":
            end = end @ before @ after
        else:
            joint, end = joint + 1, after
        ends.append((joint, end))
    return ends


def dh_table(chain: Chain, *, max_offset_mm: float = MAX_OFFSET_MM) -> DHTable:
    """Write any chain as a standard Denavit-Hartenberg table, exact to rounding.

    The table's freedom is used so: |theta| <= 90 deg with a of either sign; between parallel axes d = 0, the offset
    is in the row in which the run of parallel axes ends. `base` is the chain's F0; `flange` at most a screw about z.

    Parameters
    ----------
    chain : Chain
    max_offset_mm : float
        Largest d allowed [mm].

    Raises
    ------
    InputError
        If two axes are so nearly parallel that d would be longer than `max_offset_mm`.
    """
    normals, carried = _common_normals(chain, max_offset_mm)
    end = screw_z(*carried) @ chain.fixed[-1]
    last = _common_normal(end, last=True)
    if last.longest > max_offset_mm:  # no table row is needed here: all goes into the flange
        last, flange = _NOTHING, end
    else:
        flange = screw_z(*last.after)
    rows = [(normal.theta, normal.d, normal.a, normal.alpha) for normal in (*normals, last)]
    return _table("dh", rows, chain, base=chain.fixed[0], flange=flange)


def mdh_table(chain: Chain, *, max_offset_mm: float = MAX_OFFSET_MM) -> DHTable:
    """Write any chain as a modified (Craig's) Denavit-Hartenberg table, exact to rounding.

    `base` is a screw about z at most, `flange` the chain's last fixed motion; else as in `dh_table`.

    Raises
    ------
    InputError
        If two axes are so nearly parallel that d would be longer than `max_offset_mm`.
    """
    first = _common_normal(chain.fixed[0])
    if first.longest > max_offset_mm:  # no table row is needed here: all goes into the base
        first, base = _NOTHING, chain.fixed[0]
    else:
        base = screw_z(first.theta, first.d)
    normals, carried = _common_normals(chain, max_offset_mm, carried=first.after)
    screws = [*((normal.theta, normal.d) for normal in normals), carried]
    rows = [(*screw, normal.a, normal.alpha) for screw, normal in zip(screws, (first, *normals), strict=True)]
    return _table("mdh", rows, chain, base=base, flange=chain.fixed[-1])


class _Row(NamedTuple):
    a: float
    d: float
    alpha: float
    theta: float
    beta: float
    b: float
    kind: Kind


class _CommonNormal(NamedTuple):
    """A rigid motion as ``Rz(theta) Tz(d) Tx(a) Rx(alpha) Rz(after[0]) Tz(after[1])``."""

    theta: float
    d: float
    a: float
    alpha: float
    after: tuple[float, float]

    @property
    def longest(self) -> float:
        """The longer of the two offsets along the axes [mm]."""
        return max(abs(self.d), abs(self.after[1]))


_NOTHING = _CommonNormal(0.0, 0.0, 0.0, 0.0, (0.0, 0.0))


def _rows(
    a: npt.ArrayLike,
    d: npt.ArrayLike,
    alpha: npt.ArrayLike,
    theta: npt.ArrayLike | None = None,
    kinds: Sequence[Kind] | None = None,
    *,
    beta: npt.ArrayLike | None = None,
    b: npt.ArrayLike | None = None,
) -> list[_Row]:
    n = np.size(a)
    columns = {"a": a, "d": d, "alpha": alpha, "theta": theta, "beta": beta, "b": b}
    columns = {name: np.zeros(n) if column is None else column for name, column in columns.items()}
    arrays = {name: np.asarray(column, dtype=float) for name, column in columns.items()}
    for name, column in arrays.items():
        if column.shape != (n,):
            raise InputError(f"a table needs columns of one length, got {n} of a and shape {column.shape} of {name}")
        if not np.isfinite(column).all():
            raise InputError(f"{name} must be finite numbers, got {column.tolist()}")
    kinds = ["revolute"] * n if kinds is None else list(kinds)
    if len(kinds) != n or not set(kinds) <= set(get_args(Kind)):
        raise InputError(f"expected {n} kinds of joint out of {', '.join(get_args(Kind))}, got {kinds}")
    return [_Row(*row) for row in zip(*(column.tolist() for column in arrays.values()), kinds, strict=True)]


def _links(convention: Convention, rows: list[_Row]) -> list[tuple[Kind, FloatArray, FloatArray]]:
    """Kind, rigid motion before the joint and rigid motion after it, of each row."""
    links: list[tuple[Kind, FloatArray, FloatArray]] = []
    for row in rows:
        along_z, across = screw_z(row.theta, row.d), motion_across(row.a, row.alpha, beta=row.beta, b=row.b)
        if convention == "dh":
            links.append((row.kind, np.eye(4), along_z @ across))
        else:
            links.append((row.kind, across @ along_z, np.eye(4)))
    return links


def motion_across(a: float, alpha: float, *, beta: float = 0.0, b: float = 0.0) -> FloatArray:
    """(4, 4) motion from one axis to the next, ``Tx(a) Ty(b) Rx(alpha) Ry(beta)`` [mm, rad]."""
    across = screw_x(alpha, a)
    if beta or b:
        across[:3, :3] = across[:3, :3] @ Rotation.from_euler("y", beta).as_matrix()
        across[1, 3] = b
    return across


def _folded(
    links: list[tuple[Kind, FloatArray, FloatArray]],
    base: npt.ArrayLike | None,
    flange: npt.ArrayLike | None,
    tip_in_flange: npt.ArrayLike,
) -> Chain:
    """Chain of links (kind, rigid motion before the joint, rigid motion after it)."""
    fixed, prismatic = [_frame(base, "base")], []
    for kind, before, after in links:
        fixed[-1] = fixed[-1] @ before
        if kind == "fixed":
            fixed[-1] = fixed[-1] @ after
        else:
            fixed.append(after)
            prismatic.append(kind == "prismatic")
    if not prismatic:
        raise InputError("an arm needs at least one joint that moves, got fixed ones only")
    fixed[-1] = fixed[-1] @ _frame(flange, "flange")
    return Chain(np.array(fixed), np.asarray(tip_in_flange, dtype=float), np.array(prismatic))


def _frame(frame: npt.ArrayLike | None, name: str) -> FloatArray:
    frame = np.eye(4) if frame is None else np.array(frame, dtype=float)
    if frame.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) rigid motion, got shape {frame.shape}")
    return frame


def _common_normals(
    chain: Chain, max_offset_mm: float, *, carried: tuple[float, float] = (0.0, 0.0)
) -> tuple[list[_CommonNormal], tuple[float, float]]:
    """Split the motions between joints one after the other.

    The screw about z that remains of one split commutes with the joint there and is carried into the next.
    """
    normals = []
    for i in range(1, chain.n_joints):
        normal = _common_normal(screw_z(*carried) @ chain.fixed[i])
        if normal.longest > max_offset_mm:
            raise InputError(
                f"the axes of joints {i} and {i + 1} are nearly but not quite parallel: a Denavit-Hartenberg table "
                f"would need an offset d of {normal.longest / 1000:.3g} m (the bound is {max_offset_mm / 1000:g} m)",
                hint="write a URDF, which has no such limit",
            )
        normals.append(normal)
        carried = normal.after
    return normals, carried


def _common_normal(frame: FloatArray, *, last: bool = False) -> _CommonNormal:
    """Split a rigid motion at the common normal of its two z axes.

    Parallel axes have many: theta or d that could be at either end goes into `after`, unless this is the last.
    """
    p, z = frame[:3, 3], frame[:3, 2]
    parallel = bool(np.hypot(z[0], z[1]) < _PARALLEL)
    if parallel and np.hypot(p[0], p[1]) < _COINCIDENT_MM:
        theta = np.arctan2(frame[1, 0], frame[0, 0]) if last else 0.0
    else:
        theta = np.arctan2(p[1], p[0]) if parallel else np.arctan2(z[0], -z[1])
        if abs(theta) > np.pi / 2:
            theta -= np.copysign(np.pi, theta)  # the same normal from the other side
    left = screw_z(-theta, 0.0) @ frame  # Tz(d) Tx(a) Rx(alpha), then the screw for `after`
    sin, cos = -left[1, 2], left[2, 2]
    if parallel:
        alpha = 0.0 if cos > 0 else np.pi
        d, after = (left[2, 3], 0.0) if last else (0.0, left[2, 3] * np.sign(cos))
    else:
        alpha = np.arctan2(sin, cos)
        after = -left[1, 3] / sin
        d = left[2, 3] - after * cos
    turned = screw_x(-alpha, 0.0)[:3, :3] @ left[:3, :3]
    angle = np.arctan2(turned[1, 0], turned[0, 0])
    return _CommonNormal(float(theta), float(d), float(left[0, 3]), float(alpha), (float(angle), float(after)))


def _table(
    convention: Convention,
    rows: list[tuple[float, float, float, float]],
    chain: Chain,
    *,
    base: FloatArray,
    flange: FloatArray,
) -> DHTable:
    theta, d, a, alpha = np.array(rows).T
    return DHTable(convention, a, d, alpha, theta, chain.is_prismatic, base, flange, chain.tip_in_flange)
