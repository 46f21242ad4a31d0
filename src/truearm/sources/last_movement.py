"""The direction of each joint's last movement, on which backlash and friction depend (hysteresis)."""

from __future__ import annotations

import numpy as np

from truearm.typing import FloatArray


class LastMovement:
    """The sign of each joint's last movement: -1, 1, or 0 as long as it has not moved.

    Attributes
    ----------
    signs : (n_joints,) array
    """

    def __init__(self, angles_rad: FloatArray) -> None:
        self.signs: FloatArray = np.zeros(len(angles_rad))
        self._extreme = angles_rad

    def add(self, angles_rad: FloatArray, least: FloatArray) -> None:
        """Take in the next angles; a joint turns round when it comes back by more than `least` [rad, or mm]."""
        moved = angles_rad - self._extreme
        has_moved = np.abs(moved) > least
        self.signs = np.where(has_moved, np.sign(moved), self.signs)
        self._extreme = np.where(has_moved | (moved * self.signs > 0), angles_rad, self._extreme)
