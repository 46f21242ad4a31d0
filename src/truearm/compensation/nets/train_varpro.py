"""Training by variable projection, with Nielsen's damping and geodesic acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.training import TrainingOptions, TrainingRecord, checked_start
from truearm.compensation.nets.training_log import TrainingLog
from truearm.compensation.nets.variable_projection import ProjectedProblem
from truearm.solve import CostConverged, CostGoal, levenberg_marquardt
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class VariableProjectionOptions(TrainingOptions):
    """Options of `train_varpro`.

    Parameters
    ----------
    max_fail : int
        Validation failures since the best epoch that end it.
    """

    epochs: int = 200
    max_fail: int = 10


def train_varpro(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, TrainingRecord]:
    """Train a network whose output layer is linear: far fewer epochs than `trainlm` for the same error.

    The output layer is eliminated (`ProjectedProblem`), damping is Nielsen's, and steps are bent by their second
    derivative (geodesic acceleration, see `levenberg_marquardt`).

    It ends, asked in this order after every epoch, when `perf` is at `goal`, after `epochs`, after `time`, when an
    epoch lowers the error by less than 1e-8 of it, and when the validation error was above its best `max_fail` times.
    With more weights than errors it still trains, to a network that repeats them: set data aside for `validation`, or
    use `trainbr`.

    Parameters
    ----------
    training : FitProblem
    weights : (n_weights,) array
        Where to start; the output layer's share is not used.
    **options
        Those of `VariableProjectionOptions`.

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
    chosen = VariableProjectionOptions(**options)
    start, problem = checked_start(training, weights, chosen), ProjectedProblem(training)
    log = TrainingLog(training, chosen, problem.full_weights)
    with one_blas_thread():
        levenberg_marquardt(
            problem,
            start[: problem.n_hidden_weights],
            stops=log.stops(CostGoal(chosen.goal * log.half), CostConverged(1e-8)),
            callback=log.record_lm_epoch,
            acceleration=problem.second_directional_derivative,
            clock=chosen.clock,
        )
        return log.best_weights(), log.record(TrainingRecord)
