"""What readings tell of an arm's constants, and what they leave open, in words.

With the posterior covariance of the constants divided by their prior standard deviations on both sides, an eigenvalue
near 1 is a combination of constants of which the readings say nothing: it is as little known as before. Eigenvectors of
equal eigenvalues are any mixture; brought to echelon form by the constants that stand for them best, they name few.
Those that move no tip at any pose, as a shift of the tip and one of the last link may, stand by themselves: no readings
tell them, and nothing is lost.

What goes with a constant is told by how far it moves the tip: a free tip, a metre uncertain beforehand, hardly moves by
its own measure when it makes up for a millimetre of the last link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from truearm.arm.chain import Chain
from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.estimation.problem import PerturbedChain
from truearm.identification.terms.basis import Constant
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray

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
