"""Training by variable projection, with Nielsen's damping and geodesic acceleration."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import Epoch, TrainingRecord, check_stops, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.compensation.nets.variable_projection import ProjectedProblem
from truearm.solve import CostConverged, CostGoal, MaxEpochs, MaxSeconds, NielsenDamping, levenberg_marquardt
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


def train_varpro(
    training: FitProblem,
    weights: FloatArray,
    *,
    validation: FitProblem | None = None,
    test: FitProblem | None = None,
    epochs: int = 200,
    goal: float = 0.0,
    max_fail: int = 10,
    time: float = float("inf"),
    clock: Callable[[], float] = perf_counter,
    callback: Callable[[Epoch], None] | None = None,
) -> tuple[FloatArray, TrainingRecord]:
    """Train a network whose output layer is linear: far fewer epochs than `trainlm` for the same error.

    The output layer is eliminated (`ProjectedProblem`), damping is Nielsen's, and steps are bent by their second
    derivative (geodesic acceleration, see `levenberg_marquardt`).

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when an
    epoch lowers the error by less than 1e-8 of it, and when the validation error was above its best `max_fail` times.
    With more weights than errors it still trains, to a network that repeats them: set data aside for `validation`, or
    use `trainbr`.

    Parameters
    ----------
    training, validation, test : FitProblem
        The same network on different samples; without `validation` there is no validation stop.
    weights : (n_weights,) array
        Where to start; the output layer's share is not used.
    epochs, goal, max_fail, time, clock, callback
        As in `trainlm`.

    Returns
    -------
    weights : (n_weights,) array
        Those of the best validation epoch, or of the best `perf` without validation data.
    record : TrainingRecord
        Its `gradient` is that by the hidden weights.

    Raises
    ------
    InputError
        As `trainlm`.
    """
    weights = checked_start(training, weights, validation, test)
    check_stops(epochs=epochs, goal=goal, time=time, max_fail=max_fail)
    problem, damping = ProjectedProblem(training), NielsenDamping()
    log = TrainingLog(
        training,
        validation,
        test,
        max_fail=max_fail,
        full_weights=problem.full_weights,
        callback=callback,
    )

    with one_blas_thread():
        levenberg_marquardt(
            problem,
            weights[: problem.n_hidden_weights],
            damping=damping,
            stops=[CostGoal(goal * log.half), MaxEpochs(epochs), MaxSeconds(time), CostConverged(1e-8), *log.stops],
            callback=log.record_lm_epoch,
            acceleration=problem.second_directional_derivative,
            clock=clock,
        )
    with one_blas_thread():
        return log.best_weights(), log.record(TrainingRecord)
