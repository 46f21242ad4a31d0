"""Errors of predicted orientations of the flange, and the share of them in their stated regions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.references.orientations import LEVER_MM
from truearm.identification.references.reading_references import rows_with_orientation
from truearm.models.compensator import CheckedReadings
from truearm.models.identified_model import to_identified
from truearm.typing import FloatArray

LEVEL = 0.95


class OrientationErrors(NamedTuple):
    """Angles between predicted and measured orientations (n,) [deg], and how many are in their 95 % regions."""

    model_deg: FloatArray
    nominal_deg: FloatArray
    coverage: float

    def statistics(self) -> dict[str, dict[str, float]]:
        """Mean, root mean square, 95 % and maximum, of the nominal arm and the model."""
        return {name: {"n_orientations": len(deg), "orientation_mean_deg": float(deg.mean()),
                       "orientation_rms_deg": float(np.sqrt((deg**2).mean())),
                       "orientation_p95_deg": float(np.quantile(deg, LEVEL)), "orientation_max_deg": float(deg.max())}
                for name, deg in (("nominal", self.nominal_deg), ("model", self.model_deg))}  # fmt: skip


def orientation_errors(at: CheckedReadings) -> OrientationErrors | None:
    """Those of a model at readings; None where it did not learn how the tool is turned, or readings have none.

    A tool of another session or tip may be turned anyhow: a model of several has none either.
    """
    model, quaternion = to_identified(at.model), at.session.quaternion
    rows = rows_with_orientation(quaternion)
    if model is None or quaternion is None or not len(rows) or model.session_frames_ or len(model.tips_) > 1:
        return None
    noise = [part.noise_std / LEVER_MM for part in model.fit_.references if part.kind == "orientation"]
    if not noise:
        return None
    state, measured = at.state.rows(rows), Rotation.from_quat(quaternion[rows], scalar_first=True)

    def turned(fit: IdentificationResult) -> FloatArray:
        R = fit.perturbed_chain.poses(state, fit.coefficients).R_base_tip
        return np.asarray((Rotation.from_matrix(R) * measured.inv()).as_rotvec())

    fit, turn = model.fit_, turned(model.fit_)
    by = fit.perturbed_chain.pose_by_coefficients(state, fit.coefficients)[1][:, 3:]
    covariance = by @ fit.covariance @ by.transpose(0, 2, 1) + noise[0] ** 2 * np.eye(3)
    squares = np.einsum("ni,nij,nj->n", turn, np.linalg.inv(covariance), turn)
    inside = float((squares <= model.ellipsoid_factor(LEVEL) ** 2).mean())
    own, nominal = (np.degrees(np.linalg.norm(one, axis=1)) for one in (turn, turned(model.nominal_)))
    return OrientationErrors(own, nominal, inside)
