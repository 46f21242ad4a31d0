"""Draw only arms whose nominal model has the errors of a known arm.

NIST's constrained Monte Carlo (Phillips and others) accepts those of many virtual machines whose simulated test gives
the results of the real one. The test here is that of Gao et al. 2017: errors of the nominal model in a box of poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.identification.virtual.error_model import SystematicErrors, draw_geometry, error_model, geometry_stream
from truearm.identification.virtual.presets import Preset
from truearm.identification.virtual.state import virtual_state
from truearm.typing import FloatArray

TESTS = 30  # all must agree, since the maximum over 200 random poses scatters by some per cent
TRIES = 20_000
BATCH = 50
ROUNDS = 100  # usually four


@dataclass(frozen=True, eq=False)
class _Test:
    """The nominal model's test: poses, and what all arms of a preset share."""

    arm: Arm
    angles: FloatArray
    values: FloatArray  # of the basis functions of the error model at the poses
    nominal_tips: FloatArray  # (m, 3) [mm]
    by_constant: FloatArray  # (6 n_places, 3 m): errors by geometry, to first order

    def other_motions(self, systematic: SystematicErrors) -> FloatArray:
        """Motions (m, n_places, 6) of all errors but those of the geometry."""
        without = systematic.with_geometry(np.zeros((self.arm.chain.n_places, 6)))
        motions = without.model.perturbed_chain.motions(without.coefficients, self.values)
        return np.broadcast_to(motions, (*motions.shape[:2], len(self.angles))).transpose(2, 0, 1)

    def errors(self, motions: FloatArray) -> FloatArray:
        """Errors of the nominal model, (3 m,) [mm], with exact motions (m, n_places, 6)."""
        return (self.arm.chain.tip_in_base(self.angles, motions) - self.nominal_tips).reshape(-1)


def constrain_geometry(arm: Arm, systematic: SystematicErrors, preset: Preset, *, seed: int) -> SystematicErrors:
    """Replace the geometry by the first draw with the test results of the preset.

    Geometry is drawn repeatedly from the arm's stream. Each draw is scaled to the mean error of the preset and accepted
    if the maxima of thirty tests are then all within the preset's tolerance.

    Raises
    ------
    InputError
        If none of 20,000 draws is accepted, or the other classes alone exceed the mean error.
    """
    test = _test_of(arm, preset)
    stream = geometry_stream(seed)
    motions = test.other_motions(systematic)
    others = test.errors(motions)
    other_mean = np.abs(others).mean()
    if other_mean >= preset.nominal_mean_mm:
        raise InputError(
            f"preset {preset.name!r} states a nominal error of {preset.nominal_mean_mm} mm, but the error of arm "
            f"{arm.name!r} without errors of the geometry is {other_mean:.3f} mm already",
            hint="use smaller magnitudes of the other classes, or a larger nominal_mean_mm",
        )
    for _ in range(TRIES // BATCH):
        batch = np.stack([draw_geometry(arm.chain, preset, stream) for _ in range(BATCH)])
        for few in (3, TESTS):  # most draws fail in the first tests
            batch = _likely(test, others, batch, preset, n_tests=few)
        for constants in batch:
            scaled, off = _scaled(test, motions, others, constants, preset)
            if off <= preset.nominal_max_tolerance_mm:
                return systematic.with_geometry(scaled)
    raise InputError(
        f"none of {TRIES} draws of arm {arm.name!r} has a mean error of {preset.nominal_mean_mm} mm and a maximum "
        f"error of {preset.nominal_max_mm} mm, as preset {preset.name!r} states",
        hint="use another nominal_max_mm, or a larger nominal_max_tolerance_mm",
    )


def box_sample(arm: Arm, n: int, *, half_width_rad: float) -> FloatArray:
    """Draw random poses about the working pose, inside the limits, the same in each call, (n, n_joints)."""
    lower = np.maximum(arm.working - half_width_rad, arm.limits[:, 0])
    upper = np.minimum(arm.working + half_width_rad, arm.limits[:, 1])
    return np.random.default_rng([*b"constraint"]).uniform(lower, upper, (n, arm.n_joints))


@lru_cache(maxsize=1)  # many arms of one nominal arm are drawn in a row
def _test_of(arm: Arm, preset: Preset) -> _Test:
    n = TESTS * preset.constraint_poses
    angles = box_sample(arm, n, half_width_rad=np.radians(preset.constraint_half_width_deg))
    values = error_model(arm, preset).perturbed_chain.values(virtual_state(arm, preset, angles))
    small = arm.chain.tip_derivatives(angles)
    by_constant = np.ascontiguousarray(small.motion_jacobian.transpose(1, 2, 0, 3)).reshape(-1, 3 * n)
    return _Test(arm, angles, values, small.tip_in_base, by_constant)


def _likely(test: _Test, others: FloatArray, batch: FloatArray, preset: Preset, *, n_tests: int) -> FloatArray:
    """Keep the draws that pass `n_tests` to first order, accurate to some um, with a larger tolerance."""
    values = n_tests * preset.constraint_poses * 3
    geometric = batch.reshape(len(batch), len(test.by_constant)) @ test.by_constant[:, :values]
    scale, errors = to_mean(others[:values], geometric, preset.nominal_mean_mm)
    off = _off(errors, preset, n_tests=n_tests)
    likely: FloatArray = (scale[:, None, None] * batch)[off <= 1.2 * preset.nominal_max_tolerance_mm]
    return likely


def _scaled(
    test: _Test, motions: FloatArray, others: FloatArray, constants: FloatArray, preset: Preset
) -> tuple[FloatArray, float]:
    """Scale geometry to the mean error of the preset, with exact motions; also return the deviation of the maxima.

    Errors are linear between no geometry and that of the last round, up to the square of motions of milliradians: the
    first-order scale is accurate to three digits, and each round gains three more.
    """
    for _ in range(2):
        geometric = test.errors(motions + constants) - others
        scale, errors = to_mean(others, geometric[None], preset.nominal_mean_mm)
        constants = scale * constants
        off = float(_off(errors, preset, n_tests=TESTS)[0])
        if off > 1.01 * preset.nominal_max_tolerance_mm:  # further digits do not change that
            break
    return constants, off


def _off(errors: FloatArray, preset: Preset, *, n_tests: int) -> FloatArray:
    """Largest deviation of the maximum of a test from that of the preset, (k,) [mm], for errors (k, m) of k arms."""
    maxima = np.abs(errors).reshape(len(errors), n_tests, errors.shape[1] // n_tests).max(axis=2)
    off: FloatArray = np.abs(maxima - preset.nominal_max_mm).max(axis=1)
    return off


def to_mean(others: FloatArray, geometric: FloatArray, mean: float) -> tuple[FloatArray, FloatArray]:
    """Scale errors of geometry (k, m) until, with the others (m,), their mean magnitude is `mean`.

    The mean magnitude is a convex function of the scale, below `mean` at 0. Newton's method from a scale that is too
    large converges to the only root above. If the others of a few tests leave no root, the scale is arbitrary.

    Returns
    -------
    scale : (k,) array
    errors : (k, m) array
        Sum of both errors at this scale.
    """
    size = np.abs(geometric).mean(axis=1)
    scale = (mean + np.abs(others).mean()) / size
    for _ in range(ROUNDS):
        errors = others + scale[:, None] * geometric
        slope = np.einsum("km,km->k", np.sign(errors), geometric) / len(others)
        step = (np.abs(errors).mean(axis=1) - mean) / np.maximum(slope, 1e-3 * size)
        scale = scale - step
        if (step <= 1e-6 * scale).all():  # piecewise linear, so after so small a step it has converged
            break
    return scale, others + scale[:, None] * geometric
