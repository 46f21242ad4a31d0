"""The kinematics that a controller computes with, where they are not the drawing's: a robot's factory calibration."""

from __future__ import annotations

import copy
import zlib
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearm.arm import Chain, read_ur_kinematics
from truearm.arm.rigid_motions import inverse, screw_x, screw_z
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.programs.number_texts import six_numbers
from truearm.wings.exports.programs.program import Surroundings
from truearm.wings.exports.programs.xml_places import Node, parse_nodes
from truearm.wings.exports.targets.pose_models import reference_from_base

# Joints and pose of a point have twelve decimals; another tool or other kinematics are some tenths of a millimetre off.
AGREE_MM, AGREE_DEG = 0.01, 0.005
# A factory calibration moves the flange by some millimetres; another type of robot is some centimetres off.
MOST_MM = 30.0
NOMINAL = "nominal"
GZIP = b"\x1f\x8b"
MAX_BYTES = 200_000_000  # of the text within: programs have some MB
_ROWS = ("deltaTheta", "a", "d", "alpha")
Rows = tuple[tuple[float, ...], ...]
NOT_STATED = (
    "the program does not have the kinematics of its controller: state in --frames controller = "
    '"my_robot_calibration.yaml", or "nominal" for a robot without a factory calibration'
)


class StatedKinematics(NamedTuple):
    """The kinematics of a UR's controller as they are stated beside its program.

    Attributes
    ----------
    is_stated : bool
    controller : Chain, optional
        None: those of the drawing.
    checked : Chain, optional
        The same, or the drawing, with which joints and poses must agree.
    note : str
        Where they come from, if no person stated it.
    """

    is_stated: bool
    controller: Chain | None = None
    checked: Chain | None = None
    note: str = ""

    @classmethod
    def of(cls, beside: Surroundings) -> StatedKinematics:
        """What the file of ``--frames`` states, or the .urp of the same name that PolyScope writes beside a script."""
        stated = beside.frames.controller
        if stated == NOMINAL:
            return cls(True, checked=beside.chain)
        if stated is None and beside.file is not None:
            program = beside.file.with_suffix(".urp")
            chain = _chain_of_program(program) if program != beside.file and program.is_file() else None
            return cls(chain is not None, chain, chain, f"kinematics of the controller: those of {program.name}")
        if stated is None:
            return cls(False)
        path = (Path() if beside.file is None else beside.file.parent) / stated
        if path.suffix.lower() != ".urp":
            chain = read_ur_kinematics(path, angles="controller").chain
        elif (found := _chain_of_program(path)) is not None:
            chain = found
        else:
            raise InputError("the program has no factory calibration", file=path)
        return cls(True, chain, chain)


def _chain_of_program(path: Path) -> Chain | None:
    """The kinematics of most nodes of a PolyScope program."""
    root = parse_nodes(unpacked(read_limited(path, limit_bytes=MAX_BYTES)))
    counted = Counter(
        rows for node in root.walk() if node.tag.lower() == "kinematics" and (rows := calibrated_rows(node))
    )
    return controller_chain(counted.most_common(1)[0][0]) if counted else None


def unpacked(data: bytes) -> bytes:
    """The text of a PolyScope program, which is packed by gzip or bare."""
    if not data.startswith(GZIP):
        return data
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(data, MAX_BYTES)
    except zlib.error as error:
        raise InputError(f"its gzip is damaged: {error}", hint="copy the program again") from None
    if not unpacker.eof:
        raise InputError("its gzip ends too early, or is too large: the program is truncated", hint="copy it again")
    return text


def calibrated_rows(node: Node) -> Rows | None:
    """The rows of a factory calibration; None where the node has none."""
    if node.text("status").startswith("NOT_"):
        return None
    rows = [node.child(tag) for tag in _ROWS]
    return _rows_of(tuple("" if row is None else row.text("value") for row in rows))


@lru_cache(maxsize=64)
def _rows_of(texts: tuple[str, ...]) -> Rows | None:
    """Rows of a table from their texts, None if one has not six numbers."""
    rows = [six_numbers(text, 0) for text in texts]
    return tuple(tuple(one.value for one in row) for row in rows if row) if all(rows) else None


def controller_chain(rows: Rows) -> Chain:
    """The kinematics of a robot from its rows of a table in m and rad."""
    links = [
        screw_z(theta, MM_PER_M * d) @ screw_x(alpha, MM_PER_M * a) for theta, a, d, alpha in zip(*rows, strict=True)
    ]
    return Chain(_near_origins(np.array([np.eye(4), *links])), np.zeros(3))


def _near_origins(fixed: FloatArray) -> FloatArray:
    """The same chain, each joint's origin moved along its axis to the point nearest to the one before.

    Between nearly parallel axes the table has lengths of up to some kilometres, which cancel.
    """
    moved = fixed.copy()
    for i in range(len(moved) - 1):
        along = screw_z(0.0, -float(moved[i][:3, 2] @ moved[i][:3, 3]))
        moved[i] = moved[i] @ along
        moved[i + 1] = np.linalg.inv(along) @ moved[i + 1]
    return moved


def disagreements(controller: Chain | None, joints: FloatArray, flange: FloatArray) -> list[str]:
    """How far the joints (n, 6) of points are from their poses (n, 4, 4); empty where it is rounding, or not known."""
    if controller is None or not len(joints):
        return [""] * len(joints)
    R, position = controller.with_tip(np.zeros(3)).pose(joints)
    away = np.linalg.norm(position - flange[:, :3, 3], axis=1)
    turn = np.degrees(np.linalg.norm(R - flange[:, :3, :3], axis=(1, 2)) / np.sqrt(2))  # small, or of any size
    return [
        ""
        if mm < AGREE_MM and deg < AGREE_DEG
        else f"its joints and its pose disagree by {mm:.3g} mm and {deg:.2g} deg: another tool, or other kinematics"
        for mm, deg in zip(away.tolist(), turn.tolist(), strict=True)
    ]


def with_controller(model: Compensator, controller: Chain) -> Compensator:
    """A fitted model whose nominal arm is the controller's; base and tip are those identified with the drawing.

    Raises
    ------
    InputError
        If the controller's arm is not that of the model.
    """
    drawn, nominal = model.arm_.chain, model.nominal_.chain
    poses = np.outer([0.0, 0.5, -1.0], np.ones(drawn.n_joints))
    plain = Chain(drawn.fixed, np.zeros(3), coupling=drawn.coupling)
    away = np.linalg.norm(plain.pose(poses).tip_in_base - controller.pose(poses).tip_in_base, axis=1).max()
    if away > MOST_MM:
        raise InputError(
            f"the kinematics of the controller are {away:.0f} mm from those of {model.arm_.name!r}",
            hint="give the model of the robot of this program, with its arm in the controller's base frame",
        )
    fixed = controller.fixed.copy()
    fixed[0] = reference_from_base(model) @ fixed[0]
    fixed[-1] = fixed[-1] @ inverse(drawn.fixed[-1]) @ nominal.fixed[-1]
    chain = Chain(fixed, nominal.tip_in_flange, coupling=drawn.coupling)
    equipped = copy.copy(model)
    equipped.nominal_ = replace(model.nominal_.select(lambda _: False), perturbed_chain=PerturbedChain(chain, ()))
    return equipped
