"""A problem linearised about its parameters: normal equations, an arm's open size, and the artefacts' unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearm.identification.estimation.problem import ABSOLUTE, RELATIVE, SmallMotionProblem
from truearm.identification.references.references import Points
from truearm.solve.arrowhead import Arrowhead, SchurComplement
from truearm.solve.group_evidence import GroupedEquations
from truearm.typing import FloatArray, IntArray

# If no reference determines the size of the arm, the prior of its lengths does; it is hardly off by more than this.
SIZE_STD = 1e-2
# The prior of an artefact's unknowns is wider than any workshop [mm, or 1].
UNKNOWN_STD = 1e6


def linearised(
    problem: SmallMotionProblem, x: FloatArray, weights: list[FloatArray]
) -> tuple[list[Arrowhead], Arrowhead]:
    """Normal equations of every reference, and their sum with the constraints."""
    parts, whole = problem.equations(x, weights)
    head, gradient, cost = whole.head, whole.gradient, whole.cost
    if any(reference.kind in RELATIVE for reference in problem.references):
        size = problem.log_size_ratio_gradient(x)
        for part, reference in zip(parts, problem.references, strict=True):
            if reference.kind in RELATIVE:
                gradient = gradient - 2 * part.cost * size
        if size_is_open(problem, x):
            of_coefficients = size[: len(head)]
            head = head + np.outer(of_coefficients, of_coefficients) / SIZE_STD**2
            off = problem.log_size_ratio(x)
            gradient = gradient + size * off / SIZE_STD**2
            cost += 0.5 * (off / SIZE_STD) ** 2
    return parts, replace(whole, gradient=gradient, head=head, cost=cost)


def roughly_linearised(
    problem: SmallMotionProblem, x: FloatArray, weights: FloatArray, residuals: FloatArray, some: IntArray
) -> Arrowhead:
    """Normal equations of a problem of points alone: the gradient of all, the matrix of some of them for all.

    Parameters
    ----------
    problem : SmallMotionProblem
    x : (p,) array
    weights, residuals : (3, m) array
        One over the standard deviations of the residuals, and these [1/mm, mm].
    some : (n,) int array
        Points that stand for all, by their numbers.
    """
    (points,), chain = problem.references, problem.perturbed_chain
    assert isinstance(points, Points)
    few = replace(points.select(some), rows=np.arange(len(some)))
    of_few = SmallMotionProblem(chain, problem.state.rows(points.rows[some]), (few,))
    (found,) = of_few.normal_equations(x, [weights[:, some]])
    white = weights * residuals
    gradient = problem.gradient_of_points(x, weights * white)
    times = float((weights**2).sum() / (weights[:, some] ** 2).sum())
    return replace(found, cost=0.5 * float(np.vdot(white, white)), gradient=gradient, head=times * found.head)


def eliminate_unknowns(parts: Sequence[Arrowhead], whole: Arrowhead, x: FloatArray) -> SchurComplement:
    """Normal equations without the artefacts' unknowns.

    Unknowns without readings remain: lengths of artefacts, which couple the places of an artefact.
    """
    in_readings = np.concatenate([part.blocks.diagonal() for part in parts]) > 0
    return whole.eliminate(np.full(len(in_readings), UNKNOWN_STD**-2.0), x, shared=~in_readings)


def grouped_equations(reduced: SchurComplement, x: FloatArray, n_residuals: int) -> GroupedEquations:
    """The normal equations in a form that weighs priors by evidence."""
    right = reduced.gram @ x[reduced.kept] - reduced.gradient
    return GroupedEquations(reduced.gram, right, reduced.size, n_residuals)


def size_is_open(problem: SmallMotionProblem, x: FloatArray) -> bool:
    """Whether no reference determines the size of the arm: neither points nor distances nor lengths nor radii."""
    constraints_of = [
        reference.constraints(x[problem.unknowns_of(i)]) for i, reference in enumerate(problem.references)
    ]
    return all(r.kind not in ABSOLUTE for r in problem.references) and all(
        constraints is None for constraints in constraints_of
    )
