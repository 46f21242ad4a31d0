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
import numpy.typing as npt
from scipy.linalg import qr

from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms.basis import Constant, Harmonics
from truearm.identification.terms.state import ArmState
from truearm.solve.square_roots import unit_diagonal
from truearm.typing import FloatArray, IntArray


@dataclass(frozen=True)
class Effect:
    """What a group of terms does to the arm, root mean square over readings.

    Attributes
    ----------
    group : str
    offered : int
        Coefficients.
    determined : float
        How many of them the readings told.
    rotation_rad, shift_mm : float or None
        Size of the motions, over all places and directions that the group has there [rad, mm]. None where it has none,
        was given up, or is free: how an arm is put into its frame is no error of it.
    tip_mm : float or None
        How far they move the tip, to first order, but for what base and tip would take up where they are free [mm].
        Groups that act alike may each move it far and cancel.
    """

    group: str
    offered: int
    determined: float
    rotation_rad: float | None
    shift_mm: float | None
    tip_mm: float | None


def effects(fit: IdentificationResult, state: ArmState) -> tuple[Effect, ...]:
    """What every group of terms that was offered does at the readings of a state, in the order offered.

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
    for site, value in zip(fit.perturbed_chain.sites, fit.perturbed_chain.values(state), strict=True):
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


def _tip_squares(
    fit: IdentificationResult, state: ArmState, group: IntArray, is_free: npt.NDArray[np.bool_]
) -> FloatArray:
    """(n_groups,) sums of squares of the tip's displacements, but for what the free groups can make up for."""
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
    made_up = np.linalg.pinv(unit, rcond=1e-12, hermitian=True) @ cross
    return np.asarray(np.maximum(own - (cross * made_up).sum(axis=0), 0.0))


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


# Above this share of the prior variance a combination is as good as unknown.
UNIDENTIFIABLE_SHARE = 0.5
# Poses of all kinds, at which a combination moves the tip, or at none. To move it by a smaller share than this of what
# its members do, each alone, is not to move it: axes that the drawing has parallel or at right angles are not quite.
POSES = 100
STILL = 2e-3
# Partners that move the tip by a smaller share of what the combination's first constant does are not named.
LEAST_SHARE = 0.2
# A combination of more constants than this is named by its largest.
MOST_PARTNERS = 4
STRONG = 0.95


@dataclass(frozen=True)
class Unidentifiable:
    """A combination of constants that the readings do not determine.

    Attributes
    ----------
    constants : tuple of str
        Their names. Of several only a sum, with the weights, is known: they can move together and nothing shows.
    movement : tuple of float
        How far each moves together with the first [rad or mm], the first by its prior standard deviation.
    at_other_poses : bool
        Whether readings at other poses would determine it.
    """

    constants: tuple[str, ...]
    movement: tuple[float, ...]
    at_other_poses: bool = True

    @property
    def status(self) -> str:
        """How much of it is known, in words."""
        if len(self.constants) == 1:
            return "not told"
        return "only together" if self.at_other_poses else "only together, by any readings"

    def __str__(self) -> str:
        if len(self.constants) == 1:
            return self.constants[0]
        return f"{', '.join(self.constants[:-1])} and {self.constants[-1]} only together"


@dataclass(frozen=True)
class CorrelatedPair:
    """Two constants whose errors go together.

    Attributes
    ----------
    constants : tuple of str
    correlation : float
    """

    constants: tuple[str, str]
    correlation: float


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What readings tell of the constants.

    Attributes
    ----------
    determined : dict of str to float
        Share of each constant's prior variance that the readings took away: 1 fully known, 0 as before.
    unidentifiable : tuple of Unidentifiable
        Combinations left open.
    correlated : tuple of CorrelatedPair
        Pairs with a correlation beyond 0.95, the strongest first, ten at most.
    """

    determined: dict[str, float]
    unidentifiable: tuple[Unidentifiable, ...]
    correlated: tuple[CorrelatedPair, ...]


def identifiability(fit: IdentificationResult) -> Identifiability:
    """What the readings of a fit tell of its constants; base and tip where they are free too."""
    names, columns, effects, start = [], [], [], 0
    levers = _levers(fit.chain)
    for term in fit.perturbed_chain.terms:
        if isinstance(term.basis, Constant):
            names.append(term.name)
            columns.append(start)
            turn, shift = np.linalg.norm(term.direction[:3]), np.linalg.norm(term.direction[3:])
            effects.append(float(turn * levers[term.place] + shift))
        start += term.n_coefficients
    if not names:
        return Identifiability({}, (), ())
    prior_std = fit.prior_std[columns]
    whitened = fit.covariance[np.ix_(columns, columns)] / np.outer(prior_std, prior_std)
    determined = {name: float(np.clip(1 - v, 0.0, 1.0)) for name, v in zip(names, whitened.diagonal(), strict=True)}
    values, vectors = np.linalg.eigh(whitened)
    still = _still(fit, columns)
    left_open = vectors[:, values > UNIDENTIFIABLE_SHARE]
    left_open = left_open - still @ (still.T @ left_open)
    beside, size, _ = np.linalg.svd(left_open, full_matrices=False)
    unidentifiable = (
        *_named(beside[:, size > UNIDENTIFIABLE_SHARE], names, prior_std, np.array(effects), at_other_poses=True),
        *_named(still, names, prior_std, np.array(effects), at_other_poses=False),
    )
    return Identifiability(determined, unidentifiable, _correlated(whitened, names))


def _still(fit: IdentificationResult, columns: list[int]) -> FloatArray:
    """(n, k) combinations of the constants, over their prior standard deviations, that move the tip at no pose."""
    chain, rng = fit.perturbed_chain.chain, np.random.default_rng(0)
    angles = np.where(chain.is_prismatic, 500.0, np.pi) * rng.uniform(-1, 1, (POSES, chain.n_joints))
    arm = PerturbedChain(chain, tuple(term for term in fit.perturbed_chain.terms if isinstance(term.basis, Constant)))
    ((_, _, by),) = arm.derivatives(ArmState(chain, angles), fit.coefficients[columns])
    by_whitened = by.reshape(len(columns), -1).T * fit.prior_std[columns]
    # A base that may be metres off must not hide what a link's milliradian does: each column by its own size.
    length = np.linalg.norm(by_whitened, axis=0)
    length[length == 0] = 1.0
    _, size, mixed = np.linalg.svd(by_whitened / length, full_matrices=False)
    found = (mixed[size < STILL * size.max(initial=1.0)] / length).T
    return np.asarray(np.linalg.qr(found)[0])


def _levers(chain: Chain) -> FloatArray:
    """(n_places,) lengths of links from every place to the tip [mm]."""
    links = np.linalg.norm(chain.fixed[:, :3, 3], axis=1)
    links[0] = 0.0  # the base stands where the instrument has it
    links[-1] += np.linalg.norm(chain.tip_in_flange)
    return np.append(links[::-1].cumsum()[::-1], 0.0)


def _named(
    open_directions: FloatArray, names: list[str], prior_std: FloatArray, effects: FloatArray, *, at_other_poses: bool
) -> tuple[Unidentifiable, ...]:
    """The combinations that span `open_directions` (n, k), each by one constant of its own and what goes with it.

    `effects` (n,) say how far a unit of each moves the tip [mm].
    """
    n_open = open_directions.shape[1]
    if not n_open:
        return ()
    pivots = qr(open_directions.T, mode="r", pivoting=True)[1][:n_open]
    echelon = prior_std[:, None] * (open_directions @ np.linalg.inv(open_directions[pivots]))
    found = []
    for pivot, movement in zip(pivots, echelon.T, strict=True):
        moved = np.abs(movement) * effects
        largest = [i for i in np.argsort(-moved) if i != pivot and moved[i] > LEAST_SHARE * moved[pivot]]
        members = [int(pivot), *(int(i) for i in largest[: MOST_PARTNERS - 1])]
        found.append(
            Unidentifiable(tuple(names[i] for i in members), tuple(float(movement[i]) for i in members), at_other_poses)
        )
    return tuple(sorted(found, key=lambda one: names.index(one.constants[0])))


def _correlated(covariance: FloatArray, names: list[str]) -> tuple[CorrelatedPair, ...]:
    scale = np.sqrt(np.maximum(covariance.diagonal(), np.finfo(float).tiny))
    upper = np.triu(covariance / np.outer(scale, scale), 1)
    strongest = np.argsort(-np.abs(upper), axis=None)[:10]
    pairs = [divmod(int(k), len(names)) for k in strongest]
    return tuple(
        CorrelatedPair((names[i], names[j]), float(upper[i, j])) for i, j in pairs if abs(upper[i, j]) > STRONG
    )
