"""Poses that a plan may contain near joint angles that are wanted: the tip is in its seat, or in the volume."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.identification.planning.candidates import within_a_turn
from truearm.identification.planning.sampling.measuring import inner_limits
from truearm.identification.planning.sampling.poses import joint_travel_limits
from truearm.identification.planning.sampling.seat import CONE_RAD
from truearm.identification.planning.sampling.surroundings import Surroundings
from truearm.identification.planning.sampling.workspace import Sector, Stance, in_sector, is_above_table, stance
from truearm.typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class NearbyPoses:
    """Where poses may be; the rules are those of `candidates`.

    Parameters
    ----------
    arm : Arm
        Base z up.
    surroundings : Surroundings
        Table and boxes.
    volume : Sector
        Where poses may be without a seat; they may always be in `Sector()`.
    """

    arm: Arm
    surroundings: Surroundings
    volume: Sector

    def find(self, wanted: FloatArray, seat_points: FloatArray | None = None) -> tuple[FloatArray, BoolArray]:
        """Find poses near joint angles.

        Parameters
        ----------
        wanted : (m, n_joints) array
            [rad, or mm].
        seat_points : (m, 3) array, optional
            Where the tip must be in the base frame [mm].

        Returns
        -------
        angles : (m, n_joints) array
            With the tip in its seat, the nearest by inverse kinematics; without one, within the joint limits.
        allowed : (m,) bool array
            Whether such a pose may be in a plan.
        """
        lower, upper = inner_limits(self.arm)
        if seat_points is None:
            low, high = joint_travel_limits(self.arm)
            angles = np.clip(within_a_turn(self.arm, wanted), np.maximum(lower, low), np.minimum(upper, high))
            tips = self.arm.chain.tip_in_base(angles)
            allowed = in_sector(tips, self._stance, Sector()) | in_sector(tips, self._stance, self.volume)
        else:
            found = solve_inverse_kinematics(
                self.arm.chain, seat_points, start=np.clip(wanted, lower, upper), lower=lower, upper=upper
            )
            angles, tips = within_a_turn(self.arm, found.angles), seat_points
            stylus = self.arm.chain.pose(angles).R_base_tip[:, :, 2]
            at_a_limit = ((found.angles <= lower) | (found.angles >= upper)).any(axis=1)
            allowed = found.reached & ~at_a_limit & (stylus[:, 2] <= -np.cos(CONE_RAD))
        allowed &= is_above_table(self.arm.chain, angles, tips)
        return angles, np.asarray(allowed & self.surroundings.leaves_free(self.arm.chain, angles))

    @cached_property
    def _stance(self) -> Stance:
        return stance(self.arm)
