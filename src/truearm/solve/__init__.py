"""Nonlinear least squares, assembled from parts. Knows neither arms nor networks."""

from truearm.solve.damping import MarquardtDamping, Damping, NielsenDamping
from truearm.solve.gradient_descent import DescentState, LearningRate, DifferentiableProblem, gradient_descent
from truearm.solve.levenberg_marquardt import LevenbergMarquardtResult, levenberg_marquardt
from truearm.solve.least_squares_problem import NormalEquations, Problem
from truearm.solve.stop_criteria import (
    BestPoint,
    DampingLimit,
    MaxEpochs,
    CostGoal,
    MinGradient,
    StopReason,
    MaxSeconds,
    CostConverged,
    OptimizerState,
    StopCriterion,
    ValidationStop,
)

__all__ = [
    "BestPoint",
    "MarquardtDamping",
    "Damping",
    "DampingLimit",
    "DescentState",
    "MaxEpochs",
    "CostGoal",
    "MinGradient",
    "NielsenDamping",
    "NormalEquations",
    "Problem",
    "LearningRate",
    "StopReason",
    "LevenbergMarquardtResult",
    "MaxSeconds",
    "CostConverged",
    "DifferentiableProblem",
    "OptimizerState",
    "StopCriterion",
    "ValidationStop",
    "gradient_descent",
    "levenberg_marquardt",
]
