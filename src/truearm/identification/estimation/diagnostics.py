"""Identifiable parameters: combinations of constants that the readings do not determine.

The posterior covariance of the constants is divided by their prior standard deviations on both sides.
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
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray, IntArray

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
