"""Nonlinear least squares, assembled from parts. Knows neither arms nor networks."""

from truearm.solve.damping import Damping, MarquardtDamping, NielsenDamping
from truearm.solve.gradient_descent import DescentState, DifferentiableProblem, LearningRate, gradient_descent
from truearm.solve.least_squares_problem import NormalEquations, Problem
from truearm.solve.levenberg_marquardt import LevenbergMarquardtResult, levenberg_marquardt
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
    "BestPoint",
    "CostConverged",
    "CostGoal",
    "Damping",
    "DampingLimit",
    "DescentState",
    "DifferentiableProblem",
    "LearningRate",
    "LevenbergMarquardtResult",
    "MarquardtDamping",
    "MaxEpochs",
    "MaxSeconds",
    "MinGradient",
    "NielsenDamping",
    "NormalEquations",
    "OptimizerState",
    "Problem",
    "StopCriterion",
    "StopReason",
    "ValidationStop",
    "gradient_descent",
    "levenberg_marquardt",
]
