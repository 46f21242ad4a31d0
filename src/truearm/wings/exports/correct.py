"""Correct: joint targets that bring the arm where it should be, or the nominal joints that encoders mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.delimited import escape_formula
from truearm.findings import format_mm
from truearm.models import Compensator
from truearm.models.arm_check import check_has_kinematics, doubt_about_angles
from truearm.readings.columns import FACTOR, unit_of
from truearm.solve.threads import one_blas_thread
from truearm.typing import BoolArray, FloatArray
from truearm.verbs.inputs import ModelLike, is_model_file, model_file_fingerprint, to_model_of_tip
from truearm.verbs.outputs import check_output as check_file
from truearm.verbs.predict import check_table_path
from truearm.verbs.record import TableRecord, format_fixed, listed
from truearm.wings.exports.targets import TargetDirection, Untrained
from truearm.wings.exports.targets.correction import Correction, correct_targets, input_remarks
from truearm.wings.exports.targets.joint_files import read_corrected, read_joint_file
from truearm.wings.exports.targets.joint_files.joint_file import JointFile
from truearm.wings.exports.targets.manifest import Frame, Manifest, TargetsManifest, check_joints, read_manifest
from truearm.wings.exports.targets.pose_models import (
    JOINTS_OF_A_POSE,
    nominal_poses,
    reference_from_base,
    turns_of,
    with_tool,
)
from truearm.wings.exports.targets.program_literals import (
    LANGUAGES,
    FanucJ3,
    check_fanuc_j3,
    check_language,
    fanuc_joints,
    program_text,
)
from truearm.wings.exports.targets.start_joints import check_orientations, doubts_about_poses
from truearm.wings.exports.targets.targets import Targets, read_targets, targets_from_frame

if TYPE_CHECKING:
    import pandas as pd

TargetsLike: TypeAlias = "npt.ArrayLike | pd.DataFrame | Targets | str | Path"

MEANING = {
    "command": "command: send these joints, and the arm goes to the targets. Do not correct them again.",
    "feedback": "feedback: at these joints the nominal arm is where the arm is. Do not send them to the controller.",
}

FANUC_J3_TEXT: dict[FanucJ3, str] = {
    "coupled": "J3 is counted from the horizontal and coupled with J2, as a Fanuc teach pendant shows it.",
    "independent": "J3 is counted from the link before, not coupled with J2: a Fanuc controller must convert it.",
}


@one_blas_thread()
def correct(
    model: ModelLike,
    targets: TargetsLike,
    *,
    direction: TargetDirection = "command",
    frame: Frame = "reference",
    tool: Sequence[float] | None = None,
    start: npt.ArrayLike | None = None,
    untrained: Untrained = "refuse",
    uncertainty: bool = True,
    conditions: Conditions = "reproducibility",
    angle_unit: str | None = None,
    motors: str | None = None,
) -> CorrectedTargets:
    """Correct joint targets (inverse compensation).

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    targets : (n, n_joints) array, DataFrame, str or Path
        Joints [rad, or mm for sliding joints], or a table (docs/correct.md): joints in columns such as q1_deg, or poses
        of the tip with start joints. Positions alone have the orientation of the nominal arm at the start joints. Or a
        ROS trajectory, G-code with words of joints, or a table of LeRobot or ROS.
    direction : {"command", "feedback"}
        ``"command"``: what to send, so that the arm goes to the targets. ``"feedback"``: what the encoders mean, the
        joints at which the nominal arm is where the arm is.
    frame : {"reference", "base"}
        Of poses: that of the model's points, or the arm's own base frame.
    tool : sequence of 3 or 6 floats, optional
        Tip in the flange's frame [mm] and roll, pitch, yaw of the tool's axes there [rad], in place of the tip that the
        model was trained with.
    start : (n_joints,) array, optional
        Start joints of all poses [rad, or mm], if the table has none: they choose the configuration.
    untrained : {"refuse", "accept"}
        What to do with targets outside the trained range.
    uncertainty : bool
        Whether to compute the standard uncertainty of the tip, which takes most of the time.
    conditions : {"reproducibility", "repeatability"}
        What it is for (`Compensator.under`): any day, or the day and set-up of the training readings.
    angle_unit : str, optional
        Of a table of LeRobot (``deg``, ``percent``, ``counts``) or ROS (``deg``, ``rad``).
    motors : str, optional
        LeRobot's calibration file of this arm, for percent and counts.

    Returns
    -------
    CorrectedTargets

    Raises
    ------
    InputError
        If the targets are not those of the arm, are corrected already, or break a rule of their format. Targets that
        cannot be corrected are refused one by one, with a reason.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=40, seed=1).session
    >>> model = ta.fit("ur10", session, model="kinematic").model
    >>> corrected = ta.correct(model, session.angles[:5])
    >>> corrected.joints.shape, int(corrected.refused.sum())
    ((5, 6), 0)
    >>> nominal = ta.correct(model, corrected.joints, direction="feedback").joints
    >>> bool(abs(nominal - session.angles[:5]).max() < 1e-6)
    True
    """
    fitted = to_model_of_tip(model)
    check_has_kinematics(fitted.arm_, "corrected targets need")
    wanted = _to_targets(fitted, targets, start, direction=direction, angle_unit=angle_unit, motors=motors)
    equipped = fitted.under(conditions)
    if tool is not None:
        equipped = with_tool(equipped, _checked_tool(tool))
    check_orientations(equipped, wanted, frame)
    corrected = correct_targets(
        equipped, wanted, direction=direction, frame=frame, untrained=untrained, uncertainty=uncertainty
    )
    return CorrectedTargets(
        model=fitted,
        targets=wanted,
        correction=corrected,
        direction=direction,
        frame=frame,
        tool=None if tool is None else tuple(float(value) for value in tool),
        equipped=equipped,
    )


def _to_targets(
    model: Compensator,
    targets: TargetsLike,
    start: npt.ArrayLike | None,
    *,
    direction: TargetDirection,
    angle_unit: str | None,
    motors: str | None,
) -> Targets:
    if isinstance(targets, str | Path):
        if is_model_file(targets):
            raise InputError("expected a table of targets, got a model file", file=targets, hint="give the model first")
        found = targets_of_joint_file(targets, model, direction=direction, angle_unit=angle_unit, motors=motors)
        if found is not None:
            return found
        return read_targets(targets, start=start)
    if hasattr(targets, "columns"):
        return targets_from_frame(cast("pd.DataFrame", targets), start=start)
    if start is not None:
        raise InputError("start joints are for poses; joint targets are their own start", hint="omit start")
    return targets if isinstance(targets, Targets) else Targets.of_joints(targets)


def targets_of_joint_file(
    path: str | Path, model: Compensator, *, direction: TargetDirection, angle_unit: str | None, motors: str | None
) -> Targets | None:
    """The targets in a file of joints of another program; None of a table of targets.

    Raises
    ------
    InputError
        As `read_joint_file`.
    """
    of_file = read_joint_file(Path(path), model.arm_, direction=direction, angle_unit=angle_unit, motors=motors or "")
    return None if of_file is None else Targets(of_file.joints, file=Path(path), joint_file=of_file)


def _checked_tool(tool: Sequence[float]) -> FloatArray:
    try:
        values = np.array(tool, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((3,), (6,)) or not np.isfinite(values).all():
        raise InputError(
            f"expected a tool as x, y, z [mm] or x, y, z, roll, pitch, yaw [mm, rad], got {tool!r:.60}",
            hint="the position of the tip in the flange's frame, such as 0, 0, 120",
        )
    return np.concatenate([values, np.zeros(6 - len(values))])


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedTargets(TableRecord):
    """Corrected joints of targets, with the reasons of those that were refused.

    Attributes
    ----------
    model : Compensator
    targets : Targets
    correction : Correction
        All figures, target by target.
    direction : {"command", "feedback"}
    frame : {"reference", "base"}
    tool : tuple of float or None
        Tip in the flange [mm], and roll, pitch, yaw [rad]; None: the tip that the model was trained with.
    equipped : Compensator
        The model with that tool, and with the uncertainty of the conditions asked for.
    """

    model: Compensator
    targets: Targets
    correction: Correction
    direction: TargetDirection
    frame: Frame
    tool: tuple[float, ...] | None
    equipped: Compensator

    @property
    def joints(self) -> FloatArray:
        """(n, n_joints) corrected joints [rad, or mm]; NaN for refused targets."""
        return self.correction.joints

    @property
    def refused(self) -> BoolArray:
        """(n,) whether a target was refused."""
        return self.correction.refused

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each target was refused; empty for corrected ones."""
        return self.correction.reasons

    @property
    def u_mm(self) -> FloatArray:
        """(n,) standard uncertainty of a coordinate of the tip, root mean square of x, y, z [mm]."""
        return np.asarray(np.sqrt(np.trace(self.correction.covariances, axis1=1, axis2=2) / 3))

    def columns(self) -> dict[str, object]:
        """One row a target: the columns of the input with the corrected joints, and figures of each."""
        done = self.correction
        columns: dict[str, object] = {}
        units = [unit_of(name) for name in self._joint_columns]
        # The order is that of the input; joints come first where it has none.
        joints = {
            name: done.joints[:, i] / FACTOR[unit]
            for i, (name, unit) in enumerate(zip(self._joint_columns, units, strict=True))
        }
        if not self.targets.joint_columns:
            columns |= joints
        columns |= {**self.targets.given, **{name: joints[name] for name in joints if name in self.targets.given}}
        columns |= joints | dict(self.targets.words)
        columns["direction"] = [self.direction] * len(self.targets)
        columns["status"] = [reason or "ok" for reason in done.reasons]
        columns |= {"residual_mm": done.distance_mm, "residual_rad": done.angle_rad, "steps": done.steps}
        slides = self.model.arm_.chain.is_prismatic
        turning = next((unit for unit in units if unit != "mm"), "deg")
        for unit, which in ((turning, ~slides), ("mm", slides)):
            if which.any():
                least = done.margins[:, which].min(axis=1) / FACTOR[unit]
                columns[f"limit_margin_{unit}"] = np.where(np.isfinite(least), least, np.nan)
        columns["condition"] = done.condition
        columns["inside_training"] = (~done.outside).astype(int)
        columns["u_mm"] = self.u_mm
        return columns

    def save(self, path: str | Path, *, language: str | None = None, fanuc_j3: FanucJ3 | None = None) -> None:
        """Write the targets: a table, or a program's literals; both say the direction and carry check poses.

        Parameters
        ----------
        path : path
            Ends in ``.csv``, or as files of the language do.
        language : {"urscript", "rapid", "krl", "fanuc"}, optional
            The table of `to_frame` by default.
        fanuc_j3 : {"coupled", "independent"}, optional
            For ``"fanuc"``, which needs it: whether J3 is written as the teach pendant shows it, counted from the
            horizontal and coupled with J2, or as in the model, from the link before.

        Raises
        ------
        InputError
            If the name has another ending, cannot be written, the language cannot state the arm's joints, how J3 is
            counted is missing, or all targets were refused.
        """
        if self.targets.joint_file is not None:
            self._save_joint_file(Path(path), self.targets.joint_file)
            return
        self.check_output(path, language, fanuc_j3)
        if self.refused.all():
            raise InputError(self.summary()[:-1], file=path, hint=f"first of the reasons: {self.reasons[0]}")
        comment, content = self._content(language, fanuc_j3)
        manifest = self.manifest(language or "joint targets (csv)")
        line = TargetsManifest.for_content(manifest, comment, content).line()
        with atomic_file(path, read=read_manifest) as beside:
            beside.write_text(f"{comment} {line}\n{content}", encoding="utf-8", newline="\n")

    def _save_joint_file(self, path: Path, file: JointFile) -> None:
        """Write the file of another program whole: a path has no gaps."""
        source = self.targets.file
        assert source is not None
        check_output_of(path, source)
        if self.refused.any():
            raise InputError(
                f"{int(self.refused.sum())} of {len(self.targets)} targets were refused: the file is not written",
                file=path,
                hint=f"first of the reasons: {next(filter(None, self.reasons))}",
            )
        made = file.corrected(self.joints, f"truearm {self.direction} {model_file_fingerprint(self.model)[:8]}")
        with atomic_file(path) as beside:
            beside.write_bytes(made)

    def _content(self, language: str | None, fanuc_j3: FanucJ3 | None) -> tuple[str, str]:
        """What begins a comment in a file, and the file's text after the line of the manifest."""
        if language is not None:
            text = program_text(
                language,
                self._joints_for(fanuc_j3),
                labels=[self.targets.label(row) for row in range(len(self.targets))],
                reasons=self.reasons,
                prismatic=self.model.arm_.chain.is_prismatic,
                header=[*self._header(), *([FANUC_J3_TEXT[fanuc_j3]] if fanuc_j3 is not None else [])],
            )
            return LANGUAGES[language].comment, text
        frame = self.to_frame()
        for name in {**self.targets.given, **self.targets.words}:
            if name not in self._joint_columns:
                frame[name] = frame[name].map(lambda cell: escape_formula(cell) if isinstance(cell, str) else cell)
        table = frame.to_csv(index=False, float_format="%.12g", lineterminator="\n")
        return "#", "".join(f"# {line}\n" for line in self._header()) + table

    def _joints_for(self, fanuc_j3: FanucJ3 | None) -> FloatArray:
        """The joints as a program has them. An arm with a coupling has those of its controller already."""
        chain = self.model.arm_.chain
        if chain.coupling is None:
            return fanuc_joints(self.joints, chain.fixed) if fanuc_j3 == "coupled" else self.joints
        return chain.joint_angles(self.joints) if fanuc_j3 == "independent" else self.joints

    def check_output(self, path: str | Path, language: str | None = None, fanuc_j3: FanucJ3 | None = None) -> None:
        """Check that the targets can be written under a name; see `save`."""
        check_output(path, language, fanuc_j3)
        if language is not None:
            check_language(language, self.model.arm_.chain.is_prismatic)

    def manifest(self, format: str) -> Manifest:
        """Origin, direction and five check poses: planned (or read) joints, the corrected ones, and the tip there.

        The tip is that of the arm once the joints are corrected: ``nominal(planned) = model(sent)``, or
        ``model(read) = nominal(corrected)``.
        """
        joints = check_joints(self.model)
        checked = correct_targets(
            self.equipped, Targets.of_joints(joints), direction=self.direction, untrained="accept", uncertainty=False
        )
        if self.direction == "command":
            tips = nominal_poses(self.equipped).chain.tip_in_base(joints)
        else:
            tips = self.equipped.predict(joints)
        return Manifest.of(
            self.model,
            format,
            tips=self._in_frame(tips),
            corrected_joints=[tuple(q) if np.isfinite(q).all() else None for q in checked.joints.tolist()],
            direction=self.direction,
            frame=self.frame,
            tool=None if self.tool is None else tuple(_checked_tool(self.tool).tolist()),
        )

    def _in_frame(self, tips: FloatArray) -> FloatArray:
        """Tips (n, 3) in the frame of the reference, in that of the targets [mm]."""
        if self.frame == "reference":
            return tips
        T = reference_from_base(self.model)
        return np.asarray((tips - T[:3, 3]) @ T[:3, :3])

    def summary(self) -> str:
        """The answer in one sentence: how many targets were corrected, and by how much."""
        good, n = ~self.refused, len(self.targets)
        if not good.any():
            return f"None of {n} targets corrected: there is nothing to write."
        return (
            f"{int(good.sum())} of {n} targets corrected; largest change {self._largest_change()}; the tip moves by "
            f"{format_mm(float(self.correction.shift_mm[good].mean()))} on average."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        refusals = [f"{self.targets.label(row)}: {reason}" for row, reason in enumerate(self.reasons) if reason]
        is_broken_path = bool(refusals) and self.targets.joint_file is not None
        if not self.refused.all() and not is_broken_path:
            yield f"direction {MEANING[self.direction]}"
        yield from listed("refused", refusals, "refused targets")
        if is_broken_path:
            yield (
                "Nothing is written: a path with corrected and uncorrected targets would have steps. Change or delete "
                "the refused targets."
            )
        if any(reason.startswith("outside the trained range") for reason in self.reasons):
            yield "Take readings where the model is untrained, or correct and flag these targets (--untrained accept)."
        good = ~self.refused
        u = self.u_mm[good]
        if np.isfinite(u).any():
            yield f"standard uncertainty of a coordinate of the tip: {format_fixed(np.nanmedian(u))} mm (median)"
        if n := int((self.correction.outside & good).sum()):
            yield f"{n} corrected targets are outside the trained range: their errors may be larger than stated."
        yield from self._remarks()

    def _json(self) -> object:
        good = ~self.refused
        done = self.correction
        return {
            "summary": self.summary(),
            "direction": self.direction,
            "kind": self.targets.kind,
            **self._named("frame", "tool"),
            "n_targets": len(self.targets),
            "n_corrected": int(good.sum()),
            "refused": [
                {"target": row + 1, "name": self.targets.label(row), "reason": reason}
                for row, reason in enumerate(self.reasons)
                if reason
            ],
            "max_change": np.abs(done.change[good]).max(axis=0) if good.any() else None,
            "mean_shift_mm": float(done.shift_mm[good].mean()) if good.any() else None,
            "max_steps": int(done.steps[good].max()) if good.any() else None,
            "median_u_mm": float(np.median(self.u_mm[good])) if good.any() else None,
            "n_outside_training": int(done.outside.sum()),
            "remarks": list(self._remarks()),
        }

    @property
    def _joint_columns(self) -> tuple[str, ...]:
        """Those of the input; rad of an array, as it was given, and deg where the start was an option."""
        if self.targets.joint_columns is not None:
            return self.targets.joint_columns
        turning = "rad" if self.targets.tips is None else "deg"
        slides = self.model.arm_.chain.is_prismatic
        return tuple(f"q{i}_{'mm' if slide else turning}" for i, slide in enumerate(slides.tolist(), 1))

    def _largest_change(self) -> str:
        """The largest change of a turning joint, and of a sliding one, with the joint."""
        change, slides = np.abs(self.correction.change[~self.refused]), self.model.arm_.chain.is_prismatic
        parts = []
        for which, factor, unit in ((~slides, 180 / np.pi, "deg"), (slides, 1.0, "mm")):
            if which.any():
                joint = int(np.argmax(np.where(which, change.max(axis=0), -1.0)))
                parts.append(f"{factor * change[:, joint].max():.2g} {unit} (J{joint + 1})")
        return " and ".join(parts)

    def _remarks(self) -> Iterator[str]:
        """What a person must know of these targets."""
        yield from self.model.doubts()
        yield from self._doubt_about_numbers()
        of_file = self.targets.joint_file
        if (good := ~self.refused).any():
            readings = self.targets.session(np.where(good[:, None], self.joints, self.targets.joints))
            how = "in a table of targets, as this file has no place for it" if of_file else "in a column of that name"
            yield from input_remarks(self.equipped, readings.rows(good), how)
        yield from of_file.findings(self.joints) if of_file else ()
        n_joints = self.model.arm_.n_joints
        if len(turns_of(self.model.nominal_.chain)) == 1:
            said = "A SCARA is corrected in position and turn about its axes"
            yield f"{said}." if of_file else f"{said}; residual_rad is the tilt that remains."
        elif n_joints < JOINTS_OF_A_POSE:
            said = f"An arm of {n_joints} joints is corrected in position only, with the least movement"
            yield f"{said}." if of_file else f"{said}; residual_rad is the change of orientation that remains."
        elif self.targets.kind == "positions":
            yield "Positions without orientations: that of the nominal arm at the start joints is used."
        if "session" in self.targets.words and self.model.session_frames_:
            first = next(iter(self.model.session_frames_))
            yield f"All targets are in the frame of the session {first}, the model's first."

    def _doubt_about_numbers(self) -> Iterator[str]:
        """That targets may mean another thing: joints by the trained range, poses by where their start joints are."""
        if self.targets.tips is None:
            chain = self.model.nominal_.chain
            yield from doubt_about_angles(self.model.training_, self.targets.joints, chain.is_prismatic)
        else:
            yield from doubts_about_poses(self.equipped, self.targets, self.frame, all_refused=bool(self.refused.all()))

    def _header(self) -> list[str]:
        """Lines for the head of a file, for people."""
        lines = [f"direction {MEANING[self.direction]}"]
        if self.tool is not None:
            x, y, z, *turns = self.tool
            rpy = ", ".join(f"{angle:.6g}" for angle in np.degrees(turns or [0.0, 0.0, 0.0]))
            lines.append(f"tool in the flange: {x:.6g}, {y:.6g}, {z:.6g} mm, roll pitch yaw {rpy} deg")
        return lines


def check_output_of(path: str | Path, source: str | Path) -> None:
    """Check that a file of another program can be written with corrected joints: none that truearm has not written.

    Raises
    ------
    InputError
    """
    check_file(path, source, endings=(Path(source).suffix,), read=read_corrected)


def check_output(path: str | Path, language: str | None = None, fanuc_j3: str | None = None) -> None:
    """Check that corrected targets can have a file name, and that it is stated how a Fanuc controller counts J3.

    Raises
    ------
    InputError
        If the name does not end as files of the language do, or in .csv without one; if that statement is missing.
    """
    check_fanuc_j3(language, fanuc_j3)
    if language is None:
        if Path(path).suffix in {one.suffix for one in LANGUAGES.values()}:
            name = next(key for key, one in LANGUAGES.items() if one.suffix == Path(path).suffix)
            raise InputError(
                f"expected a table that ends in .csv, got {Path(path).name!r}", file=path, hint=f"--as {name}"
            )
        check_table_path(path)
        return
    if language not in LANGUAGES:
        raise InputError(f"expected a language among {', '.join(LANGUAGES)}, got {language!r}")
    if Path(path).suffix != LANGUAGES[language].suffix:
        raise InputError(
            f"expected a file name of {language} that ends in {LANGUAGES[language].suffix}, got {Path(path).name!r}",
            file=path,
        )
