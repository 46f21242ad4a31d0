"""A joint's own error: how far it stands from what its encoder shows, over its angle.

The harmonics about the joint's own axis, identified with everything else, as one curve with the uncertainty that the
readings left it. Encoder and gear are in it together: they turn about the same axis, and no reading of the tip tells
them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.terms.basis import Harmonics
from truearm.typing import FloatArray, IntArray

OWN_AXIS = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class JointError:
    """A joint's own error over its angle, and by order.

    Attributes
    ----------
    joint : int
        Counted from 1.
    angles : (m,) array
        That the encoder shows [rad].
    error : (m,) array
        By how much the joint has turned further [rad]. Its mean is taken off: it cannot be told from the joint's zero.
    std : (m,) array
        Standard uncertainty of it, as the readings left it [rad].
    orders : (k,) int array
        Orders that were not given up, rising; none where the readings show no error of this joint.
    amplitudes : (k,) array
        Of each order [rad]. Where the joint did not turn all round, neighbouring orders share what they cannot be told
        apart in, and only their sum is known well.
    amplitudes_std : (k,) array
        Their standard uncertainties [rad].
    """

    joint: int
    angles: FloatArray
    error: FloatArray
    std: FloatArray
    orders: IntArray
    amplitudes: FloatArray
    amplitudes_std: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square of the error [rad]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def is_significant(self) -> bool:
        """Whether the readings tell it: it is larger than its uncertainty, root mean square."""
        return self.rms > float(np.sqrt(np.mean(self.std**2)))


def joint_error(fit: IdentificationResult, joint: int, angles: npt.ArrayLike, *, mean_at: npt.ArrayLike) -> JointError:
    """The error of a joint about its own axis.

    Parameters
    ----------
    fit : IdentificationResult
    joint : int
        Counted from 1.
    angles : (m,) array
        Where to evaluate it [rad].
    mean_at : (n,) array
        Angles at which its mean is zero, such as those of the readings [rad].

    Returns
    -------
    JointError

    Raises
    ------
    InputError
        If the chain has no such joint, or arrays have the wrong shape or no elements.
    """
    if not 1 <= joint <= fit.perturbed_chain.chain.n_joints:
        raise InputError(f"expected a joint from 1 to {fit.perturbed_chain.chain.n_joints}, got {joint}")
    at, zero = (np.asarray(values, dtype=float) for values in (angles, mean_at))
    if at.ndim != 1 or zero.ndim != 1 or not len(at) or not len(zero):
        raise InputError(f"expected angles as two rows of numbers, got shapes {at.shape} and {zero.shape}")
    orders, columns = _own_axis(fit, joint)
    rising = np.argsort(orders, kind="stable")
    orders, columns = orders[rising], columns[rising]
    x, covariance = fit.coefficients[columns], fit.covariance[np.ix_(columns.ravel(), columns.ravel())]
    functions = _functions(orders, at) - _functions(orders, zero).mean(axis=0)
    spread = np.einsum("mi,ij,mj->m", functions, covariance, functions, optimize=True)
    amplitudes = np.hypot(x[:, 0], x[:, 1])
    return JointError(
        joint,
        at,
        functions @ x.ravel(),
        np.sqrt(np.maximum(spread, 0)),
        orders,
        amplitudes,
        _amplitudes_std(x, amplitudes, covariance),
    )


def _own_axis(fit: IdentificationResult, joint: int) -> tuple[IntArray, IntArray]:
    """Orders (k,) of a joint's harmonics about its own axis, and where their cosine and sine stand (k, 2)."""
    orders: list[int] = []
    columns: list[tuple[int, int]] = []
    start = 0
    for term in fit.perturbed_chain.terms:
        basis = term.basis
        if term.place == joint and term.direction == OWN_AXIS and isinstance(basis, Harmonics) and basis.joint == joint:
            orders += basis.orders
            columns += [(start + 2 * i, start + 2 * i + 1) for i in range(len(basis.orders))]
        start += term.n_coefficients
    return np.array(orders, dtype=np.intp), np.array(columns, dtype=np.intp).reshape(-1, 2)


def _functions(orders: IntArray, angles: FloatArray) -> FloatArray:
    """(m, 2 k) cosine and sine of each order."""
    phase = orders * angles[:, None]
    return np.stack([np.cos(phase), np.sin(phase)], axis=-1).reshape(len(angles), -1)


def _amplitudes_std(x: FloatArray, amplitudes: FloatArray, covariance: FloatArray) -> FloatArray:
    """(k,) uncertainty of each amplitude to first order: that of the pair (cosine, sine) along itself."""
    pairs = covariance.reshape(len(x), 2, len(x), 2)[np.arange(len(x)), :, np.arange(len(x))]
    # Of an amplitude of zero every direction is as good: the mean of two.
    along = np.divide(x, amplitudes[:, None], out=np.full_like(x, np.sqrt(0.5)), where=amplitudes[:, None] > 0)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", along, pairs, along), 0)))
