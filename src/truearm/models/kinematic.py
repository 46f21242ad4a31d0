"""The kinematic model: the constant small motions of all places, identified from points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identify.points import fit_points
from truearm.models.compensator import Compensator, chain_covariance, with_free_parts
from truearm.readings.readings import Readings

FloatArray = npt.NDArray[np.float64]


class KinematicModel(Compensator):
    """The arm's true constants: six small motions after every joint, the base and the tip.

    More constants than any minimal parametrisation; what the readings cannot tell apart is held by a Gaussian prior
    about the nominal arm, so that no list of fixed parameters is needed and near-parallel axes need no special form.

    Parameters
    ----------
    arm : Arm
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown altogether; the others are known as well as any constant of the
        arm.
    prior_angle : float
        Prior standard deviation of a rotation [rad]: how well axes and zeros are known beforehand.
    prior_length : float
        Prior standard deviation of a translation [mm].
    robust : bool
        Whether readings far off weigh less, for the nominal arm to compare with too.

    Attributes
    ----------
    fit_ : PointFit
        The identified chain, its motions and their covariance.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        free: tuple[str, ...] = ("base", "tip"),
        prior_angle: float = 3e-3,
        prior_length: float = 3.0,
        robust: bool = True,
    ) -> None:
        self.arm = arm
        self.free = free
        self.prior_angle = prior_angle
        self.prior_length = prior_length
        self.robust = robust

    def _identify(
        self, readings: Readings, points: FloatArray, progress: Callable[[int, str], None], checkpoint: Path | None
    ) -> None:
        del checkpoint  # it is there in a second
        progress(0, "constants of all places")
        self.fit_ = fit_points(
            self.nominal_.chain,
            readings.angles,
            points,
            prior_std=self._prior_std(self.nominal_.chain),
            point_std=readings.point_std,
            robust=self.robust,
        )

    def _check_options(self) -> None:
        super()._check_options()
        for name in ("prior_angle", "prior_length"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"expected {name} of zero or more, got {value}")

    def _prior_std(self, chain: Chain) -> FloatArray:
        prior_std = np.empty((chain.n_places, 6))
        prior_std[:, :3], prior_std[:, 3:] = self.prior_angle, self.prior_length
        prior_std[-1, :3] = 0  # turning about the tip moves nothing
        return with_free_parts(prior_std, self.free)

    def _tips(self, angles: FloatArray) -> FloatArray:
        return self.fit_.chain.tip_in_base(angles)

    def _covariance(self, angles: FloatArray) -> FloatArray:
        return chain_covariance(self.fit_, angles)
