"""Observability indices: how well readings determine the parameters, from the singular values of their Jacobian.

The indices compare parameters with each other, so they mean nothing before units are settled: another unit of one
parameter changes all of them. Here they are those of the *whitened* Jacobian: each row divided by the standard
deviation of its reading's noise, each column multiplied by its parameter's prior standard deviation. The Jacobian is
then a pure number, and a singular value s says that the readings determine one combination of the parameters s times
as sharply as was known before: its posterior variance is 1 / (1 + s^2) of the prior one. What is below 1 comes from
the prior. The indices were published for columns in the parameters' own units; numbers from papers compare with these
only where their scaling is the same.

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

Larger is better for each. n is the number of poses. O1 is D-optimality, O3 is E-optimality and O5 stands for
A-optimality (which proper sums the inverse squares), as Sun and Hollerbach say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray

CLEAR_GAP = 1e4
"""Ratio of neighbouring singular values from which on the smaller one counts as zero.

Where readings cannot tell a combination of parameters, rounding leaves some 1e-16 of the largest singular value; what
they can tell, even badly, is far above.
"""
ROUNDING = 1e-14
"""Share of the largest singular value below which they are taken for rounding."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of parameters by readings.

    Attributes
    ----------
    singular_values : (p,) array
        Of the whitened Jacobian, in falling order; zeros where there are fewer rows than parameters.
    rank : int
        Identifiable combinations of the parameters.
    gap : float
        How clear the rank is: the last singular value kept over the first one lost (see `rank_and_gap`), of the
        Jacobian with columns of unit length. If none is lost, the largest ratio of neighbours.
    n_poses : int
        What O1 is divided by the square root of.

    Notes
    -----
    The published indices take for granted that what cannot be identified has been left out of the parameters. They are
    taken over the `rank` identifiable combinations, for the same reason; with rank 0 they are 0.
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
    def kept(self) -> FloatArray:
        """(rank,) singular values of the identifiable combinations."""
        return self.singular_values[: self.rank]

    @property
    def o1(self) -> float:
        """Root of the product of the singular values, over the square root of the number of poses."""
        return float(np.exp(np.log(self.kept).mean()) / np.sqrt(self.n_poses)) if self.rank else 0.0

    @property
    def o2(self) -> float:
        """Inverse condition number."""
        return float(self.kept[-1] / self.kept[0]) if self.rank else 0.0

    @property
    def o3(self) -> float:
        """Smallest singular value."""
        return float(self.kept[-1]) if self.rank else 0.0

    @property
    def o4(self) -> float:
        """Noise amplification index: the smallest singular value times the inverse condition number."""
        return self.o3 * self.o2

    @property
    def o5(self) -> float:
        """Inverse of the sum of the inverse singular values."""
        return float(1 / (1 / self.kept).sum()) if self.rank else 0.0


def observability(jacobian: npt.ArrayLike, *, n_poses: int) -> Observability:
    """Observability of parameters by readings.

    Parameters
    ----------
    jacobian : (m, p) array
        Whitened: rows over the noise, columns times the parameters' prior standard deviations; without rows for the
        prior, which would make everything look identifiable.
    n_poses : int
        Number of poses that the rows come from.

    Raises
    ------
    InputError
        If the shape does not fit or a number is not finite.
    """
    J = np.asarray(jacobian, dtype=float)
    if J.ndim != 2 or 0 in J.shape:
        raise InputError(f"expected a Jacobian of shape (rows, parameters), got {J.shape}")
    if not np.isfinite(J).all():
        row, column = np.argwhere(~np.isfinite(J))[0]
        raise InputError(f"a Jacobian must be finite, got {J[row, column]} in row {row}, parameter {column}")
    m, p = J.shape
    if m > p:  # the triangular factor has the same singular values
        J = np.asarray(np.linalg.qr(J, mode="r"))
    length = np.linalg.norm(J, axis=0)
    unit = J / np.where(length > 0, length, 1.0)
    rank, gap = rank_and_gap(_singular_values(unit))
    return Observability(_singular_values(J), rank, gap, _checked_poses(n_poses))


def observability_of(singular_values: npt.ArrayLike, *, n_poses: int) -> Observability:
    """Observability from the singular values alone; the rank is then theirs.

    Parameters
    ----------
    singular_values : (p,) array
        Of a whitened Jacobian, in any order, one for each parameter. Square roots of the eigenvalues of ``J^T J`` will
        not do where parameters cannot be identified: they are known to 1e-8 of the largest only.
    n_poses : int
        Number of poses.

    Raises
    ------
    InputError
        If there are none, or one is negative or not finite.
    """
    values = _checked_values(singular_values)
    return Observability(values, *rank_and_gap(values), _checked_poses(n_poses))


def rank_and_gap(singular_values: npt.ArrayLike) -> tuple[int, float]:
    """Numerical rank, and the gap that it rests on.

    The rank is where neighbouring singular values, taken as `ROUNDING` times the largest if they are below, have the
    largest ratio. If that is less than `CLEAR_GAP` they fall away without a gap: the rank is then the number above
    rounding, and the ratio there tells how unclear it is.

    Parameters
    ----------
    singular_values : (p,) array
        In any order. Those of a Jacobian with columns of unit length are best: the rank does not depend on the columns'
        units, but what rounding does to it.

    Returns
    -------
    rank : int
    gap : float
        Ratio of the last one kept to the first one lost; of the neighbours farthest apart if none is lost; infinite if
        all are zero.
    """
    values = _checked_values(singular_values)
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
    """(p,) singular values, with zeros where there are fewer rows than columns."""
    values = np.zeros(J.shape[1])
    values[: min(J.shape)] = np.linalg.svd(J, compute_uv=False)
    return values


def _checked_values(singular_values: npt.ArrayLike) -> FloatArray:
    values = np.asarray(singular_values, dtype=float)
    if values.ndim != 1 or not len(values) or not (np.isfinite(values) & (values >= 0)).all():
        raise InputError(f"expected singular values, finite and not negative, got {values!r}")
    return np.sort(values)[::-1]


def _checked_poses(n_poses: int) -> int:
    if n_poses < 1:
        raise InputError(f"expected at least one pose, got {n_poses}")
    return n_poses
