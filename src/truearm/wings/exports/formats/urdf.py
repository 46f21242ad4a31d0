"""URDF of the best rigid stand-in: the robot's own file with new origins of its joints, or one made from the arm.

Only the origins of the moving joints between base and tip change. Links, fixed joints, meshes, inertias, limits, side
branches and the elements of other programs stay as they are, byte for byte. Every link keeps its place on its joint,
the last one the nominal flange. A link at the identified tip is added to it.

The XML is edited in place, as parsers forget how a file was laid out. Here elements know their bytes
(`truearm.files.foreign_documents.Element`), and edits replace ranges of them.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from truearm.arm import Arm, read_arm
from truearm.arm.catalogue import split_links
from truearm.arm.rigid_motions import motion, xyz_rpy_from_frame
from truearm.arm.urdf import MAX_BYTES, UrdfChain, free_name, spaced, urdf_bytes, urdf_chain
from truearm.arm.urdf_tree import MM_PER_M, UrdfJoint
from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.files.foreign_documents import child
from truearm.typing import FloatArray
from truearm.wings.exports.formats.constants_table import ConstantsFile, ConstantsRequest, writer
from truearm.wings.exports.formats.rigid_arm import RigidArm
from truearm.wings.exports.targets.edits import Edit, with_edits
from truearm.wings.exports.targets.manifest import MARKER, Frame, Manifest, read_manifest

# Spaces before a comment that are removed with it.
MAX_INDENT = 200
# A start tag: attribute values may hold ">".
_START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
_ATTRIBUTE = re.compile(rb"""(?P<name>[^\s="'<>/]+)\s*=\s*("[^"]*"|'[^']*')""")


def start_tag(content: bytes, start: int) -> bytes:
    """The start tag at a byte of well-formed XML, with its brackets."""
    found = _START_TAG.match(content, start)
    assert found is not None  # the parser found a tag here
    return found.group()


def set_attributes(content: bytes, start: int, attributes: Mapping[str, str]) -> Edit:
    """Set attributes of the element whose start tag begins at a byte; others keep their place and their form."""
    tag = start_tag(content, start)
    new = {name.encode(): assignment(name, value).encode() for name, value in attributes.items()}

    def replaced(found: re.Match[bytes]) -> bytes:
        return new.pop(found["name"], found.group())

    edited = _ATTRIBUTE.sub(replaced, tag)
    bracket = b"/>" if edited.endswith(b"/>") else b">"
    kept = edited.removesuffix(bracket).rstrip()
    added = b"".join(b" " + one for one in new.values())  # those that it did not have
    return Edit(start, start + len(tag), kept + added + edited[len(kept) :])


def assignment(name: str, value: str) -> str:
    """An attribute with its value, in characters that every encoding has."""
    return f'{name}="{html.escape(value)}"'.encode("ascii", "xmlcharrefreplace").decode()


def tag_text(tag: str, attributes: Mapping[str, str]) -> str:
    """An element without content."""
    return f"<{' '.join([tag, *(assignment(*both) for both in attributes.items())])}/>"


def comment_edits(content: bytes, is_meant: Callable[[str], bool]) -> list[Edit]:
    """Remove the comments of well-formed XML whose text is meant, with the line's start before them.

    A parser finds them: what looks like a comment in CDATA or in an attribute is none.
    """
    parser, edits = expat.ParserCreate(), []

    def found(text: str) -> None:
        if is_meant(text):
            start = parser.CurrentByteIndex
            stop = content.index(b"-->", start) + len(b"-->")
            indented = len(content[max(0, start - MAX_INDENT) : start].rstrip(b" \t")) + max(0, start - MAX_INDENT)
            for end in (b"\r\n", b"\n"):
                if content.endswith(end, 0, indented):
                    start = indented - len(end)
                    break
            edits.append(Edit(start, stop, b""))

    parser.CommentHandler = found
    parser.Parse(content, True)
    return edits


FLANGE_LINK, TIP_LINK, REFERENCE_LINK = "flange", "tip", "reference"
# An origin that changes by less stays as it is printed: rounding of the kinematics, in rad and mm.
ROUNDING = 1e-12, 1e-9


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    """Of a source everything but the origins of its moving joints is kept; base and tip link may stand after its name.

    Without one a URDF is made from the arm's constants, with the links ``base``, ``link_1`` .. ``link_n`` and
    ``flange``. In the reference frame a link ``reference`` stands before the base.
    """
    if request.source is None:
        rigid = request.rigid_arm()
        content, base, tip = _made(rigid.nominal), None, None
    else:
        file, base, tip = split_links(request.source)
        content = read_limited(file, limit_bytes=MAX_BYTES)
        with InputError.of_file(file):
            rigid = request.rigid_arm(_robot(content, base, tip).arm())

    def edited(manifest: Manifest) -> bytes:
        kept = without_manifest(content)
        named = manifest.of_joints(rigid.arm.joint_names)
        return _edited(kept, _robot(kept, base, tip), rigid, request.frame, named)

    arm = rigid.arm if request.frame == "base" else rigid.in_reference_frame()
    return ConstantsFile(rigid, arm.chain, edited)


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """(n, 3) tips [mm] of an exported file, in its base frame, at joints (n, n_joints) [rad, or mm]."""
    arm, names = read_arm(path), read_manifest(path).provenance.joint_names
    if arm.joint_names != names:
        raise InputError(f"expected the joints {', '.join(names)}, got {', '.join(arm.joint_names)}", file=path)
    return arm.chain.tip_in_base(joints)


def without_manifest(content: bytes) -> bytes:
    """The file without the comments in which earlier exports state what they are."""
    return with_edits(content, comment_edits(content, lambda text: text.lstrip().startswith(f"{MARKER}: {{")))


def _made(arm: Arm) -> bytes:
    """A URDF of the nominal arm whose last link is the flange."""
    return urdf_bytes(replace(arm, chain=arm.chain.with_tip(np.zeros(3))), tip_link=FLANGE_LINK)


def _robot(content: bytes, base: str | None, tip: str | None) -> UrdfChain:
    robot = urdf_chain(content, base, tip)
    if not robot.joints:
        raise InputError("there is no joint between the base and the tip")
    root = robot.tree.robot
    # Edits expect one byte a character.
    if not content.startswith(f"<{root.tag}".encode(), root.start):
        raise InputError("expected a URDF in UTF-8 or another encoding that has ASCII", hint="save it as UTF-8")
    return robot


def _edited(content: bytes, robot: UrdfChain, rigid: RigidArm, frame: Frame, manifest: Manifest) -> bytes:
    """The file with the origins of the rigid arm, its tip and the manifest."""
    root = robot.tree.robot
    after_start = root.start + len(start_tag(content, root.start))
    edits = [Edit(after_start, after_start, f"\n  <!-- {manifest.line()} -->".encode())]
    for joint, T_parent_joint in new_origins(robot.joints, rigid):
        edits.append(_origin_edit(content, joint, T_parent_joint))
    added, about = _added_links(robot, rigid, frame)
    extra = child(root, "truearm")
    if extra is None:
        added.append(tag_text("truearm", about))
    else:
        edits.append(set_attributes(content, extra.start, about))
    edits.append(Edit(root.end, root.end, "".join(f"  {line}\n" for line in added).encode()))
    return with_edits(content, edits)


def _added_links(robot: UrdfChain, rigid: RigidArm, frame: Frame) -> tuple[list[str], dict[str, str]]:
    """Lines of the links that are added, and the attributes of the element ``truearm``."""
    links, joints = robot.tree.links, [joint.name for joint in robot.tree.joints]
    lines: list[str] = []
    base, tip, gravity = robot.joints[0].parent, robot.joints[-1].child, rigid.arm.gravity_direction
    first, last = base, tip
    if rigid.arm.chain.tip_in_flange.any():
        tip = free_name(TIP_LINK, links)
        T_flange_tip = motion(np.eye(3), rigid.arm.chain.tip_in_flange)
        joint = free_name(f"{TIP_LINK}_joint", joints)
        lines += [tag_text("link", {"name": tip}), *_fixed_joint(joint, last, tip, T_flange_tip)]
    if frame == "reference":
        if first in robot.tree.joint_above:
            raise InputError(
                f"the link {first!r} has a parent already, so that the reference frame cannot be its parent",
                hint="export in the base frame, or name the robot's root link as base",
            )
        base, gravity = free_name(REFERENCE_LINK, links), rigid.in_reference_frame().gravity_direction
        joint = free_name(f"{REFERENCE_LINK}_joint", joints)
        lines += [tag_text("link", {"name": base}), *_fixed_joint(joint, base, first, rigid.T_reference_base)]
    about = {"base": base, "tip": tip, "title": rigid.arm.title}
    if rigid.arm.serial_number:
        about["serial_number"] = rigid.arm.serial_number
    if (gravity != [0, 0, -1]).any():
        about["gravity_in_base"] = spaced(gravity)
    return lines, about


def new_origins(joints: list[UrdfJoint], rigid: RigidArm) -> Iterator[tuple[UrdfJoint, FloatArray]]:
    """The moving joints whose origin changes, with its new value as a frame in the parent link [mm].

    The chain's constant motion between two moving joints is the product of the origins of the fixed joints between
    them, which stay, and of the second one's origin, between the rotations that bring z to the joints' axes.
    """
    new, nominal = rigid.arm.chain.fixed, rigid.nominal.chain.fixed
    from_axis, between, i = np.eye(4), np.eye(4), 0
    for joint in joints:
        if not joint.is_moving:
            between = between @ joint.origin
            continue
        turn = joint.axis_rotation
        if not is_same_frame(new[i], nominal[i]):
            yield joint, np.linalg.inv(between) @ from_axis @ new[i] @ turn.T
        from_axis, between, i = turn, np.eye(4), i + 1


def is_same_frame(one: FloatArray, other: FloatArray) -> bool:
    """Whether two frames [mm] differ by the rounding of the kinematics only."""
    angle, length = ROUNDING
    off = np.abs(one - other)
    return bool(off[:3, :3].max() <= angle and off[:3, 3].max() <= length)


def _origin_edit(content: bytes, joint: UrdfJoint, T_parent_joint: FloatArray) -> Edit:
    """Set the origin of a joint, or insert one."""
    origin = child(joint.element, "origin")
    if origin is not None:
        return set_attributes(content, origin.start, _origin(T_parent_joint))
    after = joint.element.start + len(start_tag(content, joint.element.start))
    return Edit(after, after, f"\n    {tag_text('origin', _origin(T_parent_joint))}".encode())


def _origin(frame: FloatArray) -> dict[str, str]:
    xyz, rpy = xyz_rpy_from_frame(frame)
    return {"xyz": spaced(xyz / MM_PER_M), "rpy": spaced(rpy)}


def _fixed_joint(name: str, parent: str, child: str, T_parent_child: FloatArray) -> list[str]:
    """Lines of a fixed joint between two links."""
    start = tag_text("joint", {"name": name, "type": "fixed"}).replace("/>", ">")
    parts = {"parent": {"link": parent}, "child": {"link": child}, "origin": _origin(T_parent_child)}
    return [start, *(f"  {tag_text(tag, attributes)}" for tag, attributes in parts.items()), "</joint>"]


write = writer("urdf", _file_of)
