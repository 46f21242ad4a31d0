"""MATLAB's ``traingdx``: gradient descent with momentum and an adaptive rate, its names, defaults and stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.traingd import MeanSquareProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord, check_stops, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.errors import InputError
from truearm.solve import CostGoal, DescentState, LearningRate, MaxEpochs, MaxSeconds, MinGradient, gradient_descent
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveRecord(TrainingRecord):
    """A training record with the learning rate after every epoch.

    Attributes
    ----------
    lr : (epochs + 1,) array
        As the next epoch uses it.
    """

    lr: FloatArray


def traingdx(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
    test: FitProblem | None = None,
    epochs: int = 1000,
    goal: float = 0.0,
    lr: float = 0.01,
    lr_inc: float = 1.05,
    lr_dec: float = 0.7,
    max_perf_inc: float = 1.04,
    mc: float = 0.9,
    max_fail: int = 6,
    min_grad: float = 1e-5,
    time: float = float("inf"),
    clock: Callable[[], float] = perf_counter,
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, AdaptiveRecord]:
    """Train a network's weights by gradient descent with momentum and an adaptive rate.

    A step is ``mc * last step - (1 - mc) * lr * gradient``. If it multiplies the error by more than `max_perf_inc` it
    is not made, `lr` is multiplied by `lr_dec`, and the next step is without momentum. If it lowers the error, `lr` is
    multiplied by `lr_inc`. It ends as `traingd` does.

    Source: defaults, stops and the rate's rule as https://www.mathworks.com/help/deeplearning/ref/traingdx.html has
    them; the step as M. T. Hagan, H. B. Demuth, M. Beale, "Neural Network Design" (1996), chapter 12. (MATLAB's page
    writes ``lr * mc`` for ``(1 - mc) * lr``, unlike that of ``traingdm``.)

    Parameters
    ----------
    training, validation, test : FitProblem
        The same network on different samples; without `validation` there is no validation stop.
    weights : (n_weights,) array
        Where to start.
    epochs, goal, lr, lr_inc, lr_dec, max_perf_inc, mc, max_fail, min_grad, time
        As in MATLAB; see `traingd`.
    clock, callback
        As in `trainlm`.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : AdaptiveRecord
        Its `mu` is NaN.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    if not (0 < lr < float("inf") and lr_inc >= 1 and 0 < lr_dec < 1 and max_perf_inc >= 1 and 0 <= mc < 1):
        raise InputError(
            "expected lr > 0, lr_inc >= 1, 0 < lr_dec < 1, max_perf_inc >= 1 and 0 <= mc < 1, got "
            f"{lr}, {lr_inc}, {lr_dec}, {max_perf_inc}, {mc}"
        )
    start = checked_start(training, weights, validation, test)
    check_stops(epochs=epochs, goal=goal, time=time, min_grad=min_grad, max_fail=max_fail)
    log = TrainingLog(
        training,
        validation,
        test,
        max_fail=max_fail,
        extra=("lr",),
        callback=callback,
    )

    def keep(state: DescentState) -> None:
        log.keep(state, perf=state.cost, gradient=state.gradient_norm, extra=(state.rate,))

    with one_blas_thread():
        gradient_descent(
            MeanSquareProblem(training),
            start,
            rate=LearningRate(lr, mc, lr_inc, lr_dec, max_perf_inc),
            stops=[CostGoal(goal), MaxEpochs(epochs), MaxSeconds(time), MinGradient(min_grad), *log.stops],
            callback=keep,
            clock=clock,
        )
    return log.best_weights(), log.record(AdaptiveRecord)
