"""Arm files: a Denavit-Hartenberg table in TOML with its units in the names; a URDF by its suffix.

The format::

    name = "two-link"                  # for the command line
    title = "Planar arm of two links"  # optional
    source = "drawing 12-345"          # optional: source of the numbers
    serial_number = "10017"            # optional: of this unit
    convention = "dh"                  # or "mdh": row i then holds alpha(i-1), a(i-1)
    tip_mm = [0.0, 0.0, 50.0]          # tip after the last row and the flange
    nominal_error_mm = 20.0            # optional: error of an arm that is less accurate than usual
    gravity_in_base = [0, 0, -1]       # optional: direction of gravity; -z by default

    [base]                             # optional, before the first row
    xyz_mm = [0.0, 0.0, 300.0]
    rpy_deg = [0.0, 0.0, 90.0]         # roll, pitch, yaw about fixed axes, as in URDF

    [[joints]]                         # base to tip
    name = "shoulder"                  # optional: J1, J2, ... by default
    type = "revolute"                  # or "prismatic", or "fixed": folded in, no joint of the arm
    a_mm = 400.0
    d_mm = 0.0
    alpha_deg = 0.0
    theta_deg = 0.0                    # optional, 0 by default: added to the joint's angle
    min_deg = -170.0                   # optional limits; _mm for a sliding joint
    max_deg = 170.0
    working_deg = 30.0                 # optional, a typical pose in use
    mass_kg = 4.2                      # optional: of the link that moves with the joint, for all joints or none
    centre_of_mass_mm = [-180, 0, 15]  # and its centre of mass, in the frame in which the row ends

    [flange]                           # optional, after the last row, as [base]

    [coupling]                         # optional: joints whose angles are sums of the encoders' angles
    matrix = [[1, 0], [1, 1]]          # joint angles = matrix times encoder angles [rad, or mm], moving joints only

Every ``_mm`` may be ``_m`` and every ``_deg`` may be ``_rad``, but not both at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from truearm.arm.arm import Arm, LinkMasses, PointMass, combine_point_masses
from truearm.arm.chain import Chain
from truearm.arm.denavit_hartenberg import DHTable, Kind, chain_from_dh, dh_table, mdh_table, row_end_frames
from truearm.arm.rigid_motions import frame_from_xyz_rpy, xyz_rpy_from_frame
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import parse_file
from truearm.files.toml_documents import parse_toml, reject_control_characters, toml_text
from truearm.printable_text import printable_name
from truearm.typing import FloatArray

MAX_BYTES = 1_000_000

_Line = Annotated[str, AfterValidator(reject_control_characters)]
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Triple = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_UNITS = {"mm": 1.0, "m": 1000.0, "deg": np.pi / 180, "rad": 1.0}  # to mm and rad
_LENGTHS = ("_mm", "_m")
_ANGLES = ("_deg", "_rad")
_COLUMNS = ("a", "d", "alpha", "theta", "beta", "b")


class _Strict(BaseModel):
    """A table of the file: no unknown keys, and each quantity in one unit."""

    model_config = ConfigDict(extra="forbid", defer_build=True)

    @model_validator(mode="after")
    def _one_unit_each(self) -> Self:
        given = sorted(self.model_fields_set)
        for key, following in pairwise(given):
            if key.rpartition("_")[0] and key.rpartition("_")[0] == following.rpartition("_")[0]:
                raise InputError(f"expected one of {key} and {following}, got both")
        return self

    def settled(self, quantity: str) -> FloatArray | None:
        """Return the quantity in mm or rad, whatever its unit in the file; None if it is missing."""
        for unit, factor in _UNITS.items():
            value = vars(self).get(f"{quantity}_{unit}")  # sooner than pydantic's answer that there is none
            if value is not None:
                return factor * np.asarray(value)
        return None


class _Frame(_Strict):
    xyz_mm: _Triple | None = None
    xyz_m: _Triple | None = None
    rpy_deg: _Triple | None = None
    rpy_rad: _Triple | None = None


class _Joint(_Strict):
    name: _Line | None = None
    type: Kind
    a_mm: _Number | None = None
    a_m: _Number | None = None
    d_mm: _Number | None = None
    d_m: _Number | None = None
    alpha_deg: _Number | None = None
    alpha_rad: _Number | None = None
    theta_deg: _Number | None = None
    theta_rad: _Number | None = None
    beta_deg: _Number | None = None
    beta_rad: _Number | None = None
    b_mm: _Number | None = None
    b_m: _Number | None = None
    min_deg: _Number | None = None
    min_rad: _Number | None = None
    min_mm: _Number | None = None
    min_m: _Number | None = None
    max_deg: _Number | None = None
    max_rad: _Number | None = None
    max_mm: _Number | None = None
    max_m: _Number | None = None
    working_deg: _Number | None = None
    working_rad: _Number | None = None
    working_mm: _Number | None = None
    working_m: _Number | None = None
    mass_kg: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)] | None = None
    centre_of_mass_mm: _Triple | None = None
    centre_of_mass_m: _Triple | None = None

    @model_validator(mode="after")
    def _whole_row(self) -> Self:
        for quantity in ("a", "d", "alpha"):
            if self.settled(quantity) is None:
                raise InputError(f"the key {' or '.join(_Joint.keys_of(quantity))} is missing")
        return self

    @model_validator(mode="after")
    def _fits_the_type(self) -> Self:
        units = {"revolute": _ANGLES, "prismatic": _LENGTHS, "fixed": ()}[self.type]
        for quantity in ("min", "max", "working"):
            for key in self.model_fields_set.intersection(_Joint.keys_of(quantity)):
                if not units:
                    raise InputError(f"a fixed joint has no {key}")
                if not key.endswith(units):
                    raise InputError(
                        f"a {self.type} joint needs {' or '.join(quantity + unit for unit in units)}, got {key}"
                    )
        return self

    @model_validator(mode="after")
    def _whole_mass(self) -> Self:
        centred = self.settled("centre_of_mass") is not None
        if centred and self.mass_kg is None:
            raise InputError("a centre of mass without the key mass_kg")
        if self.mass_kg and not centred:
            raise InputError("mass_kg needs the key centre_of_mass_mm or centre_of_mass_m")
        return self

    @classmethod
    def keys_of(cls, quantity: str) -> list[str]:
        """List the keys that may hold the quantity."""
        return [key for key in cls.model_fields if key.rpartition("_")[0] == quantity]


class _Coupling(_Strict):
    matrix: Annotated[list[list[_Number]], Field(min_length=1, max_length=100)]


class _ArmFile(_Strict):
    name: Annotated[str, Field(min_length=1)]
    title: str = ""
    source: str = ""
    serial_number: _Line = ""
    convention: Convention
    tip_mm: _Triple | None = None
    tip_m: _Triple | None = None
    base: _Frame | None = None
    flange: _Frame | None = None
    gravity_in_base: _Triple | None = None
    nominal_error_mm: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    joints: Annotated[list[_Joint], Field(min_length=1, max_length=100)]
    coupling: _Coupling | None = None


def read_arm(path: str | Path) -> Arm:
    """Read an arm file (TOML), a URDF, an MJCF or a maker's kinematics yaml, which the suffix decides.

    Raises
    ------
    InputError
        If the file is missing, of another kind, or breaks a rule of its format; with the key.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        return parse_file(path, lambda content: _arm_of(parse_toml(content, _ArmFile)), limit_bytes=MAX_BYTES)
    from truearm.arm import kinematics_yaml, mjcf, urdf  # no arm of the catalogue waits for XML and YAML

    readers: dict[str, Callable[[Path], Arm]] = {
        **dict.fromkeys((".urdf", ".xacro"), urdf.read_urdf),
        ".xml": mjcf.read_mjcf,
        **dict.fromkeys((".yaml", ".yml"), kinematics_yaml.read_kinematics_yaml),
    }
    if path.suffix.lower() not in readers:
        raise InputError(f"an arm file ends in .toml, .urdf, .xml or .yaml, got {path.suffix!r}", file=path)
    return readers[path.suffix.lower()](path)


def write_arm(
    arm: Arm, path: str | Path, *, convention: Convention = "dh", notes: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write an arm as TOML, or as URDF if `path` ends in ``.urdf``.

    Parameters
    ----------
    arm : Arm
    path : path
    convention : {"dh", "mdh"}
        Of the TOML file's table.
    notes : dict of str to str
        Comments of the TOML file, one line each, by the names of joints, ``"tip"`` and ``"base"``.

    Raises
    ------
    InputError
        If two axes are too nearly parallel for a table (a URDF takes any arm), or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() == ".urdf":
        from truearm.arm.urdf import write_urdf

        write_urdf(arm, path)
        return
    if path.suffix.lower() != ".toml":
        raise InputError(f"a file that an arm is written to ends in .toml or .urdf, got {path.suffix!r}", file=path)
    table = arm.table
    if table is None or table.convention != convention or not _is_hayatis(table, arm.chain):
        table = dh_table(arm.chain) if convention == "dh" else mdh_table(arm.chain)
    with atomic_file(path, read=read_arm) as beside:
        beside.write_text("\n".join(_toml_lines(arm, table, notes)) + "\n", encoding="utf-8")


def _is_hayatis(table: DHTable, chain: Chain) -> bool:
    """Whether a table has Hayati's constants between nearly parallel axes, and is that of the chain."""
    return bool(table.beta.any() or table.b.any()) and np.allclose(table.chain().fixed, chain.fixed, rtol=0, atol=1e-9)


def _arm_of(file: _ArmFile) -> Arm:
    moving = [joint for joint in file.joints if joint.type != "fixed"]
    lower, upper, working = np.array([_states_of(joint) for joint in moving]).reshape(-1, 3).T
    table = {q: np.array([_number(joint, q) for joint in file.joints]) for q in _COLUMNS}
    rows: dict[str, Any] = table | {"kinds": [joint.type for joint in file.joints]}
    chain = chain_from_dh(
        **rows,
        base=_frame_of(file.base),
        flange=_frame_of(file.flange),
        tip_in_flange=_triple(file, "tip"),
        convention=file.convention,
    )
    return Arm(
        name=file.name,
        chain=chain if file.coupling is None else replace(chain, coupling=_matrix_of(file.coupling)),
        title=file.title,
        joint_names=tuple(joint.name or f"J{number}" for number, joint in enumerate(moving, 1)),
        lower=lower,
        upper=upper,
        working_pose=working,
        source=file.source,
        serial_number=file.serial_number,
        nominal_error_mm=file.nominal_error_mm,
        masses=_masses_of(file, row_end_frames(file.convention, **rows)),
        gravity_in_base=None if file.gravity_in_base is None else np.asarray(file.gravity_in_base),
        table=_stated_table(file, table),
    )


def _matrix_of(coupling: _Coupling) -> FloatArray:
    if len({len(coupling.matrix), *map(len, coupling.matrix)}) > 1:
        raise InputError("expected the matrix of the coupling with as many columns as rows, one a moving joint")
    return np.array(coupling.matrix)


def _stated_table(file: _ArmFile, table: Mapping[str, FloatArray]) -> DHTable | None:
    """The table as it stands in the file; None if it has rows that are no joints."""
    if any(joint.type == "fixed" for joint in file.joints):
        return None
    base, flange = (np.eye(4) if one is None else one for one in (_frame_of(file.base), _frame_of(file.flange)))
    prismatic, tip = np.array([joint.type == "prismatic" for joint in file.joints]), _triple(file, "tip")
    return DHTable(file.convention, **table, prismatic=prismatic, base=base, flange=flange, tip_in_flange=tip)


def _masses_of(file: _ArmFile, ends: Sequence[tuple[int, FloatArray]]) -> LinkMasses | None:
    """Masses of the links, those of fixed rows with the link that carries them; what does not move has no effect.

    `ends` are those of `row_end_frames`.
    """
    lumps = []
    for joint, (number, end) in zip(file.joints, ends, strict=True):
        if joint.mass_kg is not None and number > 0:
            lumps.append(PointMass(number, joint.mass_kg, end[:3, :3] @ _triple(joint, "centre_of_mass") + end[:3, 3]))
    given = {lump.joint for lump in lumps}
    if not given:
        return None
    n_joints = ends[-1][0]
    if missing := [number for number in range(1, n_joints + 1) if number not in given]:
        raise InputError(
            f"the mass of the link after moving joint {missing[0]} is missing: expected masses of all {n_joints} "
            f"links or none, got {len(given)}",
            hint="write mass_kg = 0 for a link of negligible mass",
        )
    return combine_point_masses(lumps, n_joints)


def _states_of(joint: _Joint) -> tuple[float, float, float]:
    """Lower limit, upper limit and working value of a joint [rad, or mm]."""
    lower = _number(joint, "min", missing=-np.inf)
    upper = _number(joint, "max", missing=np.inf)
    return lower, upper, _number(joint, "working", missing=min(max(0.0, lower), upper))


def _frame_of(frame: _Frame | None) -> FloatArray | None:
    return None if frame is None else frame_from_xyz_rpy(_triple(frame, "xyz"), _triple(frame, "rpy"))


def _number(table: _Strict, quantity: str, *, missing: float = 0.0) -> float:
    value = table.settled(quantity)
    return missing if value is None else float(value)


def _triple(table: _Strict, quantity: str) -> FloatArray:
    value = table.settled(quantity)
    return np.zeros(3) if value is None else value


def _toml_lines(arm: Arm, table: DHTable, notes: Mapping[str, str]) -> Iterator[str]:
    yield "# An arm: see docs/arm-file.md. The names state the units; title and source appear in reports."
    yield f"name = {toml_text(arm.name)}"
    yield f"title = {toml_text(arm.title)}"
    yield f"source = {toml_text(arm.source)}"
    if arm.serial_number:
        yield f"serial_number = {toml_text(arm.serial_number)}"
    if arm.nominal_error_mm:
        yield f"nominal_error_mm = {_plain(arm.nominal_error_mm)}"
    yield f'convention = "{table.convention}"'
    yield from (f"# {printable_name(notes[part])}" for part in ("base", "tip") if part in notes)
    yield f"tip_mm = {_listed(table.tip_in_flange)}  # the tip after the last joint's row"
    if (arm.gravity_direction != [0, 0, -1]).any():
        yield f"gravity_in_base = {_listed(arm.gravity_direction)}  # direction of gravity"
    yield from _frame_lines("base", table.base)
    centres = np.zeros((0, 3)) if arm.masses is None else _centres_at_row_ends(arm.chain, arm.masses, table)
    for i, name in enumerate(arm.joint_names):
        slides = bool(table.prismatic[i])
        yield from ("", "[[joints]]", *([f"# {printable_name(notes[name])}"] if name in notes else []))
        yield from (f"name = {toml_text(name)}", f'type = "{"prismatic" if slides else "revolute"}"')
        yield from (f"a_mm = {_plain(table.a[i])}", f"d_mm = {_plain(table.d[i])}")
        yield from (f"alpha_deg = {_plain_deg(table.alpha[i])}", f"theta_deg = {_plain_deg(table.theta[i])}")
        if table.beta[i] or table.b[i]:
            yield f"beta_deg = {_plain_deg(table.beta[i])}  # about y after alpha: the axes are nearly parallel"
            yield f"b_mm = {_plain(table.b[i])}"
        plain, unit = (_plain, "mm") if slides else (_plain_deg, "deg")
        lower, upper = arm.limits[i]
        if np.isfinite(lower):
            yield f"min_{unit} = {plain(lower)}"
        if np.isfinite(upper):
            yield f"max_{unit} = {plain(upper)}"
        if np.isinf(lower) and np.isinf(upper):
            yield f"# min_{unit} = -170.0, max_{unit} = 170.0: limits, one a line; none for an unlimited joint"
        yield f"working_{unit} = {plain(arm.working[i])}"
        if arm.masses is not None:
            yield f"mass_kg = {_plain(arm.masses.mass_kg[i])}"
            yield f"centre_of_mass_mm = {_listed(centres[i])}  # in the frame at the end of this row"
    yield from _frame_lines("flange", table.flange)
    if arm.chain.coupling is not None:
        yield from ("", "[coupling]  # joint angles by those of the encoders")
        yield f"matrix = [{', '.join(map(_listed, arm.chain.coupling))}]"


def _centres_at_row_ends(chain: Chain, masses: LinkMasses, table: DHTable) -> FloatArray:
    """(n_joints, 3) centres of mass in the frames at the ends of a table's rows [mm].

    The table's places lie on the same axes as the chain's, but turned about and shifted along them.
    """
    kinds: list[Kind] = ["prismatic" if slides else "revolute" for slides in table.prismatic]
    columns = {name: getattr(table, name) for name in _COLUMNS}
    ends = row_end_frames(table.convention, **columns, kinds=kinds)
    places = [np.stack(list(accumulate(c.fixed[:-1], np.matmul))) for c in (chain, table.chain())]
    at_ends = np.linalg.inv(places[0]) @ places[1] @ np.stack([end for _, end in ends])
    off = masses.centre_in_joint_mm - at_ends[:, :3, 3]
    return np.asarray(np.einsum("nab,na->nb", at_ends[:, :3, :3], off))


def _frame_lines(key: str, frame: FloatArray) -> Iterator[str]:
    if (frame == np.eye(4)).all():
        return
    xyz, rpy = xyz_rpy_from_frame(frame)
    yield from ("", f"[{key}]", f"xyz_mm = {_listed(xyz)}", f"rpy_deg = [{', '.join(map(_plain_deg, rpy))}]")


def _plain(number: float) -> str:
    return repr(float(number) + 0.0)  # + 0.0: no "-0"


def _plain_deg(angle: float) -> str:
    return _plain(round(float(np.rad2deg(angle)), 12))  # a hundredth of a nanometre at a reach of metres


def _listed(numbers: FloatArray) -> str:
    return f"[{', '.join(_plain(number) for number in numbers)}]"
