"""Where the camera and the board are: the result of hand-eye, with what it leaves at every image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from truearm.findings import Finding, format_mm
from truearm.readings import Session
from truearm.verbs.fit import FitResult
from truearm.verbs.record import Record, TextTable, format_fixed, number_of
from truearm.wings.camera.closed_form import HandEyeAlone
from truearm.wings.camera.interpretation import Interpretation
from truearm.wings.camera.mounts import Transform


@dataclass(frozen=True, eq=False, repr=False)
class CameraAndBoard(Record):
    """Where the camera and the board are, with uncertainty, and the identified arm.

    Attributes
    ----------
    camera, board : Transform
        The camera in the base and the board in the flange; where the camera is on the flange, the camera in the flange
        and the board in the base.
    eye_in_hand : bool
    n_images, n_used : int
        Images that were given, and without those that contradict the others.
    turn_deg : float
        Root mean square difference between the turns of robot and camera.
    alone_mm : float
        Mean distance of a board from where the other images put it, on the arm as its controller has it.
    fitted : FitResult or None
        The identified arm; None without joints.
    findings : tuple of Finding
    """

    camera: Transform
    board: Transform
    eye_in_hand: bool
    n_images: int
    n_used: int
    turn_deg: float
    alone_mm: float
    fitted: FitResult | None
    findings: tuple[Finding, ...]

    @property
    def held_out_mm(self) -> tuple[float, float]:
        """Mean error of the board's position on held-out images: with the arm as it is, and with it identified."""
        found = None if self.fitted is None else self.fitted.held_out_mm
        return (self.alone_mm, self.alone_mm) if found is None else (found[1], found[0])

    @property
    def transforms(self) -> tuple[Transform, ...]:
        """Camera and board, and both the other way round."""
        return (self.camera, self.board, self.camera.inverted(), self.board.inverted())

    def summary(self) -> str:
        """The answer in one sentence."""
        one = self.camera
        return (
            f"The camera in the {one.parent} is known to {format_mm(one.U_mm)} and {one.U_deg:.2g} deg (U, k = 2), "
            f"from {number_of(self.n_used, 'image')}."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        yield self.summary()
        alone, identified = self.held_out_mm
        if self.fitted is None or self.fitted.model_name == "nominal":
            yield f"Hand-eye alone leaves {format_mm(alone)} of the board's position on held-out images (mean)."
        else:
            yield (
                f"Hand-eye alone leaves {format_mm(alone)} of the board's position on held-out images (mean), with the "
                f"arm identified {format_mm(identified)}."
            )
        yield from map(str, self.findings)
        yield TextTable(
            ("frame", "in", "x mm", "y mm", "z mm", "roll deg", "pitch deg", "yaw deg", "U mm", "U deg"),
            [_row(one) for one in self.transforms],
            left_aligned=(0, 1),
        )
        yield TextTable(
            ("frame", "in", "qx", "qy", "qz", "qw"),
            [(one.child, one.parent, *(format_fixed(q, 6) for q in one.quaternion_xyzw)) for one in self.transforms],
            left_aligned=(0, 1),
        )
        yield f"The turns of robot and camera agree to {self.turn_deg:.2g} deg."

    def details(self) -> Iterator[str | TextTable]:
        """See `Record.details`."""
        if self.fitted is not None:
            yield from self.fitted.blocks()

    def _json(self) -> dict[str, Any]:
        alone, identified = self.held_out_mm
        return {
            **self._named("eye_in_hand", "n_images", "n_used", "turn_deg"),
            "transforms": [one.to_dict() for one in self.transforms],
            "held_out": {"hand_eye_alone_mm": alone, "arm_identified_mm": identified},
            "findings": [str(one) for one in self.findings],
            "fit": None if self.fitted is None else self.fitted.to_dict(),
        }


def _row(one: Transform) -> Sequence[str]:
    position = (format_fixed(x, 2) for x in one.position_mm)
    turned = (format_fixed(angle, 3) for angle in one.rpy_deg)
    return (one.child, one.parent, *position, *turned, f"{one.U_mm:.2g}", f"{one.U_deg:.2g}")


@dataclass(frozen=True, eq=False, repr=False)
class HandEyeByImages(CameraAndBoard):
    """Where the camera and the board are by poses of the board, image by image.

    Attributes
    ----------
    names : tuple of str
        What the images are called.
    interpretation : Interpretation
        What the poses mean, and how far robot and camera turn alike.
    alone : HandEyeAlone
        Hand-eye on the arm as its controller has it, by the images of the interpretation.
    readings : Session or None
        The images that were used as readings of the arm's tip.
    files : tuple of Path
        Those that were read.
    """

    names: tuple[str, ...] = field(kw_only=True)
    interpretation: Interpretation = field(kw_only=True)
    alone: HandEyeAlone = field(kw_only=True)
    readings: Session | None = field(kw_only=True)
    files: tuple[Path, ...] = field(kw_only=True)
