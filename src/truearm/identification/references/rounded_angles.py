"""Rounded angles: how uncertain tips and residuals are by the standard uncertainty of the angles.

To first order an error of joint j moves the tip along its derivative by that angle; errors of different joints are
independent (JCGM 100:2008, 5.1.2).
"""

from __future__ import annotations

import numpy as np

from truearm.arm.chain import Chain
from truearm.identification.references.references import LinearisedResiduals
from truearm.typing import FloatArray


def tip_motions(chain: Chain, angles: FloatArray, std: FloatArray) -> FloatArray:
    """(n_joints, n, 3) motions of the tip by one standard uncertainty of each joint [mm]."""
    tips = chain.tip_in_base(angles)
    return np.stack([chain.tip_in_base(angles + one) - tips for one in np.diag(std)])


def tip_motion_mm(chain: Chain, angles: FloatArray, std: FloatArray) -> float:
    """Root mean square motion of the tip by errors of the angles [mm]."""
    if not std.any():
        return 0.0
    return float(np.sqrt((tip_motions(chain, angles, std) ** 2).sum(axis=(0, 2)).mean()))


def residual_variance(linear: LinearisedResiduals, motions: FloatArray) -> FloatArray:
    """(k, m) variances of residuals by motions (n_joints, m, 3) of tips [mm^2]; turns of the flange are ignored."""
    return np.asarray((np.einsum("kim,jmi->kjm", linear.by_tip, motions) ** 2).sum(axis=1))
