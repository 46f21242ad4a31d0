"""The turn between two poses is the same for robot and camera: what contradicts that is known before any fit.

``angle(F_i^-1 F_j) = angle(C_i C_j^-1)`` for every pair of images, whatever camera, board and their mounts are. It
needs neither hand-eye nor board size, and it is blind to inverted poses; positions tell those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.typing import BoolArray, FloatArray

# Tolerance of a pair: so many times the median of all, within these limits [deg].
TIMES_MEDIAN, LEAST_DEG, MOST_DEG = 4.0, 1.0, 5.0
# Share of the other images with which an image agrees.
AGREES = 0.75
# Shares of the images that must agree for the poses to belong together, and to be said wrong one by one.
TOGETHER, FEW_WRONG = 0.5, 1 / 3
# Images that do not agree among which exchanged ones are looked for.
MOST_EXCHANGED = 40


def turns(R: Rotation) -> FloatArray:
    """(n, n) angles [deg] between rotations, of ``R_i R_j^-1``."""
    q = R.as_quat()
    return np.asarray(np.degrees(2 * np.arccos(np.clip(np.abs(q @ q.T), 0.0, 1.0))))


@dataclass(frozen=True, eq=False)
class TurnTest:
    """How far the turns of robot and camera agree.

    Attributes
    ----------
    agree : (n,) bool array
        The images that agree with each other.
    rms_deg : float
        Root mean square difference of their turns.
    tolerance_deg : float
    off_deg : (n, n) array
        Difference between the turns of robot and camera from each image to each other one.
    """

    agree: BoolArray
    rms_deg: float
    tolerance_deg: float
    off_deg: FloatArray

    @classmethod
    def of(cls, robot: Rotation, camera: Rotation) -> TurnTest:
        """Compare all pairs, and ignore what agrees least until the rest agree."""
        off = np.abs(turns(robot) - turns(camera))
        n = len(off)
        tolerance = float(np.clip(TIMES_MEDIAN * np.median(off[np.triu_indices(n, 1)]), LEAST_DEG, MOST_DEG))
        fits, kept = off < tolerance, np.ones(n, dtype=bool)
        others = fits.sum(axis=1) - 1
        while (left := int(kept.sum())) > 2:
            worst = int(np.where(kept, others, n).argmin())
            if others[worst] >= AGREES * (left - 1):
                break
            kept[worst] = False
            others -= fits[worst]
        among = off[np.ix_(kept, kept)][np.triu_indices(int(kept.sum()), 1)]
        return cls(kept, float(np.sqrt((among**2).mean())), tolerance, off)

    @property
    def share(self) -> float:
        """Share of the images that agree."""
        return float(self.agree.mean())

    @property
    def passes(self) -> bool:
        """Whether most images agree; three of a few agree by chance."""
        return bool(self.agree.sum() >= 3 and self.share > TOGETHER)


def wrong_rows(test: TurnTest, robot: Rotation, camera: Rotation, directions: FloatArray) -> dict[str, list[int]]:
    """What is wrong with each image that does not agree with the others, and its rows, counted from 0.

    Parameters
    ----------
    test : TurnTest
    robot, camera : Rotation
        Of the flange in the base, of the board in the camera.
    directions : (n, 3) array
        To the board, in the camera.
    """
    bad, good = np.flatnonzero(~test.agree), np.flatnonzero(test.agree)
    named: dict[str, list[int]] = {}

    def fits(seen: Rotation, row: int, least: float = AGREES) -> bool:
        apart = np.degrees((camera[good] * seen.inv()).magnitude())
        due = np.degrees((robot[good] * robot[row].inv()).magnitude())
        return bool((np.abs(apart - due) < test.tolerance_deg).mean() >= least)

    half = {f"{'xyz'[k]}": Rotation.from_rotvec(np.pi * np.eye(3)[k]) for k in (2, 0, 1)}
    for row in bad.tolist():
        for axis, turn in half.items():
            if fits(camera[row] * turn, row):
                named.setdefault(f"the board was seen half turned about its {axis} axis", []).append(row)
                break
        else:
            quarter = [Rotation.from_rotvec(s * np.pi / 2 * np.eye(3)[2]) for s in (1, -1)]
            along = Rotation.from_rotvec(np.pi * directions[row] / np.linalg.norm(directions[row]))
            near = bad.tolist() if len(bad) <= MOST_EXCHANGED else []
            others = [other for other in near if other != row and fits(camera[other], row)]
            if any(fits(camera[row] * turn, row) for turn in quarter):
                named.setdefault("the board was seen a quarter turned about its z axis", []).append(row)
            elif fits(along * camera[row] * half["z"], row):
                named.setdefault("the board was seen with the other tilt (a single marker has two)", []).append(row)
            elif len(others) == 1:
                named.setdefault("poses and images are exchanged among these", []).append(row)
            else:
                named.setdefault("the image is of another pose, or was taken while the arm moved", []).append(row)
    return named


def shifted(robot: Rotation, camera: Rotation, *, most: int = 3) -> int | None:
    """By how many rows all images are shifted against the poses, where that makes them agree; else None."""
    n = len(robot)
    for shift in (one for k in range(1, min(most, n - 4) + 1) for one in (k, -k)):
        images = slice(max(shift, 0), n + min(shift, 0))
        poses = slice(max(-shift, 0), n + min(-shift, 0))
        if (test := TurnTest.of(robot[poses], camera[images])).passes and test.share > 2 * TOGETHER * 0.9:
            return shift
    return None
