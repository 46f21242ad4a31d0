"""MATLAB's ``trainlm``: Levenberg-Marquardt training with its names, defaults and stops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from truearm.nets.normal_equations import FitProblem
from truearm.nets.training import DampedOptions, TrainingLog, TrainingRecord, checked_start
from truearm.solve import CostGoal, DampingLimit, MinGradient, levenberg_marquardt
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
