"""``trainbr``: Levenberg-Marquardt training with Bayesian regularisation, as MATLAB names it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import Epoch, TrainingRecord, training_record
from truearm.solve import (
    Classical,
    DampingLimit,
    Epochs,
    Gradient,
    NormalEquations,
    Reason,
    Seconds,
    State,
    levenberg_marquardt,
)
from truearm.solve.evidence import Evidence, updated_evidence
from truearm.solve.threads import one_blas_thread

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
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
        gram.flat[:: len(gram) + 1] += alpha
        cost = beta * errors.cost + 0.5 * alpha * float(x @ x)
        return RegularisedEquations(cost, beta * errors.gradient + alpha * x, gram, errors)


def trainbr(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
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
    The number of weights in use, `gamk`, settles by itself, so that no readings need be set aside to stop in time.

    Source: F. D. Foresee, M. T. Hagan, "Gauss-Newton approximation to Bayesian learning", ICNN 1997, 1930-1935.

    Parameters
    ----------
    training : FitProblem
        With more errors than weights, or alpha and beta mean little.
    weights : (n_weights,) array
        Where to start.
    validation : FitProblem, optional
        Only recorded: it stops nothing, as in MATLAB (``max_fail`` 0).
    epochs, goal, min_grad, mu, mu_dec, mu_inc, mu_max, time
        As in MATLAB; `goal` is a mean squared error of scaled outputs, `min_grad` a norm of the gradient of the cost.
    callback : callable, optional
        Told how it goes after every epoch, and at the start.

    Returns
    -------
    weights : (n_weights,) array
    record : BayesianRecord
        `perf` is the mean squared error, without the weights' share.
    """
    n = training.n_errors
    rows: list[tuple[float, ...]] = []
    evidence = _first_evidence(training, weights)

    def renew(x: FloatArray, equations: NormalEquations) -> tuple[RegularisedProblem, NormalEquations]:
        nonlocal evidence
        assert isinstance(equations, RegularisedEquations)  # made by the problem below
        evidence = updated_evidence(
            evidence,
            gram=equations.errors.gram,
            parameter_squares=float(x @ x),
            residual_squares=2 * equations.errors.cost,
            n_residuals=n,
        )
        problem = RegularisedProblem(training, evidence)
        return problem, problem.weighted(x, equations.errors)

    def reached(state: State) -> Reason | None:
        squares = float(state.x @ state.x)
        aside = np.nan if validation is None else validation.mean_square(state.x)
        rows.append((training.mean_square(state.x), aside, evidence.gamma, squares, evidence.alpha, evidence.beta))
        return Reason("Performance goal met.", True) if rows[-1][0] <= goal else None

    def tell(state: State) -> None:
        if callback is not None:
            perf, vperf = rows[-1][:2]
            callback(Epoch(state.epoch, perf, vperf, state.mu, state.gradient_norm, 0, state.seconds, lambda: state.x))

    with one_blas_thread():
        result = levenberg_marquardt(
            RegularisedProblem(training, evidence),
            weights,
            damping=Classical(mu, mu_dec, mu_inc, mu_max),
            stops=[
                reached,
                Epochs(epochs),
                Seconds(time),
                Gradient(min_grad),
                DampingLimit(),
            ],
            callback=tell,
            renew=renew,
        )
    perf, vperf, gamk, ssX, alpha, beta = np.array(rows).T
    record = training_record(result, n, None, np.full(len(rows), np.nan))
    common = {f.name: getattr(record, f.name) for f in fields(record)}
    common |= {"perf": perf, "vperf": vperf, "gradient": np.array([state.gradient_norm for state in result.history])}
    return result.x, BayesianRecord(**common, gamk=gamk, ssX=ssX, alpha=alpha, beta=beta)


def _first_evidence(training: FitProblem, weights: FloatArray) -> Evidence:
    """MATLAB's start: as if all weights were in use."""
    squares, size = 2 * training.cost(weights), float(weights @ weights)
    freedom = training.n_errors - len(weights)
    return Evidence(
        alpha=len(weights) / size if size > 0 else 1.0,
        beta=freedom / squares if freedom > 0 and squares > 0 else 2.0,
        gamma=float(len(weights)),
    )
