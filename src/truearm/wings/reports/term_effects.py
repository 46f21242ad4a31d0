"""Effects of groups of terms, and errors of single joints, as the page of a model shows them.

Effects: how large the motions of a group of terms are, and how far they move the tip.

Joint errors: how far a joint stands from what its encoder shows, over its angle. The curve is that of the harmonics
about the joint's own axis. It contains encoder and gear: they turn about the same axis, and no reading of the tip can
separate them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.arm.rigid_motions import cos_sin
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms import ArmState, Harmonics
from truearm.solve.linear_algebra import unit_diagonal
from truearm.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Effect:
    """Effect of a group of terms on the arm, root mean square over readings.

    Attributes
    ----------
    group : str
    offered : int
        Number of coefficients.
    determined : float
        How many of them the readings determine.
    rotation_rad, shift_mm : float or None
        Size of the motions over all places and directions of the group [rad, mm]. None without such motions, for
        pruned groups and for free ones: the placement of an arm in its frame is no error.
    tip_mm : float or None
        Displacement of the tip, to first order, less the part that a free base and tip compensate [mm]. Groups with
        similar effects may each displace it far and cancel.
    """

    group: str
    offered: int
    determined: float
    rotation_rad: float | None
    shift_mm: float | None
    tip_mm: float | None


def effects(fit: IdentificationResult, state: ArmState) -> tuple[Effect, ...]:
    """Effects of all offered groups of terms at the readings of a state.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of at least one reading.
    """
    n, names = len(state), [group.name for group in fit.groups]
    of_terms = [np.full(term.n_coefficients, names.index(term.group)) for term in fit.perturbed_chain.terms]
    group = np.concatenate([np.zeros(0, dtype=np.intp), *of_terms])
    squares = np.zeros((len(names), 2))  # of rotations and shifts
    sites = np.zeros((len(names), 2))
    values = fit.perturbed_chain.by_site(fit.perturbed_chain.values(state))
    for site, value in zip(fit.perturbed_chain.sites, values, strict=True):
        parts = site.direction.reshape(2, 3)
        for i in np.unique(group[site.columns]):
            here = group[site.columns] == i
            motion = fit.coefficients[site.columns[here]] @ value[here]
            squares[i] += (parts**2).sum(axis=1) * float(motion @ motion) / n
            sites[i] += parts.any(axis=1)
    free = {term.group for term in fit.perturbed_chain.terms if not term.learn}
    tip_squares = _tip_squares(fit, state, group, np.isin(names, list(free))) / n
    sizes = [
        [float(np.sqrt(s / k)) if k and name not in free else None for s, k in zip(*row, strict=True)]
        for name, row in zip(names, zip(squares, sites, strict=True), strict=True)
    ]
    return tuple(
        Effect(
            found.name,
            found.n_coefficients,
            found.effective,
            turning,
            shifting,
            float(np.sqrt(tip_square)) if turning is not None or shifting is not None else None,
        )
        for found, (turning, shifting), tip_square in zip(fit.groups, sizes, tip_squares, strict=True)
    )


def _tip_squares(fit: IdentificationResult, state: ArmState, group: IntArray, is_free: BoolArray) -> FloatArray:
    """(n_groups,) sums of squared displacements of the tip, less the parts that free groups compensate."""
    parts = [np.flatnonzero(group == i) for i in range(len(is_free))]
    free = np.flatnonzero(is_free[group])
    own, cross, gram = np.zeros(len(parts)), np.zeros((len(free), len(parts))), np.zeros((len(free), len(free)))
    for _, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients):
        flat = columns.reshape(len(columns), 3 * columns.shape[2])
        moved = np.stack([fit.coefficients[part] @ flat[part] for part in parts])
        own += (moved**2).sum(axis=1)
        cross += flat[free] @ moved.T
        gram += flat[free] @ flat[free].T
    unit, scale = unit_diagonal(gram)
    cross /= scale[:, None]
    compensation = np.linalg.pinv(unit, rcond=1e-12, hermitian=True) @ cross
    return np.asarray(np.maximum(own - (cross * compensation).sum(axis=0), 0.0))


OWN_AXIS = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class JointError:
    """Angle error of a joint over its angle, and by order.

    Attributes
    ----------
    joint : int
        Counted from 1.
    angles : (m,) array
        Angles by the encoder [rad].
    error : (m,) array
        True angle less encoder angle [rad], without its mean, which is indistinguishable from the joint offset.
    std : (m,) array
        Standard uncertainty of the error [rad].
    orders : (k,) int array
        Orders that were not pruned, rising; empty if the readings show no error of this joint.
    amplitudes : (k,) array
        Amplitude of each order [rad]. If the joint did not make a full turn, neighbouring orders are hard to
        distinguish, and only their sum is known well.
    amplitudes_std : (k,) array
        Standard uncertainties of the amplitudes [rad].
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
        """Whether the root mean square of the error is larger than that of its uncertainty."""
        return self.rms > float(np.sqrt(np.mean(self.std**2)))


def joint_error(fit: IdentificationResult, joint: int, angles: FloatArray, *, mean_at: FloatArray) -> JointError:
    """The angle error of a joint.

    Parameters
    ----------
    fit : IdentificationResult
    joint : int
        Counted from 1.
    angles : (m,) array
        Where to evaluate it [rad].
    mean_at : (n,) array
        Angles over which its mean is zero, usually those of the readings [rad].

    Returns
    -------
    JointError
    """
    orders, columns = _own_axis(fit, joint)
    rising = np.argsort(orders, kind="stable")
    orders, columns = orders[rising], columns[rising]
    x, covariance = fit.coefficients[columns], fit.covariance[np.ix_(columns.ravel(), columns.ravel())]
    functions = _functions(orders, angles) - _functions(orders, mean_at).mean(axis=0)
    spread = np.einsum("mi,ij,mj->m", functions, covariance, functions, optimize=True)
    amplitudes = np.hypot(x[:, 0], x[:, 1])
    return JointError(
        joint,
        angles,
        functions @ x.ravel(),
        np.sqrt(np.maximum(spread, 0)),
        orders,
        amplitudes,
        _amplitudes_std(x, amplitudes, covariance),
    )


def _own_axis(fit: IdentificationResult, joint: int) -> tuple[IntArray, IntArray]:
    """Orders (k,) of a joint's harmonics about its own axis, and the columns (k, 2) of their cosine and sine."""
    orders: list[int] = []
    found: list[IntArray] = [np.zeros(0, dtype=np.intp)]
    for term, columns in zip(fit.perturbed_chain.terms, fit.perturbed_chain.columns, strict=True):
        basis = term.basis
        if term.place == joint and term.direction == OWN_AXIS and isinstance(basis, Harmonics) and basis.joint == joint:
            orders += basis.orders
            found.append(columns)
    return np.array(orders, dtype=np.intp), np.concatenate(found).reshape(-1, 2)


def _functions(orders: IntArray, angles: FloatArray) -> FloatArray:
    """(m, 2 k) cosine and sine of each order."""
    return np.stack(cos_sin(orders * angles[:, None]), axis=-1).reshape(len(angles), -1)


def _amplitudes_std(x: FloatArray, amplitudes: FloatArray, covariance: FloatArray) -> FloatArray:
    """(k,) uncertainty of each amplitude to first order: that of the pair (cosine, sine) along itself."""
    pairs = covariance.reshape(len(x), 2, len(x), 2)[np.arange(len(x)), :, np.arange(len(x))]
    # For an amplitude of zero, use the mean over two directions.
    along = np.divide(x, amplitudes[:, None], out=np.full_like(x, np.sqrt(0.5)), where=amplitudes[:, None] > 0)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", along, pairs, along), 0)))
