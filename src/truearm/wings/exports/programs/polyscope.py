"""Programs of PolyScope (.urp): gzipped XML with the joints of each waypoint and the kinematics of its robot.

PolyScope 5 has ``<Waypoint type="Fixed"><position><JointAngles/><TCPOffset/><Kinematics/></position></Waypoint>``: the
pose is that of the joints. PolyScope 3 writes joints, pose, pose in the feature and pose of the flange, which are kept
consistent. Nodes refer to earlier ones by their place (XStream), so that none is moved: only numbers of attributes
change. The kinematics are those of the controller, its factory calibration: targets are corrected against them.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from truearm.arm import Chain, chain_from_dh
from truearm.arm.rigid_motions import screw_z
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.typing import FloatArray
from truearm.wings.exports.programs.controllers import NOT_STATED, StatedKinematics, disagreement
from truearm.wings.exports.programs.program import (
    Edit,
    Language,
    LeftAlone,
    Move,
    MoveKind,
    Number,
    Program,
    Surroundings,
    Target,
    inverse,
    line_of,
    transform,
)
from truearm.wings.exports.programs.urscript import JOINTS, POSE, pose_matrix, pose_numbers

_MAGIC = b"\x1f\x8b"
MAX_BYTES = 200_000_000  # of the text within: programs have some MB
_TAG = re.compile(
    r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>"
    r"|<(/?)([\w.:-]+)((?:\s+[\w.:-]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))*)\s*(/?)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([\w.:-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_STEP = re.compile(r"([\w.:-]+)(?:\[(\d+)\])?")
_ROWS = ("deltaTheta", "a", "d", "alpha")
Rows = tuple[tuple[float, ...], ...]
_TYPES = {
    "Variable": "its place is a variable",
    "Relative": "it is relative to where the arm is",
}
_KINDS: dict[str, MoveKind] = {"MoveJ": "joint", "MoveL": "linear", "MoveP": "linear"}


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

    def child(self, tag: str) -> Node | None:
        """The first child of a name; if it refers to an earlier node, that one."""
        found = next((one for one in self.children if one.tag == tag), None)
        return None if found is None else found.resolved()

    def resolved(self) -> Node | None:
        """The node, or the earlier one that it refers to (XStream's relative path); None if there is none."""
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
            same = [one for one in node.children if named and one.tag == named[1]]
            k = int(named[2] or 1) if named else 0
            node = same[k - 1] if 0 < k <= len(same) else None
        return None if node is None or node.start >= self.start else node.resolved()  # earlier ones only: no circle

    def inside(self, tag: str) -> bool:
        """Whether an element of a name is around it."""
        return self.parent is not None and (self.parent.tag == tag or self.parent.inside(tag))

    def text(self, name: str) -> str:
        """An attribute, empty without it."""
        return self.attributes.get(name, (0, ""))[1]

    def numbers(self, name: str) -> list[Number] | None:
        """The six numbers of an attribute."""
        start, text = self.attributes.get(name, (0, ""))
        parts = text.split(",")
        found = [
            Number(start + one.start(), start + one.end(), one[0].encode("ascii")) for one in _NUMBER.finditer(text)
        ]
        whole = len(parts) == 6 and all(_NUMBER.fullmatch(part.strip()) for part in parts)
        return found if whole else None


def parse_nodes(data: bytes) -> Node:
    """The elements of an XML text with their places. No entity is expanded, no file read.

    Raises
    ------
    InputError
        If an element does not end: the program is truncated.
    """
    text = data.decode("latin-1")
    root = Node("", 0, None)
    node = root
    for found in _TAG.finditer(text):
        if found[2] is None:
            continue
        if found[1]:
            if node.parent is None or node.tag != found[2]:
                raise InputError(f"</{found[2]}> ends no open element", line=line_of(data, found.start()))
            node = node.parent
            continue
        made = Node(found[2], found.start(), node)
        for one in _ATTRIBUTE.finditer(text, found.start(3), found.end(3)):
            group = 2 if one[2] is not None else 3
            made.attributes[one[1]] = (one.start(group), one[group])
        node.children.append(made)
        if not found[4]:
            node = made
    if node is not root or not root.children:
        raise InputError(
            f"<{node.tag}> does not end: the program is truncated" if node is not root else "it has no element",
            line=line_of(data, node.start),
        )
    return root


def controller_chain(rows: Rows) -> Chain:
    """The kinematics of a robot from its rows of a table in m and rad."""
    theta, a, d, alpha = (np.array(row) for row in rows)
    chain = chain_from_dh(a=MM_PER_M * a, d=MM_PER_M * d, alpha=alpha, theta=theta)
    return Chain(_near_origins(chain.fixed), np.zeros(3))


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


@dataclass(frozen=True, eq=False)
class _Waypoint(Target):
    """A waypoint with the kinematics of its controller, for the poses that PolyScope 3 writes beside the joints."""

    controller: Chain | None = None
    T_feature_base: FloatArray | None = None


class _Reader:
    """The waypoints of a program."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        self.data = data
        self.root = parse_nodes(data)
        self.stated = StatedKinematics.of(beside)
        self.waypoints = [node for node in self.root.walk() if node.tag == "Waypoint"]
        self.of_program = next(
            (one for one in self.root.walk() if one.tag.lower() == "kinematics" and not one.inside("Waypoint")), None
        )
        self.keys = {node: key for node in self.waypoints if (key := self._kinematics(node)) is not None}
        counted = Counter(self.keys.values())
        self.key = counted.most_common(1)[0][0] if counted else None
        self.chain = self.stated.chain if self.key is None else controller_chain(self.key)

    def _kinematics(self, waypoint: Node) -> Rows | None:
        """The calibrated kinematics that a waypoint was taught with, None without them."""
        position = waypoint.child("position")
        node = (position and position.child("Kinematics")) or self.of_program
        if node is None or node.text("status") == "NOT_INITIALIZED":
            return None
        rows = [None if (row := node.child(tag)) is None else row.numbers("value") for tag in _ROWS]
        return tuple(tuple(one.value for one in row) for row in rows if row) if all(rows) else None

    def target(self, node: Node) -> Target | str:
        """The target of a waypoint, or why it is not changed."""
        kind, position = node.text("type"), node.child("position")
        if node.inside("SuppressedNode") or node.inside("suppressedNode"):
            return "it is suppressed"
        if kind != "Fixed":
            return _TYPES.get(kind, f"a waypoint of the type {kind!r}")
        if position is None:
            return "it has no position"
        key = self.keys.get(node)
        if key is None and not self.stated.is_stated:
            return NOT_STATED
        if key != self.key:
            return "it was taught with other kinematics than most waypoints: another robot, or before a calibration"
        angles = position.child("JointAngles")
        if angles is None:
            return self._of_polyscope3(node, position)
        joints, tcp = angles.numbers("angles"), position.child("TCPOffset")
        tool = None if tcp is None else tcp.numbers("pose")
        if joints is None or tool is None:
            return "its joints or its tool are not six numbers each"
        q = np.array([one.value for one in joints])
        T_tool = pose_matrix([one.value for one in tool])
        named = dict(zip(JOINTS, joints, strict=True))
        return _Waypoint(node.text("name"), self.line(node), named, joints=q, T_flange_tool=T_tool)

    def _of_polyscope3(self, node: Node, position: Node) -> Target | str:
        """Joints, pose, pose in the feature and pose of the flange, which belong together."""
        flange, feature = node.child("outputFlangePose"), node.child("poseInFeatureCoordinates")
        joints = position.numbers("joints")
        parts = {
            "pose": position.numbers("pose"),
            "flange": None if flange is None else flange.numbers("pose"),
            "feature": None if feature is None else feature.numbers("pose"),
        }
        found = {key: pose_matrix([one.value for one in numbers]) for key, numbers in parts.items() if numbers}
        if joints is None or len(found) < len(parts):
            return "its joints or its poses are not six numbers each"
        q, T_pose, T_flange = np.array([one.value for one in joints]), found["pose"], found["flange"]
        away = disagreement(self.chain, q, T_flange)
        if away is not None:
            return away
        named = dict(zip(JOINTS, joints, strict=True))
        for key, numbers in parts.items():
            named |= {f"{key}.{name}": one for name, one in zip(POSE, numbers or [], strict=True)}
        return _Waypoint(
            node.text("name"),
            self.line(node),
            named,
            joints=q,
            T_flange_tool=inverse(T_flange) @ T_pose,
            controller=self.chain,
            T_feature_base=found["feature"] @ inverse(T_pose),
        )

    def line(self, node: Node) -> int:
        return line_of(self.data, node.start)


class PolyScope(Language):
    """Program of PolyScope, Universal Robots."""

    title = "PolyScope program of Universal Robots"
    endings = (".urp",)

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return b"<URProgram" in _beginning(data)

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        reader = _Reader(data, beside)
        targets: dict[int, Target] = {}
        left: list[LeftAlone] = []
        moves: list[tuple[int, MoveKind, int]] = []
        moved = 0
        for node in reader.waypoints:
            node = node.resolved() or node
            made, line = reader.target(node), reader.line(node)
            if isinstance(made, str):
                literal = node.text("type") == "Fixed" and not made.startswith("it is suppressed")
                left.append(LeftAlone(line, node.text("name") or "waypoint", made, is_literal=literal))
                continue
            at = next(iter(made.numbers.values())).start
            targets.setdefault(at, made)
            moves.append((line, _kind(node), at))
            feature = node.child("BaseToFeature")
            moved += bool(feature and any(one.value for one in feature.numbers("pose") or ()))
        order = {at: k for k, at in enumerate(targets)}
        notes = [f"{moved} waypoints move with a feature if that is taught again"] if moved else []
        return Program(
            data,
            tuple(targets.values()),
            tuple(left),
            tuple(Move(line, kind, order[at]) for line, kind, at in moves),
            tuple(notes),
            reader.chain,
        )

    def values(self, target: Target, joints: FloatArray, pose: FloatArray | None) -> Mapping[str, float]:
        """See `Language`."""
        del pose  # a waypoint is stated by its joints
        assert isinstance(target, _Waypoint)
        new = {f"j{i}": q for i, q in enumerate(joints.tolist(), 1)}
        if target.controller is None:
            return new
        assert target.T_flange_tool is not None  # both of PolyScope 3
        assert target.T_feature_base is not None
        flange = target.controller.pose(joints[None])
        T_flange = transform(flange.R_base_tip[0], flange.tip_in_base[0].tolist())
        T_pose = T_flange @ target.T_flange_tool
        for key, T in {"pose": T_pose, "flange": T_flange, "feature": target.T_feature_base @ T_pose}.items():
            names = [f"{key}.{name}" for name in POSE]
            new |= zip(names, pose_numbers(T, [target.numbers[name].value for name in names]), strict=True)
        return new

    def mark(self, program: Program, words: str) -> Edit:
        """See `Language`: a comment after the last element."""
        end = len(program.data.rstrip())
        return Edit(end, end, f"<!-- {words} -->".encode("latin-1"))

    def unpacked(self, data: bytes) -> bytes:
        """See `Language`."""
        if not data.startswith(_MAGIC):
            return data
        unpacker = zlib.decompressobj(wbits=31)
        try:
            text = unpacker.decompress(data, MAX_BYTES)
        except zlib.error as error:
            raise InputError(f"its gzip is damaged: {error}", hint="copy the program again") from None
        if not unpacker.eof:
            raise InputError("its gzip ends too early, or is too large: the program is truncated", hint="copy it again")
        return text

    def packed(self, text: bytes, file: bytes) -> bytes:
        """See `Language`."""
        return gzip.compress(text, mtime=0) if file.startswith(_MAGIC) else text


def _beginning(data: bytes) -> bytes:
    """The first bytes of a program's text."""
    if not data.startswith(_MAGIC):
        return data[:4096]
    try:
        return zlib.decompressobj(wbits=31).decompress(data, 4096)
    except zlib.error:
        return b""


def _kind(node: Node) -> MoveKind:
    """How the arm moves to a waypoint."""
    around = node.parent
    while around is not None and around.tag not in ("Move", "CircleMove"):
        around = around.parent
    return (
        "circular"
        if around and around.tag == "CircleMove"
        else _KINDS.get(around.text("motionType") if around else "", "joint")
    )
