"""The links and joints of a URDF as a tree, and the joints between two of its links."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from truearm.arm.rigid_motions import frame_from_xyz_rpy, rotation_from_z_to
from truearm.errors import InputError
from truearm.files.foreign_documents import Element, attribute, child, children, float_attribute
from truearm.typing import FloatArray

MM_PER_M = 1000.0
MOVING = ("revolute", "continuous", "prismatic")
KNOWN = (*MOVING, "fixed", "floating", "planar")


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF.

    Attributes
    ----------
    name : str
    kind : str
        One of `KNOWN`.
    parent, child : str
        Names of its links.
    element : Element
    """

    name: str
    kind: str
    parent: str
    child: str
    element: Element

    @property
    def is_moving(self) -> bool:
        """Whether it turns or slides."""
        return self.kind != "fixed"

    @property
    def origin(self) -> FloatArray:
        """Frame of the joint in its parent link [mm]; refuse joints that a serial chain cannot have."""
        if self.kind not in (*MOVING, "fixed"):
            raise InputError(
                f"joint {self.name!r} is {self.kind}: a chain has {', '.join(MOVING)} and fixed joints",
                line=self.element.line,
            )
        origin = child(self.element, "origin")
        if origin is None:
            return np.eye(4)
        what = f"the origin of joint {self.name!r}"
        xyz = float_attribute(origin, "xyz", what, 3) if "xyz" in origin.attrib else np.zeros(3)
        rpy = float_attribute(origin, "rpy", what, 3) if "rpy" in origin.attrib else np.zeros(3)
        return frame_from_xyz_rpy(MM_PER_M * xyz, rpy)

    @property
    def axis_rotation(self) -> FloatArray:
        """(4, 4) rotation of the frame of a moving joint that brings its z axis to the joint's axis."""
        turn = np.eye(4)
        turn[:3, :3] = rotation_from_z_to(self._axis)
        return turn

    @property
    def _axis(self) -> FloatArray:
        axis_element = child(self.element, "axis")
        if axis_element is None:
            return np.array([1.0, 0.0, 0.0])  # URDF's default
        axis = float_attribute(axis_element, "xyz", f"the axis of joint {self.name!r}", 3)
        largest = float(np.abs(axis).max())
        if not 1e-9 < largest < 1e9:
            raise InputError(
                f"the axis of joint {self.name!r} is no direction: its largest component is {largest:g}",
                line=axis_element.line,
            )
        return axis / float(np.linalg.norm(axis))

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit [rad, or mm]; none where both are zero, which an exporter of CAD writes by default."""
        limit = child(self.element, "limit")
        if self.kind == "continuous" or limit is None or not {"lower", "upper"} & set(limit.attrib):
            return -np.inf, np.inf
        what = f"the limit of joint {self.name!r}"
        unit = MM_PER_M if self.kind == "prismatic" else 1.0
        lower, upper = (
            unit * float(float_attribute(limit, end, what, 1)[0]) if end in limit.attrib else 0.0
            for end in ("lower", "upper")
        )
        return (lower, upper) if lower or upper else (-np.inf, np.inf)


class UrdfTree:
    """The links and joints of a robot.

    Parameters
    ----------
    robot : Element
        The root of the file.

    Raises
    ------
    InputError
        If it is no ``<robot>``, or holds instructions of xacro; if names repeat, or joints and links form no tree.
    """

    def __init__(self, robot: Element) -> None:
        if robot.tag != "robot":
            raise InputError(f"a URDF starts with <robot>, got <{robot.tag}>", line=robot.line)
        _check_expanded(robot)
        self.robot = robot
        elements = children(robot, "link")
        links = _unique([attribute(link, "name") for link in elements], "links")
        self.links = dict(zip(links, elements, strict=True))  # in the order of the file, and quickly found
        self.joints = [_joint_of(element) for element in children(robot, "joint")]
        _unique([joint.name for joint in self.joints], "joints")
        self.joint_above: dict[str, UrdfJoint] = {}
        for joint in self.joints:
            self._add(joint)

    def _add(self, joint: UrdfJoint) -> None:
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

    def path(self, base: str, tip: str) -> list[UrdfJoint]:
        """List the joints from the link `base` to the link `tip`."""
        joints: list[UrdfJoint] = []
        link = tip
        while link != base:
            if link not in self.joint_above:
                raise InputError(
                    f"the link {tip!r} is not connected to {base!r}, but to {link!r}", hint=f"use the base {link!r}"
                )
            if len(joints) == len(self.joints):
                raise InputError(f"the joints above the link {tip!r} form a loop")
            joints.append(self.joint_above[link])
            link = joints[-1].parent
        return joints[::-1]

    def standing_link_above(self, link: str) -> str:
        """Where the joints above a link begin: the root, or what a floating or planar joint carries."""
        start = link
        for _ in self.joints:
            joint = self.joint_above.get(link)
            if joint is None or joint.kind in ("floating", "planar"):
                return link
            link = joint.parent
        if link in self.joint_above:
            raise InputError(f"the joints above the link {start!r} form a loop")
        return link

    @property
    def stated_ends(self) -> tuple[str | None, str | None]:
        """Base and tip link that the file itself names in its element ``truearm``; None where it names none."""
        extra = child(self.robot, "truearm")
        return (None, None) if extra is None else (extra.get("base"), extra.get("tip"))


def _joint_of(element: Element) -> UrdfJoint:
    name = attribute(element, "name")
    kind = attribute(element, "type")
    if kind not in KNOWN:
        raise InputError(f"joint {name!r} has the unknown type {kind!r}", line=element.line, hint=", ".join(KNOWN))
    return UrdfJoint(name, kind, _link_of(element, "parent"), _link_of(element, "child"), element)


def _link_of(joint: Element, end: str) -> str:
    found = child(joint, end)
    if found is None:
        raise InputError(f"joint {joint.get('name')!r} has no <{end}>", line=joint.line)
    return attribute(found, "link")


def _check_expanded(robot: Element) -> None:
    """Refuse a file with instructions of xacro: a program that writes a URDF, and may do anything else on the way."""
    for element in robot.iter():
        if isinstance(element, Element) and element.tag.startswith("xacro:"):
            raise InputError(
                f"expected a URDF, got a xacro file: it has <{element.tag}>",
                line=element.line,
                hint="expand it first, with xacro of ROS or with xacrodoc (pip install xacrodoc), which needs no ROS: "
                "xacrodoc FILE.xacro -o robot.urdf",
            )


def _unique(names: list[str], what: str) -> list[str]:
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise InputError(f"{count} {what} have the name {name!r}")
    return names


def named(names: list[str]) -> str:
    """Join names, the first 20 of them."""
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
