"""The readings of a session, prepared once for all steps of an identification: in one frame, as references.

Rounded angles: how uncertain tips and residuals are by the standard uncertainty of the angles.

To first order an error of joint j moves the tip along its derivative by that angle; errors of different joints are
independent (JCGM 100:2008, 5.1.2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.findings import Finding
from truearm.identification.references.cross_validation_groups import (
    cross_validation_groups,
    is_in_one_place,
    joint_space_regions,
)
from truearm.identification.references.reading_references import Referenced, roughly_aligned_chain, state_of
from truearm.identification.references.reference_table import ReferenceTable, reference_table
from truearm.identification.references.references import LinearisedResiduals, Points, Reference
from truearm.identification.references.session_frames import in_one_frame
from truearm.identification.references.tips import free_tips
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.catalogue import relative_size
from truearm.identification.terms.type_prior import TypePrior
from truearm.readings.anchors import bars_without_certificate
from truearm.readings.checks import check_sessions
from truearm.readings.lengths import Lengths
from truearm.readings.readings import Measured, points_there
from truearm.readings.reference_uncertainty import scale_errors
from truearm.readings.repeats import rounding_steps
from truearm.readings.session import Session
from truearm.typing import BoolArray, FloatArray, IntArray


def tip_motions(chain: Chain, angles: FloatArray, std: FloatArray) -> FloatArray:
    """(n_joints, n, 3) motions of the tip by one standard uncertainty of each joint [mm]."""
    tips = chain.tip_in_base(angles)
    return np.stack([chain.tip_in_base(angles + one) - tips for one in np.diag(std)])


def tip_motion_mm(chain: Chain, angles: FloatArray, std: FloatArray) -> float:
    """Root mean square motion of the tip by errors of the angles [mm]."""
    if not std.any():
        return 0.0
    return float(np.sqrt((tip_motions(chain, angles, std) ** 2).sum(axis=(0, 2)).mean()))


def residual_variance(linear: LinearisedResiduals, motions: FloatArray) -> FloatArray:
    """(k, m) variances of residuals by motions (n_joints, m, 3) of tips [mm^2]; turns of the flange are ignored."""
    return np.asarray((np.einsum("kim,jmi->kjm", linear.by_tip, motions) ** 2).sum(axis=1))


# Root mean square motion of the tip by rounding of the angles that counts, on an arm of usual reach [mm]: what a laser
# tracker is uncertain by.
LEAST_ROUNDING_MM = 0.01
# Readings that determine base (6) and tip (3): 3 coordinates each, and one reading to spare.
MIN_ROWS = 4
# Stretches of a large session, and readings of each, in which a residual process is tried before it is in all of them.
STRETCHES = (12, 1000)


@dataclass(frozen=True, eq=False, kw_only=True)
class PreparedReadings:
    """What all steps of an identification learn from; whoever has it checks nothing again.

    Attributes
    ----------
    arm : Arm
    measured : Measured
        The readings as they were given, named in messages.
    state : ArmState
        State of the arm at them, with the uncertainty of rounded angles.
    state_as_read : ArmState
        The same without it, at the temperatures that were read.
    points, point_std : (n, 3) array or None
        Reference points of all readings in one frame, and their standard uncertainties [mm].
    references : list of Reference
        Of the readings and the lengths.
    lengths : Lengths or None
        Known lengths between their seats.
    free : tuple of str
        The free parts that the readings determine: without reference points the base stays nominal.
    frames : mapping of str to (4, 4) array
        Of several sessions by name the rough rigid motion of its points into the frame of the first; empty for one.
    tips : tuple of str
        Names of the tips on the flange; empty if none is named.
    robust : bool
        Whether outliers get a smaller weight.
    chain : Chain
        The nominal one, its base and tool roughly where the readings have them.
    tool : list of Term
        Rotation of the tracked tool.
    in_one_place : bool
        See `is_in_one_place`.
    groups : (n,) int array
        What is held out together: positions, seats, or regions of the joint space.
    table : ReferenceTable or None
        In which mistakes of a description are looked for.
    scale_errors : (n, 4) array
        Of x, y, z and the distance by one standard uncertainty of the reference's scale [mm].
    n_repeats : (n,) int array or None
        How many readings each is the mean of.
    averaged_mm2, repeat_std_mm : float
        See `truearm.readings.readings.Readings`.
    stretches : (PreparedReadings, (m,) int array) or None
        Stretches of many readings, as if there were no others, and their rows: see `_stretches`.
    prior : TypePrior or None
        What arms of its type have in common, if that is known.
    findings : tuple of Finding
        What a person must know of the readings.
    """

    arm: Arm
    measured: Measured
    state: ArmState
    state_as_read: ArmState
    points: FloatArray | None
    point_std: FloatArray | None
    references: list[Reference]
    lengths: Lengths | None
    free: tuple[str, ...]
    frames: Mapping[str, FloatArray]
    tips: tuple[str, ...]
    robust: bool
    chain: Chain
    tool: list[Term]
    in_one_place: bool
    groups: IntArray
    table: ReferenceTable | None
    scale_errors: FloatArray
    n_repeats: IntArray | None
    averaged_mm2: float
    repeat_std_mm: float
    findings: tuple[Finding, ...]
    stretches: tuple[PreparedReadings, IntArray] | None = None
    prior: TypePrior | None = None

    @classmethod
    def of(cls, arm: Arm, readings: Session, lengths: Lengths | None, *, free: tuple[str, ...], robust: bool) -> Self:
        """Prepare readings of an arm whose angles were checked, each session in its own frame.

        Raises
        ------
        InputError
            If a seat or a length is in two sessions, the frames of sessions are not determined (see
            `rough_session_frames`), several tips are not free, or fewer than `MIN_ROWS` readings have a reference.
        """
        lengths = lengths_in_seats(readings, lengths)
        check_sessions(readings, lengths, own_frame="base" not in free)
        determined = free if readings.has_point.any() else tuple(part for part in free if part != "base")
        in_frame, frames = in_one_frame(arm, readings, determined)
        tips = free_tips(readings, free)
        session, references, as_read, chain, tool, too_few = Referenced.of(arm, in_frame, lengths, determined)
        check_enough(references, readings)
        one_place = is_in_one_place(session.has_point, as_read)
        prepared = cls(
            arm=arm,
            measured=readings.measured,
            state=with_rounded_angles(as_read),
            state_as_read=as_read,
            points=session.points,
            point_std=session.point_std,
            references=references,
            lengths=lengths,
            free=determined,
            frames=frames,
            tips=tips,
            robust=robust,
            chain=chain,
            tool=tool,
            in_one_place=one_place,
            groups=joint_space_regions(session.angles, arm.chain)
            if one_place
            else cross_validation_groups(session, frames),
            table=reference_table(readings, lengths, free=determined),
            scale_errors=scale_errors(session, is_frame_free="base" in determined),
            n_repeats=session.n_repeats,
            averaged_mm2=float(session.averaged_mm2.mean()),
            repeat_std_mm=session.repeat_std_mm,
            findings=(*too_few, *_findings(readings, lengths, list(frames))),
        )
        return replace(prepared, stretches=_stretches(prepared, session))

    def __len__(self) -> int:
        return len(self.state)

    @property
    def days(self) -> tuple[str, ...]:
        """Names of the sessions on days of their own: not those of several cameras, which are frames of one day."""
        return () if any(one.kind == "pose" for one in self.references) else tuple(self.frames)

    @property
    def has_point(self) -> BoolArray:
        """(n,) Whether each reading has a reference point."""
        return points_there(self.points, len(self))

    def typical_state(self, angles: FloatArray) -> ArmState:
        """State of the arm at angles (n, n_joints), as warm and as loaded as at the readings on average."""
        at = self.state_as_read
        return state_of(
            self.arm,
            Session(angles),
            temperature_degC=None if at.temperature_degC is None else float(at.temperature_degC.mean()),
            columns={name: float(values.mean()) for name, values in at.columns.items()},
            direction=0.0,
        )


def _stretches(prepared: PreparedReadings, session: Session) -> tuple[PreparedReadings, IntArray] | None:
    """Stretches of consecutive readings, evenly spaced, as if there were no others; and their rows.

    None unless there are four times as many readings, all of them of one session and with points alone: neighbours stay
    together, so that what holds for near readings holds in the stretches.
    """
    points, (n, length) = prepared.references[0], STRETCHES
    if len(prepared.references) > 1 or not isinstance(points, Points) or prepared.frames:
        return None
    if len(points.rows) < 4 * n * length:
        return None
    starts = np.linspace(0, len(points.rows) - length, n).astype(np.intp)
    chosen = (starts[:, None] + np.arange(length)).ravel()
    rows = points.rows[chosen]
    within = session.rows(rows)
    some = replace(
        prepared,
        measured=prepared.measured.rows(rows),
        state=prepared.state.rows(rows),
        state_as_read=prepared.state_as_read.rows(rows),
        points=within.points,
        point_std=within.point_std,
        references=[replace(points.select(chosen), rows=np.arange(len(rows)))],
        chain=roughly_aligned_chain(prepared.arm, within, prepared.free),
        groups=cross_validation_groups(within),
        scale_errors=prepared.scale_errors[rows],
        n_repeats=within.n_repeats,
        averaged_mm2=float(within.averaged_mm2.mean()),
    )
    return some, rows


def _findings(readings: Session, lengths: Lengths | None, frames: list[str]) -> Iterator[Finding]:
    """What a person must know of readings before anything is identified from them."""
    if frames:
        first, *others = frames
        said = (
            f"Each session has a frame of its own: coordinates are in that of session {first}, those of readings of "
            f"{', '.join(others)} in theirs."
        )
        yield Finding("session frames", said, {"n": len(frames)})
    yield from bars_without_certificate(readings)
    if all(one is None for one in (readings.points, lengths, readings.sphere_distance, readings.distance_mm)):
        said = "the arm keeps its nominal size, as uncertain as its lengths"
        yield Finding("size", f"No reference point and no length is known: {said}.")
    elif all(one is None for one in (readings.points, lengths, readings.sphere_distance)):
        u = 0.0 if readings.u_scale_ppm is None else 1e-4 * float(readings.u_scale_ppm.max())
        exact = "which count as exact: state u_scale_ppm (1000 for 0.1 %)"
        said = f"as uncertain as stated, {u:.2g} %" if u else exact
        yield Finding("size", f"All lengths of the arm rest on the scale of the distances, {said}.", {"u_percent": u})


def with_rounded_angles(state: ArmState) -> ArmState:
    """The state with the uncertainty of its angles by rounding, where that moves the tip by `LEAST_ROUNDING_MM`."""
    std = rounding_steps(state.angles, state.chain.is_prismatic) / np.sqrt(12)
    moved = tip_motion_mm(state.chain, state.angles, std)
    return replace(state, angle_std=std) if moved >= LEAST_ROUNDING_MM * relative_size(state.chain) else state


def lengths_in_seats(readings: Session, lengths: Lengths | None) -> Lengths | None:
    """The lengths between the seats of readings, which must name some if there are lengths."""
    if lengths is None:
        return None
    if readings.seat is None:
        raise readings.error("lengths are between seats, and the readings name no seats", column="seat")
    return lengths.between(readings.seat)


def check_enough(references: Sequence[Reference], readings: Session) -> None:
    """Check that `MIN_ROWS` readings or more have a reference."""
    n_known = len(np.unique(np.concatenate([reference.rows for reference in references])))
    if n_known < MIN_ROWS:
        raise readings.error(f"expected {MIN_ROWS} or more readings with a reference, got {n_known}")
