"""Nonlinear least squares, assembled from parts. Knows neither arms nor networks."""

from truearm.solve.damping import Classical, Damping, Nielsen
from truearm.solve.gradient_descent import DescentState, Rate, Smooth, gradient_descent
from truearm.solve.levenberg_marquardt import Result, levenberg_marquardt
from truearm.solve.problem import NormalEquations, Problem
from truearm.solve.stops import (
    Best,
    DampingLimit,
    Epochs,
    Goal,
    Gradient,
    Reason,
    Seconds,
    Settled,
    State,
    Stop,
    Validation,
)

__all__ = [
    "Best",
    "Classical",
    "Damping",
    "DampingLimit",
    "DescentState",
    "Epochs",
    "Goal",
    "Gradient",
    "Nielsen",
    "NormalEquations",
    "Problem",
    "Rate",
    "Reason",
    "Result",
    "Seconds",
    "Settled",
    "Smooth",
    "State",
    "Stop",
    "Validation",
    "gradient_descent",
    "levenberg_marquardt",
]
