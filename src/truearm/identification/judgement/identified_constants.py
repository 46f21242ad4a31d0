"""Constants of an identified arm beside the drawing: zeros of joints that are off, and what no right drawing has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.joint_zeros import COLUMNS, table_changes
from truearm.arm.nearest_table import drawn_convention, drawn_table, nearest_table
from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.typing import FloatArray

# Largest changes of constants that are credible. A zero that is off by more than an eighth of a turn is nearer to
# another zero. Other angles: 7 degrees, forty times as much as usual. Lengths: 5 % of the reach, as of links that are
# a tenth too long; what explains a zero that is off by a quarter turn are lengths of 8 % or more. The zero of a slide
# is a length that no drawing states: a column that was homed 100 mm off, on an arm of 500 mm.
MAX_ZERO, MAX_ANGLE, MAX_LENGTH, MAX_SLIDE_ZERO = np.radians(45.0), np.radians(7.0), 0.05, 0.2
# Columns of the table that are angles.
ANGLES = ("theta", "alpha", "beta")
# Standard uncertainties by which a constant must exceed that: noise leaves lengths open.
SURE = 3.0
# Standard uncertainties of a difference quotient.
STEP = 1e-3
# Zeros that are off by more are named: six times what is usual [rad; of sliding joints mm].
NAMED_ZERO, NAMED_SLIDE_ZERO = np.radians(1.0), 3.0


@dataclass(frozen=True)
class IdentifiedConstants:
    """By how much the constants of an identified arm differ from the drawing.

    Attributes
    ----------
    zeros : dict of str to (float, float)
        What is to be added to the zeros of joints, with its standard uncertainty [rad; of sliding joints mm], of those
        that are off by `NAMED_ZERO` (`NAMED_SLIDE_ZERO`) or more, and by more than `SURE` standard uncertainties.
    slides : tuple of str
        The sliding joints.
    largest : str
        The constant that differs most, compared with what is credible, and by how much.
    share : float
        Its size over the largest credible one.
    """

    zeros: dict[str, tuple[float, float]]
    largest: str
    share: float
    slides: tuple[str, ...] = ()

    @property
    def are_credible(self) -> bool:
        """Whether an arm that is described rightly can differ so."""
        return self.share <= 1

    @classmethod
    def of(cls, fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> Self:
        """Compare an identified arm with the nominal one."""
        names = [(name, joint) for name in COLUMNS for joint in arm.joint_names]
        try:
            changes, std = _changes(fit, arm, free)
        except InputError as error:
            return cls({}, error.problem, np.inf)
        slides, n = arm.chain.is_prismatic, arm.n_joints
        zeros = np.where(slides, COLUMNS.index("d"), COLUMNS.index("theta")) * n + np.arange(n)
        most = np.array([MAX_ANGLE if name in ANGLES else MAX_LENGTH * arm.chain.reach for name, _ in names])
        most[zeros] = np.where(slides, MAX_SLIDE_ZERO * arm.chain.reach, MAX_ZERO)
        shares = np.abs(changes) / (most + SURE * std)
        worst = int(shares.argmax())
        name, joint = names[worst]
        value = float(changes[worst])
        size = f"{np.degrees(value):+.3g} deg" if name in ANGLES else f"{value:+.3g} mm"
        largest, share = f"{name} of {joint} {size}", float(shares[worst])
        for place, off in _displacements(fit, arm, free).items():
            if (of_place := off / (MAX_LENGTH * arm.chain.reach)) > share:
                largest, share = f"the {place}, which is stated to be known, {off:.3g} mm", of_place
        least = np.maximum(np.where(slides, NAMED_SLIDE_ZERO, NAMED_ZERO), SURE * std[zeros])
        named = {
            arm.joint_names[i]: (float(changes[zeros[i]]), float(std[zeros[i]]))
            for i in np.flatnonzero(np.abs(changes[zeros]) >= least).tolist()
        }
        sliding = tuple(arm.joint_names[i] for i in np.flatnonzero(slides).tolist())
        return cls(named, largest, share, sliding)

    def __str__(self) -> str:
        if not self.zeros:
            return f"The largest difference is {self.largest}: correct the arm file if it is wrong there."
        turning = ", ".join(
            f"{j} {_with_u(np.degrees(zero), 'deg')}" for j, zero in self.zeros.items() if j not in self.slides
        )
        sliding = ", ".join(f"{j} {_with_u(zero, 'mm')}" for j, zero in self.zeros.items() if j in self.slides)
        of = [f"to their {name}: {zeros}" for name, zeros in (("theta", turning), ("d", sliding)) if zeros]
        return (
            f"Zeros of joints are off, add {' and '.join(of)}; `truearm fit ... --apply my-arm.toml` writes a new "
            "arm file with them."
        )


def _with_u(stated: Sequence[float] | FloatArray, unit: str) -> str:
    """A zero with its standard uncertainty, where that is seen."""
    zero, u = stated
    return f"{zero:+.3g} {unit}" + (f" (u {u:.1g})" if u > 0.01 * abs(zero) else "")


def _changes(fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Changes of the table's constants, column by column, and their standard uncertainties, to first order."""

    def changes(coefficients: FloatArray) -> FloatArray:
        chain = fit.perturbed_chain.with_constants(coefficients)
        return np.concatenate(list(table_changes(chain, arm, free=free).values()))

    found = changes(fit.coefficients)
    variances, vectors = np.linalg.eigh(fit.covariance)
    along = (vectors * np.sqrt(np.maximum(variances, 0.0))).T
    squares = [np.zeros(len(found)), *((changes(fit.coefficients + STEP * one) - found) ** 2 for one in along)]
    return found, np.sqrt(np.sum(squares, axis=0)) / STEP


def _displacements(fit: IdentificationResult, arm: Arm, free: Sequence[str]) -> dict[str, float]:
    """By how much the base and the tip are displaced that are not free [mm]."""
    convention = drawn_convention(arm.chain)
    found, drawn = nearest_table(fit.chain, arm.chain, convention=convention, free=free), arm.chain
    off = {"base": found.base[:3, 3] - drawn_table(drawn, convention).base[:3, 3]}
    off["tip"] = found.tip_in_flange - drawn.tip_in_flange
    return {place: float(np.linalg.norm(one)) for place, one in off.items() if place not in free}
