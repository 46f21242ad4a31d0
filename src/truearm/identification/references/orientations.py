"""References to orientations of the flange; with a point at the same reading, a full pose.

A pose is a point and an orientation, two references of the same readings. Each has a noise of its own, estimated from
the readings, so that no weight of millimetres against radians is needed.

The rotation of the tracked tool on the flange is unknown, in every session and of every tip: it is that of the tip's
place, see `truearm.identification.references.reading_references.tool_terms`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import rotations_and_jacobians
from truearm.errors import InputError
from truearm.identification.references.references import LinearisedResiduals
from truearm.typing import FloatArray, IntArray

# Angles are converted to the displacement at a metre's distance, so that every residual is in mm. This is a unit, not
# a weight: orientations have a noise of their own.
LEVER_MM = 1000.0


@dataclass(frozen=True, eq=False)
class Orientations:
    """Orientations of the flange measured by a reference instrument.

    The residual is the rotation vector of ``R_reference_flange^T R_model``, along the flange's axes, times `LEVER_MM`.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    R_reference_flange : (m, 3, 3) array
        Axes of the flange, or of the tool on it, as columns in the reference's frame.
    turn_std : (m, 3) array, optional
        Standard uncertainties about those axes [rad].

    Raises
    ------
    InputError
        If a matrix is not a rotation (1e-6).
    """

    rows: IntArray
    R_reference_flange: FloatArray
    turn_std: FloatArray | None = None
    kind = "orientation"
    repeat_variance: ClassVar[None] = None
    n_residuals = 3
    uses_orientation = True
    unknowns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        R = np.asarray(self.R_reference_flange, dtype=float)
        if R.shape != (len(self.rows), 3, 3):
            raise InputError(f"expected {len(self.rows)} orientations as (3, 3) matrices, got shape {R.shape}")
        R = np.where(np.abs(R) < 2, R, 0.0)  # neither NaN nor what overflows
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        bad = ~((off < 1e-6) & (np.linalg.det(R) > 0))
        if bad.any():
            raise InputError(f"expected rotations, got another matrix at reading {self.rows[int(np.argmax(bad))] + 1}")

    @property
    def std(self) -> FloatArray:
        """(3, m) standard uncertainties at the lever arm [mm]."""
        return np.zeros((3, len(self.rows))) if self.turn_std is None else LEVER_MM * self.turn_std.T

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """See `Reference`."""
        del tips
        return self, np.zeros(0)

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        del unknowns
        assert axes is not None, "needed, as uses_orientation is set"
        m = tips.shape[1]
        back = self.R_reference_flange[which].transpose(0, 2, 1)
        r = Rotation.from_matrix(back @ axes.transpose(2, 0, 1)).as_rotvec()
        # Turning the flange by d turns R_ref^T R_model on the left by R_ref^T d; the rotation vector's change is the
        # inverse of the left Jacobian times that. The Jacobian's eigenvalues stay above 2/pi up to half a turn.
        _, J = rotations_and_jacobians(r.T)
        by_turn = LEVER_MM * (np.linalg.inv(J.transpose(2, 0, 1)) @ back).transpose(1, 2, 0)
        nothing = np.zeros((0, m), np.intp), np.zeros((3, 0, m))
        return LinearisedResiduals(LEVER_MM * r.T, np.zeros((3, 3, m)), *nothing, by_turn)

    def constraints(self, unknowns: FloatArray) -> None:
        """See `Reference`."""
        del unknowns


def orient_flange_coarsely(chain: Chain, angles: npt.ArrayLike, R_reference_flange: FloatArray) -> Chain:
    """The chain with the flange axes rotated to the mean of the measured orientations (m, 3, 3).

    Gauss-Newton steps converge to the rotation of the tool from less than half a turn; this start value suits any
    rotation, once the chain is placed in the frame of the reference. The tip does not move.
    """
    measured_in_flange = chain.pose(angles).R_base_tip.transpose(0, 2, 1) @ R_reference_flange
    motions = np.zeros((chain.n_places, 6))
    motions[-1, :3] = Rotation.from_matrix(measured_in_flange).mean().as_rotvec()
    return chain.with_motions(motions)
