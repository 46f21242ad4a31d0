"""References to orientations of the flange; with a point at the same reading, a full pose.

A pose is a point and an orientation, two references of the same readings. Each has a noise of its own, estimated from
the readings, so that no weight of millimetres against radians is needed.

The rotation of the tracked tool on the flange is unknown, in every session and of every tip: it is that of the tip's
place, see `truearm.identification.references.reading_references.tool_terms`.

Position and orientation of a pose may err together, and all poses may share errors. With the position error e and the
rotation error w (on the left, along the reference's axes) of a pose, whose covariance by the instrument is
``[[P, C^T], [C, R]]``, and an arm whose own errors have the variances v and v / L^2, the residuals are

    U^T e,      L V^T (w - G e),      G = C (P + v)^-1,

which are independent. U and V are the principal axes of P and of ``R - G C^T``: so every residual has a standard
uncertainty of its own, beside which the noise of the kind, v, is the same in all six.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import rotations_and_jacobians
from truearm.errors import InputError
from truearm.identification.references.references import Constraints, LinearisedResiduals
from truearm.readings.pose_errors import PoseErrors
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


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the flange measured by a reference instrument; unknowns are the errors that they share.

    Parameters
    ----------
    rows : (m,) int array
        The readings.
    points : (m, 3) array
        [mm].
    R_reference_flange : (m, 3, 3) array
        Axes of the flange, or of the tool on it, as columns in the reference's frame.
    errors : PoseErrors
        Of these readings.
    """

    rows: IntArray
    points: FloatArray
    R_reference_flange: FloatArray
    errors: PoseErrors
    kind = "pose"
    repeat_variance: ClassVar[None] = None
    n_residuals = 6
    uses_orientation = True

    @property
    def std(self) -> FloatArray:
        """(6, m) standard uncertainties along the principal axes [mm]."""
        return self._along[1]

    @property
    def principal_axes(self) -> FloatArray:
        """(m, 3, 3) those of the position errors as columns: their residuals are along them."""
        return self._along[0][:, :3, :3].transpose(0, 2, 1)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """The common errors."""
        return self.errors.common

    def initialise(self, tips: FloatArray) -> tuple[Self, FloatArray]:
        """Without common errors."""
        del tips
        return self, np.zeros(len(self.unknowns))

    def linearised(
        self, tips: FloatArray, unknowns: FloatArray, which: slice, axes: FloatArray | None = None
    ) -> LinearisedResiduals:
        """See `Reference`."""
        assert axes is not None, "needed, as uses_orientation is set"
        along, by_common = self._along[0][which], self.errors.by_common[which]
        moved = (by_common @ unknowns).T
        turned, jacobian = rotations_and_jacobians(moved[3:])
        measured = turned.transpose(2, 0, 1) @ self.R_reference_flange[which]
        w = Rotation.from_matrix(axes.transpose(2, 0, 1) @ measured.transpose(0, 2, 1)).as_rotvec()
        # A turn d of the flange changes w by the inverse of its left Jacobian times d; one of the measured axes by
        # minus the inverse of the right one, its transpose.
        inverse = np.linalg.inv(rotations_and_jacobians(w.T)[1].transpose(2, 0, 1))
        error = np.concatenate([tips - self.points[which].T - moved[:3], w.T])
        by_unknown = -by_common.copy()
        by_unknown[:, 3:] = inverse.transpose(0, 2, 1) @ jacobian.transpose(2, 0, 1) @ by_unknown[:, 3:]
        m, a = len(along), len(unknowns)
        return LinearisedResiduals(
            np.einsum("mki,im->km", along, error),
            along[:, :, :3].transpose(1, 2, 0),
            np.broadcast_to(np.arange(a)[:, None], (a, m)),
            (along @ by_unknown).transpose(1, 2, 0),
            (along[:, :, 3:] @ inverse).transpose(1, 2, 0),
        )

    def constraints(self, unknowns: FloatArray) -> Constraints | None:
        """What is known of the common errors."""
        if not len(self.errors.offset):
            return None
        residuals = self.errors.root @ unknowns + self.errors.offset
        one = np.ones(len(residuals))
        return Constraints(residuals, self.errors.root, one, ("common error",) * len(one), np.zeros((len(one), 2)))

    @cached_property
    def _along(self) -> tuple[FloatArray, FloatArray]:
        """(m, 6, 6) residuals by position and rotation errors, and their standard uncertainties (6, m)."""
        P, C, R = (self.errors.covariance[:, a, b] for a, b in ((_P, _P), (_R, _P), (_R, _R)))
        lever, v = self.errors.lever_mm, max(self.errors.arm_std_mm**2, _LEAST_MM2)
        G = C @ np.linalg.inv(P + v * np.eye(3))
        of_position, U = np.linalg.eigh(P)
        of_rotation, V = np.linalg.eigh(R - G @ C.transpose(0, 2, 1))
        along = np.zeros((len(P), 6, 6))
        along[:, :3, :3] = U.transpose(0, 2, 1)
        along[:, 3:, 3:] = lever * V.transpose(0, 2, 1)
        along[:, 3:, :3] = -along[:, 3:, 3:] @ G
        variance = np.concatenate([of_position, lever**2 * of_rotation], axis=1)
        return along, np.sqrt(np.maximum(variance, 0.0)).T


_P, _R = slice(0, 3), slice(3, 6)
# A nanometre squared: the covariance of exact poses is zero.
_LEAST_MM2 = 1e-12
