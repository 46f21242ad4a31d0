"""Expected error of an identified arm over a region of its joint space."""

from __future__ import annotations

import numpy as np

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.state import ArmState


def expected_square_error(fit: IdentificationResult, state: ArmState) -> float:
    """Expected squared error of a tip, mean over the readings of a state: of the parameters, and of the noise [mm^2].

    Integrated over a region it is the criterion of I-optimal plans: V. V. Fedorov, "Theory of Optimal Experiments",
    1972, section 2.9.
    """
    of_parameters = np.trace(fit.tip_covariance(state), axis1=1, axis2=2)
    return float(of_parameters.mean() + 3 * fit.references[0].noise_std ** 2)
