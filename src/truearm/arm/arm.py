"""An articulated arm as its owner knows it: a nominal chain with names, limits and a pose to work in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truearm.arm.chain import Chain, FloatArray
from truearm.errors import InputError


@dataclass(frozen=True, eq=False)
class Arm:
    """A nominal articulated arm.

    Parameters
    ----------
    name : str
        Short name, as typed on the command line.
    chain : Chain
        Nominal kinematics, base frame to tip.
    title : str
        What it is, in a few words.
    joint_names : tuple of str, optional
        One a joint, base to tip. ``J1`` .. ``Jn`` by default.
    lower, upper : (n_joints,) array, optional
        Joint limits [rad, or mm for sliding joints]; infinite (no limit) by default.
    working_pose : (n_joints,) array, optional
        A pose in the middle of usual work [rad, or mm]; zeros by default.
    source : str
        Where the numbers come from.

    Raises
    ------
    InputError
        If a length does not fit the chain, limits are crossed, or the working pose lies outside them.
    """

    name: str
    chain: Chain
    title: str = ""
    joint_names: tuple[str, ...] = ()
    lower: FloatArray | None = None
    upper: FloatArray | None = None
    working_pose: FloatArray | None = None
    source: str = ""

    def __post_init__(self) -> None:
        n = self.chain.n_joints
        names = tuple(self.joint_names) or tuple(f"J{i + 1}" for i in range(n))
        if len(names) != n or len(set(names)) != n:
            raise InputError(f"arm {self.name!r} has {n} joints and needs as many different names, got {list(names)}")
        object.__setattr__(self, "joint_names", names)
        for field, default in (("lower", -np.inf), ("upper", np.inf), ("working_pose", 0.0)):
            given = getattr(self, field)
            value = np.full(n, default) if given is None else np.array(given, dtype=float)
            if value.shape != (n,) or np.isnan(value).any():
                raise InputError(f"arm {self.name!r}: {field} must be {n} numbers, got {given}")
            value.flags.writeable = False
            object.__setattr__(self, field, value)
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

    def __repr__(self) -> str:
        return f"Arm({self.name!r}, {self.n_joints} joints)"

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.chain.n_joints

    @property
    def limits(self) -> FloatArray:
        """(n_joints, 2) lower and upper limits [rad, or mm for sliding joints]."""
        assert self.lower is not None  # set in __post_init__
        assert self.upper is not None
        return np.stack([self.lower, self.upper], axis=1)

    @property
    def working(self) -> FloatArray:
        """(n_joints,) the working pose [rad, or mm for sliding joints]."""
        assert self.working_pose is not None  # set in __post_init__
        return self.working_pose

    def with_chain(self, chain: Chain) -> Arm:
        """Give the same arm other kinematics."""
        return replace(self, chain=chain)
