"""Observability indices: how well readings determine the parameters, from the singular values of their Jacobian.

The indices depend on the units of the parameters. Here they are those of the *whitened* Jacobian: each row divided by
the standard deviation of its reading's noise, each column multiplied by its parameter's prior standard deviation. It is
dimensionless. With a singular value s the posterior variance of one combination of the parameters is 1 / (1 + s^2) of
the prior variance: below s = 1 the prior dominates. The indices were published for columns in the parameters' own
units; published numbers are comparable only with the same scaling.

====== ==================================== ===========================================================================
index  definition, s1 >= ... >= sL          source
====== ==================================== ===========================================================================
O1     (s1 ... sL)^(1/L) / sqrt(n)          J.-H. Borm, C.-H. Menq, "Determination of optimal measurement configurations
                                            for robot calibration based on observability measure", Int. J. Robotics
                                            Research 10 (1991) 51
O2     sL / s1                              M. R. Driels, U. S. Pathre, "Significance of observation strategy on the
                                            design of robot calibration experiments", J. Robotic Systems 7 (1990) 197
O3     sL                                   A. Nahvi, J. M. Hollerbach, V. Hayward, "Calibration of a parallel robot
                                            using multiple kinematic closed loops", IEEE Int. Conf. Robotics and
                                            Automation 1994, 407
O4     sL^2 / s1                            A. Nahvi, J. M. Hollerbach, "The noise amplification index for optimal pose
                                            selection in robot calibration", IEEE Int. Conf. Robotics and Automation
                                            1996, 647
O5     1 / (1/s1 + ... + 1/sL)              Y. Sun, J. M. Hollerbach, "Observability index selection for robot
                                            calibration", IEEE Int. Conf. Robotics and Automation 2008, 831
====== ==================================== ===========================================================================

Larger is better for each. n is the number of poses. O1 is D-optimality, O3 is E-optimality and O5 is close
to A-optimality, which sums the inverse squares (Sun and Hollerbach).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.typing import FloatArray

CLEAR_GAP = 1e4
"""Ratio of neighbouring singular values above which the smaller one counts as zero.

Of a combination of parameters that is not identifiable, rounding leaves some 1e-16 of the largest singular value; an
identifiable one, even if poorly determined, is far above.
"""
ROUNDING = 1e-14
"""Share of the largest singular value below which a singular value counts as rounding."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of parameters by readings.

    Attributes
    ----------
    singular_values : (p,) array
        Of the whitened Jacobian, in descending order; zeros if there are fewer rows than parameters.
    rank : int
        Identifiable combinations of the parameters.
    gap : float
        Clearness of the rank: last nonzero over first zero singular value (see `rank_and_gap`), of the Jacobian with
        columns of unit length. At full rank, the largest ratio of neighbours.
    n_poses : int
        Number of poses, for O1.

    Notes
    -----
    The published indices assume that all parameters are identifiable. Here they are those of the `rank` identifiable
    combinations; with rank 0 they are 0.
    """

    singular_values: FloatArray
    rank: int
    gap: float
    n_poses: int

    @property
    def n_parameters(self) -> int:
        """Number of parameters, identifiable or not."""
        return len(self.singular_values)

    @property
    def nonzero(self) -> FloatArray:
        """(rank,) singular values of the identifiable combinations."""
        return self.singular_values[: self.rank]

    @property
    def o1(self) -> float:
        """Root of the product of the singular values, over the square root of the number of poses."""
        return float(np.exp(np.log(self.nonzero).mean()) / np.sqrt(self.n_poses)) if self.rank else 0.0

    @property
    def o2(self) -> float:
        """Inverse condition number."""
        return float(self.nonzero[-1] / self.nonzero[0]) if self.rank else 0.0

    @property
    def o3(self) -> float:
        """Smallest singular value."""
        return float(self.nonzero[-1]) if self.rank else 0.0

    @property
    def o4(self) -> float:
        """Noise amplification index: the smallest singular value times the inverse condition number."""
        return self.o3 * self.o2

    @property
    def o5(self) -> float:
        """Inverse of the sum of the inverse singular values."""
        return float(1 / (1 / self.nonzero).sum()) if self.rank else 0.0


def observability(jacobian: FloatArray, *, n_poses: int) -> Observability:
    """Observability of parameters by readings.

    Parameters
    ----------
    jacobian : (m, p) array
        Whitened: rows over the noise, columns times the parameters' prior standard deviations; without rows for the
        prior, which would make everything identifiable.
    n_poses : int
        Number of poses that the rows come from.
    """
    m, p = jacobian.shape
    # The triangular factor has the same singular values.
    J = np.asarray(np.linalg.qr(jacobian, mode="r")) if m > p else jacobian
    length = np.linalg.norm(J, axis=0)
    rank, gap = rank_and_gap(_singular_values(J / np.where(length > 0, length, 1.0)))
    return Observability(_singular_values(J), rank, gap, n_poses)


def rank_and_gap(values: FloatArray) -> tuple[int, float]:
    """Numerical rank, and the gap that determines it.

    The rank is where neighbouring singular values have the largest ratio; those below `ROUNDING` times the largest
    count as equal to it. If the ratio is less than `CLEAR_GAP`, there is no gap: the rank is then the number of values
    above rounding, and the ratio there shows how unclear it is.

    Parameters
    ----------
    values : (p,) array
        Singular values, in descending order. Use those of a Jacobian with columns of unit length: rounding depends on
        the units of the columns.

    Returns
    -------
    rank : int
    gap : float
        Ratio of the last nonzero to the first zero value; at full rank the largest ratio of neighbours; infinite if all
        are zero.
    """
    if values[0] == 0:
        return 0, np.inf
    above = np.maximum(values, ROUNDING * values[0])
    ratios = above[:-1] / above[1:]
    widest = float(ratios.max(initial=1.0))
    if widest >= CLEAR_GAP:
        return int(ratios.argmax()) + 1, widest
    rank = int((values > ROUNDING * values[0]).sum())
    return rank, widest if rank == len(values) else float(ratios[rank - 1])


def _singular_values(J: FloatArray) -> FloatArray:
    """(p,) singular values, with zeros if there are fewer rows than columns."""
    values = np.zeros(J.shape[1])
    values[: min(J.shape)] = np.linalg.svd(J, compute_uv=False)
    return values
