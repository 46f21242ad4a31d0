"""The kinematics that a controller computes with, where they are not the drawing's: a robot's factory calibration."""

from __future__ import annotations

import copy
import re
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearm.arm import Chain, list_arms, load_arm
from truearm.arm.kinematics_yaml import read_ur_kinematics
from truearm.arm.rigid_motions import inverse, screw_x, screw_z
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.findings import format_mm
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.programs.number_texts import six_numbers
from truearm.wings.exports.programs.numbers import Number
from truearm.wings.exports.programs.program import Lines, Surroundings
from truearm.wings.exports.targets.pose_models import reference_from_base

# Levels of a program: each node of PolyScope's tree takes two, and a waypoint some more.
MAX_DEPTH = 500
# What does not end reaches to the end of the text: to look for its end once is enough.
_TAG = re.compile(
    r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)"
    r"|<(/?)([\w.:-]+)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([\w.:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_STEP = re.compile(r"([\w.:-]+)(?:\[(\d+)\])?")


@dataclass(eq=False)
class Node:
    """An element: its attributes with their places, and its children."""

    tag: str
    start: int
    parent: Node | None
    attributes: dict[str, tuple[int, str]] = field(default_factory=dict)
    children: list[Node] = field(default_factory=list)

    def walk(self) -> Iterator[Node]:
        """Yield the element and all below it, in the order of the text."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.children)

    @cached_property
    def by_tag(self) -> dict[str, list[Node]]:
        """The children by their names, once all are read."""
        found: defaultdict[str, list[Node]] = defaultdict(list)
        for one in self.children:
            found[one.tag].append(one)
        return dict(found)

    def child(self, tag: str) -> Node | None:
        """The first child of a name; if it refers to an earlier node, that one."""
        return self.by_tag[tag][0].resolved() if tag in self.by_tag else None

    def resolved(self) -> Node | None:
        """The node, or the earlier one that it refers to (XStream's relative path); None if there is none."""
        chain, node = [self], self.referred
        while node is not None and node is not chain[-1]:
            chain.append(node)
            node = node.referred
        for one in chain:
            one.referred = node
        return node

    @cached_property
    def referred(self) -> Node | None:
        """The node, or the one that its own reference names."""
        if "reference" not in self.attributes:
            return self
        node: Node | None = self
        for step in self.attributes["reference"][1].split("/"):
            if node is None:
                return None
            if step == "..":
                node = node.parent
                continue
            named = _STEP.fullmatch(step)
            same = node.by_tag.get(named[1], []) if named else []
            k = int(named[2] or 1) if named else 0
            node = same[k - 1] if 0 < k <= len(same) else None
        return None if node is None or node.start >= self.start else node  # earlier ones only: no circle

    def inside(self, tag: str) -> bool:
        """Whether an element of a name is around it."""
        node = self.parent
        while node is not None and node.tag != tag:
            node = node.parent
        return node is not None

    def text(self, name: str) -> str:
        """An attribute, empty without it."""
        return self.attributes.get(name, (0, ""))[1]

    def numbers(self, name: str) -> list[Number] | None:
        """The six numbers of an attribute."""
        start, text = self.attributes.get(name, (0, ""))
        return six_numbers(text, start)


def parse_nodes(data: bytes) -> Node:
    """The elements of an XML text with their places. No entity is expanded, no file read.

    Raises
    ------
    InputError
        If an element does not end: the program is truncated; if elements are nested too deep.
    """
    text = data.decode("latin-1")
    node = root = Node("", 0, None)
    depth = 0
    for found in _TAG.finditer(text):
        if found[2] is None:
            continue
        if found[1]:
            if node.parent is None or node.tag != found[2]:
                raise InputError(f"</{found[2]}> ends no open element", line=Lines(data)(found.start()))
            node = node.parent
            depth -= 1
            continue
        made = Node(found[2], found.start(), node)
        for one in _ATTRIBUTE.finditer(text, found.start(3), found.end(3)):
            group = 2 if one[2] is not None else 3
            made.attributes[one[1]] = (one.start(group), one[group])
        node.children.append(made)
        if not found[4]:
            node = made
            depth += 1
            if depth > MAX_DEPTH:
                raise InputError(f"expected at most {MAX_DEPTH} levels of elements", line=Lines(data)(node.start))
    if node is not root or not root.children:
        raise InputError(
            f"<{node.tag}> does not end: the program is truncated" if node is not root else "it has no element",
            line=Lines(data)(node.start),
        )
    return root


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


def other_robot(joints: FloatArray, flange: FloatArray) -> str:
    """What to do where joints (n, 6) and poses (n, 4, 4) disagree: the known robot with which they agree, if any."""
    chains = {name: load_arm(name).chain.with_tip(np.zeros(3)) for name in list_arms("Universal Robots")}
    away = {
        name: float(np.linalg.norm(chain.tip_in_base(joints) - flange[:, :3, 3], axis=1).max())
        for name, chain in chains.items()
    }
    name = min(away, key=away.__getitem__)
    if away[name] < MOST_MM / 3:  # other types are farther off
        return (
            f"they agree for {name!r} to {format_mm(away[name])}: give the model and the calibration of that very robot"
        )
    return "give the model of the robot of this program, its calibration and its tool; lengths are in m, angles in rad"


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
