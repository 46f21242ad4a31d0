"""Arms: kinematic chains, the files they come from, a catalogue of them, and inverse kinematics."""

from truearm.arm.arm import Arm
from truearm.arm.catalogue import arm_from, load, names
from truearm.arm.chain import Chain, Pose, SmallMotions, exponential_derivative
from truearm.arm.conventions import DHTable, chain_from_dh, chain_from_mdh, dh_table, mdh_table
from truearm.arm.files import read_arm, write_arm
from truearm.arm.inverse import InverseResult, solve_inverse
from truearm.arm.masses import LinkMasses
from truearm.arm.urdf import read_urdf, write_urdf

__all__ = [
    "Arm",
    "Chain",
    "DHTable",
    "InverseResult",
    "LinkMasses",
    "Pose",
    "SmallMotions",
    "arm_from",
    "chain_from_dh",
    "chain_from_mdh",
    "dh_table",
    "exponential_derivative",
    "load",
    "mdh_table",
    "names",
    "read_arm",
    "read_urdf",
    "solve_inverse",
    "write_arm",
    "write_urdf",
]
