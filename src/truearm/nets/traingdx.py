"""MATLAB's ``traingdx``: gradient descent with momentum and an adaptive rate, its names, defaults and stops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from truearm.errors import InputError
from truearm.nets.normal_equations import FitProblem
from truearm.nets.traingd import DescentOptions, descend
from truearm.nets.training import TrainingRecord
from truearm.solve import LearningRate
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveDescentOptions(DescentOptions):
    """Options of `traingdx`, as MATLAB's.

    Parameters
    ----------
    lr_inc, lr_dec : float
        Factors of `lr` after a step that lowered the error, and after one that was not made.
    max_perf_inc : float
        A step is not made if it multiplies the error by more than this.
    mc : float
        Momentum: the share of the last step in the next.
    """

    lr_inc: float = 1.05
    lr_dec: float = 0.7
    max_perf_inc: float = 1.04
    mc: float = 0.9


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveRecord(TrainingRecord):
    """A training record with the learning rate after every epoch.

    Attributes
    ----------
    lr : (epochs + 1,) array
        As the next epoch uses it.
    """

    lr: FloatArray


def traingdx(training: FitProblem, weights: FloatArray, **options: Any) -> tuple[FloatArray, AdaptiveRecord]:
    """Train a network's weights by gradient descent with momentum and an adaptive rate.

    A step is ``mc * last step - (1 - mc) * lr * gradient``. If it multiplies the error by more than `max_perf_inc` it
    is not made, `lr` is multiplied by `lr_dec`, and the next step is without momentum. If it lowers the error, `lr` is
    multiplied by `lr_inc`. It ends as `traingd` does.

    Source: defaults, stops and the rate's rule as https://www.mathworks.com/help/deeplearning/ref/traingdx.html has
    them; the step as M. T. Hagan, H. B. Demuth, M. Beale, "Neural Network Design" (1996), chapter 12. (MATLAB's page
    writes ``lr * mc`` for ``(1 - mc) * lr``, unlike that of ``traingdm``.)

    Parameters and results are those of `trainlm`, with options of `AdaptiveDescentOptions`; `mu` of the record is NaN.
    """
    o = AdaptiveDescentOptions(**options)
    if not (0 < o.lr < float("inf") and o.lr_inc >= 1 and 0 < o.lr_dec < 1 and o.max_perf_inc >= 1 and 0 <= o.mc < 1):
        raise InputError(
            "expected lr > 0, lr_inc >= 1, 0 < lr_dec < 1, max_perf_inc >= 1 and 0 <= mc < 1, got "
            f"{o.lr}, {o.lr_inc}, {o.lr_dec}, {o.max_perf_inc}, {o.mc}"
        )
    log = descend(training, weights, o, LearningRate(o.lr, o.mc, o.lr_inc, o.lr_dec, o.max_perf_inc))
    return log.best_weights(), log.record(AdaptiveRecord)
