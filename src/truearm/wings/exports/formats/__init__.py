"""Exports of a model into the files of other programs: URDF, tables of constants, C, JavaScript, ONNX, JSON."""

from typing import Literal

ExportFormat = Literal[
    "urdf",
    "mjcf",
    "constants",
    "ur-kinematics",
    "kinematics-yaml",
    "joint-offsets",
    "lerobot",
    "c",
    "js",
    "onnx",
    "json",
]
