"""Tools and work frames of a program that are not in it: a TOML file that a person writes from the controller."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from truearm.arm.rigid_motions import motion, screw_z
from truearm.errors import InputError
from truearm.files.toml_documents import Document, Name, NotNegative, Real
from truearm.typing import FloatArray
from truearm.wings.exports.programs.numbers import NOT_THERE, Number, rotation_of, rotation_of_quaternion

Three = tuple[Real, Real, Real]
_QUATERNION_ROUNDED = 1e-3
# Digits of a pendant: elements of a rotation, and lengths [mm].
_SAME_FRAME = np.array([[1e-3, 1e-3, 1e-3, 0.02]])


class Frame(Document):
    """A position and at most one orientation, as the pendant shows it.

    Attributes
    ----------
    xyz_mm : tuple of 3 floats
    quaternion : tuple of 4 floats, optional
        q1 .. q4 of RAPID, scalar first.
    abc_deg : tuple of 3 floats, optional
        A, B, C of KUKA: Rz(A) Ry(B) Rx(C).
    wpr_deg : tuple of 3 floats, optional
        W, P, R of Fanuc, Rx, Ry, Rz of Yaskawa: Rz(R) Ry(P) Rx(W).
    rotation_vector_rad : tuple of 3 floats, optional
        rx, ry, rz of Universal Robots.
    """

    xyz_mm: Three
    quaternion: tuple[Real, Real, Real, Real] | None = None
    abc_deg: Three | None = None
    wpr_deg: Three | None = None
    rotation_vector_rad: Three | None = None

    @model_validator(mode="after")
    def _one_orientation(self) -> Self:
        stated = [self.quaternion, self.abc_deg, self.wpr_deg, self.rotation_vector_rad]
        if sum(one is not None for one in stated) > 1:
            raise InputError("a frame states its orientation once", hint="keep one of the keys")
        if self.quaternion is not None and abs(np.linalg.norm(self.quaternion) - 1) > _QUATERNION_ROUNDED:
            raise InputError(f"expected a quaternion of length 1, got {np.linalg.norm(self.quaternion):.6g}")
        return self

    @cached_property
    def T(self) -> FloatArray:
        """(4, 4) rigid motion, translation in mm."""
        R = np.eye(3)
        if self.quaternion is not None:
            R = rotation_of_quaternion(self.quaternion)
        elif self.rotation_vector_rad is not None:
            R = Rotation.from_rotvec(self.rotation_vector_rad).as_matrix()
        elif wpr := self.wpr_deg or (self.abc_deg or ())[::-1]:
            R = rotation_of(wpr)
        return motion(R, self.xyz_mm)


class Positioner(Frame):
    """The axis of a unit that carries a work frame: z of this frame in the world, with the unit at zero.

    Attributes
    ----------
    axis : int
        Number of the external axis, from 1.
    slides : bool
        Whether it slides along z [mm], or turns about it [deg].
    """

    axis: Annotated[int, Field(ge=1, le=6)]
    slides: bool = False

    def at(self, value: float) -> FloatArray:
        """(4, 4) what the unit carries, in the world."""
        return np.asarray(self.T @ (screw_z(0.0, value) if self.slides else screw_z(np.radians(value), 0.0)))


Frames = Annotated[dict[Name, Frame], Field(max_length=1000)]


class FramesFile(Document):
    """The file of ``--frames``.

    Attributes
    ----------
    tools : dict of str to Frame
        Tool in the flange, by the name or number that the program has.
    works : dict of str to Frame
        Work object, base or user frame, in the world frame of the controller.
    base : Frame
        The arm's base in the world frame; the same by default.
    rail : int
        External axis that is the rail under the robot, from 1, if the model has one.
    not_carrying : tuple of int
        External axes that do not carry the robot, from 1.
    positioners : dict of str to Positioner
        Units that carry work frames, by the names (RAPID) or numbers (KRL) that the program has.
    tool, work : str, optional
        Those of targets that name none.
    controller : str, optional
        Kinematics of a Universal Robots controller: its kinematics yaml or a .urp of it, beside the program, or
        ``"nominal"``.
    pulses_per_deg : tuple of float, optional
        Of a Yaskawa controller, with their signs, S to T.
    payload_kg, temperature_degC : float, optional
        Inputs of the model at all targets, as in a session file.
    """

    tools: Frames = Field(default_factory=dict)
    works: Frames = Field(default_factory=dict)
    base: Frame = Frame(xyz_mm=(0.0, 0.0, 0.0))
    rail: Annotated[int, Field(ge=1, le=6)] = 1
    not_carrying: Annotated[tuple[Annotated[int, Field(ge=1, le=6)], ...], Field(max_length=6)] = ()
    positioners: Annotated[dict[Name, Positioner], Field(max_length=100)] = Field(default_factory=dict)
    tool: Name | None = None
    work: Name | None = None
    controller: Name | None = None
    pulses_per_deg: Annotated[tuple[Real, ...], Field(min_length=6, max_length=6)] | None = None
    payload_kg: NotNegative | None = None
    temperature_degC: Real | None = None

    def tool_of(self, name: str | None) -> FloatArray | None:
        """(4, 4) tool in the flange, or None where it is not stated; the case of names does not count."""
        return self.frames["tool", (name or self.tool or "").casefold()]

    def work_of(self, name: str | None) -> FloatArray | None:
        """(4, 4) work frame in the arm's base, or None where it is not stated."""
        return self.frames["work", (name or self.work or "").casefold()]

    @cached_property
    def frames(self) -> defaultdict[tuple[str, str], FloatArray | None]:
        """Tools and work frames, these in the arm's base, by their kinds and names."""
        found: defaultdict[tuple[str, str], FloatArray | None] = defaultdict(lambda: None)
        found |= {("tool", name.casefold()): frame.T for name, frame in self.tools.items()}
        found |= {("work", name.casefold()): self.in_base(frame.T) for name, frame in self.works.items()}
        return found

    def check_tool(self, name: str, T: FloatArray) -> None:
        """Check that a tool which a program states is not stated otherwise here.

        Raises
        ------
        InputError
            If it is.
        """
        self._check("tool", name, T)

    def check_work(self, name: str, T: FloatArray) -> None:
        """Check that a work frame in the arm's base, which a program states, is not stated otherwise here.

        Raises
        ------
        InputError
            If it is.
        """
        self._check("work", name, T)

    def _check(self, kind: str, name: str, T: FloatArray) -> None:
        stated = self.frames.get((kind, name.casefold()))
        if stated is not None and (np.abs(stated - T) > _SAME_FRAME).any():
            raise InputError(
                f"the program has the {kind} frame {name} otherwise than the file of --frames",
                hint="correct one of the two",
            )

    def carried(self, unit: str, external: Sequence[Number], T: FloatArray) -> FloatArray | str:
        """A frame that a unit carries, in the arm's base at a target; or what is to be stated."""
        name = next((one for one in self.positioners if one.casefold() == unit.casefold()), None)
        if name is None:
            return f"state [positioners.{unit}] in --frames"
        positioner = self.positioners[name]
        value = external[positioner.axis - 1].value if len(external) >= positioner.axis else np.inf
        if abs(value) > NOT_THERE:
            return f"external axis {positioner.axis} is not stated"
        return self.in_base(positioner.at(value) @ T)

    def in_base(self, T_world: FloatArray) -> FloatArray:
        """A frame of the world in the arm's base."""
        return np.asarray(np.linalg.inv(self.base.T) @ T_world)
