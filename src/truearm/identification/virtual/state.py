"""What a reading depends on besides its angles: where joints came from, how warm links are, how the hand presses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter
from scipy.special import dawsn

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.virtual.presets import Preset
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class VirtualArmState:
    """State of an arm at n readings.

    Attributes
    ----------
    direction : (n, n_joints) array
        Sign of each joint's last movement; 0 is half way between the two.
    link_temperature_degC : (n, n_joints + 1) array
        Of the stand and the links.
    force_in_flange_N : (n, 3) array
        On the tip, along the flange's axes.
    cage_phase : (n_joints,) array
        Where the ball cages stand at angle zero in this session [rad].
    """

    direction: FloatArray
    link_temperature_degC: FloatArray
    force_in_flange_N: FloatArray
    cage_phase: FloatArray

    def __len__(self) -> int:
        return len(self.direction)

    def rows(self, which: slice) -> VirtualArmState:
        """Select the readings that `which` says."""
        return VirtualArmState(
            self.direction[which], self.link_temperature_degC[which], self.force_in_flange_N[which], self.cage_phase
        )

    def with_force(self, force_in_flange_N: FloatArray) -> VirtualArmState:
        """Give the same under another force."""
        return replace(self, force_in_flange_N=np.broadcast_to(force_in_flange_N, self.force_in_flange_N.shape))


def at_rest(chain: Chain, n: int, *, temperature_degC: float = REFERENCE_DEGC) -> VirtualArmState:
    """State of n readings with no force, no direction of movement and links of one temperature."""
    return VirtualArmState(
        np.zeros((n, chain.n_joints)),
        np.full((n, chain.n_joints + 1), float(temperature_degC)),
        np.zeros((n, 3)),
        np.zeros(chain.n_joints),
    )


def link_temperatures(air_degC: FloatArray, lag_s: npt.ArrayLike, *, interval_s: float) -> FloatArray:
    """Temperatures that follow the air with first-order lags, from balance at the first reading.

    Parameters
    ----------
    air_degC : (n,) array
        Air at each reading [degC].
    lag_s : (n_links,) array
        Time constants [s]; 0 follows at once.
    interval_s : float
        Between readings [s].

    Returns
    -------
    (n, n_links) array
        [degC].
    """
    out = np.empty((len(air_degC), len(np.asarray(lag_s))))
    for link, lag in enumerate(np.asarray(lag_s, dtype=float)):
        kept = float(np.exp(-interval_s / lag)) if lag > 0 else 0.0
        # T_k = kept T_{k-1} + (1 - kept) air_k, counted from the first reading's air.
        out[:, link] = air_degC[0] + lfilter([1 - kept], [1, -kept], air_degC - air_degC[0])
    return out


def air_temperatures(n: int, preset: Preset, stream: np.random.Generator) -> FloatArray:
    """Air of a session: a slow swing about the preset's mean from a random phase, (n,) [degC]."""
    time_s = np.arange(n) * preset.reading_interval_s
    phase = stream.uniform(0, 2 * np.pi)
    swing = np.sin(2 * np.pi * time_s / preset.temperature_period_s + phase)
    air: FloatArray = preset.temperature_degC + preset.temperature_swing_K * swing
    return air


def given_temperatures(temperature_degC: npt.ArrayLike, n: int) -> FloatArray:
    """Air as the caller states it: one number or one a reading, (n,) [degC]."""
    air = np.asarray(temperature_degC, dtype=float)
    if air.shape not in ((), (n,)) or not np.isfinite(air).all():
        raise InputError(f"expected one temperature or {n} finite ones in degC, got shape {air.shape}")
    return np.broadcast_to(air, (n,)).copy()


def hand_forces(preset: Preset, n: int, stream: np.random.Generator) -> FloatArray:
    """Draw forces of the part on the tip, (n, 3) [N]: back along the stylus (the flange's z axis), tilted."""
    size = np.maximum(0.0, preset.force_mean_N + preset.force_std_N * stream.standard_normal(n))
    tilt = np.radians(preset.force_tilt_deg) * stream.standard_normal((n, 2))
    angle = np.linalg.norm(tilt, axis=1)
    normal = np.column_stack([np.sinc(angle / np.pi)[:, None] * tilt, -np.cos(angle)])
    force: FloatArray = size[:, None] * normal
    return force


def mean_hand_force(preset: Preset) -> FloatArray:
    """Mean of `hand_forces`, (3,) [N]; forces below zero, which it cuts off, are taken as rare.

    The tilt's angle has a Rayleigh distribution, whose mean cosine is ``1 - sqrt(2) s D(s / sqrt(2))`` with Dawson's
    integral D.
    """
    s = np.radians(preset.force_tilt_deg)
    mean_cosine = float(1 - np.sqrt(2) * s * dawsn(s / np.sqrt(2)))
    return np.array([0.0, 0.0, -preset.force_mean_N * mean_cosine])
