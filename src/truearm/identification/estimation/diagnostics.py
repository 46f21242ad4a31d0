"""Diagnostics of an identification: the effects of groups of terms, errors of single joints, identifiable parameters.

Effects: how large the motions of a group of terms are, and how far they move the tip.

Joint errors: how far a joint stands from what its encoder shows, over its angle. The curve is that of the harmonics
about the joint's own axis. It contains encoder and gear: they turn about the same axis, and no reading of the tip can
separate them.

Identifiability: the posterior covariance of the constants is divided by their prior standard deviations on both sides.
An eigenvalue near 1 is then a combination of constants that the readings do not determine. Eigenvectors of equal
eigenvalues are arbitrary mixtures; in echelon form, by the constants that represent them best, they name few constants.
Combinations that move the tip at no pose, for example a shift of the tip against one of the last link, are listed
separately: no reading can determine them, and predictions do not depend on them. Partners of a constant are ranked by
how far they move the tip: a free tip, a metre uncertain beforehand, hardly moves by its own measure when it compensates
a millimetre of the last link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import cos_sin
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.basis import Constant, Harmonics
from truearm.identification.terms.state import ArmState
from truearm.solve.square_roots import unit_diagonal
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


# A combination with a larger share of its prior variance counts as not identifiable.
UNIDENTIFIABLE_SHARE = 0.5
# Random poses at which a combination moves the tip, or does not. A displacement below this share of those of its
# members counts as none: nominally parallel or perpendicular axes of an identified arm are not exactly so.
POSES = 100
NO_DISPLACEMENT = 2e-3
# Partners that move the tip by a smaller share of the displacement by the first constant are not named.
LEAST_SHARE = 0.2
# Of a combination of more constants than this the largest are named.
MOST_PARTNERS = 4
# Sizes within this share of the largest are equal to it: rounding must not decide.
_TIE = 0.02
STRONG = 0.95


@dataclass(frozen=True)
class Unidentifiable:
    """A combination of constants that the readings do not determine.

    Attributes
    ----------
    constants : tuple of str
        Their names. Of several constants only a weighted sum is known: a common motion of them has no effect.
    movement : tuple of float
        The common motion without effect [rad or mm], the first constant by its prior standard deviation.
    at_other_poses : bool
        Whether readings at other poses would determine it.
    """

    constants: tuple[str, ...]
    movement: tuple[float, ...]
    at_other_poses: bool = True

    @property
    def status(self) -> str:
        """What is known of it."""
        if len(self.constants) == 1:
            return "not identifiable"
        return "identifiable only as a sum" if self.at_other_poses else "identifiable only as a sum, from any readings"

    def __str__(self) -> str:
        if len(self.constants) == 1:
            return self.constants[0]
        return f"{', '.join(self.constants[:-1])} and {self.constants[-1]} (only as a sum)"


@dataclass(frozen=True)
class CorrelatedPair:
    """Two constants with correlated errors.

    Attributes
    ----------
    constants : tuple of str
    correlation : float
    """

    constants: tuple[str, str]
    correlation: float


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Which constants the readings determine.

    Attributes
    ----------
    determined : dict of str to float
        Share of each constant's prior variance that the readings removed: 1 fully determined, 0 not at all.
    unidentifiable : tuple of Unidentifiable
        Combinations that are not identifiable.
    correlated : tuple of CorrelatedPair
        Pairs with a correlation beyond 0.95, the strongest first, ten at most.
    """

    determined: dict[str, float]
    unidentifiable: tuple[Unidentifiable, ...]
    correlated: tuple[CorrelatedPair, ...]


def identifiability(fit: IdentificationResult) -> Identifiability:
    """Identifiability of the constants of a fit, including a free base and tip."""
    constants = fit.select(lambda term: isinstance(term.basis, Constant))
    terms, prior_std, levers = constants.perturbed_chain.terms, constants.prior_std, _levers(fit.chain)
    if not terms:
        return Identifiability({}, (), ())
    names = [term.name for term in terms]
    directions = np.array([term.direction for term in terms])
    turns, shifts = np.linalg.norm(directions[:, :3], axis=1), np.linalg.norm(directions[:, 3:], axis=1)
    effects = turns * levers[[term.place for term in terms]] + shifts
    whitened = constants.covariance / np.outer(prior_std, prior_std)
    determined = {name: float(np.clip(1 - v, 0.0, 1.0)) for name, v in zip(names, whitened.diagonal(), strict=True)}
    values, vectors = np.linalg.eigh(whitened)
    without_effect = _combinations_without_effect(constants)
    left_open = vectors[:, values > UNIDENTIFIABLE_SHARE]
    left_open = left_open - without_effect @ (without_effect.T @ left_open)
    basis, size, _ = np.linalg.svd(left_open, full_matrices=False)
    unidentifiable = (
        *_named(basis[:, size > UNIDENTIFIABLE_SHARE], names, prior_std, effects, at_other_poses=True),
        *_named(without_effect, names, prior_std, effects, at_other_poses=False),
    )
    return Identifiability(determined, unidentifiable, _correlated(whitened, names))


def _combinations_without_effect(constants: IdentificationResult) -> FloatArray:
    """(n, k) combinations of the constants, in prior standard deviations, that move the tip at no pose."""
    chain, rng = constants.perturbed_chain.chain, np.random.default_rng(0)
    angles = np.where(chain.is_prismatic, 500.0, np.pi) * rng.uniform(-1, 1, (POSES, chain.n_joints))
    ((_, _, by),) = constants.perturbed_chain.derivatives(ArmState(chain, angles), constants.coefficients)
    by_whitened = by.reshape(len(by), -1).T * constants.prior_std
    # Scale each column: a base that is uncertain by metres must not hide the effect of a link's milliradian.
    length = np.linalg.norm(by_whitened, axis=0)
    length[length == 0] = 1.0
    _, size, mixed = np.linalg.svd(by_whitened / length, full_matrices=False)
    found = (mixed[size < NO_DISPLACEMENT * size.max(initial=1.0)] / length).T
    return np.asarray(np.linalg.qr(found)[0])


def _levers(chain: Chain) -> FloatArray:
    """(n_places,) lengths of links from every place to the tip [mm]."""
    links = np.linalg.norm(chain.fixed[:, :3, 3], axis=1)
    links[0] = 0.0  # the instrument defines the base
    links[-1] += np.linalg.norm(chain.tip_in_flange)
    return np.append(links[::-1].cumsum()[::-1], 0.0)


def _named(
    open_directions: FloatArray, names: list[str], prior_std: FloatArray, effects: FloatArray, *, at_other_poses: bool
) -> tuple[Unidentifiable, ...]:
    """The combinations that span `open_directions` (n, k), each by one constant of its own and its partners.

    `effects` (n,) are the displacements of the tip by a unit of each [mm].
    """
    n_open = open_directions.shape[1]
    if not n_open:
        return ()
    pivots = _pivots(open_directions)
    echelon = prior_std[:, None] * (open_directions @ np.linalg.inv(open_directions[pivots]))
    found = []
    for pivot, movement in zip(pivots, echelon.T, strict=True):
        moved = np.abs(movement) * effects
        by_size = np.argsort(-moved, kind="stable")
        largest = [i for i in by_size if i != pivot and moved[i] > LEAST_SHARE * moved[pivot]]
        members = [int(pivot), *(int(i) for i in largest[: MOST_PARTNERS - 1])]
        found.append(
            Unidentifiable(tuple(names[i] for i in members), tuple(float(movement[i]) for i in members), at_other_poses)
        )
    return tuple(sorted(found, key=lambda one: names.index(one.constants[0])))


def _pivots(open_directions: FloatArray) -> IntArray:
    """Rows of an (n, k) matrix that pivoted Gram-Schmidt selects, of equal ones the first: rounding must not decide."""
    rows, pivots = open_directions.copy(), np.zeros(open_directions.shape[1], dtype=np.intp)
    for k in range(len(pivots)):
        size = np.linalg.norm(rows, axis=1)
        pivots[k] = np.argmax(size >= (1 - _TIE) * size.max())
        along = rows[pivots[k]] / size[pivots[k]]
        rows -= np.outer(rows @ along, along)
    return pivots


def _correlated(covariance: FloatArray, names: list[str]) -> tuple[CorrelatedPair, ...]:
    scale = np.sqrt(np.maximum(covariance.diagonal(), np.finfo(float).tiny))
    upper = np.triu(covariance / np.outer(scale, scale), 1)
    strongest = np.argsort(-np.abs(upper), axis=None)[:10]
    pairs = [divmod(int(k), len(names)) for k in strongest]
    return tuple(
        CorrelatedPair((names[i], names[j]), float(upper[i, j])) for i, j in pairs if abs(upper[i, j]) > STRONG
    )
