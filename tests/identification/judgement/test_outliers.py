"""Readings far off are listed, the farthest first, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import load_arm
from truearm.identification.estimation.identification import identify
from truearm.identification.estimation.identification_result import ReferenceFit
from truearm.identification.judgement.outliers import outliers
from truearm.identification.references.references import Points
from truearm.identification.terms import ArmState, constants


def test_gross_errors_are_the_ones_listed(rng):
    arm = load_arm("gao2017")
    angles = arm.working + 0.8 * rng.uniform(-1, 1, (200, 6))
    points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.02, (200, 3))
    bad = {7: 1.0, 50: 30.0, 120: 0.4, 199: 5.0}  # mm
    for row, size in bad.items():
        points[row] += size * np.array([2.0, -1, 2]) / 3
    fit = identify(arm.chain, ArmState(arm.chain, angles), constants(arm.chain), [Points(np.arange(200), points)])
    found = outliers(fit)
    assert [one.row for one in found] == [50, 199, 7, 120]
    for one in found:
        assert one.kind == "point"
        assert one.error_mm == pytest.approx(bad[one.row], abs=0.15)
        assert one.normalized_residual == pytest.approx(one.error_mm / np.sqrt(3) / fit.references[0].noise_std)


def test_one_half_of_the_trust_is_the_limit_and_uncertain_readings_are_no_outliers():
    """By hand: rows 3, 5, 9 of residuals 4, 4, 1 mm; the second was stated to be uncertain by 4 mm, and is trusted."""
    residuals = np.zeros((3, 3))
    residuals[0] = [4.0, 4.0, 1.0]
    std = np.zeros((3, 3))
    std[:, 1] = 4.0
    rows = np.array([3, 5, 9])
    reference = ReferenceFit("seat", rows, residuals, std, 1.0, np.array([0.49, 1.0, 0.5]), np.zeros(3, dtype=int), {})
    arm = load_arm("gao2017")
    points = arm.chain.tip_in_base(np.tile(arm.working, (4, 1)))
    fit = identify(arm.chain, ArmState(arm.chain, np.tile(arm.working, (4, 1))), [], [Points(np.arange(4), points)])
    (found,) = outliers(replace(fit, references=(reference,)))
    assert (found.row, found.kind, found.error_mm) == (3, "seat", 4.0)
    assert found.normalized_residual == pytest.approx(4 / np.sqrt(3))
    assert outliers(fit) == []
    none = ReferenceFit("point", rows[:0], residuals[:, :0], std[:, :0], 1.0, np.zeros(0), rows[:0], {})
    assert outliers(replace(fit, references=(none,))) == []
