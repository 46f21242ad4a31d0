"""The state of an arm at n readings: all that its small motions may depend on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm, LinkMasses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms.links import (
    STANDARD_GRAVITY,
    STANDARD_GRAVITY_IN_BASE,
    GravityLoads,
    gravity_loads,
    loads_per_kg_at_tip,
    uniform_links,
)
from truearm.readings.readings import PAYLOAD
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray


@dataclass(frozen=True, eq=False)
class ArmState:
    """State of an arm at n readings, the argument of every basis function.

    Parameters
    ----------
    chain : Chain
        Nominal kinematics in the base frame of the arm, not in that of a reference: it defines gravity and the stand.
    angles : (n, n_joints) array
        Joint angles [rad], displacements of prismatic joints [mm]; those of the encoders where joints are coupled.
    temperature_degC : (n,) or (n, n_joints + 1) array, optional
        Of the arm, or of the stand and each link [degC].
    directions : (n, n_joints) array, optional
        Sign of each joint's last movement: -1, 1, or 0 where it is unknown.
    columns : mapping of str to (n,) array
        Further columns of the session by name, in the units that the names state.
    links : LinkMasses, optional
        Masses of the links; 1 kg/m by default: the pattern of the torques is then a guess, and the coefficients
        determine their size.
    session : (n,) array of str, optional
        Name of the session of each reading; None: the session in whose frame the chain is.
    tip : (n,) array of str, optional
        Name of the tip of each reading; None: the first of the arm's tips.
    angle_std : (n_joints,) array, optional
        Standard uncertainty of the angles as they were read, from rounding [rad, or mm]; None where it is negligible.
    stride : float
        Readings of the session from one of these to the next: more than 1 in a sample.
    gravity_in_base : (3,) array
        Acceleration of free fall along the base frame's axes [m/s^2]; of an upright arm by default.

    Raises
    ------
    InputError
        If a shape does not match or a number is not finite.
    """

    chain: Chain
    angles: FloatArray
    temperature_degC: FloatArray | None = None
    directions: FloatArray | None = None
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    links: LinkMasses | None = None
    gravity_in_base: FloatArray = field(default_factory=lambda: np.array(STANDARD_GRAVITY_IN_BASE))
    session: NameArray | None = None
    tip: NameArray | None = None
    angle_std: FloatArray | None = None
    stride: float = 1.0

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, dtype=float)
        n_joints = self.chain.n_joints
        if angles.ndim != 2 or angles.shape[1] != n_joints:
            raise InputError(f"expected angles of shape (n, {n_joints}), got {angles.shape}")
        n = len(angles)
        checked: dict[str, object] = {"angles": _finite(angles, "angles")}
        if self.temperature_degC is not None:
            checked["temperature_degC"] = _fitting(self.temperature_degC, "temperatures", ((n,), (n, n_joints + 1)))
        if self.directions is not None:
            directions = _fitting(self.directions, "directions", ((n, n_joints),))
            if (np.abs(directions) > 1).any():
                raise InputError("expected directions of movement between -1 and 1")
            checked["directions"] = directions
        checked["columns"] = {
            name: _fitting(column, f"column {name!r}", ((n,),)) for name, column in self.columns.items()
        }
        if self.session is not None:
            checked["session"] = np.asarray(self.session, dtype=np.str_)
            if np.shape(self.session) != (n,):
                raise InputError(f"expected sessions of shape {(n,)}, got {np.shape(self.session)}")
        if self.tip is not None:
            checked["tip"] = np.asarray(self.tip, dtype=np.str_)
            if np.shape(self.tip) != (n,):
                raise InputError(f"expected tips of shape {(n,)}, got {np.shape(self.tip)}")
        checked["gravity_in_base"] = _fitting(self.gravity_in_base, "gravity", ((3,),))
        if self.angle_std is not None:
            checked["angle_std"] = _fitting(self.angle_std, "uncertainties of angles", ((n_joints,),))
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, arm: Arm, angles: npt.ArrayLike, **more: Any) -> Self:
        """State of an arm, with its masses and the direction of its weight, at angles (n, n_joints) [rad, or mm].

        `more` are `temperature_degC`, `directions`, `columns`, `session`, `tip` and `stride`.
        """
        gravity = STANDARD_GRAVITY * arm.gravity_direction
        return cls(arm.chain, np.asarray(angles, dtype=float), links=arm.masses, gravity_in_base=gravity, **more)

    def __len__(self) -> int:
        return len(self.angles)

    def rows(self, which: slice | BoolArray | IntArray) -> ArmState:
        """Select readings; all of them in their order, by their numbers or as a slice, are the state itself."""
        if which == slice(0, len(self)) if isinstance(which, slice) else _are_all(which, len(self)):
            return self
        return ArmState(
            self.chain,
            self.angles[which],
            None if self.temperature_degC is None else self.temperature_degC[which],
            None if self.directions is None else self.directions[which],
            {name: column[which] for name, column in self.columns.items()},
            self.links,
            self.gravity_in_base,
            None if self.session is None else self.session[which],
            None if self.tip is None else self.tip[which],
            self.angle_std,
            self.stride,
        )

    def at_temperature(self, degC: FloatArray) -> ArmState:
        """The state at another temperature [degC], (n,) or (n, n_joints + 1); it keeps the loads of the weight."""
        other = replace(self, temperature_degC=degC)
        if "gravity_loads" in vars(self):
            vars(other)["gravity_loads"] = self.gravity_loads
        return other

    @cached_property
    def joint_angles(self) -> FloatArray:
        """(n, n_joints) angles of the joints [rad, or mm]: those of the encoders, if none are coupled."""
        return self.chain.joint_angles(self.angles)

    @property
    def gravity_torques(self) -> FloatArray:
        """(n, n_joints, 3) torque of the weight at every joint, along the axes of its place [N m]."""
        return self.gravity_loads.torque_in_joint

    @cached_property
    def gravity_loads(self) -> GravityLoads:
        """Torque and force of the weight at every joint, with that of the payload where the arm's masses are known.

        Where they are not, torques are those of assumed masses: a payload in kg does not fit them.
        """
        links = _guessed_links(self.chain) if self.links is None else self.links
        own = gravity_loads(self.chain, self.angles, links, gravity_in_base=self.gravity_in_base)
        if self.links is None or PAYLOAD not in self.columns:
            return own
        kg = self.columns[PAYLOAD][:, None, None]
        return GravityLoads(*(of_arm + kg * by_kg for of_arm, by_kg in zip(own, self.loads_per_kg, strict=True)))

    @cached_property
    def loads_per_kg(self) -> GravityLoads:
        """Torque and force at every joint by a payload of 1 kg at the nominal tip [N m/kg, N/kg]."""
        return loads_per_kg_at_tip(self.chain, self.angles, gravity_in_base=self.gravity_in_base)


@lru_cache(maxsize=64)
def _guessed_links(chain: Chain) -> LinkMasses:
    return uniform_links(chain, kg_per_m=1.0)


def _are_all(which: BoolArray | IntArray, n: int) -> bool:
    """Whether numbers of readings are those of n, in their order."""
    return which.dtype != bool and np.array_equal(which, np.arange(n))


def _fitting(value: npt.ArrayLike, what: str, shapes: tuple[tuple[int, ...], ...]) -> FloatArray:
    array = np.asarray(value, dtype=float)
    if array.shape not in shapes:
        raise InputError(f"expected {what} of shape {' or '.join(map(str, shapes))}, got {array.shape}")
    return _finite(array, what)


def _finite(array: FloatArray, what: str) -> FloatArray:
    if np.count_nonzero(np.isfinite(array)) < array.size:  # of a single pose half the time of `all`
        raise InputError(f"expected finite {what}, got NaN or infinity")
    return array
