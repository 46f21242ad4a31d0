"""What the groups of terms do: how large their motions are, and how far they move the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearm.identification.estimation.identification import IdentificationResult
from truearm.identification.terms.state import ArmState
from truearm.solve.square_roots import unit_diagonal
from truearm.typing import FloatArray, IntArray


@dataclass(frozen=True)
class Effect:
    """What a group of terms does to the arm, root mean square over readings.

    Attributes
    ----------
    group : str
    offered : int
        Coefficients.
    determined : float
        How many of them the readings told.
    rotation_rad, shift_mm : float or None
        Size of the motions, over all places and directions that the group has there [rad, mm]. None where it has none,
        was given up, or is free: how an arm is put into its frame is no error of it.
    tip_mm : float or None
        How far they move the tip, to first order, but for what base and tip would take up where they are free [mm].
        Groups that act alike may each move it far and cancel.
    """

    group: str
    offered: int
    determined: float
    rotation_rad: float | None
    shift_mm: float | None
    tip_mm: float | None


def effects(fit: IdentificationResult, state: ArmState) -> tuple[Effect, ...]:
    """What every group of terms that was offered does at the readings of a state, in the order offered.

    Parameters
    ----------
    fit : IdentificationResult
    state : ArmState
        Of at least one reading.
    """
    n, names = len(state), [group.name for group in fit.groups]
    of_terms = [np.full(term.n_coefficients, names.index(term.group)) for term in fit.perturbed_chain.terms]
    group = np.concatenate([np.zeros(0, dtype=np.intp), *of_terms])
    squares = np.zeros((len(names), 2))  # of rotations and shifts
    sites = np.zeros((len(names), 2))
    for site, value in zip(fit.perturbed_chain.sites, fit.perturbed_chain.values(state), strict=True):
        parts = site.direction.reshape(2, 3)
        for i in np.unique(group[site.columns]):
            here = group[site.columns] == i
            motion = fit.coefficients[site.columns[here]] @ value[here]
            squares[i] += (parts**2).sum(axis=1) * float(motion @ motion) / n
            sites[i] += parts.any(axis=1)
    free = {term.group for term in fit.perturbed_chain.terms if not term.learn}
    tip_squares = _tip_squares(fit, state, group, np.isin(names, list(free))) / n
    sizes = [
        [float(np.sqrt(s / k)) if k and name not in free else None for s, k in zip(*row, strict=True)]
        for name, row in zip(names, zip(squares, sites, strict=True), strict=True)
    ]
    return tuple(
        Effect(
            found.name,
            found.n_coefficients,
            found.effective,
            turning,
            shifting,
            float(np.sqrt(tip_square)) if turning is not None or shifting is not None else None,
        )
        for found, (turning, shifting), tip_square in zip(fit.groups, sizes, tip_squares, strict=True)
    )


def _tip_squares(
    fit: IdentificationResult, state: ArmState, group: IntArray, is_free: npt.NDArray[np.bool_]
) -> FloatArray:
    """(n_groups,) sums of squares of the tip's displacements, but for what the free groups can make up for."""
    parts = [np.flatnonzero(group == i) for i in range(len(is_free))]
    free = np.flatnonzero(is_free[group])
    own, cross, gram = np.zeros(len(parts)), np.zeros((len(free), len(parts))), np.zeros((len(free), len(free)))
    for _, _, columns in fit.perturbed_chain.derivatives(state, fit.coefficients):
        flat = columns.reshape(len(columns), 3 * columns.shape[2])
        moved = np.stack([fit.coefficients[part] @ flat[part] for part in parts])
        own += (moved**2).sum(axis=1)
        cross += flat[free] @ moved.T
        gram += flat[free] @ flat[free].T
    unit, scale = unit_diagonal(gram)
    cross /= scale[:, None]
    made_up = np.linalg.pinv(unit, rcond=1e-12, hermitian=True) @ cross
    return np.asarray(np.maximum(own - (cross * made_up).sum(axis=0), 0.0))
