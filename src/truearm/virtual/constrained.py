"""Draw only arms that err as a known arm does.

NIST's constrained Monte Carlo (Phillips and others) keeps, out of many virtual machines, those whose simulated test
gives the results of the real one. The test here is the founding paper's: errors of the nominal model in a box of poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.virtual.motions import true_tips
from truearm.virtual.presets import Preset
from truearm.virtual.state import State, at_rest, mean_hand_force
from truearm.virtual.systematic import Systematic, draw_constants, geometry_stream

FloatArray = npt.NDArray[np.float64]

TESTS = 30  # the maximum over 200 random poses scatters by some per cent: so many tests must agree
TRIES = 20_000
BATCH = 50


@dataclass(frozen=True)
class _Test:
    """The nominal model's test: poses, and how their errors follow from geometry to first order."""

    chain_errors: FloatArray  # (m, 3) of everything but geometry [mm]
    by_constant: FloatArray  # (n_places, 6, m, 3)
    angles: FloatArray
    state: State


def constrain_geometry(arm: Arm, systematic: Systematic, preset: Preset, *, seed: int) -> Systematic:
    """Replace the geometry by the first drawn whose test results are the preset's.

    Geometry is drawn again and again from the arm's stream. Scaling a draw settles the mean error; the draw is kept if
    the maxima of thirty tests are then all within the preset's tolerance.

    Raises
    ------
    InputError
        If none out of 20,000 draws is, or the other classes alone already err more than the mean asked for.
    """
    test = _prepare(arm, systematic, preset)
    stream = geometry_stream(seed)
    other_mean = np.abs(test.chain_errors).mean()
    if other_mean >= preset.nominal_mean_mm:
        raise InputError(
            f"preset {preset.name!r} asks for a nominal error of {preset.nominal_mean_mm} mm, but without any error of "
            f"geometry arm {arm.name!r} already errs by {other_mean:.3f} mm",
            hint="smaller magnitudes of the other classes, or a larger nominal_mean_mm",
        )
    for _ in range(TRIES // BATCH):
        batch = np.stack([draw_constants(arm.chain, preset, stream) for _ in range(BATCH)])
        for few in (3, TESTS):  # most draws fail in the first tests
            batch = _likely(test, batch, preset, n_tests=few)
        for constants in batch:
            scaled, maxima = _scaled(arm, systematic, test, constants, preset)
            if np.abs(maxima - preset.nominal_max_mm).max() <= preset.nominal_max_tolerance_mm:
                return systematic.with_constants(scaled)
    raise InputError(
        f"none of {TRIES} draws of arm {arm.name!r} errs by {preset.nominal_mean_mm} mm on average and "
        f"{preset.nominal_max_mm} mm at most, as preset {preset.name!r} asks",
        hint="another nominal_max_mm, or a larger nominal_max_tolerance_mm",
    )


def box_sample(arm: Arm, n: int, *, half_width_rad: float) -> FloatArray:
    """Draw the same random poses each time about the working pose, inside the limits, (n, n_joints)."""
    lower = np.maximum(arm.working - half_width_rad, arm.limits[:, 0])
    upper = np.minimum(arm.working + half_width_rad, arm.limits[:, 1])
    return np.random.default_rng([*b"constraint"]).uniform(lower, upper, (n, arm.n_joints))


def _prepare(arm: Arm, systematic: Systematic, preset: Preset) -> _Test:
    n = TESTS * preset.constraint_poses
    angles = box_sample(arm, n, half_width_rad=np.radians(preset.constraint_half_width_deg))
    state = at_rest(arm.chain, n, temperature_degC=preset.temperature_degC).with_force(mean_hand_force(preset))
    small = arm.chain.small_motions(angles)
    without_geometry = systematic.with_constants(np.zeros_like(systematic.constants))
    errors = true_tips(arm.chain, without_geometry, angles, state) - small.tip_in_base
    return _Test(errors, small.by_motion.transpose(1, 2, 0, 3), angles, state)


def _likely(test: _Test, batch: FloatArray, preset: Preset, *, n_tests: int) -> FloatArray:
    """Keep the draws that pass `n_tests` to first order, which is good to some um, with a larger tolerance."""
    poses = slice(0, n_tests * preset.constraint_poses)
    geometric = np.tensordot(batch, test.by_constant[:, :, poses], axes=2)  # (batch, m, 3)
    scale = np.ones(len(batch))
    for _ in range(8):  # nearly proportional: each round gains a digit
        errors = np.abs(test.chain_errors[poses] + scale[:, None, None] * geometric)
        scale *= preset.nominal_mean_mm / errors.mean(axis=(1, 2))
    maxima = errors.reshape(len(batch), n_tests, 3 * preset.constraint_poses).max(axis=2)
    likely: FloatArray = batch[
        np.abs(maxima - preset.nominal_max_mm).max(axis=1) <= 1.2 * preset.nominal_max_tolerance_mm
    ]
    return likely


def _scaled(
    arm: Arm, systematic: Systematic, test: _Test, constants: FloatArray, preset: Preset
) -> tuple[FloatArray, FloatArray]:
    """Scale geometry until the mean error is the preset's, with exact motions; also give the tests' maxima."""
    nominal = arm.chain.tip_in_base(test.angles)

    def errors(scale: float) -> FloatArray:
        moved = systematic.with_constants(scale * constants)
        return np.abs(true_tips(arm.chain, moved, test.angles, test.state) - nominal)

    def excess(scale: float) -> float:
        return float(errors(scale).mean()) - preset.nominal_mean_mm

    upper = 1.0
    while excess(upper) < 0:
        upper *= 2
    scale = brentq(excess, 0.0, upper, xtol=1e-6)
    return scale * constants, errors(scale).reshape(TESTS, -1).max(axis=1)
