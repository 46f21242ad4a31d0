"""The nominal arm: a chain with joint names, limits, working pose, masses of links; the zeros of an identified one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.arm.chain import Chain, Pose
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.inverse_kinematics import InverseKinematicsResult, solve_inverse_kinematics
from truearm.arm.nearest_table import drawn_convention, drawn_table, nearest_table
from truearm.arm.rigid_motions import screw_z
from truearm.errors import InputError
from truearm.printable_text import printable, printable_name
from truearm.typing import FloatArray

# A hundred tonnes, a kilometre: larger numbers have a wrong unit.
MAX_KG = 1e5
MAX_CENTRE_MM = 1e6
COLUMNS = ("theta", "alpha", "beta", "a", "d", "b")


@dataclass(frozen=True, eq=False)
class LinkMasses:
    """Masses of the moving links.

    Parameters
    ----------
    mass_kg : (n_joints,) array
        Mass of the link that moves with joint i (from joint i to joint i + 1, the last one to the tip).
    centre_in_joint_mm : (n_joints, 3) array
        Its centre of mass in the frame of place i (see `truearm.arm.chain`).

    Raises
    ------
    InputError
        If the shapes do not fit, a number is not finite, a mass is negative, or one is beyond 100 t or 1 km.
    """

    mass_kg: FloatArray
    centre_in_joint_mm: FloatArray

    def __post_init__(self) -> None:
        mass, centre = np.array(self.mass_kg, dtype=float), np.array(self.centre_in_joint_mm, dtype=float)
        if mass.ndim != 1 or centre.shape != (len(mass), 3):
            raise InputError(f"expected n masses and (n, 3) centres of mass, got {mass.shape} and {centre.shape}")
        if not (np.isfinite(mass).all() and np.isfinite(centre).all() and (mass >= 0).all()):
            raise InputError(f"masses must be finite and not negative and their centres finite, got masses {mass} kg")
        if mass.max(initial=0.0) > MAX_KG or np.abs(centre).max(initial=0.0) > MAX_CENTRE_MM:
            raise InputError(
                f"expected masses of at most {MAX_KG:g} kg with centres within {MAX_CENTRE_MM:g} mm, got up to "
                f"{mass.max():g} kg and {np.abs(centre).max():g} mm",
                hint="check their units",
            )
        for name, value in (("mass_kg", mass), ("centre_in_joint_mm", centre)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)


class PointMass(NamedTuple):
    """A mass that moves with a joint.

    Attributes
    ----------
    joint : int
        Counted from 1.
    mass_kg : float
    centre_in_joint_mm : (3,) array
        In the frame of the joint's place.
    """

    joint: int
    mass_kg: float
    centre_in_joint_mm: FloatArray


def combine_point_masses(lumps: Iterable[PointMass], n_joints: int) -> LinkMasses:
    """Combine point masses to masses of links; a link without any has mass zero."""
    mass, moment = np.zeros(n_joints), np.zeros((n_joints, 3))
    for lump in lumps:
        mass[lump.joint - 1] += lump.mass_kg
        moment[lump.joint - 1] += lump.mass_kg * lump.centre_in_joint_mm
    return LinkMasses(mass, moment / np.where(mass > 0, mass, 1.0)[:, None])


def table_changes(chain: Chain, arm: Arm, *, free: Sequence[str] = ("base", "tip")) -> dict[str, FloatArray]:
    """By how much the constants of an identified chain differ from those of the drawing, row by row.

    What no reading of the tip separates from a free base or tip, as the zero of the first joint and of the last, does
    not differ (see `nearest_table`).

    Parameters
    ----------
    chain : Chain
        The identified one.
    arm : Arm
        The nominal one.
    free : sequence of str
        Which of ``"base"`` and ``"tip"`` are unknown.

    Returns
    -------
    dict of str to (n_joints,) array
        theta, alpha, beta [rad], a, d, b [mm].

    Raises
    ------
    InputError
        If an axis is far from that of the drawing.
    """
    convention = drawn_convention(arm.chain)
    found, drawn = nearest_table(chain, arm.chain, convention=convention, free=free), drawn_table(arm.chain, convention)
    return {name: getattr(found, name) - getattr(drawn, name) for name in COLUMNS}


def joint_zeros(chain: Chain, arm: Arm, *, free: Sequence[str] = ("base", "tip")) -> FloatArray:
    """(n_joints,) what is to be added to the angles of a nominal arm, or to its thetas [rad; of sliding joints mm, d].

    Parameters and errors are those of `table_changes`.
    """
    changes = table_changes(chain, arm, free=free)
    return np.where(arm.chain.is_prismatic, changes["d"], changes["theta"])


def with_zeros(arm: Arm, zeros: FloatArray) -> Arm:
    """The nominal arm with zeros (n_joints,) added to its own [rad; of sliding joints mm]; all else is unchanged."""
    fixed = arm.chain.fixed.copy()
    for joint, (zero, slides) in enumerate(zip(zeros.tolist(), arm.chain.is_prismatic, strict=True), 1):
        fixed[joint] = screw_z(*((0.0, zero) if slides else (zero, 0.0))) @ fixed[joint]
    return replace(arm, chain=replace(arm.chain, fixed=fixed), table=None)


# Metadata of a field that model files do not keep.
NOT_KEPT = "not kept in a model file"


@dataclass(frozen=True, eq=False)
class Arm:
    """A nominal articulated arm.

    Parameters
    ----------
    name : str
        Short name, for the command line.
    chain : Chain
        Nominal kinematics, base frame to tip.
    title : str
        Description in a few words.
    joint_names : tuple of str, optional
        One a joint, base to tip. ``J1`` .. ``Jn`` by default.
    lower, upper : (n_joints,) array, optional
        Joint limits [rad, or mm for sliding joints]; infinite (no limit) by default.
    working_pose : (n_joints,) array, optional
        A typical pose in use [rad, or mm]; zeros by default.
    source : str
        Source of the numbers.
    masses : LinkMasses, optional
        Masses of its links, if known. Masses that are all zero count as unknown: descriptions of arms often have zeros
        in place of numbers.
    gravity_in_base : (3,) array, optional
        Direction of gravity in the base frame: -z by default, as on an upright arm. Its length does not matter; it is
        stored as a unit vector.
    serial_number : str
        Of this unit among the arms of its type; empty if it is not stated.
    nominal_error_mm : float
        Error of the nominal arm at the tip, if it is known to be larger than usual [mm]: a model is fitted to readings
        that the arm misses by up to twice as much. 0 if nothing is stated.
    table : DHTable, optional
        The table that the chain was built from, as its file states it; not kept in a model file. It counts only as long
        as it is that of the chain.
    remarks : tuple of str
        What was assumed when its file was read; not kept in a model file.

    Raises
    ------
    InputError
        If a length does not fit the chain, limits are crossed, the working pose lies outside them, or gravity has no
        direction.

    Examples
    --------
    >>> import truearm as ta
    >>> arm = ta.load_arm("ur10")
    >>> arm.n_joints, arm.joint_names[0]
    (6, 'J1')
    >>> there = arm.forward([arm.working])
    >>> bool(arm.inverse(there.tip_in_base, there.R_base_tip).reached[0])
    True
    """

    name: str
    chain: Chain
    title: str = ""
    joint_names: tuple[str, ...] = ()
    lower: FloatArray | None = None
    upper: FloatArray | None = None
    working_pose: FloatArray | None = None
    source: str = ""
    masses: LinkMasses | None = None
    gravity_in_base: FloatArray | None = None
    serial_number: str = ""
    nominal_error_mm: float = 0.0
    table: DHTable | None = field(default=None, repr=False, metadata={NOT_KEPT: True})
    remarks: tuple[str, ...] = field(default=(), repr=False, metadata={NOT_KEPT: True})

    def __post_init__(self) -> None:
        for name in ("name", "title"):
            object.__setattr__(self, name, printable_name(getattr(self, name)))
        object.__setattr__(self, "source", printable(self.source))
        n = self.chain.n_joints
        names = tuple(self.joint_names) or tuple(f"J{i + 1}" for i in range(n))
        if len(names) != n or len(set(names)) != n:
            raise InputError(f"arm {self.name!r} has {n} joints and needs as many different names, got {list(names)}")
        object.__setattr__(self, "joint_names", names)
        for name, default in (("lower", -np.inf), ("upper", np.inf), ("working_pose", 0.0)):
            given = getattr(self, name)
            value = np.full(n, default) if given is None else np.array(given, dtype=float)
            if value.shape != (n,) or np.isnan(value).any():
                raise InputError(f"arm {self.name!r}: {name} must be {n} numbers, got {given}")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        lower, upper = self.limits.T
        if not (lower < upper).all():
            joint = names[int(np.argmin(lower < upper))]
            raise InputError(
                f"arm {self.name!r}: the lower limit of {joint} must be below the upper one",
                hint='describe a joint that cannot move as type = "fixed"',
            )
        inside = (self.working >= lower) & (self.working <= upper)
        if not inside.all():
            raise InputError(
                f"arm {self.name!r}: the working pose of {names[int(np.argmin(inside))]} is outside its limits"
            )

        if not 0 <= self.nominal_error_mm < np.inf:
            raise InputError(
                f"arm {self.name!r}: expected nominal_error_mm of 0 or more, got {self.nominal_error_mm!r:.30}"
            )
        if self.masses is not None and len(self.masses.mass_kg) != n:
            raise InputError(f"arm {self.name!r} has {n} joints and needs as many masses, got {self.masses.mass_kg}")
        if self.masses is not None and not self.masses.mass_kg.any():
            object.__setattr__(self, "masses", None)
        object.__setattr__(self, "gravity_in_base", self._unit_gravity())

    def _unit_gravity(self) -> FloatArray:
        given = (0.0, 0.0, -1.0) if self.gravity_in_base is None else self.gravity_in_base
        gravity = np.array(given, dtype=float)
        largest = float(np.abs(gravity).max(initial=0.0))
        if gravity.shape != (3,) or not 1e-9 < largest < 1e9:
            raise InputError(
                f"arm {self.name!r}: expected gravity as a direction of three numbers, got {given}",
                hint="[0, 0, -1] on a table or floor, [0, 0, 1] on a ceiling",
            )
        length = float(np.linalg.norm(gravity))
        if abs(length - 1) > 1e-15:  # a unit vector is not changed, to the last bit
            gravity = gravity / length
        gravity.flags.writeable = False
        return gravity

    def __repr__(self) -> str:
        return f"Arm({self.name!r}, {self.n_joints} joints)"

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.chain.n_joints

    @property
    def joint_labels(self) -> list[str]:
        """Number and name of each joint: J1, J2 shoulder."""
        return [name if name == f"J{i}" else f"J{i} {name}" for i, name in enumerate(self.joint_names, start=1)]

    @property
    def joint_units(self) -> list[str]:
        """In what people read each joint: mm of one that slides, deg of one that turns."""
        return ["mm" if slides else "deg" for slides in self.chain.is_prismatic]

    @property
    def has_kinematics(self) -> bool:
        """Whether the chain describes an arm; False if only the number and kind of the joints are known."""
        return bool((self.chain.fixed != np.eye(4)).any() or self.chain.tip_in_flange.any())

    @cached_property
    def limits(self) -> FloatArray:
        """(n_joints, 2) lower and upper limits [rad, or mm for sliding joints]."""
        assert self.lower is not None  # set in __post_init__
        assert self.upper is not None
        limits = np.stack([self.lower, self.upper], axis=1)
        limits.flags.writeable = False
        return limits

    @property
    def working(self) -> FloatArray:
        """(n_joints,) the working pose [rad, or mm for sliding joints]."""
        assert self.working_pose is not None  # set in __post_init__
        return self.working_pose

    @property
    def gravity_direction(self) -> FloatArray:
        """(3,) unit vector of gravity in the base frame."""
        assert self.gravity_in_base is not None  # set in __post_init__
        return self.gravity_in_base

    def forward(self, angles: npt.ArrayLike) -> Pose:
        """Poses of the nominal arm: forward kinematics.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad, or mm for sliding joints]; also beyond the limits.

        Returns
        -------
        Pose
            ``tip_in_base`` (n, 3) [mm]; ``R_base_tip`` (n, 3, 3), the axes of the flange in the base frame as columns.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        return self.chain.pose(angles)

    def jacobian(self, angles: npt.ArrayLike) -> FloatArray:
        """Derivatives of the nominal arm's poses by its joints: the geometric Jacobian.

        Parameters
        ----------
        angles : (n, n_joints) array
            Joint angles [rad, or mm for sliding joints].

        Returns
        -------
        (n, 6, n_joints) array
            Translation of the tip [mm], then rotation of the flange [rad], along the axes of the base frame, per rad or
            mm of the joint.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        return self.chain.pose_jacobians(angles)[1]

    def inverse(
        self, tip_in_base: npt.ArrayLike, R_base_tip: npt.ArrayLike | None = None, *, start: npt.ArrayLike | None = None
    ) -> InverseKinematicsResult:
        """Joint angles within the limits that bring the tip of the nominal arm to targets: inverse kinematics.

        A local method, `truearm.arm.solve_inverse_kinematics`: the solution belongs to the configuration of the start
        where that reaches the target. Nothing is reached by chance: see ``reached``.

        Parameters
        ----------
        tip_in_base : (n, 3) array
            Targets [mm].
        R_base_tip : (3, 3) or (n, 3, 3) array, optional
            Orientation of the flange there; any by default. Arms of fewer than six joints reach few of them.
        start : (n_joints,) or (n, n_joints) array, optional
            Joint angles to start from [rad, or mm]. By default the working pose and, for targets that are not reached
            from there, others all over the joint ranges.

        Returns
        -------
        InverseKinematicsResult
            ``angles`` (n, n_joints), ``reached`` (n,), and the errors that remain, ``distance_mm`` and ``angle_rad``.

        Raises
        ------
        InputError
            If shapes do not fit, a number is not finite, or an orientation is no rotation.
        """
        lower, upper = self.limits.T
        solve = partial(solve_inverse_kinematics, self.chain, lower=lower, upper=upper)
        found = solve(tip_in_base, R_base_tip=R_base_tip, start=self.working if start is None else start)
        tips, R = np.asarray(tip_in_base, dtype=float), None if R_base_tip is None else np.asarray(R_base_tip)
        for other in self._further_starts() if start is None else ():
            if not len(rows := np.flatnonzero(~found.reached)):
                break
            again = solve(tips[rows], R_base_tip=R if R is None or R.ndim == 2 else R[rows], start=other)
            found = found.replaced(rows[again.reached], again.rows(again.reached))
        return found

    def _further_starts(self) -> FloatArray:
        """(20, n_joints) joint angles all over the ranges; those of joints without limits are a turn, or the reach."""
        width = np.where(self.chain.is_prismatic, self.chain.reach, np.pi)
        lower, upper = np.where(np.isfinite(self.limits.T), self.limits.T, self.working + [-width, width])
        return np.random.default_rng(0).uniform(lower, upper, (20, self.n_joints))
