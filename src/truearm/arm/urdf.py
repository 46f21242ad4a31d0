"""URDF, the robot description of ROS: a chain out of one, and one out of an arm.

URDF speaks metres and radians; everything is turned into mm here. Meshes, inertias and whatever else a file holds
are passed over.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from truearm.arm.arm import Arm
from truearm.arm.bounded import read_bounded
from truearm.arm.chain import Chain
from truearm.arm.frames import FloatArray, frame_from_xyz_rpy, turn_of_z_to, xyz_rpy_of
from truearm.errors import InputError
from truearm.writing import whole_file

MAX_BYTES = 5_000_000
MM_PER_M = 1000.0
MOVING = ("revolute", "continuous", "prismatic")
KNOWN = (*MOVING, "fixed", "floating", "planar")


def read_urdf(path: str | Path, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Read the chain between two links of a URDF.

    Fixed joints are folded into their neighbours. A revolute or sliding joint without a lower and upper limit has
    none here; if one of the two is given, the other is 0, as URDF has it. The frame of the tip's link is the flange,
    its origin the tip. A title, a source and a working pose are read from an element ``truearm``, which other readers
    pass over (see `write_urdf`); without it the working pose is zero, or the limit next to it.

    Parameters
    ----------
    path : path
    base : str, optional
        Name of the link to start from; by default the one that is no joint's child.
    tip : str, optional
        Name of the link to end at; by default the one that is no joint's parent.

    Raises
    ------
    InputError
        If the file is missing, too large, no XML, declares a document type, or is no URDF; if the chain is not
        unique, has no moving joint, or has one that a serial chain cannot hold (floating, planar, mimic).
    """
    try:
        tree = _Tree(_parsed(read_bounded(path, limit_bytes=MAX_BYTES)))
        joints = tree.path(base, tip)
        return _arm_of(tree.robot, joints)
    except InputError as error:
        raise error.in_file(path) from None


class _Element(ET.Element):
    """An element that knows its line."""

    line: int


def _parsed(content: bytes) -> _Element:
    """Parse XML without document types, so that no entity can expand or reach another file."""
    parser = expat.ParserCreate()

    def element(tag: str, attributes: dict[str, str]) -> _Element:
        made = _Element(tag, attributes)
        made.line = parser.CurrentLineNumber
        return made

    def refuse(*_: object) -> None:
        raise InputError("a URDF needs no DOCTYPE or ENTITY, and none is read here", line=parser.CurrentLineNumber)

    builder = ET.TreeBuilder(element_factory=element)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(f"not valid XML: {expat.errors.messages[error.code]}", line=error.lineno) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"not valid XML: {error}") from None
    root = builder.close()
    assert isinstance(root, _Element)
    return root


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    element: _Element


class _Tree:
    """The links and joints of a robot."""

    def __init__(self, robot: _Element) -> None:
        if robot.tag != "robot":
            raise InputError(f"a URDF starts with <robot>, got <{robot.tag}>", line=robot.line)
        self.robot = robot
        self.links = _unique([_attribute(link, "name") for link in _children(robot, "link")], "links")
        self.joints = [_joint_of(element) for element in _children(robot, "joint")]
        _unique([joint.name for joint in self.joints], "joints")
        self.joint_above: dict[str, _Joint] = {}
        for joint in self.joints:
            self._add(joint)

    def _add(self, joint: _Joint) -> None:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in self.links:
                raise InputError(
                    f"joint {joint.name!r} has the {end} {link!r}, but there is no such link", line=joint.element.line
                )
        if joint.child in self.joint_above:
            other = self.joint_above[joint.child]
            raise InputError(
                f"link {joint.child!r} is the child of two joints, {other.name!r} and {joint.name!r}: not a tree",
                line=joint.element.line,
            )
        self.joint_above[joint.child] = joint

    def path(self, base: str | None, tip: str | None) -> list[_Joint]:
        """List the joints from the link `base` to the link `tip`."""
        parents = {joint.parent for joint in self.joints}
        base = self._only(base, [link for link in self.links if link not in self.joint_above], "base")
        tip = self._only(tip, [link for link in self.links if link not in parents], "tip")
        joints: list[_Joint] = []
        link = tip
        while link != base:
            if link not in self.joint_above:
                raise InputError(f"the link {tip!r} does not hang on {base!r}, but on {link!r}", hint=f"base {link!r}")
            if len(joints) == len(self.joints):
                raise InputError(f"the joints above the link {tip!r} go round in a circle")
            joints.append(self.joint_above[link])
            link = joints[-1].parent
        return joints[::-1]

    def _only(self, asked: str | None, candidates: list[str], end: str) -> str:
        if asked is not None:
            if asked not in self.links:
                raise InputError(f"there is no link {asked!r}", hint=f"one of {_named(self.links)}")
            return asked
        if not candidates:
            raise InputError(f"no link can be the {end}: the joints go round in a circle")
        if len(candidates) > 1:
            raise InputError(f"{len(candidates)} links could be the {end}", hint=f"name one of {_named(candidates)}")
        return candidates[0]


def _arm_of(robot: _Element, joints: list[_Joint]) -> Arm:
    fixed, prismatic, names, limits = [np.eye(4)], [], [], []
    for joint in joints:
        fixed[-1] = fixed[-1] @ _origin_of(joint)
        if joint.kind == "fixed":
            continue
        turn = np.eye(4)
        turn[:3, :3] = turn_of_z_to(_axis_of(joint))
        fixed[-1] = fixed[-1] @ turn
        fixed.append(turn.T)
        prismatic.append(joint.kind == "prismatic")
        names.append(joint.name)
        limits.append(_limits_of(joint))
    if not names:
        raise InputError("there is no moving joint between the base and the tip")
    lower, upper = np.array(limits).T
    extra = robot.find("truearm")
    return Arm(
        name=_attribute(robot, "name"),
        chain=Chain(np.array(fixed), np.zeros(3), np.array(prismatic)),
        title="" if extra is None else extra.get("title", ""),
        joint_names=tuple(names),
        lower=lower,
        upper=upper,
        working_pose=_working_pose(extra, names, np.array(prismatic), np.clip(0.0, lower, upper)),
        source="" if extra is None else extra.get("source", ""),
    )


def _working_pose(
    extra: ET.Element | None, names: list[str], prismatic: npt.NDArray[np.bool_], default: FloatArray
) -> FloatArray:
    pose = default.copy()
    for working in [] if extra is None else _children(extra, "working"):
        joint = _attribute(working, "joint")
        if joint not in names:
            raise InputError(f"the working pose names a joint {joint!r} that is not in the chain", line=working.line)
        i = names.index(joint)
        pose[i] = _numbers(working, "position", "a working pose", 1)[0] * (MM_PER_M if prismatic[i] else 1.0)
    return pose


def _joint_of(element: _Element) -> _Joint:
    name = _attribute(element, "name")
    kind = _attribute(element, "type")
    if kind not in KNOWN:
        raise InputError(f"joint {name!r} has the unknown type {kind!r}", line=element.line, hint=", ".join(KNOWN))
    return _Joint(name, kind, _link_of(element, "parent"), _link_of(element, "child"), element)


def _link_of(joint: _Element, end: str) -> str:
    found = _child(joint, end)
    if found is None:
        raise InputError(f"joint {joint.get('name')!r} has no <{end}>", line=joint.line)
    return _attribute(found, "link")


def _origin_of(joint: _Joint) -> FloatArray:
    """Frame of the joint in its parent link [mm]; also refuse what a serial chain cannot hold."""
    if joint.kind not in (*MOVING, "fixed"):
        raise InputError(
            f"joint {joint.name!r} is {joint.kind}: a chain holds {', '.join(MOVING)} and fixed joints",
            line=joint.element.line,
        )
    if _child(joint.element, "mimic") is not None:
        raise InputError(f"joint {joint.name!r} mimics another: coupled joints are not read", line=joint.element.line)
    origin = _child(joint.element, "origin")
    if origin is None:
        return np.eye(4)
    what = f"the origin of joint {joint.name!r}"
    xyz = _numbers(origin, "xyz", what, 3) if "xyz" in origin.attrib else np.zeros(3)
    rpy = _numbers(origin, "rpy", what, 3) if "rpy" in origin.attrib else np.zeros(3)
    return frame_from_xyz_rpy(MM_PER_M * xyz, rpy)


def _axis_of(joint: _Joint) -> FloatArray:
    axis_element = _child(joint.element, "axis")
    if axis_element is None:
        return np.array([1.0, 0.0, 0.0])  # URDF's default
    axis = _numbers(axis_element, "xyz", f"the axis of joint {joint.name!r}", 3)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InputError(f"the axis of joint {joint.name!r} is zero", line=axis_element.line)
    return axis / length


def _limits_of(joint: _Joint) -> tuple[float, float]:
    """Lower and upper limit [rad, or mm]."""
    limit = _child(joint.element, "limit")
    if joint.kind == "continuous" or limit is None or not {"lower", "upper"} & set(limit.attrib):
        return -np.inf, np.inf
    what = f"the limit of joint {joint.name!r}"
    unit = MM_PER_M if joint.kind == "prismatic" else 1.0
    lower, upper = (
        unit * float(_numbers(limit, end, what, 1)[0]) if end in limit.attrib else 0.0 for end in ("lower", "upper")
    )
    return lower, upper


def _children(element: ET.Element, tag: str) -> list[_Element]:
    return [child for child in element if child.tag == tag and isinstance(child, _Element)]


def _child(element: _Element, tag: str) -> _Element | None:
    found = _children(element, tag)
    if len(found) > 1:
        raise InputError(f"expected one <{tag}>, got {len(found)}", line=found[1].line)
    return found[0] if found else None


def _attribute(element: _Element, name: str) -> str:
    value = element.get(name, "")
    if not value:
        raise InputError(f"<{element.tag}> has no {name!r}", line=element.line)
    return value


def _numbers(element: _Element, name: str, what: str, count: int) -> FloatArray:
    text = _attribute(element, name)
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        expected = f"{count} finite numbers" if count > 1 else "a finite number"
        raise InputError(f"{what}: expected {expected} in {name}, got {text[:80]!r}", line=element.line)
    return numbers


def _unique(names: list[str], what: str) -> list[str]:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"two {what} have the name {twice[0]!r}")
    return names


def _named(names: list[str]) -> str:
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")


def write_urdf(arm: Arm, path: str | Path) -> None:
    """Write an arm as a URDF with the links ``base``, ``link_1`` .. ``link_n`` and ``tip``.

    The link ``tip`` has the axes of the flange and its origin at the tip. Title, source and working pose go into
    an element ``truearm``, which other readers pass over.

    Raises
    ------
    InputError
        If a joint has one limit only, which URDF cannot say, or the file cannot be written.
    """
    robot = ET.Element("robot", name=arm.name)
    n = arm.n_joints
    links = ["base", *(f"link_{i + 1}" for i in range(n)), "tip"]
    for link in links:
        ET.SubElement(robot, "link", name=link)
    for i in range(n):
        joint = _joint_element(robot, arm.joint_names[i], _kind_of(arm, i), links[i : i + 2], arm.chain.fixed[i])
        ET.SubElement(joint, "axis", xyz="0 0 1")
        _add_limit(joint, arm, i)
    end = arm.chain.fixed[n].copy()
    end[:3, 3] += end[:3, :3] @ arm.chain.tip_in_flange
    _joint_element(robot, _free_name("tip_joint", arm.joint_names), "fixed", links[n:], end)
    extra = ET.SubElement(robot, "truearm", title=arm.title, source=arm.source)
    for name, position in zip(arm.joint_names, arm.working / _unit_of(arm), strict=True):
        ET.SubElement(extra, "working", joint=name, position=repr(float(position)))
    ET.indent(robot)
    with whole_file(path) as beside:
        ET.ElementTree(robot).write(beside, encoding="utf-8", xml_declaration=True)


def _unit_of(arm: Arm) -> FloatArray:
    """(n_joints,) mm in a metre for sliding joints, 1 for the others."""
    return np.where(arm.chain.slides, MM_PER_M, 1.0)


def _kind_of(arm: Arm, i: int) -> str:
    limited = np.isfinite(arm.limits[i])
    if limited.any() and not limited.all():
        raise InputError(f"joint {arm.joint_names[i]} has one limit only, which a URDF cannot say", hint="a .toml file")
    if _unit_of(arm)[i] == MM_PER_M:
        return "prismatic"
    return "revolute" if limited.all() else "continuous"


def _joint_element(robot: ET.Element, name: str, kind: str, links: list[str], frame: FloatArray) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    xyz, rpy = xyz_rpy_of(frame)
    ET.SubElement(joint, "origin", xyz=_spaced(xyz / MM_PER_M), rpy=_spaced(rpy))
    return joint


def _add_limit(joint: ET.Element, arm: Arm, i: int) -> None:
    limits = arm.limits[i] / _unit_of(arm)[i]
    if np.isfinite(limits).all():
        lower, upper = map(repr, limits.tolist())
        # Effort and velocity are compulsory in URDF and unknown here: zero says nothing is claimed.
        ET.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity="0")


def _free_name(name: str, taken: tuple[str, ...]) -> str:
    while name in taken:
        name += "_"
    return name


def _spaced(numbers: FloatArray) -> str:
    return " ".join(repr(float(number) + 0.0) for number in numbers)
