"""Basis functions of errors that identification never offers, and the deflection of a beam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.arm.rigid_motions import cos_sin, cross_matrix
from truearm.identification.terms import ArmState, Basis
from truearm.identification.terms.basis import AXES
from truearm.identification.virtual.state import cage_phase_column
from truearm.typing import FloatArray


@dataclass(frozen=True)
class GravityForce(Basis):
    """A component of the weight outward of a joint, along the axes of the joint's place, at the nominal pose [N].

    Parameters
    ----------
    joint : int
        Counted from 1.
    axis : int
        0, 1, 2 for x, y, z.
    """

    joint: int
    axis: int

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"weight outward of J{self.joint} along {AXES[self.axis]}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) forces [N]."""
        return np.ascontiguousarray(state.gravity_loads.force_in_joint[None, :, self.joint - 1, self.axis])


@dataclass(frozen=True)
class CageHarmonics(Basis):
    """Cosine and sine of the angle of a joint's ball cage, which starts a session at a phase of its own.

    Parameters
    ----------
    joint : int
        Counted from 1.
    ratio : float
        Turns of the cage in a turn of the joint.
    """

    joint: int
    ratio: float

    def labels(self) -> tuple[str, ...]:
        """Two functions."""
        return (f"cos of the ball cage of J{self.joint}", f"sin of the ball cage of J{self.joint}")

    def values(self, state: ArmState) -> FloatArray:
        """(2, n) cosine and sine."""
        angle = self.ratio * state.angles[:, self.joint - 1] + state.columns[cage_phase_column(self.joint)]
        return np.stack(cos_sin(angle))


@dataclass(frozen=True)
class Spots(Basis):
    """Bumps of a joint's angle: Gaussians at centres evenly spaced around the turn.

    Parameters
    ----------
    joint : int
        Counted from 1.
    width_rad : float
        Standard deviation of a Gaussian [rad]. The centres are three widths apart.
    """

    joint: int
    width_rad: float

    @property
    def n_spots(self) -> int:
        """Number of centres."""
        return max(1, round(2 * np.pi / (3 * self.width_rad)))

    def labels(self) -> tuple[str, ...]:
        """One function for each centre."""
        return tuple(f"spot at {360 * k / self.n_spots:.4g} deg of J{self.joint}" for k in range(self.n_spots))

    def values(self, state: ArmState) -> FloatArray:
        """(n_spots, n) heights from 0 to 1."""
        centres = 2 * np.pi / self.n_spots * np.arange(self.n_spots)
        away = np.remainder(state.angles[:, self.joint - 1] - centres[:, None] + np.pi, 2 * np.pi) - np.pi
        return np.asarray(np.exp(-0.5 * (away / self.width_rad) ** 2))


@dataclass(frozen=True)
class GearErrors(Basis):
    """Errors of a gear's mesh: cosine, sine and two sawteeth of a multiple of a joint's angle, which may be no integer.

    Parameters
    ----------
    joint : int
        Counted from 1.
    ratio : float
        Periods in a turn of the joint.
    """

    joint: int
    ratio: float

    def labels(self) -> tuple[str, ...]:
        """Four functions."""
        return tuple(f"{what} {self.ratio:g} J{self.joint}" for what in ("cos", "sin", "sawtooth", "shifted sawtooth"))

    def values(self, state: ArmState) -> FloatArray:
        """(4, n) values from -1 to 1."""
        phase = self.ratio * state.angles[:, self.joint - 1]
        sawteeth = [np.remainder((phase + shift) / np.pi, 2.0) - 1.0 for shift in (0.0, np.pi / 2)]
        return np.stack([*cos_sin(phase), *sawteeth])


@dataclass(frozen=True)
class Slack(Basis):
    """Side of its slack on which a joint lies: the sign of the gravity torque about its axis, smooth where it is small.

    Parameters
    ----------
    joint : int
        Counted from 1.
    zone_Nm : float
        Torque that closes the gap to 76 % (tanh 1) [N m].
    """

    joint: int
    zone_Nm: float

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"side of the slack of J{self.joint}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) values from -1 to 1."""
        return np.asarray(np.tanh(state.gravity_torques[:, self.joint - 1, 2] / self.zone_Nm))[None]


@dataclass(frozen=True)
class CableDrag(Basis):
    """Torque of a cable that is led across a joint and the next one, and slips in its guides where it pulls strongly.

    A cable of unit length at the zeros of both joints (angles a, b [rad]) is stretched to ``s = sqrt(1 + a^2 + b^2 + a
    b)``. Its energy ``(s - 1)^2 / 2`` has the slope ``(s - 1) (a + b / 2) / s`` by a; slipping limits it as tanh does.

    Parameters
    ----------
    joint : int
        Counted from 1; the last joint of an arm has none.
    """

    joint: int

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"drag of the cable across J{self.joint} and J{self.joint + 1}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) values from -1 to 1."""
        a, b = state.angles[:, self.joint - 1], state.angles[:, self.joint]
        s = np.sqrt(1 + a**2 + b**2 + a * b)
        return np.asarray(np.tanh((s - 1) * (a + b / 2) / s))[None]


def beam(
    link_mm: FloatArray, *, own_share: float, bending_stiffness_Nm2: float, torsion_stiffness_Nm2: float
) -> FloatArray:
    """Motion at the start of a straight link that moves its far end as bending and torsion of the link do.

    Euler-Bernoulli beam, held at the start. With length L, direction u, torque M and weight F carried at the start, of
    which W is the link's own, spread evenly: slope ``(L M - L^2/2 u x (F - W) - L^2/3 u x W) / EI``, deflection
    ``(L^2/2 M - L^3/6 u x (F - W) - L^3/8 u x W) x u / EI``, twist ``L (u . M) u / GJ``.

    Parameters
    ----------
    link_mm : (3,) array
        From the joint to the link's far end, in the joint's frame [mm].
    own_share : float
        W / F.
    bending_stiffness_Nm2, torsion_stiffness_Nm2 : float
        E I and G J [N m^2]; infinite is stiff.

    Returns
    -------
    (6, 6) array
        Columns: torque [N m], force [N]; rows: rotation [rad], translation [mm].
    """
    length_m = float(np.linalg.norm(link_mm)) * 1e-3
    out = np.zeros((6, 6))
    if length_m == 0.0:
        return out
    u = np.asarray(link_mm, dtype=float) * 1e-3 / length_m
    across, cross_u = np.eye(3) - np.outer(u, u), cross_matrix(u)
    by_torque = length_m * across / bending_stiffness_Nm2
    by_force = -(length_m**2) * ((1 - own_share) / 2 + own_share / 3) * cross_u / bending_stiffness_Nm2
    out[:3, :3] = by_torque + length_m * np.outer(u, u) / torsion_stiffness_Nm2
    out[:3, 3:] = by_force
    # Deflection is a moment turned into a shift: v -> v x u.
    shift_by_torque = length_m**2 / 2 * across / bending_stiffness_Nm2
    shift_by_force = -(length_m**3) * ((1 - own_share) / 6 + own_share / 8) * cross_u / bending_stiffness_Nm2
    out[3:, :3] = -1e3 * cross_u @ shift_by_torque
    out[3:, 3:] = -1e3 * cross_u @ shift_by_force
    # The rotation about the joint already moves the far end by r x link: subtract that.
    out[3:] += cross_matrix(np.asarray(link_mm, dtype=float)) @ out[:3]
    return out
