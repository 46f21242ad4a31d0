"""Nonlinear least squares, assembled from parts. Knows neither arms nor networks."""

from truearm.solve.damping import Classical, Damping, Nielsen
from truearm.solve.levenberg_marquardt import Result, levenberg_marquardt
from truearm.solve.problem import NormalEquations, Problem
from truearm.solve.stops import DampingLimit, Epochs, Goal, Gradient, Reason, Seconds, Settled, State, Stop, Validation

__all__ = [
    "Classical",
    "Damping",
    "DampingLimit",
    "Epochs",
    "Goal",
    "Gradient",
    "Nielsen",
    "NormalEquations",
    "Problem",
    "Reason",
    "Result",
    "Seconds",
    "Settled",
    "State",
    "Stop",
    "Validation",
    "levenberg_marquardt",
]
