"""Programs of PolyScope (.urp): gzipped XML with the joints of each waypoint and the kinematics of its robot.

PolyScope 5 has ``<Waypoint type="Fixed"><position><JointAngles/><TCPOffset/><Kinematics/></position></Waypoint>``: the
pose is that of the joints. PolyScope 3 writes joints, pose, pose in the feature and pose of the flange, which are kept
consistent. Nodes refer to earlier ones by their place (XStream), so that none is moved: only numbers of attributes
change. The kinematics are those of the controller, its factory calibration: targets are corrected against them.
"""

from __future__ import annotations

import gzip
import zlib
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truearm.arm import Chain
from truearm.arm.rigid_motions import inverse, motion
from truearm.typing import FloatArray
from truearm.wings.exports.programs.controllers import (
    GZIP,
    NOT_STATED,
    Node,
    Rows,
    StatedKinematics,
    calibrated_rows,
    controller_chain,
    disagreements,
    parse_nodes,
    unpacked,
)
from truearm.wings.exports.programs.program import (
    Language,
    LeftAlone,
    Lines,
    Move,
    MoveKind,
    Program,
    Surroundings,
    Target,
)
from truearm.wings.exports.programs.urscript import JOINTS, POSE, pose_matrix, pose_numbers
from truearm.wings.exports.targets.edits import Edit

_LEVEL = 6
_PLACES = ("position", "JointAngles", "poseInFeatureCoordinates", "outputFlangePose")
_TYPES = {"Variable": "its place is a variable", "Relative": "it is relative to where the arm is"}
_KINDS: dict[str, MoveKind] = {"MoveJ": "joint", "MoveL": "linear", "MoveP": "linear"}


@dataclass(frozen=True, eq=False)
class _Waypoint(Target):
    """A waypoint with the kinematics of its controller, for the poses that PolyScope 3 writes beside the joints."""

    controller: Chain | None = None
    T_feature_base: FloatArray | None = None


class _Reader:
    """The waypoints of a program."""

    def __init__(self, data: bytes, beside: Surroundings) -> None:
        self.line_of = Lines(data)
        self.root = parse_nodes(data)
        self.stated = StatedKinematics.of(beside)
        self.waypoints = [node for node in self.root.walk() if node.tag == "Waypoint"]
        self.of_program = next(
            (one for one in self.root.walk() if one.tag == "kinematics" and not one.inside("Waypoint")), None
        )
        self.keys = {node: key for node in self.waypoints if (key := self._kinematics(node)) is not None}
        counted = Counter(self.keys.values())
        self.key = counted.most_common(1)[0][0] if counted else None
        self.chain = self.stated.controller if self.key is None else controller_chain(self.key)

    def _kinematics(self, waypoint: Node) -> Rows | None:
        """The calibrated kinematics that a waypoint was taught with, None without them."""
        position = waypoint.child("position")
        node = (position and position.child("Kinematics")) or self.of_program
        return None if node is None else calibrated_rows(node)

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
        (away,) = disagreements(self.chain, q[None], T_flange[None])
        if away:
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
        return self.line_of(node.start)


class PolyScope(Language):
    """Program of PolyScope, Universal Robots."""

    title = "PolyScope program of Universal Robots"
    endings = (".urp",)
    takes_no_targets = "nodes of its XML refer to each other by their places"
    keeps_comments = False

    def recognises(self, data: bytes) -> bool:
        """See `Language`."""
        return b"<URProgram" in _beginning(data)

    def read(self, data: bytes, beside: Surroundings) -> Program:
        """See `Language`."""
        reader = _Reader(data, beside)
        targets: dict[int, Target] = {}
        left: list[LeftAlone] = []
        moves: list[tuple[Move, int]] = []
        moved = 0
        all_made = {
            node: reader.target(node) for node in dict.fromkeys(one.resolved() or one for one in reader.waypoints)
        }
        shared = _shared(all_made)
        for node in reader.waypoints:
            node = node.resolved() or node
            made, line = all_made[node], reader.line(node)
            if isinstance(made, Target) and node in shared:
                made = f"it shares joints with {shared[node]}, which has another tool or is not changed"
            if isinstance(made, str):
                literal = node.text("type") == "Fixed" and not made.startswith("it is suppressed")
                left.append(LeftAlone(line, node.text("name") or "waypoint", made, is_literal=literal))
                moves.append((Move(line, _kind(node), None), -1))
                continue
            at = next(iter(made.numbers.values())).start
            targets.setdefault(at, made)
            moves.append((Move(line, _kind(node), None), at))
            feature = node.child("BaseToFeature")
            moved += bool(feature and any(one.value for one in feature.numbers("pose") or ()))
        notes = [f"{moved} waypoints move with a feature if that is taught again"] if moved else []
        return Program.of(data, targets, left, moves, notes, reader.chain)

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
        T_flange = motion(flange.R_base_tip[0], flange.tip_in_base[0].tolist())
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
        return unpacked(data)

    def packed(self, text: bytes, file: bytes) -> bytes:
        """See `Language`."""
        return gzip.compress(text, _LEVEL, mtime=0) if file.startswith(GZIP) else text


def _places(node: Node) -> set[int]:
    """Where the numbers of a waypoint stand, which it may share with others."""
    around = [one.resolved() for one in node.children]
    parts = [part for one in around if one for part in (one, *(inner.resolved() for inner in one.children))]
    return {
        number.start
        for part in parts
        if part is not None and part.tag in _PLACES
        for name in ("angles", "joints", "pose")
        for number in part.numbers(name) or ()
    }


def _shared(made: Mapping[Node, Target | str]) -> dict[Node, str]:
    """Waypoints that share a number with another one, but not all that it is corrected by; with the other's name."""
    owners: defaultdict[int, list[Node]] = defaultdict(list)
    for node in made:
        for start in _places(node):
            owners[start].append(node)
    return {
        node: other.text("name")
        for nodes in owners.values()
        for node in nodes
        for other in nodes
        if not _are_same(made[node], made[other])
    }


def _are_same(one: Target | str, other: Target | str) -> bool:
    """Whether two waypoints have one correction."""
    if isinstance(one, str) or isinstance(other, str) or one.numbers != other.numbers:
        return one is other
    assert one.T_flange_tool is not None  # of every waypoint
    assert other.T_flange_tool is not None
    return bool((one.T_flange_tool == other.T_flange_tool).all())


def _beginning(data: bytes) -> bytes:
    """The first bytes of a program's text."""
    if not data.startswith(GZIP):
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
