"""URDF, the robot description of ROS: read as an arm, and written from one.

URDF has metres and radians; lengths are converted to mm here. Meshes, moments of inertia and all other content are
ignored.

Base and tip are the links between which the arm is, as far as the file shows them. The arm is the longest chain of
moving joints. Its tip is a link that is fixed to its last moving link; of several the names decide that public
collections use. Fingers of a gripper are no part of the arm: what carries them is its tip. So it is where an arm
divides that has as many joints before as any branch after: the branches are those of a hand.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearm.arm.arm import Arm, PointMass, combine_point_masses
from truearm.arm.chain import Chain
from truearm.arm.rigid_motions import screw_z, xyz_rpy_from_frame
from truearm.arm.urdf_tree import MM_PER_M, MOVING, UrdfJoint, UrdfTree, named
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import parse_file
from truearm.files.foreign_documents import Element, attribute, child, children, float_attribute, parse_xml
from truearm.typing import BoolArray, FloatArray

# Usual names of a tip, the first that fits: behind the name of a robot or a side, before "link" or "frame".
TIP_NAMES = (
    ("tool0", r"tool_?0"),
    ("flange", r"flange"),
    ("ee_link", r"ee|eef|link_ee"),
    ("tcp", r"tcp|tool_center_point|tool|tooltip|tip"),
    ("end_effector", r"end_?effector(_tip)?"),
    ("attachment site", r"attachment|gripper_?frame"),
    ("gripper base", r"(gripper|hand)(_base|_body|_palm)?|palm"),
)
_USUAL = [re.compile(rf"(.*_)?({form})(_link|_frame|_site)?") for _, form in TIP_NAMES]
_FINGER = re.compile("finger|knuckle|jaw|thumb|claw")
# Every other chain of moving joints has at most this part of the joints of the arm.
_OTHER_CHAINS = 0.5


class Ends(NamedTuple):
    """The links between which an arm is, and in words what was chosen of what; no words where there was no choice."""

    base: str
    tip: str
    remark: str = ""


def find_ends(tree: UrdfTree, base: str | None = None, tip: str | None = None) -> Ends:
    """Find the links between which the arm of a URDF is: those asked for, else those that the file states itself.

    Raises
    ------
    InputError
        If there is no such link, the joints form a loop, nothing moves, or several arms are equally long.
    """
    base, tip = base or tree.stated_ends[0], tip or tree.stated_ends[1]
    for link in (base, tip):
        if link is not None and link not in tree.links:
            raise InputError(f"there is no link {link!r}", hint=f"use one of {named(list(tree.links))}")
    if tip is not None:
        return Ends(tree.standing_link_above(tip) if base is None else base, tip)
    if not tree.links or not tree.joints:
        raise InputError(f"the robot has no <{'joint' if tree.links else 'link'}>")
    if base is not None:
        return _Branches(tree, [base]).ends([base])
    roots = [link for link in tree.links if link not in tree.joint_above]
    if not roots:
        raise InputError("no link can be the base: the joints form a loop")
    # What a floating or planar joint carries stands as far as the arm is concerned.
    carried = [joint.child for joint in tree.joints if joint.kind in ("floating", "planar")]
    branches = _Branches(tree, roots)
    moving = [link for link in (*roots, *carried) if branches.depth.get(link)] or roots
    return branches.ends(moving)


class _Branches:
    """How many joints deep an arm hangs below each link, without the fingers of grippers."""

    def __init__(self, tree: UrdfTree, roots: list[str]) -> None:
        self.below: dict[str, list[UrdfJoint]] = {link: [] for link in tree.links}
        for joint in tree.joints:
            self.below[joint.parent].append(joint)
        self.depth: dict[str, int] = {}
        self.fingers: set[str] = set()
        for link in reversed(list(self._walk(roots))):
            last = (joint for joint in self.below[link] if joint.kind in MOVING and not self.depth[joint.child])
            self.fingers |= {joint.name for joint in last if _is_named_finger(joint)}
            self.depth[link] = max([0, *map(self.length, self.below[link])])

    def _walk(self, roots: list[str]) -> Iterator[str]:
        """Yield all links below some, every one after the link that carries it."""
        waiting = roots[::-1]
        while waiting:
            yield (link := waiting.pop())
            waiting += [joint.child for joint in reversed(self.below[link])]

    def length(self, joint: UrdfJoint) -> int:
        """Number of moving joints in a row from a joint on."""
        if joint.kind in ("floating", "planar"):
            return 0
        return self.depth[joint.child] + (joint.kind in MOVING and joint.name not in self.fingers)

    def ends(self, bases: list[str]) -> Ends:
        """The longest chain from one of some bases."""
        base = max(bases, key=lambda link: self.depth[link])
        length = self.depth[base]
        if not length:
            what = " but the fingers of a gripper" if self.fingers else ""
            raise InputError(f"there is no moving joint{what} between the base and the tip")
        rivals = [link for link in bases if link != base and self.depth[link] > _OTHER_CHAINS * length]
        if rivals:
            self._refuse(length, [self._tip(link)[0] for link in (base, *rivals)])
        tip, candidates, passed = self._tip(base)
        choice = [f"tip: {tip}, of {named(candidates)}"] if len(candidates) > 1 else []
        if passed:
            choice.append("the longest chain" if choice else f"tip: {tip}, of the longest chain")
        if any(joint.name in self.fingers for link in candidates for joint in self.below[link]):
            choice.append("without its fingers" if choice else f"tip: {tip}, which carries the fingers of a gripper")
        return Ends(base, tip, ", ".join(choice))

    def _tip(self, start: str, above: int = 0) -> tuple[str, list[str], bool]:
        """The tip of the longest chain from a link, all that it could be, and whether other chains were passed.

        Some moving joints may stand above the link.
        """
        passed, link = False, start
        while True:
            body = self._fixed_to(link)
            going = [joint for member in body for joint in self.below[member] if self._goes_on(joint)]
            if not going:
                break
            going.sort(key=self.length, reverse=True)
            rivals = [one for one in going[1:] if self.length(one) > _OTHER_CHAINS * self.length(going[0])]
            if rivals and above >= self.length(going[0]):
                self.fingers |= {joint.name for joint in going}
                break
            above += 1
            if rivals:
                self._refuse(self.length(going[0]), [self._tip(one.child, above)[0] for one in (going[0], *rivals)])
            passed, link = passed or len(going) > 1, going[0].child
        carries = [member for member in body if any(joint.name in self.fingers for joint in self.below[member])]
        ends = [member for member in body if member in carries or not self.below[member]] or [link]

        def rank(member: str) -> tuple[bool, int, bool]:
            name = re.sub(r"[\W_]+", "_", member.lower())
            usual = next((i for i, form in enumerate(_USUAL) if form.fullmatch(name)), len(_USUAL))
            return usual == len(_USUAL), usual, member not in carries

        best = min(ends, key=rank)
        if len(ends) > 1 and rank(best)[0] and best not in carries:
            best = link  # none has a usual name: the last link that moves
        return best, list(dict.fromkeys((best, *ends))), passed

    def _goes_on(self, joint: UrdfJoint) -> bool:
        return joint.kind in MOVING and joint.name not in self.fingers

    def _fixed_to(self, link: str) -> list[str]:
        """The link and all that are fixed to it."""
        body = [link]
        for member in body:  # it grows
            body += [joint.child for joint in self.below[member] if joint.kind == "fixed"]
        return body

    def _refuse(self, length: int, tips: list[str]) -> None:
        joints = f"{length} joint{'s' * (length > 1)}"
        raise InputError(
            f"{len(tips)} arms could be meant, the longest of {joints}, with the tips {named(tips)}",
            hint=f"name one after the file: FILE.urdf::{tips[0]} (FILE.urdf:BASE:TIP)",
        )


def _is_named_finger(joint: UrdfJoint) -> bool:
    """Whether a joint at the end of a chain has the name of a finger, or of a gripper that opens."""
    name, link = joint.name.lower(), joint.child.lower()
    opens = "gripper" in name and not re.search("base|palm|body|wrist|rot|roll", f"{name} {link}")
    return bool(opens or _FINGER.search(name) or _FINGER.search(link))


MAX_BYTES = 5_000_000
BASE_LINK, TIP_LINK = "base", "tip"


def read_urdf(path: str | Path, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Read the chain between two links of a URDF.

    Fixed joints are folded into their neighbours. A joint that mimics another on the way is coupled with it: a joint of
    the arm whose own column in a table is not used. A revolute or sliding joint without a lower and upper limit has
    none here; if one of the two is given, the other is 0, as URDF has it. The frame of the tip's link is the flange,
    its origin the tip. Masses are those of the chain's own links; a link without ``<inertial>`` has none; if none has
    more than zero, the masses are not known. Links attached to the chain at its side are ignored. A title, a source, a
    serial number, a working pose and the direction of gravity are read from an element ``truearm``, which other
    readers ignore (see `write_urdf`); without it the working pose is zero, or the limit next to it, and the arm is
    upright.

    Parameters
    ----------
    path : path
    base : str, optional
        Name of the link to start from; by default the one that the element ``truearm`` states as ``base``, or the root
        of the robot.
    tip : str, optional
        Name of the link to end at; by default the one that the element ``truearm`` states as ``tip``, or the end of
        the longest chain of moving joints (see `find_ends`): the arm's remarks say what was chosen.

    Raises
    ------
    InputError
        If the file is missing, too large, no XML, declares a document type, or is no URDF; if several arms are in it,
        or the chain has no moving joint, or has one that a serial chain cannot have (floating, planar, or a mimic of a
        joint beside it).
    """

    def parsed(content: bytes) -> Arm:
        return arm_with_remarks(urdf_chain(content, base, tip), Path(path))

    return parse_file(path, parsed, limit_bytes=MAX_BYTES)


def arm_with_remarks(chain: UrdfChain, file: Path) -> Arm:
    """The arm of a chain in a file, with remarks on what was chosen; errors as in `read_urdf`."""
    arm = chain.arm()
    remarks = [f"{chain.remark}; {file.name}::LINK takes another."] if chain.remark else []
    if arm.chain.coupling is not None:
        unread = ", ".join(np.array(arm.joint_names)[~arm.chain.is_read])
        remarks.append(
            f"no angle is read of {unread}, which mimics another joint: in a table its column may hold zeros."
        )
    return replace(arm, remarks=tuple(remarks))


class UrdfChain(NamedTuple):
    """A URDF and the joints between two of its links, with a remark on the choice of the links if there was one."""

    tree: UrdfTree
    joints: list[UrdfJoint]
    remark: str

    def arm(self) -> Arm:
        """The arm with these joints; errors as in `read_urdf`."""
        tree, joints = self.tree, self.joints
        robot = tree.robot
        fixed, prismatic, names, limits = [np.eye(4)], [], [], []
        lumps: list[PointMass] = []
        for joint in joints:
            fixed[-1] = fixed[-1] @ joint.origin
            if joint.is_moving:
                turn = joint.axis_rotation
                fixed[-1] = fixed[-1] @ turn
                fixed.append(turn.T)
                prismatic.append(joint.kind == "prismatic")
                names.append(joint.name)
                is_read = child(joint.element, "mimic") is None  # no encoder of its own
                limits.append(joint.limits if is_read else (-np.inf, np.inf))
            inertial = child(tree.links[joint.child], "inertial")
            if inertial is not None and names:  # a mass that does not move has no effect
                mass, centre = _mass_of(joint.child, inertial)
                lumps.append(PointMass(len(names), mass, fixed[-1][:3, :3] @ centre + fixed[-1][:3, 3]))
        if not names:
            raise InputError("there is no moving joint between the base and the tip")
        lower, upper = np.array(limits).T
        fixed, coupling = _coupled(joints, fixed)
        extra, known = child(robot, "truearm"), {joint.name for joint in tree.joints}
        gravity = None
        if extra is not None and "gravity_in_base" in extra.attrib:
            gravity = float_attribute(extra, "gravity_in_base", "the direction of gravity", 3)
        return Arm(
            name=attribute(robot, "name"),
            chain=Chain(np.array(fixed), np.zeros(3), np.array(prismatic), coupling),
            title="" if extra is None else extra.get("title", ""),
            joint_names=tuple(names),
            lower=lower,
            upper=upper,
            working_pose=_working_pose(extra, known, names, np.array(prismatic), np.clip(0.0, lower, upper)),
            source="" if extra is None else extra.get("source", ""),
            serial_number="" if extra is None else extra.get("serial_number", ""),
            masses=combine_point_masses(lumps, len(names)),
            gravity_in_base=gravity,
        )


def urdf_chain(content: bytes, base: str | None, tip: str | None) -> UrdfChain:
    """The chain between two links in the content of a URDF; parameters and errors as of `read_urdf`."""
    return tree_chain(UrdfTree(parse_xml(content)), base, tip)


def tree_chain(tree: UrdfTree, base: str | None, tip: str | None) -> UrdfChain:
    """The chain between two links of a tree; parameters and errors as of `read_urdf`."""
    ends = find_ends(tree, base, tip)
    return UrdfChain(tree, tree.path(ends.base, ends.tip), ends.remark)


def _coupled(joints: list[UrdfJoint], fixed: list[FloatArray]) -> tuple[list[FloatArray], FloatArray | None]:
    """The fixed motions with the offsets of joints that mimic others, and the coupling; None where none does."""
    moving = [joint for joint in joints if joint.is_moving]
    unit = [MM_PER_M if joint.kind == "prismatic" else 1.0 for joint in moving]
    at = {joint.name: i for i, joint in enumerate(moving)}
    follows: dict[int, tuple[int, float, float]] = {}
    for i, joint in enumerate(moving):
        if (mimic := child(joint.element, "mimic")) is None:
            continue
        master = attribute(mimic, "joint")
        if master not in at:
            raise InputError(
                f"joint {joint.name!r} mimics {master!r}, which is not on the way to the tip", line=mimic.line
            )
        what = f"the mimic of joint {joint.name!r}"
        factor, offset = (
            float(float_attribute(mimic, name, what, 1)[0]) if name in mimic.attrib else default
            for name, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        follows[i] = at[master], factor * unit[i] / unit[at[master]], offset * unit[i]
    if not follows:
        return fixed, None
    matrix, shift = np.eye(len(moving)), np.zeros(len(moving))
    for i in follows:
        factor, j, passed = 1.0, i, 0
        while j in follows:
            leader, by, offset = follows[j]
            shift[i] += factor * offset
            factor, j, passed = factor * by, leader, passed + 1
            if passed > len(follows):
                raise InputError(f"joint {moving[i].name!r} mimics itself", line=moving[i].element.line)
        matrix[i] = factor * (np.arange(len(moving)) == j)
    moved = (screw_z(0.0, s) if u != 1 else screw_z(s, 0.0) for s, u in zip(shift, unit, strict=True))
    return [fixed[0], *(move @ one for move, one in zip(moved, fixed[1:], strict=True))], matrix


def _working_pose(
    extra: ET.Element | None, known: set[str], names: list[str], prismatic: BoolArray, default: FloatArray
) -> FloatArray:
    pose = default.copy()
    for working in [] if extra is None else children(extra, "working"):
        joint = attribute(working, "joint")
        if joint not in known:
            raise InputError(f"the working pose names a joint {joint!r} that is not in the robot", line=working.line)
        if joint not in names:
            continue  # a part of the robot was chosen
        i = names.index(joint)
        pose[i] = float_attribute(working, "position", "a working pose", 1)[0] * (MM_PER_M if prismatic[i] else 1.0)
    return pose


def _mass_of(link: str, inertial: Element) -> tuple[float, FloatArray]:
    """Mass [kg] of a link and its centre in the link's frame [mm]."""
    mass = child(inertial, "mass")
    if mass is None:
        raise InputError(f"the <inertial> of link {link!r} has no <mass>", line=inertial.line)
    value = float(float_attribute(mass, "value", f"the mass of link {link!r}", 1)[0])
    if value < 0:
        raise InputError(f"the mass of link {link!r} is negative: {value:g} kg", line=mass.line)
    origin = child(inertial, "origin")
    if origin is None or "xyz" not in origin.attrib:
        return value, np.zeros(3)
    return value, MM_PER_M * float_attribute(origin, "xyz", f"the centre of mass of link {link!r}", 3)


def write_urdf(arm: Arm, path: str | Path) -> None:
    """Write an arm as a URDF with the links ``base``, ``link_1`` .. ``link_n`` and ``tip``.

    The link ``tip`` has the axes of the flange and its origin at the tip. Masses are written without moments of
    inertia, which are not known. Title, source, serial number, working pose and a direction of gravity other than
    downwards go into an element ``truearm``, which other readers ignore.

    Raises
    ------
    InputError
        If joints are coupled or one has one limit only, which URDF cannot state, a text holds a control character, or
        the file cannot be written.
    """
    content = urdf_bytes(arm)
    with atomic_file(path, read=read_urdf) as beside:
        beside.write_bytes(content)


def urdf_bytes(arm: Arm, *, tip_link: str = TIP_LINK) -> bytes:
    """The content of the file that `write_urdf` writes, with another name for its last link; errors as there."""
    if arm.chain.coupling is not None:
        raise InputError(
            f"arm {arm.name!r} has coupled joints, which truearm writes to no URDF", hint="write a .toml file"
        )
    robot = ET.Element("robot", name=arm.name)
    n = arm.n_joints
    links = [BASE_LINK, *(f"link_{i + 1}" for i in range(n)), tip_link]
    for i, link in enumerate(links):
        element = ET.SubElement(robot, "link", name=link)
        if arm.masses is not None and 1 <= i <= n:
            _add_mass(element, float(arm.masses.mass_kg[i - 1]), arm.masses.centre_in_joint_mm[i - 1])
    for i in range(n):
        joint = _joint_element(robot, arm.joint_names[i], _kind_of(arm, i), links[i : i + 2], arm.chain.fixed[i])
        ET.SubElement(joint, "axis", xyz="0 0 1")
        _add_limit(joint, arm, i)
    end = arm.chain.fixed[n].copy()
    end[:3, 3] += end[:3, :3] @ arm.chain.tip_in_flange
    _joint_element(robot, free_name(f"{tip_link}_joint", arm.joint_names), "fixed", links[n:], end)
    extra = ET.SubElement(robot, "truearm", title=arm.title, source=arm.source)
    if arm.serial_number:
        extra.set("serial_number", arm.serial_number)
    if (arm.gravity_direction != [0, 0, -1]).any():
        extra.set("gravity_in_base", spaced(arm.gravity_direction))
    for name, position in zip(arm.joint_names, arm.working / _unit_of(arm), strict=True):
        ET.SubElement(extra, "working", joint=name, position=repr(float(position)))
    ET.indent(robot)
    content: bytes = ET.tostring(robot, encoding="utf-8", xml_declaration=True)
    parse_xml(content)  # a control character in a name would make the file unreadable
    return content


def _unit_of(arm: Arm) -> FloatArray:
    """(n_joints,) mm in a metre for sliding joints, 1 for the others."""
    return np.where(arm.chain.is_prismatic, MM_PER_M, 1.0)


def _kind_of(arm: Arm, i: int) -> str:
    limited = np.isfinite(arm.limits[i])
    if limited.any() and not limited.all():
        raise InputError(
            f"joint {arm.joint_names[i]} has one limit only, which a URDF cannot state", hint="write a .toml file"
        )
    if arm.chain.is_prismatic[i]:
        return "prismatic"
    return "revolute" if limited.all() else "continuous"


def _joint_element(robot: ET.Element, name: str, kind: str, links: list[str], frame: FloatArray) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    xyz, rpy = xyz_rpy_from_frame(frame)
    ET.SubElement(joint, "origin", xyz=spaced(xyz / MM_PER_M), rpy=spaced(rpy))
    return joint


def _add_mass(link: ET.Element, mass_kg: float, centre_mm: FloatArray) -> None:
    """Add the mass; moments of inertia are compulsory, but unknown here: zero claims nothing."""
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=spaced(centre_mm / MM_PER_M), rpy="0.0 0.0 0.0")
    ET.SubElement(inertial, "mass", value=repr(mass_kg))
    ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))


def _add_limit(joint: ET.Element, arm: Arm, i: int) -> None:
    """Add the limits; effort and velocity are compulsory, but unknown here: zero claims nothing."""
    limits = arm.limits[i] / _unit_of(arm)[i]
    if np.isfinite(limits).all():
        lower, upper = map(repr, limits.tolist())
        ET.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity="0")
    elif arm.chain.is_prismatic[i]:
        ET.SubElement(joint, "limit", effort="0", velocity="0")  # only a turning joint can be called continuous


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, with underscores if it is taken."""
    while name in taken:
        name += "_"
    return name


def spaced(numbers: FloatArray) -> str:
    """Numbers of an attribute, to the last bit."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)
