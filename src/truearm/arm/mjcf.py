"""MJCF, the models of MuJoCo: read as an arm, by way of the URDF with the same bodies and joints.

Read are bodies, frames, sites, joints and masses, with the angles, Euler sequence and default classes of the file.
MuJoCo's own parser compiles meshes and files that are included, which a file from others may not ask for here; what a
chain needs is little. A site is a link that is fixed to its body. A hinge with a reference angle turns from there.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.arm.arm import Arm
from truearm.arm.rigid_motions import rotation_from_z_to, xyz_rpy_from_frame
from truearm.arm.urdf import MAX_BYTES, UrdfChain, arm_with_remarks, spaced, tree_chain
from truearm.arm.urdf_tree import MM_PER_M, UrdfTree
from truearm.errors import InputError
from truearm.files.file_reading import parse_file
from truearm.files.foreign_documents import Element, children, float_attribute, parse_xml
from truearm.typing import FloatArray

WORLD = "world"
# Links of the URDF; a humanoid in a kitchen has some hundreds.
MAX_LINKS = 10_000
_LENGTHS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}
_JOINTS = ("joint", "freejoint")
_KINDS = {"hinge": "revolute", "slide": "prismatic", "free": "floating", "ball": "floating"}
# What makes bodies that are not in the file.
_MAKERS = ("attach", "replicate", "composite", "flexcomp")
# Parts of a model in which another file cannot change poses.
_WITHOUT_POSES = ("asset", "visual")
_WHOLE_MODEL = "let MuJoCo write the whole model: mujoco.mj_saveLastXML"
_EULER = re.compile(r"[xyzXYZ]{3}")


class MjcfJoint(NamedTuple):
    """A moving joint in its body.

    Attributes
    ----------
    body : Element
    is_alone : bool
        Whether no other joint moves the body, so that the body's pose places the joint.
    at_zero : (4, 4) array
        From the body's frame at the reference value to the joint's frame at 0 [mm].
    in_body : (4, 4) array
        The joint's frame in the body [mm].
    """

    body: Element
    is_alone: bool
    at_zero: FloatArray
    in_body: FloatArray


@dataclass(eq=False)
class MjcfRobot:
    """A model with the URDF that has the same chain.

    Attributes
    ----------
    root : Element
        Of the model.
    robot : Element
        Of the URDF.
    joints : dict of str to MjcfJoint
        By name.
    """

    # The name of the text element in which truearm states base and tip.
    ends_name: ClassVar[str] = "truearm"
    orientations: ClassVar[tuple[str, ...]] = ("quat", "axisangle", "xyaxes", "zaxis", "euler")

    root: Element
    robot: Element
    joints: dict[str, MjcfJoint] = field(default_factory=dict)

    @property
    def ends(self) -> Element | None:
        """The text element in which truearm has stated base and tip; None without."""
        texts = (text for custom in children(self.root, "custom") for text in children(custom, "text"))
        return next((text for text in texts if text.get("name") == self.ends_name), None)

    def chain(self, base: str | None, tip: str | None) -> UrdfChain:
        """The chain between two bodies or sites; parameters and errors as of `read_mjcf`."""
        return tree_chain(UrdfTree(self.robot), base, tip)


def read_mjcf(path: str | Path, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Read the chain between two bodies of a model of MuJoCo.

    Parameters
    ----------
    path : path
    base, tip : str, optional
        Names of bodies, the tip also of a site; found as in `truearm.arm.urdf.read_urdf`.

    Raises
    ------
    InputError
        If the file is missing, too large or no MJCF, includes another one on the way, or as `read_urdf`.
    """

    def parsed(content: bytes) -> Arm:
        return arm_with_remarks(mjcf_robot(content).chain(base, tip), Path(path))

    return parse_file(path, parsed, limit_bytes=MAX_BYTES)


def mjcf_robot(content: bytes) -> MjcfRobot:
    """The model in the content of a file; errors as of `read_mjcf`."""
    root = parse_xml(content)
    if root.tag != "mujoco":
        raise InputError(f"a model of MuJoCo starts with <mujoco>, got <{root.tag}>", line=root.line)
    return _Reading(root).result()


class _Settings:
    """What a file says of its numbers: unit of angles, sequence of Euler angles, values of its classes."""

    def __init__(self, root: Element) -> None:
        compiler: dict[str, str] = {}
        for one in children(root, "compiler"):
            compiler |= one.attrib
        if compiler.get("coordinate", "local") != "local":
            raise InputError("MuJoCo reads no global coordinates any more, and truearm neither", line=root.line)
        self.angle = 1.0 if compiler.get("angle", "degree") == "radian" else np.pi / 180
        self.sequence = compiler.get("eulerseq", "xyz")
        if not _EULER.fullmatch(self.sequence):
            raise InputError(f"expected eulerseq as three of x, y, z, X, Y, Z, got {self.sequence[:40]!r}")
        self.limits_by_range = compiler.get("autolimits", "true") == "true"
        self.classes: dict[str, dict[str, str]] = {"main": {}}
        waiting = [(one, dict[str, str](), "main") for one in children(root, "default")]
        while waiting:
            node, given, name = waiting.pop()
            if (is_top := name == "main") != (node.get("class", name) == "main") or not node.get("class", name):
                expected = "no class but 'main'" if is_top else "a class of its own"
                raise InputError(f"expected this <default> with {expected}", line=node.line)
            name = node.get("class", name)
            values = dict(given)
            for one in children(node, "joint"):
                values |= one.attrib
            self.classes[name] = self.classes.get(name, {}) | values
            waiting += [(one, values, "") for one in children(node, "default")]

    def class_of(self, element: Element, attribute: str, default: str) -> str:
        """The class that an element states for itself or its children; refused if the file has no such class."""
        name = element.get(attribute, default)
        if name not in self.classes:
            raise InputError(
                f"<{element.tag}> has the class {name[:40]!r}, which no <default> of the file defines",
                line=element.line,
            )
        return name

    def of_joint(self, joint: Element, childclass: str) -> dict[str, str]:
        """Attributes of a joint with those of its class."""
        return {**self.classes[self.class_of(joint, "class", childclass)], **joint.attrib}

    def pose(self, element: Element) -> FloatArray:
        """Frame [mm] of a body, a frame or a site in what it is in."""
        frame, what = np.eye(4), f"<{element.tag}> {element.get('name', '')!r}"
        if "pos" in element.attrib:
            frame[:3, 3] = MM_PER_M * float_attribute(element, "pos", what, 3)
        stated = [name for name in MjcfRobot.orientations if name in element.attrib]
        if len(stated) > 1:
            raise InputError(f"{what} has the orientations {' and '.join(stated)}", line=element.line)
        for name in stated:
            numbers = float_attribute(element, name, what, _LENGTHS[name])
            if name != "euler" and not 1e-9 < np.abs(numbers[:3] if name == "axisangle" else numbers).max() < 1e9:
                raise InputError(f"{what}: {name} is no orientation", line=element.line)
            frame[:3, :3] = self._rotation(name, numbers)
        return frame

    def _rotation(self, name: str, numbers: FloatArray) -> FloatArray:
        if name == "quat":
            return np.asarray(Rotation.from_quat(numbers, scalar_first=True).as_matrix())
        if name == "euler":
            turns = np.eye(3)  # a small letter turns about the axes as turned before, a capital about fixed ones
            for letter, angle in zip(self.sequence, self.angle * numbers, strict=True):
                one = Rotation.from_euler(letter.lower(), angle).as_matrix()
                turns = turns @ one if letter.islower() else one @ turns
            return turns
        if name == "axisangle":
            axis = numbers[:3] / np.linalg.norm(numbers[:3])
            return np.asarray(Rotation.from_rotvec(self.angle * numbers[3] * axis).as_matrix())
        if name == "zaxis":
            return rotation_from_z_to(numbers / np.linalg.norm(numbers))
        x = numbers[:3] / np.linalg.norm(numbers[:3])
        y = numbers[3:] - x * (x @ numbers[3:])
        y = y / np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])


def _check_complete(root: Element) -> None:
    """Refuse a model whose bodies, classes or angles can be in another file."""
    waiting = [root]
    while waiting:
        inside = [one for one in waiting.pop() if isinstance(one, Element) and one.tag not in _WITHOUT_POSES]
        for one in inside:
            if one.tag == "include":
                raise InputError(
                    "<include> has bodies or settings that are not in the file",
                    line=one.line,
                    hint=f"give the file that has the bodies, or {_WHOLE_MODEL}",
                )
        waiting += inside


class _Reading:
    """The bodies of a model, made links and joints of a URDF."""

    def __init__(self, root: Element) -> None:
        _check_complete(root)
        self.settings = _Settings(root)
        self.root = root
        self.robot = _made("robot", root, name=root.get("model", "mujoco"))
        self.made = MjcfRobot(root, self.robot)
        named = [one.get("name", "") for one in root.iter() if one.tag in ("body", "site", *_JOINTS)]
        self.taken = {WORLD, *named}
        self.used: set[str] = set()
        self.links: dict[str, Element] = {}
        self.numbers: Counter[str] = Counter()

    def result(self) -> MjcfRobot:
        worlds = children(self.root, "worldbody")
        if not worlds:
            raise InputError("the model has no <worldbody>", line=self.root.line)
        self._add_link(WORLD, self.root)
        # What a link holds, what it is fixed to, and the class of its children.
        waiting = [(world, WORLD, self.settings.class_of(world, "childclass", "main")) for world in reversed(worlds)]
        while waiting:
            holder, link, childclass = waiting.pop()
            inside = []
            for one in holder:
                if not isinstance(one, Element):
                    continue
                if one.tag in _MAKERS:
                    raise InputError(
                        f"<{one.tag}> makes bodies that are not in the file", line=one.line, hint=_WHOLE_MODEL
                    )
                below = self.settings.class_of(one, "childclass", childclass)
                if one.tag == "body":
                    inside.append((one, self._body(one, link, below), below))
                elif one.tag == "frame":
                    name = self._free("frame")
                    self._fixed(one, link, name, self.settings.pose(one))
                    inside.append((one, name, below))
                elif one.tag == "site" and holder.tag != "worldbody":
                    name = self._name(one)
                    self._fixed(one, link, name, self.settings.pose(one))
            waiting += reversed(inside)
        self._state_ends()
        return self.made

    def _body(self, body: Element, parent: str, childclass: str) -> str:
        """Add a body: a link after each of its joints, the last one with the body's name."""
        name = self._name(body)
        joints = [one for one in body if isinstance(one, Element) and one.tag in _JOINTS]
        at, link = self.settings.pose(body), parent
        for joint in joints:
            given = self.settings.of_joint(joint, childclass)
            kind = _KINDS.get("free" if joint.tag == "freejoint" else given.get("type", "hinge"))
            called = self._name(joint)
            if kind is None:
                raise InputError(f"joint {called!r} has the unknown type {given['type'][:40]!r}", line=joint.line)
            one = _made("joint", joint, name=called, type=kind)
            moved = _made("given", joint, **given)
            in_body, at_zero, axis, limits = self._of_joint(moved, called, kind)
            is_same = len(joints) == 1 and not (in_body - np.eye(4)).any()
            after = name if is_same else self._free(f"{called} moves")
            self._join(one, link, after, at @ at_zero)
            one.append(_made("axis", joint, xyz=spaced(axis)))
            if limits is not None:
                one.append(_made("limit", joint, lower=repr(limits[0]), upper=repr(limits[1])))
            self._add_link(after, joint)
            self.made.joints[called] = MjcfJoint(body, len(joints) == 1, at_zero, in_body)
            at, link = np.asarray(np.linalg.inv(in_body), dtype=float), after
        if link != name:
            self._fixed(body, link, name, at)
        for inertial in children(body, "inertial")[:1]:
            self._add_mass(name, inertial)
        return name

    def _of_joint(
        self, given: Element, name: str, kind: str
    ) -> tuple[FloatArray, FloatArray, FloatArray, list[float] | None]:
        """Frames [mm] as of `MjcfJoint`, the axis, and limits [rad, or m]."""
        what, in_body, turn = f"joint {name!r}", np.eye(4), np.eye(4)
        if kind == "floating":
            return in_body, turn, np.array([0.0, 0.0, 1.0]), None
        axis = float_attribute(given, "axis", what, 3) if "axis" in given.attrib else np.array([0.0, 0.0, 1.0])
        if not 1e-9 < np.abs(axis).max() < 1e9:
            raise InputError(f"the axis of {what} is no direction", line=given.line)
        axis = axis / np.linalg.norm(axis)
        unit = self.settings.angle if kind == "revolute" else 1.0
        ref = unit * float(float_attribute(given, "ref", what, 1)[0]) if "ref" in given.attrib else 0.0
        if kind == "revolute":
            if "pos" in given.attrib:
                in_body[:3, 3] = MM_PER_M * float_attribute(given, "pos", what, 3)
            turn[:3, :3] = Rotation.from_rotvec(-ref * axis).as_matrix()
        else:
            turn[:3, 3] = -MM_PER_M * ref * axis
        limits = None
        is_limited = given.get("limited", "auto")
        if "range" in given.attrib and (
            is_limited == "true" or (is_limited == "auto" and self.settings.limits_by_range)
        ):
            limits = (unit * float_attribute(given, "range", what, 2)).tolist()
        return in_body, in_body @ turn, axis, limits

    def _add_mass(self, link: str, inertial: Element) -> None:
        mass = _made("inertial", inertial)
        pos = inertial.get("pos", "0 0 0")
        mass.append(_made("origin", inertial, xyz=pos))
        mass.append(_made("mass", inertial, value=inertial.get("mass", "")))
        self.links[link].append(mass)

    def _fixed(self, element: Element, parent: str, name: str, at: FloatArray) -> None:
        self._join(_made("joint", element, name=self._free(f"{name} fixed"), type="fixed"), parent, name, at)
        self._add_link(name, element)

    def _join(self, joint: Element, parent: str, below: str, at: FloatArray) -> None:
        xyz, rpy = xyz_rpy_from_frame(at)
        joint.append(_made("parent", joint, link=parent))
        joint.append(_made("child", joint, link=below))
        joint.append(_made("origin", joint, xyz=spaced(xyz / MM_PER_M), rpy=spaced(rpy)))
        self.robot.append(joint)

    def _add_link(self, name: str, element: Element) -> None:
        if len(self.links) >= MAX_LINKS:
            raise InputError(f"expected at most {MAX_LINKS} bodies, joints and sites", line=element.line)
        self.links[name] = _made("link", element, name=name)
        self.robot.append(self.links[name])

    def _name(self, element: Element) -> str:
        """The name of an element, or a free one."""
        name = element.get("name") or self._free(element.tag)
        if name in self.used and element.tag not in _JOINTS:
            name = self._free(name)  # a site may have the name of a body
        self.used.add(name)
        return name

    def _free(self, name: str) -> str:
        found = name
        while found in self.taken:
            self.numbers[name] += 1
            found = f"{name} {self.numbers[name] + 1}"
        self.taken.add(found)
        return found

    def _state_ends(self) -> None:
        """The ends that the file states, and gravity, as the URDF of truearm has them."""
        about: dict[str, str] = {}
        if (text := self.made.ends) is not None:
            base, _, tip = text.get("data", "").partition(":")
            about = {"base": base, "tip": tip}
        for option in children(self.root, "option"):
            if "gravity" in option.attrib:
                gravity = float_attribute(option, "gravity", "the option", 3)
                if gravity.any():
                    about["gravity_in_base"] = spaced(gravity)
        if about:
            self.robot.append(_made("truearm", self.root, **about))


def _made(tag: str, place: Element, /, **attributes: str) -> Element:
    """An element of the URDF, with the place of what it stands for."""
    element = Element(tag, attributes)
    element.line, element.start, element.end = place.line, place.start, place.end
    return element
