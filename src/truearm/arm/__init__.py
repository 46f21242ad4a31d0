"""Arms: kinematic chains, the files they come from, a catalogue of them, and inverse kinematics."""

from truearm.arm.arm import Arm, LinkMasses
from truearm.arm.arm_files import read_arm, write_arm
from truearm.arm.catalogue import list_arms, load_arm
from truearm.arm.chain import Chain, Pose, TipDerivatives, exponential_derivative
from truearm.arm.denavit_hartenberg import DHTable, chain_from_dh, chain_from_mdh, dh_table, mdh_table
from truearm.arm.inverse_kinematics import InverseKinematicsResult, solve_inverse_kinematics
from truearm.arm.nearest_table import drawn_table, nearest_table

__all__ = [
    "Arm",
    "Chain",
    "DHTable",
    "InverseKinematicsResult",
    "LinkMasses",
    "Pose",
    "TipDerivatives",
    "chain_from_dh",
    "chain_from_mdh",
    "dh_table",
    "drawn_table",
    "exponential_derivative",
    "list_arms",
    "load_arm",
    "mdh_table",
    "nearest_table",
    "read_arm",
    "solve_inverse_kinematics",
    "write_arm",
]
