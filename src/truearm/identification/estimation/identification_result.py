"""Result of an identification: terms with covariance, groups with their scales, references with their noise.

The derivatives of an arm whose motions are the same in every pose, as one of constants alone, are prepared once.
With its motions composed it is a chain without any, and a change of a coefficient is a small motion of that chain,
the same in every pose. So the derivatives along the sites are those of the chain by its small motions, times a matrix.

Terms that the arm lacks, beside its constants, move tips in part as these do: a translation in the plane of a joint
that turns backwards with its angle is a constant one before the joint. Of 245 derivatives of such an arm of six joints
65 are sums of others at every pose. With ``J = K P`` for independent columns K of J,

    J Sigma J^T = K (P Sigma P^T) K^T,

in which half as many numbers are multiplied, and the covariance has a Cholesky factor.

Source of the columns: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th ed., section 5.4.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Self

import numpy as np
from scipy.linalg import qr, solve_triangular

from truearm.arm.arm import NOT_KEPT
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import exponential_derivative, rotations
from truearm.identification.estimation.covariance_root import CovarianceRoot
from truearm.identification.estimation.perturbed_chain import FEW, PerturbedChain, SiteDerivatives, chunks, moved_chain
from truearm.identification.references.references import Reference
from truearm.identification.terms.basis import Constant, Harmonics
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import Term
from truearm.typing import BoolArray, FloatArray, IntArray

# Poses at which columns are compared at first, beside one for three of them: each has three coordinates.
SPARE_POSES = 20
# Angles of sliding joints there, to both sides [mm].
TRAVEL_MM = 500.0
# Columns of length one that are farther from the others than this are independent: rounding is 1e-15 of them, and the
# nearest of a UR10 are 1e-5 apart.
INDEPENDENT = 1e-10
# A column that others make up differs from them by less at other poses, in its length.
SAME = 1e-7
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
            piece = state.rows(rows)
            yield rows, *self._along_sites(piece), self.perturbed_chain.values(piece)

    def without_repeated(self, covariance: FloatArray) -> tuple[Self, FloatArray]:
        """The arm with fewer of its terms, and a covariance of their coefficients: tips have the same covariance.

        Coefficients of functions of nothing but the joint angles are compared. Those that are omitted have a variance
        of zero; terms of omitted coefficients alone are omitted too.
        """
        which = covariance.diagonal() > 0
        n_poses = max(SPARE_POSES + int(which.sum()) // 3, FEW)
        while (found := self._repeated(which, n_poses)) is None:
            n_poses *= 2
        (kept, left, shares), fewer = found, covariance.copy()
        fewer[kept] += shares @ fewer[left]
        fewer[:, kept] += fewer[:, left] @ shares.T
        fewer[left] = fewer[:, left] = 0.0
        pairs = zip(self.perturbed_chain.terms, self.perturbed_chain.columns, strict=True)
        is_left = fewer.diagonal() != 0
        remaining = [pair for pair in pairs if is_left[pair[1]].any()]
        of_terms = np.concatenate([np.zeros(0, np.intp), *(columns for _, columns in remaining)])
        rest = PerturbedChain(self.perturbed_chain.chain, tuple(term for term, _ in remaining))
        return replace(self, perturbed_chain=rest), fewer[np.ix_(of_terms, of_terms)]

    def _repeated(self, which: BoolArray, n_poses: int) -> tuple[IntArray, IntArray, FloatArray] | None:
        """Of some coefficients those to keep, those to omit, and the shares of the omitted ones that the others take.

        None where they do not have these shares at other poses: along one direction a pose shows one coordinate.
        """
        compared, derivatives = self._derivatives_at_poses(which, n_poses + FEW)
        elsewhere, derivatives = derivatives[..., n_poses:], derivatives[..., :n_poses].reshape(len(compared), -1)
        size = np.maximum(np.linalg.norm(derivatives, axis=1), LEAST_MM)
        # Constants and harmonics are the quickest to evaluate: others are omitted first, as if they were short.
        size[~self.perturbed_chain.of_basis(Constant, Harmonics)[compared]] *= LATER
        derivatives /= size[:, None]
        R, order = qr(derivatives.T, overwrite_a=True, mode="r", pivoting=True, check_finite=False)
        n = int(np.count_nonzero(np.abs(R.diagonal()) > INDEPENDENT))
        shares = solve_triangular(R[:n, :n], R[:n, n:], check_finite=False) * (size[order[n:]] / size[order[:n], None])
        off = elsewhere[order[n:]] - np.tensordot(shares, elsewhere[order[:n]], (0, 0))
        if n_poses < len(compared) and (np.linalg.norm(off, axis=(1, 2)) > SAME * size[order[n:]]).any():
            return None
        return compared[order[:n]], compared[order[n:]], shares

    def _derivatives_at_poses(self, which: BoolArray, n_poses: int) -> tuple[IntArray, FloatArray]:
        """Coefficients of functions of the joint angles among some, and derivatives (.., 3, m) of tips at poses."""
        arm, half = self.perturbed_chain, np.where(self.chain.is_prismatic, TRAVEL_MM, np.pi)
        pairs = zip(arm.terms, arm.columns, strict=True)
        compared = [pair for pair in pairs if (inputs := pair[0].basis.inputs) is not None and inputs <= {"angle"}]
        terms, of_terms = [term for term, _ in compared], [columns for _, columns in compared]
        columns = np.concatenate([np.zeros(0, np.intp), *of_terms])
        state = ArmState(arm.chain, np.random.default_rng(0).uniform(-half, half, (n_poses, len(half))))
        values = {basis: basis.values(state) for basis in dict.fromkeys(term.basis for term in terms)}
        directions = np.array([term.direction for term in terms]).reshape(-1, 6)
        motions = self._motions(np.array([term.place for term in terms], dtype=np.intp), directions)
        along = motions @ moved_chain(self.chain, state)[1].reshape(motions.shape[1], -1)
        derivatives = np.repeat(along, list(map(len, of_terms)), axis=0)
        derivatives *= np.tile(np.concatenate([np.zeros((0, n_poses)), *(values[term.basis] for term in terms)]), 3)
        return columns[which[columns]], derivatives[which[columns]].reshape(-1, 3, n_poses)

    def _motions(self, places: IntArray, directions: FloatArray) -> FloatArray:
        """(k, 6 n_places) components of the small motions of `chain` by motions at places (k,) along directions."""
        out = np.zeros((len(places), *self.changes.shape[:2]))
        out[np.arange(len(places)), places] = (self.changes[places] @ directions[:, :, None])[:, :, 0]
        return out.reshape(len(places), 6 * len(self.changes))

    @cached_property
    def _by_motion(self) -> FloatArray:
        """(n_sites, 6 n_places) components of the small motions of `chain` by a motion along each site."""
        directions, places = self.perturbed_chain.of_site
        return self._motions(places, directions)

    def _along_sites(self, state: ArmState) -> tuple[FloatArray, FloatArray]:
        """Tips (3, m) [mm] and their derivatives (n_sites, 3, m) along the sites."""
        tips, jacobian = moved_chain(self.chain, state)
        along_sites = self._by_motion.dot(jacobian.reshape(self._by_motion.shape[1], -1))
        return tips, along_sites.reshape(-1, *jacobian.shape[2:])


@dataclass(frozen=True)
class TermGroupResult:
    """Outcome for a group of terms.

    Attributes
    ----------
    name : str
    n_coefficients : int
        Number of coefficients offered.
    effective : float
        How many of them the readings determine.
    scale : float
        Scale of the prior, relative to the start value; 0 if the evidence pruned the group.
    """

    name: str
    n_coefficients: int
    effective: float
    scale: float


@dataclass(frozen=True, eq=False)
class ReferenceFit:
    """Residuals and noise of a reference under the identified terms.

    Attributes
    ----------
    kind : str
        Kind of reference: point, seat, ...
    rows : (m,) int array
        Rows of its readings.
    residuals : (k, m) array
        [mm].
    std : (k, m) array
        Stated standard uncertainties, with those by rounding of the angles [mm].
    noise_std : float
        Standard deviation of a residual beyond the stated uncertainty [mm].
    robust_weight : (m,) array
        Robust weight of every reading, 1 unless it is an outlier.
    artefact : (m,) int array
        Index of the seat or sphere of each reading; zeros for points.
    unknowns : dict of str to float
        Identified unknowns of the artefacts by name; the names state units.
    repeat_variance : (m,) array, optional
        Variance by which errors common to repeats lower the weight of each [mm^2].
    to_minimum : (k, m) array, optional
        Change of the residuals to the minimum of the linearisation, of which the last round stopped short [mm]; None
        where that is not known, or nothing.
    """

    kind: str
    rows: IntArray
    residuals: FloatArray
    std: FloatArray
    noise_std: float
    robust_weight: FloatArray
    artefact: IntArray
    unknowns: dict[str, float]
    repeat_variance: FloatArray | None = None
    to_minimum: FloatArray | None = field(default=None, metadata={NOT_KEPT: True})

    @property
    def weights(self) -> FloatArray:
        """(k, m) weights of the residuals: square roots of robust weight over variance [1/mm]."""
        of_repeats = 0.0 if self.repeat_variance is None else self.repeat_variance
        return np.asarray(np.sqrt(self.robust_weight / (self.std**2 + self.noise_std**2 + of_repeats)))


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """Result of an identification.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        The nominal chain, placed, with its terms; pruned groups are not among them.
    coefficients : (n_coefficients,) array
        Coefficients of the terms [rad or mm per unit of the basis].
    covariance : (n_coefficients, n_coefficients) array
        Their posterior covariance.
    prior_std : (n_coefficients,) array
        Their prior standard deviations as scaled by the evidence.
    groups : tuple of TermGroupResult
        All groups that were offered.
    references : tuple of ReferenceFit
    converged : bool
    rounds : int
    repeatability_covariance : (n_coefficients, n_coefficients) array, optional
        The posterior covariance under repeatability conditions (JCGM 200:2012, 2.20): on the day of the readings, in
        their set-up. `covariance` is then that of any day. None where the two are one.
    """

    perturbed_chain: PerturbedChain
    coefficients: FloatArray
    covariance: FloatArray
    prior_std: FloatArray
    groups: tuple[TermGroupResult, ...]
    references: tuple[ReferenceFit, ...]
    converged: bool
    rounds: int
    repeatability_covariance: FloatArray | None = None

    @cached_property
    def chain(self) -> Chain:
        """The chain with the constant terms composed, without those that depend on the state of the arm."""
        return self.perturbed_chain.with_constants(self.coefficients)

    def columns_of(self, is_meant: Callable[[Term], bool]) -> BoolArray:
        """(n_coefficients,) Whether each coefficient is of a term that is meant."""
        terms = self.perturbed_chain.terms
        meant, counts = [is_meant(term) for term in terms], [term.n_coefficients for term in terms]
        return np.repeat(np.array(meant, dtype=bool), counts)

    def select(self, is_meant: Callable[[Term], bool]) -> IdentificationResult:
        """The same with some of the terms; the others are integrated out."""
        kept = self.columns_of(is_meant)
        if kept.all():
            return self
        return replace(
            self,
            perturbed_chain=PerturbedChain(
                self.perturbed_chain.chain, tuple(filter(is_meant, self.perturbed_chain.terms))
            ),
            coefficients=self.coefficients[kept],
            covariance=self.covariance[np.ix_(kept, kept)],
            prior_std=self.prior_std[kept],
            repeatability_covariance=None
            if (same := self.repeatability_covariance) is None
            else same[np.ix_(kept, kept)],
        )

    def under_repeatability_conditions(self) -> IdentificationResult:
        """The result on the day of its readings, in their set-up; itself where that makes no difference."""
        if self.repeatability_covariance is None:
            return self
        return replace(self, covariance=self.repeatability_covariance, repeatability_covariance=None)

    @property
    def parameters(self) -> FloatArray:
        """The coefficients, then the unknowns of the references: the parameters of `SmallMotionProblem`."""
        return np.concatenate([self.coefficients, *(list(part.unknowns.values()) for part in self.references)])

    def residual_freedom(self, references: Sequence[Reference]) -> float:
        """Number of residuals and constraints of the references less that of the parameters and unknowns."""
        n_residuals = sum(len(part.residuals) * int((part.robust_weight > 0).sum()) for part in self.references)
        unknowns = [np.array(list(part.unknowns.values())) for part in self.references]
        found = [reference.constraints(x) for reference, x in zip(references, unknowns, strict=True)]
        n_constraints = sum(len(one.residuals) for one in found if one is not None)
        n_unknowns = sum(map(len, unknowns)) - n_constraints
        return n_residuals - n_unknowns - sum(group.effective for group in self.groups)

    @cached_property
    def _is_constant(self) -> bool:
        return self.perturbed_chain.is_constant(self.coefficients)

    def tips(self, state: ArmState) -> FloatArray:
        """(n, 3) tips [mm] at the readings of a state."""
        if self._is_constant:
            return self.chain.tip_in_base(state.angles)
        return self.perturbed_chain.tips(state, self.coefficients)

    def tip_covariance(self, state: ArmState) -> FloatArray:
        """(n, 3, 3) covariance of tips [mm^2] by that of the coefficients, to first order."""
        return self.uncertain_tips(state)[1]

    def uncertain_tips(self, state: ArmState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`tips`, `tip_covariance` and `direction_effects`, with the basis functions evaluated once."""
        (derivatives, root), chain, x = self._uncertain, self.perturbed_chain, self.coefficients
        is_few, is_constant, out = len(state) <= FEW, self._is_constant, np.empty((len(state), 3, 3))
        tips = self.chain.tip_in_base(state.angles) if is_constant and not is_few else np.empty((len(state), 3))
        of_directions = np.zeros((chain.chain.n_joints, len(state), 3))
        for rows, own, along_sites, values in derivatives(state):
            if is_few:
                tips = own.T  # the same to the last bit
            elif not is_constant:
                tips[rows] = chain.tips_from_values(state.angles[rows], values, x)
            if not is_constant:
                of_directions[:, rows] = chain.direction_effects(state.rows(rows), x, along_sites)
            out[rows] = root.covariances(along_sites, values, state.joint_angles[rows])
        return tips, out + self.unspanned_covariance(state) if self.processes else out, of_directions

    def direction_effects(self, state: ArmState) -> FloatArray:
        """(n_joints, n, 3) effects of unknown directions of movement on the tips [mm]: see `PerturbedChain`."""
        chain, x = self.perturbed_chain, self.coefficients
        out = np.zeros((chain.chain.n_joints, len(state), 3))
        if state.directions is not None and not chain.is_constant(x):
            for rows, _, along_sites, _ in chain.site_derivatives(state, x):
                out[:, rows] = chain.direction_effects(state.rows(rows), x, along_sites)
        return out

    def expected_square_error(self, state: ArmState) -> float:
        """Expected squared error of a tip, by parameters and noise, mean over the readings of a state [mm^2].

        Integrated over a region it is the criterion of I-optimal plans: V. V. Fedorov, "Theory of Optimal Experiments",
        1972, section 2.9.
        """
        of_parameters = np.trace(self.tip_covariance(state), axis1=1, axis2=2)
        return float(of_parameters.mean() + 3 * self.references[0].noise_std ** 2)

    def tip_displacements(self, state: ArmState) -> FloatArray:
        """(k, n, 3) the errors of tips [mm] by k independent causes of variance one.

        The sum of their products is `tip_covariance`, and those between two readings are the covariance of their tips.
        """
        derivatives, root = self._uncertain
        out = np.zeros((root.n_rows, len(state), 3))
        for rows, _, along_sites, values in derivatives(state):
            out[:, rows] = root.times(along_sites, values).transpose(0, 2, 1)
        return np.concatenate([out, self.unspanned_displacements(state)])

    def unspanned_covariance(self, state: ArmState) -> FloatArray:
        """(n, 3, 3) covariance of tips [mm^2] by what processes do between and beyond their inducing points."""
        displacements = self.unspanned_displacements(state)
        return np.asarray(np.einsum("kni,knj->nij", displacements, displacements))

    def unspanned_displacements(self, state: ArmState) -> FloatArray:
        """(k, n, 3) the same as displacements [mm] of tips by k independent processes of variance one."""
        processes = self.processes
        out = np.zeros((len(processes), len(state), 3))
        alike = dict.fromkeys((term.place, term.basis) for term, _ in processes)
        for place, basis in alike:
            size = np.sqrt(basis.remainder(state))[:, None]
            by_motion = self.perturbed_chain.motion_derivatives(state, self.coefficients, place)
            for own, (term, std) in zip(out, processes, strict=True):
                if (term.place, term.basis) == (place, basis):
                    own[:] = std * size * np.tensordot(by_motion, np.array(term.direction), axes=(1, 0))
        return out

    @cached_property
    def processes(self) -> list[tuple[Term, float]]:
        """Terms whose functions approximate a process, and its prior standard deviation."""
        chain = self.perturbed_chain
        pairs = zip(chain.terms, chain.columns, strict=True)
        return [(term, float(self.prior_std[columns[-1]])) for term, columns in pairs if term.basis.is_approximate]

    @cached_property
    def covariance_root(self) -> CovarianceRoot:
        """F with ``F^T F`` the covariance of the coefficients that are uncertain."""
        return CovarianceRoot.of(self.covariance, self.perturbed_chain)

    @cached_property
    def _uncertain(self) -> tuple[Callable[[ArmState], SiteDerivatives], CovarianceRoot]:
        """The derivatives of tips along sites (`PerturbedChain.site_derivatives`), and F with ``F^T F`` the covariance.

        Of an arm with constant motions without the terms that move tips as others do.
        """
        if not self.perturbed_chain.is_constant(self.coefficients):
            derivatives = partial(self.perturbed_chain.site_derivatives, x=self.coefficients)
            return derivatives, self.covariance_root
        composed = ComposedArm.of(self.perturbed_chain, self.coefficients)
        if not any(isinstance(term.basis, Harmonics) for term in self.perturbed_chain.terms):
            return composed.site_derivatives, self.covariance_root
        composed, covariance = composed.without_repeated(self.covariance)
        return composed.site_derivatives, CovarianceRoot.of(covariance, composed.perturbed_chain)
