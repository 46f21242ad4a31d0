"""An arm whose motions are the same in every pose, as one of constants alone: its derivatives, prepared once.

With its motions composed the arm is a chain without any, and a change of a coefficient is a small motion of that chain,
the same in every pose. So the derivatives along the sites are those of the chain by its small motions, times a matrix.

Terms that the arm lacks, beside its constants, move tips in part as these do: a translation in the plane of a joint
that turns backwards with its angle is a constant one before the joint. Of 245 derivatives of such an arm of six joints
65 are sums of others at every pose. With ``J = K P`` for independent columns K of J,

    J Sigma J^T = K (P Sigma P^T) K^T,

in which half as many numbers are multiplied, and the covariance has a Cholesky factor.

Source of the columns: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., section 5.4.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.linalg import qr, solve_triangular

from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import exponential_derivative, rotations
from truearm.identification.estimation.perturbed_chain import PerturbedChain, SiteDerivatives, chunks, moved_chain
from truearm.identification.terms.basis import Constant, Harmonics
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray, IntArray

# Poses at which columns are compared, beside one for two of them: each has three coordinates.
FEWEST_POSES = 20
# Angles of sliding joints there, to both sides [mm].
TRAVEL_MM = 500.0
# Columns of length one that are farther from the others than this are independent: rounding is 1e-15 of them, and the
# nearest of a UR10 are 1e-5 apart.
INDEPENDENT = 1e-10
# A column that is shorter is rounding: it moves no tip.
LEAST_MM = 1e-3
LATER = 1e3


@dataclass(frozen=True, eq=False)
class ComposedArm:
    """The chain with all motions composed, and the small motions of it along the sites.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        The arm, with coefficients for which its motions are constant.
    chain : Chain
    changes : (n_places, 6, 6) array
        Components of the small motion of `chain` at a place, by those of the motion there.
    """

    perturbed_chain: PerturbedChain
    chain: Chain
    changes: FloatArray

    @classmethod
    def of(cls, perturbed_chain: PerturbedChain, x: FloatArray) -> Self:
        """The arm with coefficients `x` for which its motions are constant."""
        chain = perturbed_chain.chain
        motions = perturbed_chain.constant_motions(x)
        changes = exponential_derivative(motions)
        # The motions of base and tip are composed before these places: what changes there is along axes turned by them.
        for place in (0, -1):
            turned = rotations(motions[place, :3, None])[:, :, 0].T
            changes[place, :3] = turned @ changes[place, :3]
            changes[place, 3:] = np.hstack([np.zeros((3, 3)), turned])
        return cls(perturbed_chain, chain.with_motions(motions), changes)

    def site_derivatives(self, state: ArmState) -> SiteDerivatives:
        """Yield what `PerturbedChain.site_derivatives` does."""
        for rows in chunks(len(state)):
            piece = state if len(state) <= rows.stop - rows.start else state.rows(rows)
            yield rows, *self._along_sites(piece), self.perturbed_chain.values(piece)

    def without_repeated(self, covariance: FloatArray) -> tuple[Self, FloatArray]:
        """The arm with fewer of its terms, and a covariance of their coefficients: tips have the same covariance.

        Coefficients of functions of nothing but the joint angles are compared. Those that are omitted have a variance
        of zero; terms of omitted coefficients alone are omitted too.
        """
        compared, derivatives = self._derivatives_at_poses()
        uncertain = covariance.diagonal()[compared] > 0
        compared, derivatives = compared[uncertain], derivatives[uncertain]
        size = np.maximum(np.linalg.norm(derivatives, axis=1), LEAST_MM)
        # Constants and harmonics are the quickest to evaluate: others are omitted first, as if they were short.
        size[~self.perturbed_chain.of_basis(Constant, Harmonics)[compared]] *= LATER
        R, order = qr((derivatives / size[:, None]).T, mode="r", pivoting=True, check_finite=False)
        n = int(np.count_nonzero(np.abs(R.diagonal()) > INDEPENDENT))
        shares = solve_triangular(R[:n, :n], R[:n, n:], check_finite=False)
        kept, left = compared[order[:n]], compared[order[n:]]
        remaining, arm = np.delete(np.arange(len(covariance)), left), self.perturbed_chain
        to_remaining = np.eye(len(covariance))[remaining]
        by_size = shares * size[order[n:]] / size[order[:n], None]
        to_remaining[np.ix_(np.searchsorted(remaining, kept), left)] = by_size
        fewer = np.zeros_like(covariance)
        fewer[np.ix_(remaining, remaining)] = to_remaining @ covariance @ to_remaining.T
        pairs = [pair for pair in zip(arm.terms, arm.columns, strict=True) if fewer.diagonal()[pair[1]].any()]
        of_terms = np.concatenate([np.zeros(0, np.intp), *(columns for _, columns in pairs)])
        rest = PerturbedChain(arm.chain, tuple(term for term, _ in pairs))
        return replace(self, perturbed_chain=rest), fewer[np.ix_(of_terms, of_terms)]

    def _derivatives_at_poses(self) -> tuple[IntArray, FloatArray]:
        """Coefficients of functions of the joint angles, and derivatives (.., m) of tips at random poses."""
        arm, half = self.perturbed_chain, np.where(self.chain.is_prismatic, TRAVEL_MM, np.pi)
        n_poses = FEWEST_POSES + arm.n_coefficients // 2
        state = ArmState(arm.chain, np.random.default_rng(0).uniform(-half, half, (n_poses, len(half))))
        along_sites, (site_of, _) = self._along_sites(state)[1], arm.of_coefficient
        compared, derivatives = [np.zeros(0, np.intp)], [np.zeros((0, 3, n_poses))]
        for term, columns in zip(arm.terms, arm.columns, strict=True):
            if (inputs := term.basis.inputs) is not None and inputs <= {"angle"}:
                compared.append(columns)
                derivatives.append(along_sites[site_of[columns]] * term.basis.values(state)[:, None])
        return np.concatenate(compared), np.concatenate(derivatives).reshape(-1, 3 * n_poses)

    @cached_property
    def _by_motion(self) -> FloatArray:
        """(n_sites, 6 n_places) components of the small motions of `chain` by a motion along each site."""
        sites, changes = self.perturbed_chain.sites, self.changes
        out = np.zeros((len(sites), *changes.shape[:2]))
        for own, site in zip(out, sites, strict=True):
            own[site.place] = changes[site.place] @ site.direction
        return out.reshape(len(sites), 6 * len(changes))

    def _along_sites(self, state: ArmState) -> tuple[FloatArray, FloatArray]:
        """Tips (3, m) [mm] and their derivatives (n_sites, 3, m) along the sites."""
        tips, jacobian = moved_chain(self.chain, state)
        along_sites = self._by_motion.dot(jacobian.reshape(self._by_motion.shape[1], -1))
        return tips, along_sites.reshape(-1, *jacobian.shape[2:])
