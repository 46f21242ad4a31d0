"""The Jacobian of a least-squares problem as a matrix, which the normal equations do without."""

import numpy as np

from truearm.identification.estimation.perturbed_chain import chunks
from truearm.identification.estimation.problem import SmallMotionProblem, of_readings
from truearm.typing import FloatArray


def plain_jacobian(problem: SmallMotionProblem, x: FloatArray) -> list[FloatArray]:
    """Derivatives (n_parameters, k, m) of the residuals of every reference.

    They still contain what the normal equations lose to rounding, such as the rank.
    """
    n = problem.perturbed_chain.n_coefficients
    found = []
    for i, whole in enumerate(problem.linearised(x)):
        out = np.zeros((problem.n_parameters, *whole.residuals.shape))
        for piece in chunks(out.shape[2]):
            rows = np.arange(piece.start, piece.stop)
            along_sites, values = problem.site_derivatives(i, rows, whole, x)
            out[:n, :, piece] = problem.perturbed_chain.by_coefficient(along_sites, values)
            linear = of_readings(whole, rows)
            for unknown, by in zip(linear.unknown, linear.by_unknown.transpose(1, 2, 0), strict=True):
                out[problem.unknowns_of(i).start + unknown, :, rows] += by
        found.append(out)
    return found
