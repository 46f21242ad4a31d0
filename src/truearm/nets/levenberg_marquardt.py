"""Levenberg-Marquardt training: ``trainlm`` with MATLAB's names, defaults and stops, and ``trainbr``, regularised.

``trainbr`` estimates the scales of parameters and of noise from the data by evidence. With residuals r of precision
beta and parameters x of prior precision alpha about zero, the type-II likelihood is greatest where

    gamma = sum over i of 1 - alpha [(beta J^T J + alpha I)^-1]_ii,
    alpha = gamma / |x|^2,   beta = (n - gamma) / |r|^2.

MacKay's fixed point repeats this; gamma counts the parameters that the data, rather than the prior, determine. Source:
D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415, eqs. 4.8 to 4.10.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_numpy_array
from scipy.linalg import LinAlgError, cholesky
from scipy.linalg.lapack import dtrtri

from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import DampedOptions, TrainingLog, TrainingRecord, checked_start
from truearm.solve import (
    CostGoal,
    DampingLimit,
    MinGradient,
    NormalEquations,
    OptimizerState,
    StopReason,
    levenberg_marquardt,
)
from truearm.solve.linear_algebra import Array, add_to_diagonal, to_numpy
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class LevenbergMarquardtOptions(DampedOptions):
    """Options of `trainlm`, as MATLAB's.

    Parameters
    ----------
    max_fail : int
        Validation failures since the best epoch that end it.
    """

    max_fail: int = 6


def trainlm(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network's weights.

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when
    `gradient` is at `min_grad`, when `mu` is at `mu_max`, and when the validation error was above its best `max_fail`
    times. With more weights than errors it still trains: the damping chooses among the weights that fit alike.

    Parameters
    ----------
    training : FitProblem
    weights : (n_weights,) array
        Where to start.
    **options
        Those of `LevenbergMarquardtOptions`. `min_grad` is a norm of the gradient of the mean squared error. The
        damping `mu` is added to ``J^T J / n`` of the n scaled errors, as MATLAB's is for ``mse``.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : TrainingRecord

    Raises
    ------
    InputError
        If weights, data or options do not fit together.
    """
    chosen = LevenbergMarquardtOptions(**options)
    start, n, log = checked_start(training, weights, chosen), training.n_errors, TrainingLog(training, chosen)
    with one_blas_thread():
        levenberg_marquardt(
            training,
            start,
            damping=chosen.damping(n),  # (J^T J / n + mu I) step = -J^T e / n, multiplied by n
            stops=log.stops(CostGoal(chosen.goal * log.half), MinGradient(chosen.min_grad * log.half), DampingLimit()),
            callback=lambda state: log.record_lm_epoch(state, mu=state.mu / n),
            clock=chosen.clock,
        )
    return log.best_weights(), log.record(TrainingRecord)


@dataclass(frozen=True)
class Evidence:
    """Precisions and the effective number of parameters.

    Attributes
    ----------
    alpha : float
        Prior precision of a parameter, one over its unit squared.
    beta : float
        Precision of a residual, one over its unit squared.
    gamma : float
        Effective number of parameters.
    """

    alpha: float
    beta: float
    gamma: float


def update_evidence(
    evidence: Evidence, *, gram: Array, parameter_squares: float, residual_squares: float, n_residuals: int
) -> Evidence:
    """One round of MacKay's fixed point.

    Parameters
    ----------
    evidence : Evidence
        Precisions so far.
    gram : (p, p) array
        ``J^T J`` of the unweighted residuals, of NumPy or PyTorch.
    parameter_squares, residual_squares : float
        ``|x|^2`` and ``|r|^2`` at or near the most probable parameters under `evidence`.
    n_residuals : int
        Number of residuals.

    Returns
    -------
    Evidence
        The precision is unchanged if all parameters, or all residuals, are zero.
    """
    p = gram.shape[0]
    gamma = float(np.clip(p - evidence.alpha * _trace_of_variances(evidence, gram), 0, p))
    # With as many parameters as data no freedom remains to estimate the noise: use a thousandth instead.
    freedom = max(n_residuals - gamma, 1e-3 * n_residuals)
    return Evidence(
        alpha=gamma / parameter_squares if parameter_squares > 0 and gamma > 0 else evidence.alpha,
        beta=freedom / residual_squares if residual_squares > 0 else evidence.beta,
        gamma=gamma,
    )


def _trace_of_variances(evidence: Evidence, gram: Array) -> float:
    """Trace of ``(beta J^T J + alpha I)^-1``."""
    if is_numpy_array(gram):
        precision = evidence.beta * gram
        add_to_diagonal(precision, evidence.alpha)
        try:
            # With A = L L^T the trace is the sum of squares of L^-1, which costs a sixth of the whole inverse.
            inverse, _ = dtrtri(cholesky(precision, lower=True, overwrite_a=True, check_finite=False), lower=1)
            return float(np.vdot(inverse, inverse))
        except LinAlgError:  # rounding made eigenvalues of undetermined directions negative
            pass
    values = to_numpy(array_namespace(gram).linalg.eigvalsh(gram))
    return float((1 / (evidence.beta * np.maximum(values, 0) + evidence.alpha)).sum())


# Foresee and Hagan's start, alpha = 0 and beta = 1 of ``beta |e|^2 + alpha |w|^2``: the errors alone, with just enough
# beside them to tell apart what the data do not determine at all.
FIRST_ALPHA, FIRST_BETA = 1e-6, 2.0
# While an epoch lowers the cost by more than this share, the errors are not noise yet, but what is still to be learnt.
# Taken for noise they smooth the network flat, often for good: a sine ends as a line.
LEARNING = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class BayesianRecord(TrainingRecord):
    """A training record with the evidence after every epoch.

    Attributes
    ----------
    gamk : (epochs + 1,) array
        Effective number of weights.
    ssX : (epochs + 1,) array
        Sum of squared weights.
    alpha, beta : (epochs + 1,) array
        Precision of a weight and of a scaled error; MATLAB's are half of these.
    """

    gamk: FloatArray
    ssX: FloatArray
    alpha: FloatArray
    beta: FloatArray


@dataclass(frozen=True, eq=False)
class RegularisedEquations(NormalEquations):
    """The equations of errors and weights together, with those of the errors alone."""

    errors: NormalEquations


@dataclass(frozen=True, eq=False)
class RegularisedProblem:
    """A network's fit with a Gaussian prior on its weights: ``(beta |e|^2 + alpha |w|^2) / 2``."""

    fit: FitProblem
    evidence: Evidence

    def cost(self, x: FloatArray) -> float:
        """The cost at weights `x` (n_weights,)."""
        return self.evidence.beta * self.fit.cost(x) + 0.5 * self.evidence.alpha * float(x @ x)

    def normal_equations(self, x: FloatArray) -> RegularisedEquations:
        """Cost, gradient and Gauss-Newton matrix at weights `x` (n_weights,)."""
        return self.weighted(x, self.fit.normal_equations(x))

    def weighted(self, x: FloatArray, errors: NormalEquations) -> RegularisedEquations:
        """The equations at `x` from those of the errors alone."""
        alpha, beta = self.evidence.alpha, self.evidence.beta
        gram = beta * errors.gram
        add_to_diagonal(gram, alpha)
        cost = beta * errors.cost + 0.5 * alpha * float(x @ x)
        return RegularisedEquations(cost, beta * errors.gradient + alpha * x, gram, errors)


@dataclass(frozen=True, eq=False, kw_only=True)
class BayesianOptions(DampedOptions):
    """Options of `trainbr`, as MATLAB's."""

    mu: float = 5e-3


def trainbr(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, BayesianRecord]:
    """Train a network's weights, weighing errors against the size of the weights by the evidence.

    Every epoch is a Levenberg-Marquardt step on ``beta |e|^2 + alpha |w|^2``, then one round of MacKay's fixed point.
    The number of weights in use, `gamk`, converges by itself, so that no validation data are needed to stop in time.

    Source: F. D. Foresee, M. T. Hagan, "Gauss-Newton approximation to Bayesian learning", ICNN 1997, 1930-1935. As
    there the first step is on the errors alone; MATLAB begins as if all weights were in use. Unlike both, alpha and
    beta then stand while an epoch lowers the cost by over a tenth: MacKay's equations hold at the most probable
    weights, and far from them the network is easily smoothed flat.

    Parameters
    ----------
    training : FitProblem
        It may have fewer errors than weights: the prior determines what the data do not, and gamma stays below their
        number.
    weights : (n_weights,) array
        Where to start.
    **options
        Those of `BayesianOptions`. Validation and test data are only recorded: they stop nothing, as in MATLAB
        (``max_fail`` 0). `min_grad` is a norm of the gradient of the cost. The cost here is half of beta times the
        squared errors and so on, with a beta that is twice MATLAB's: the same `mu` damps half as much.

    Returns
    -------
    weights : (n_weights,) array
        Those of the last epoch.
    record : BayesianRecord
        `perf` is the mean squared error, without the weights' share; `gradient` that of the whole cost.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    chosen = BayesianOptions(**options)
    start = checked_start(training, weights, chosen)
    rounds, log = _EvidenceRounds(training, start, chosen.goal), TrainingLog(training, chosen)
    with one_blas_thread():
        end = levenberg_marquardt(
            RegularisedProblem(training, rounds.evidence),
            start,
            damping=chosen.damping(),
            stops=log.stops(rounds.goal_met, MinGradient(chosen.min_grad), DampingLimit()),
            callback=lambda state: log.keep(state, gradient=state.gradient_norm, **rounds.entries()),
            update_problem=rounds.renewed,
            clock=chosen.clock,
        )
    record = log.record(BayesianRecord)
    return end.x.copy(), replace(record, best_epoch=record.num_epochs)


class _EvidenceRounds:
    """The evidence of a training, round by round, with the mean squared error and the sum of squared weights."""

    def __init__(self, training: FitProblem, start: FloatArray, goal: float) -> None:
        self.training, self.goal, self.n = training, goal, training.n_errors
        self.evidence = Evidence(FIRST_ALPHA, FIRST_BETA, gamma=float(len(start)))
        self.perf, self.squares, self.is_first = training.mean_square(start), float(start @ start), True

    @property
    def cost(self) -> float:
        """Twice the cost under the evidence so far."""
        return self.evidence.beta * self.n * self.perf + self.evidence.alpha * self.squares

    def renewed(self, x: FloatArray, equations: NormalEquations) -> tuple[RegularisedProblem, NormalEquations]:
        """The problem after an epoch, by a round of the fixed point unless the network is still learning."""
        assert isinstance(equations, RegularisedEquations)  # made by the problem below
        before = self.cost
        self.perf, self.squares = 2 * equations.errors.cost / self.n, float(x @ x)
        if self.is_first or self.cost >= (1 - LEARNING) * before:  # the first step gives alpha its scale
            self.evidence = update_evidence(
                self.evidence,
                gram=equations.errors.gram,
                parameter_squares=self.squares,
                residual_squares=self.n * self.perf,
                n_residuals=self.n,
            )
        self.is_first = False
        problem = RegularisedProblem(self.training, self.evidence)
        return problem, problem.weighted(x, equations.errors)

    def goal_met(self, state: OptimizerState) -> StopReason | None:  # noqa: ARG002 - the goal is of the errors alone, not of the cost
        """Stop when the mean squared error is at the goal."""
        return StopReason("Performance goal met.", True) if self.perf <= self.goal else None

    def entries(self) -> dict[str, float]:
        """Of the record, after an epoch."""
        alpha, beta, gamma = self.evidence.alpha, self.evidence.beta, self.evidence.gamma
        return {"perf": self.perf, "gamk": gamma, "ssX": self.squares, "alpha": alpha, "beta": beta}
