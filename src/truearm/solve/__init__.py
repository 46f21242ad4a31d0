"""Nonlinear least squares and evidence, assembled from parts; independent of arms and networks."""

from truearm.solve.least_squares import (
    UNSOLVED,
    RowsResult,
    damped_step,
    gauss_newton,
    levenberg_marquardt,
    levenberg_marquardt_by_row,
)
from truearm.solve.least_squares_problem import (
    DenseProblem,
    KnownStep,
    MarquardtDamping,
    NielsenDamping,
    NormalEquations,
    StepHalving,
)
from truearm.solve.stop_criteria import (
    BestPoint,
    CostConverged,
    CostGoal,
    DampingLimit,
    MaxEpochs,
    MaxSeconds,
    MinGradient,
    OptimizerState,
    StopCriterion,
    StopReason,
    ValidationStop,
)

__all__ = [
    "UNSOLVED",
    "BestPoint",
    "CostConverged",
    "CostGoal",
    "DampingLimit",
    "DenseProblem",
    "KnownStep",
    "MarquardtDamping",
    "MaxEpochs",
    "MaxSeconds",
    "MinGradient",
    "NielsenDamping",
    "NormalEquations",
    "OptimizerState",
    "RowsResult",
    "StepHalving",
    "StopCriterion",
    "StopReason",
    "ValidationStop",
    "damped_step",
    "gauss_newton",
    "levenberg_marquardt",
    "levenberg_marquardt_by_row",
]
