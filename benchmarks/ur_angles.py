"""Roll, pitch, yaw in kinematics files of UR robots: written as Rx Ry Rz, read as Rz Ry Rx; what that is worth.

    python benchmarks/ur_angles.py [--json] [FILE.yaml ...]

Without files: robots whose controllers' constants are public. Their files are computed as the driver's tool lays them
out; forward kinematics of constants and file are compared in both readings over 2000 random poses.

Sources of the constants: UR5 Universal_Robots_ROS_Driver 457; UR3 MyRobotLab/pyrobotlab 145, differences added to the
nominal constants; UR10e the manual of ur_calibration.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from machine import Target, arguments_of, print_json, say_machine, say_targets
from truearm.arm import Chain, chain_from_dh, read_ur_kinematics
from truearm.arm.rigid_motions import frame_from_xyz_rpy, screw_x, screw_z
from truearm.typing import FloatArray

POSES = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 6))


class Constants(NamedTuple):
    """D-H constants of a controller [rad, m]."""

    theta: list[float]
    d: list[float]
    a: list[float]
    alpha: list[float]


# ruff: noqa: E501 (published numbers, a list of six a line)
ROBOTS = {
    "UR5": Constants(
        [-9.62699668632896e-06, -1.43707039992005, 2.02543119975016, -0.588254688694989, 4.13647390228702e-05, 8.1737464953645e-06],
        [0.0888794492754001, 574.241384579456, -507.363402098168, -66.7676839353205, 0.0949734691141216, 0.0825625014554953],
        [0.000279332356195598, -0.0566854832098269, -0.32646702272051, 1.49388687216263e-05, 2.23692592990586e-07, 0],
        [1.57033858830411, -0.000733893428160216, 0.00325607356326439, 1.57040005185553, -1.57101000328584, 0],
    ),
    "UR3": Constants(
        [9.14361764983717684e-08, 0.178461025123001604, 6.68283349819805572, -0.578116982609792496, 6.11299818305960363e-06, -5.03926212855332345e-07],
        [0.15199225352853909, 12.0620003757611567, 17.6719025641737275, -29.6216460369544869, 0.08532183538220463, 0.0821174204710821],
        [-0.000243788991999517813, -0.23983834581357648, -0.17874692154689506, 0.000107694612896758047, -0.000198736633205663144, 0],
        [1.5719524842607927, 0.0035851898103369975, 0.00392132336586574568, 1.5712029956830027, -1.572808030755058, 0],
    ),
    "UR10e": Constants(
        [-2.4147806894359e-07, 1.60233952386695, -1.68607190752171, 0.0837331147700119, -1.01260355871158e-07, 3.91986209186124e-08],
        [0.180539811714259, 439.140974079901, -446.027059806332, 7.0603368964236, 0.119811341150314, 0.115670917257426],
        [2.12234865571206e-05, 0.0193171326277006, -0.569251663611088, -4.61409023720934e-05, -6.39280053471802e-05, 0],
        [1.57014608044242, 0.0013941666682559, 0.00693818880325995, 1.56998468543761, -1.57038520649543, 0],
    ),
}  # fmt: skip


def links_of(robot: Constants, *, quadrants: bool) -> list[FloatArray]:
    """Poses of the links [m]: frames 2 and 3 slide along their axes to where the next axis crosses their xy plane.

    `quadrants`: whether the direction there is found in all four quadrants, as newer versions do.
    """
    own = [screw_z(theta, d) for theta, d in zip(robot.theta, robot.d, strict=True)]
    across = [screw_x(alpha, a) for alpha, a in zip(robot.alpha, robot.a, strict=True)]
    for i in (1, 2):
        passive = own[i] @ across[i]
        slide = passive[2, 3] / passive[2, 2]
        x, y, _ = passive[:3, 3] - slide * passive[:3, 2]
        turn = np.arctan2(-y, -x) if quadrants else np.arctan(y / x)
        after = screw_z(robot.theta[i] - turn, 0.0) @ screw_x(robot.alpha[i], 0.0)
        after[0, 3] = -np.hypot(x, y)
        own[i], across[i] = screw_z(turn, 0.0), after
        own[i + 1] = screw_z(0.0, slide) @ own[i + 1]
    return [own[0], *(across[i] @ own[i + 1] for i in range(5))]


def as_eigen_splits(link: FloatArray) -> FloatArray:
    """Roll, pitch, yaw of Rx Ry Rz with roll from 0 to pi, as Eigen's eulerAngles has it."""
    roll, pitch, yaw = Rotation.from_matrix(link[:3, :3]).as_euler("XYZ")
    return np.array([roll, pitch, yaw] if roll >= 0 else [roll + np.pi, np.pi - pitch, yaw + np.pi])


def errors_of(robot: Constants, *, quadrants: bool) -> dict[str, FloatArray]:
    """Distances [mm] of the file's tips from the controller's in both readings."""
    links = links_of(robot, quadrants=quadrants)
    end = screw_x(robot.alpha[5], 1000 * robot.a[5])
    a, d = 1000 * np.array(robot.a), 1000 * np.array(robot.d)
    true = chain_from_dh(a=a, d=d, alpha=robot.alpha, theta=robot.theta).tip_in_base(POSES)
    found = {}
    for reading in ("Rx Ry Rz", "URDF"):
        frames = []
        for link in links:
            rpy = as_eigen_splits(link)
            frame = frame_from_xyz_rpy(1000 * link[:3, 3], rpy)
            if reading == "Rx Ry Rz":
                frame[:3, :3] = Rotation.from_euler("XYZ", rpy).as_matrix()
            frames.append(frame)
        tips = Chain(np.array([*frames, end]), np.zeros(3)).tip_in_base(POSES)
        found[reading] = np.linalg.norm(tips - true, axis=1)
    return found


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="kinematics files, for the difference of the two readings")
    options = parser.parse_args()
    numbers, targets = {}, []
    for name, robot in ROBOTS.items():
        for version, quadrants in (("newer", True), ("older", False)):
            errors = errors_of(robot, quadrants=quadrants)
            for reading, off in errors.items():
                numbers[f"{name}, {version} versions, read as {reading}: mean / max [mm]"] = [off.mean(), off.max()]
            if quadrants:
                targets.append(Target(f"{name} as Rx Ry Rz [mm]", float(errors["Rx Ry Rz"].max()), 1e-8))
    for file in options.files:
        one, other = (
            read_ur_kinematics(file, angles=angles).chain.tip_in_base(POSES) for angles in ("urdf", "controller")
        )
        off = np.linalg.norm(one - other, axis=1)
        numbers[f"{file.name}, between the two readings: mean / max [mm]"] = [off.mean(), off.max()]
    if options.json:
        print_json(numbers, targets)
        return
    say_machine()
    for name, (mean, largest) in numbers.items():
        print(f"{name}: {mean:.3g} / {largest:.3g}")
    say_targets(targets)


if __name__ == "__main__":
    main()
