"""State of a virtual arm at a reading apart from its angles: directions, link temperatures, force, ball cages, base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.special import dawsn

from truearm.arm import Arm, Chain
from truearm.errors import InputError
from truearm.identification.terms import ArmState, LinkMasses, uniform_links
from truearm.identification.terms.basis import AXES
from truearm.identification.terms.links import STANDARD_GRAVITY
from truearm.typing import FloatArray
from truearm.wings.planning.virtual.presets import ARCSEC, Preset

# First words of the families of streams: an arm and a session of the same seed share no random numbers.
_FAMILIES = {"arm": 1, "session": 2}


def random_stream(family: str, seed: int, what: str) -> np.random.Generator:
    """Return the random numbers of one quantity of an arm or a session.

    Every quantity has a stream of its own, so that a change of one leaves the draws of the others.
    """
    return np.random.default_rng([_FAMILIES[family], seed, *what.encode()])


def link_masses(arm: Arm, preset: Preset) -> LinkMasses:
    """Return the arm's own masses if they are known, else straight links of the preset's mass per length."""
    return uniform_links(arm.chain, kg_per_m=preset.link_kg_per_m) if arm.masses is None else arm.masses


def radian_of(chain: Chain) -> FloatArray:
    """(n_joints,) what is as large as a radian [rad, or mm]: a third of the reach where a joint slides."""
    return np.where(chain.is_prismatic, chain.reach / 3, 1.0)


def virtual_state(
    arm: Arm,
    preset: Preset,
    angles: FloatArray,
    *,
    directions: npt.ArrayLike = 0.0,
    link_temperature_degC: npt.ArrayLike | None = None,
    force_in_flange_N: npt.ArrayLike | None = None,
    cage_phase: npt.ArrayLike = 0.0,
    base_motion: npt.ArrayLike = 0.0,
) -> ArmState:
    """State of a virtual arm at n readings.

    Parameters
    ----------
    arm : Arm
        Nominal.
    preset : Preset
        Its masses, mean temperature and mean force are the defaults.
    angles : (n, n_joints) array
        [rad].
    directions : (n, n_joints) array
        Sign of each joint's last movement; 0 is half way between the two.
    link_temperature_degC : (n, n_joints + 1) array, optional
        Of the stand and the links.
    force_in_flange_N : (n, 3) array, optional
        On the tip, along the axes of the flange.
    cage_phase : (n_joints,) array
        Angles of the ball cages at joint angle zero in this session [rad].
    base_motion : (n, 6) array
        Of the base since the arm was identified: rotation [rad], translation [mm].
    """
    n, n_joints = angles.shape
    temperature = preset.temperature_degC if link_temperature_degC is None else link_temperature_degC
    phases = np.broadcast_to(cage_phase, n_joints)
    force = mean_hand_force(preset) if force_in_flange_N is None else force_in_flange_N
    columns = {cage_phase_column(joint): np.full(n, phase) for joint, phase in enumerate(phases, start=1)}
    moved = np.broadcast_to(base_motion, (n, 6))
    columns |= {base_motion_column(component): moved[:, component] for component in range(6)}
    return ArmState(
        arm.chain,
        angles,
        np.broadcast_to(temperature, (n, n_joints + 1)),
        np.broadcast_to(directions, angles.shape),
        columns | _force_columns(force, n),
        link_masses(arm, preset),
        STANDARD_GRAVITY * arm.gravity_direction,
    )


def with_force(state: ArmState, force_in_flange_N: npt.ArrayLike) -> ArmState:
    """Replace the force on the tip, (3,) or (n, 3) [N]."""
    return replace(state, columns={**state.columns, **_force_columns(force_in_flange_N, len(state))})


def _force_columns(force_in_flange_N: npt.ArrayLike, n: int) -> dict[str, FloatArray]:
    force = np.broadcast_to(force_in_flange_N, (n, 3))
    return {force_column(axis): force[:, axis] for axis in range(3)}


def force_column(axis: int) -> str:
    """Name of the column of `ArmState` with the force on the tip along an axis of the flange [N]."""
    return f"tip_force_{AXES[axis]}_N"


def cage_phase_column(joint: int) -> str:
    """Name of the column of `ArmState` with the phase of a joint's ball cage [rad]."""
    return f"cage_phase_{joint}_rad"


def base_motion_column(component: int) -> str:
    """Name of the column of `ArmState` with a component of the base's motion [rad, or mm]."""
    return f"base_{'turn' if component < 3 else 'shift'}_{AXES[component % 3]}_{'rad' if component < 3 else 'mm'}"


def base_motions(n: int, preset: Preset, stream: np.random.Generator) -> FloatArray:
    """Draw the motion of the base at the readings of a session, (n, 6) [rad, mm].

    The base starts a session where it has settled, and then creeps: a random walk (Wiener process) in time.
    """
    settled = 1e-3 * preset.base_settling_um * stream.standard_normal(3)
    hours = preset.reading_interval_s / 3600
    steps = np.sqrt(hours) * stream.standard_normal((n, 6))
    steps[0] = 0.0
    walk: FloatArray = np.cumsum(steps, axis=0)
    walk[:, :3] *= preset.base_creep_arcsec_per_sqrt_h * ARCSEC
    walk[:, 3:] *= preset.base_creep_um_per_sqrt_h * 1e-3
    walk[:, 3:] += settled
    return walk


def air_temperatures(n: int, preset: Preset, stream: np.random.Generator) -> FloatArray:
    """Draw the air temperature of a session: a slow swing about the preset's mean, of random phase, (n,) [degC]."""
    time_s = np.arange(n) * preset.reading_interval_s
    phase = stream.uniform(0, 2 * np.pi)
    swing = np.sin(2 * np.pi * time_s / preset.temperature_period_s + phase)
    return np.asarray(preset.temperature_degC + preset.temperature_swing_K * swing)


def given_temperatures(temperature_degC: npt.ArrayLike, n: int) -> FloatArray:
    """Air temperature from one number or one per reading, (n,) [degC]."""
    air = np.asarray(temperature_degC, dtype=float)
    if air.shape not in ((), (n,)) or not np.isfinite(air).all():
        raise InputError(f"expected one temperature or {n} finite ones in degC, got shape {air.shape}")
    return np.broadcast_to(air, (n,)).copy()


def hand_forces(preset: Preset, n: int, stream: np.random.Generator) -> FloatArray:
    """Draw forces of the part on the tip, (n, 3) [N]: against the stylus (the z axis of the flange), tilted."""
    size = np.maximum(0.0, preset.force_mean_N + preset.force_std_N * stream.standard_normal(n))
    tilt = np.radians(preset.force_tilt_deg) * stream.standard_normal((n, 2))
    angle = np.linalg.norm(tilt, axis=1)
    normal = np.column_stack([np.sinc(angle / np.pi)[:, None] * tilt, -np.cos(angle)])
    return np.asarray(size[:, None] * normal)


def mean_hand_force(preset: Preset) -> FloatArray:
    """Mean of `hand_forces`, (3,) [N]; forces below zero, which it cuts off, are assumed to be rare.

    The tilt's angle has a Rayleigh distribution, whose mean cosine is ``1 - sqrt(2) s D(s / sqrt(2))`` with Dawson's
    integral D.
    """
    s = np.radians(preset.force_tilt_deg)
    mean_cosine = float(1 - np.sqrt(2) * s * dawsn(s / np.sqrt(2)))
    return np.array([0.0, 0.0, -preset.force_mean_N * mean_cosine])
