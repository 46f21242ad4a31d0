"""``trainbr``: Levenberg-Marquardt training with Bayesian regularisation, as MATLAB names it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord, check_stops, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.solve import (
    DampingLimit,
    MarquardtDamping,
    MaxEpochs,
    MaxSeconds,
    MinGradient,
    NormalEquations,
    OptimizerState,
    StopReason,
    levenberg_marquardt,
)
from truearm.solve.arrays import add_to_diagonal
from truearm.solve.evidence import Evidence, update_evidence
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

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


def trainbr(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
    test: FitProblem | None = None,
    epochs: int = 1000,
    goal: float = 0.0,
    min_grad: float = 1e-7,
    mu: float = 5e-3,
    mu_dec: float = 0.1,
    mu_inc: float = 10.0,
    mu_max: float = 1e10,
    time: float = float("inf"),
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, BayesianRecord]:
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
    validation, test : FitProblem, optional
        Only recorded: they stop nothing, as in MATLAB (``max_fail`` 0).
    epochs, goal, min_grad, mu, mu_dec, mu_inc, mu_max, time
        As in MATLAB; `goal` is a mean squared error of scaled outputs, `min_grad` a norm of the gradient of the cost.
        The cost here is half of beta times the squared errors and so on, with a beta that is twice MATLAB's: the same
        `mu` damps half as much.
    callback
        As in `trainlm`.

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
    start = checked_start(training, weights, validation, test)
    check_stops(epochs=epochs, goal=goal, time=time, min_grad=min_grad)
    damping = MarquardtDamping(mu, mu_dec, mu_inc, mu_max)
    log = TrainingLog(
        training,
        validation,
        test,
        extra=("gamk", "ssX", "alpha", "beta"),
        callback=callback,
    )
    n = training.n_errors
    evidence = Evidence(FIRST_ALPHA, FIRST_BETA, gamma=float(len(start)))
    perf, squares = training.mean_square(start), float(start @ start)

    def renew(x: FloatArray, equations: NormalEquations) -> tuple[RegularisedProblem, NormalEquations]:
        nonlocal evidence, perf, squares
        assert isinstance(equations, RegularisedEquations)  # made by the problem below
        before = evidence.beta * n * perf + evidence.alpha * squares
        perf, squares = 2 * equations.errors.cost / n, float(x @ x)
        settling = evidence.beta * n * perf + evidence.alpha * squares >= (1 - LEARNING) * before
        if settling or log.epoch == 0:  # the first step gives alpha its scale
            evidence = update_evidence(
                evidence,
                gram=equations.errors.gram,
                parameter_squares=squares,
                residual_squares=n * perf,
                n_residuals=n,
            )
        problem = RegularisedProblem(training, evidence)
        return problem, problem.weighted(x, equations.errors)

    def goal_met(state: OptimizerState) -> StopReason | None:  # noqa: ARG001 - the goal is of the errors alone, not of the cost
        return StopReason("Performance goal met.", True) if perf <= goal else None

    def keep(state: OptimizerState) -> None:
        log.keep(
            state,
            perf=perf,
            gradient=state.gradient_norm,
            extra=(evidence.gamma, squares, evidence.alpha, evidence.beta),
        )

    with one_blas_thread():
        end = levenberg_marquardt(
            RegularisedProblem(training, evidence),
            start,
            damping=damping,
            stops=[
                goal_met,
                MaxEpochs(epochs),
                MaxSeconds(time),
                MinGradient(min_grad),
                DampingLimit(),
                *log.stops,
            ],
            callback=keep,
            update_problem=renew,
        )
    record = log.record(BayesianRecord)
    return end.x.copy(), replace(record, best_epoch=record.num_epochs)
