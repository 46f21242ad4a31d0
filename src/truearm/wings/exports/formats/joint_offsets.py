"""Joint offsets for ROS as YAML: what to add to the angle of each encoder, and the frames in which joints then turn.

One direction: ``feedback``. The offset of a joint is added to the position that its encoder reports; to send a
position, subtract it. The offsets alone are the part of a calibration that a driver can apply. With the origins,
written as a URDF's ``<origin>``, they are the best rigid arm: ``origin_1 Rz(q_1 + offset_1) origin_2 ... tip``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np

from truearm.arm import Chain, DHTable
from truearm.arm.rigid_motions import frame_from_xyz_rpy, screw_z, xyz_rpy_from_frame
from truearm.arm.urdf_tree import MM_PER_M
from truearm.errors import InputError
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.formats.constants_table import ConstantsFile, ConstantsRequest, reader, writer
from truearm.wings.exports.targets.manifest import Manifest

DIRECTION: Final = "feedback"
_BREAKS = "\u0085\u2028\u2029"
# Names that YAML 1.1 takes for a truth value or for nothing.
_NOT_PLAIN = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}
_ORIGIN = ("x", "y", "z", "roll", "pitch", "yaw")


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    rigid, table = request.table()
    offsets, origins = _parts(table.nominal, table.identified)
    text = partial(_text, table.joint_names, offsets, origins, table.identified.prismatic)
    return ConstantsFile(rigid, _chain(offsets, origins, table.identified.prismatic), text)


def _text(
    names: Sequence[str], offsets: FloatArray, origins: Sequence[FloatArray], slides: BoolArray, manifest: Manifest
) -> str:
    lines = [
        f"# {manifest.line()}",
        "# feedback: true position = encoder position + offset; position to send = true position - offset.",
        "# The offsets alone are a part of the calibration. With the origins below, each in the frame of the joint",
        "# before, they are the best rigid arm. A URDF exported by truearm has both: do not add these offsets to it.",
        "joint_offsets:",
        f"  direction: {DIRECTION}",
        "  joints:",
    ]
    for name, offset, sliding in zip(names, offsets, slides, strict=True):
        unit, factor = ("m", MM_PER_M) if sliding else ("rad", 1.0)
        lines += [f"    {_yaml_text(name)}:", f"      offset: {yaml_number(offset / factor)}", f"      unit: {unit}"]
    lines.append("origins:")
    for name, origin in zip(_ends(names), origins, strict=True):
        lines += [f"  {_yaml_text(name)}:", *pose_lines(origin)]
    return "\n".join([*lines, ""])


def _chain_of(content: bytes, manifest: Manifest) -> Chain:
    names = manifest.provenance.joint_names
    entries = parse_yaml(content).mapping("joint offsets", required=("joint_offsets", "origins"))
    offsets, slides = _offsets_of(entries["joint_offsets"], names)
    ends = _ends(names)
    found = entries["origins"].mapping("origins", required=ends)
    return _chain(offsets, [_origin_of(end, found[end]) for end in ends], slides)


def _ends(names: Sequence[str]) -> tuple[str, ...]:
    """Keys of the origins: the joints, then the tip by a name that no joint has."""
    tip = "tip"
    while tip in names:
        tip += "_"
    return (*names, tip)


def _parts(nominal: DHTable, identified: DHTable) -> tuple[FloatArray, list[FloatArray]]:
    """Offsets (n_joints,) [rad, or mm] and n_joints + 1 origins [mm] of a table: each joint's, then the tip's."""
    slides = identified.prismatic
    offsets = np.where(slides, identified.d - nominal.d, identified.theta - nominal.theta)
    chain = identified.chain()
    modified = identified.convention == "mdh"
    origins = [frame.copy() for frame in chain.fixed]
    origins[-1][:3, 3] += origins[-1][:3, :3] @ chain.tip_in_flange
    for i, (offset, sliding) in enumerate(zip(offsets, slides, strict=True)):
        taken = screw_z(0.0, -offset) if sliding else screw_z(-offset, 0.0)
        # The table has a joint's own constants after it, a modified one before; along the axis they commute with it.
        if modified:
            origins[i] = origins[i] @ taken
        else:
            origins[i + 1] = taken @ origins[i + 1]
    return offsets, origins


def _chain(offsets: FloatArray, origins: Sequence[FloatArray], slides: BoolArray) -> Chain:
    fixed = np.array(origins)
    for i, (offset, sliding) in enumerate(zip(offsets, slides, strict=True)):
        fixed[i + 1] = (screw_z(0.0, offset) if sliding else screw_z(offset, 0.0)) @ fixed[i + 1]
    return Chain(fixed, np.zeros(3), slides)


def _offsets_of(node: YamlNode, names: Sequence[str]) -> tuple[FloatArray, BoolArray]:
    """Offsets [rad, or mm] of the joints and which of them slide."""
    entries = node.mapping("joint_offsets", required=("direction", "joints"))
    if entries["direction"].text != DIRECTION:
        raise InputError(
            f"expected the direction {DIRECTION}, got {str(entries['direction'].text)[:60]!r}",
            line=entries["direction"].line,
        )
    joints = entries["joints"].mapping("joints", required=names)
    offsets, slides = [], []
    for name in names:
        one = joints[name].mapping(f"the joint {name}", required=("offset", "unit"))
        if one["unit"].text not in ("rad", "m"):
            raise InputError(f"expected rad or m, got {str(one['unit'].text)[:60]!r}", line=one["unit"].line)
        slides.append(one["unit"].text == "m")
        offsets.append(one["offset"].number(f"the offset of {name}") * (MM_PER_M if slides[-1] else 1.0))
    return np.array(offsets), np.array(slides)


def _origin_of(name: str, node: YamlNode) -> FloatArray:
    entries = node.mapping(f"the origin of {name}", required=_ORIGIN)
    numbers = np.array([entries[key].number(f"{key} of {name}") for key in _ORIGIN])
    return frame_from_xyz_rpy(MM_PER_M * numbers[:3], numbers[3:])


def yaml_number(value: float) -> str:
    """A number that every YAML reader takes for one, to the last bit: with a point before an exponent."""
    text = repr(float(value) + 0.0)  # + 0.0: no "-0"
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def yaml_pose(frame: FloatArray) -> list[str]:
    """Position [m] and roll, pitch, yaw [rad] of a frame [mm]."""
    xyz, rpy = xyz_rpy_from_frame(frame)
    return [yaml_number(value) for value in (*(xyz / MM_PER_M), *rpy)]


def pose_lines(frame: FloatArray) -> list[str]:
    """The lines of a mapping of `yaml_pose`."""
    return [f"    {key}: {text}" for key, text in zip(_ORIGIN, yaml_pose(frame), strict=True)]


def _yaml_text(text: str) -> str:
    """A text that every YAML reader takes for one: in double quotes, unless it is a plain name."""
    plain = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", text) and text.lower() not in _NOT_PLAIN
    return text if plain else f'"{"".join(map(_quoted, text))}"'


def _quoted(character: str) -> str:
    """A character in double quotes: YAML has no pairs of surrogates, and more line breaks."""
    if character in {'"', "\\"}:
        return f"\\{character}"
    if character.isprintable() and character not in _BREAKS:
        return character
    return f"\\U{ord(character):08x}"


write = writer("joint-offsets", _file_of, DIRECTION)
tips = reader(_chain_of)
