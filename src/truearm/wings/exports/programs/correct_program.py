"""Correct a robot program: its targets become those at which the nominal controller brings the real arm there.

A target in its tool and work frame gives the joints of the controller's arm, the model gives corrected joints, and the
controller's arm at those joints gives the new target. Only the numbers of a target change.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.arm.catalogue import maker_of
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.files.toml_documents import read_document
from truearm.findings import format_mm
from truearm.models import Compensator
from truearm.models.arm_check import check_has_kinematics
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray
from truearm.verbs.inputs import ModelLike, model_file_fingerprint, to_model_of_tip
from truearm.verbs.record import Record, TextTable, listed, number_of
from truearm.wings.exports.programs.branches import QUANTITIES
from truearm.wings.exports.programs.controllers import with_controller
from truearm.wings.exports.programs.fanuc_ls import FanucListing
from truearm.wings.exports.programs.frames_file import FramesFile
from truearm.wings.exports.programs.krl import Krl
from truearm.wings.exports.programs.number_texts import direction_of_check_digits, new_numbers, with_check_digits
from truearm.wings.exports.programs.polyscope import PolyScope
from truearm.wings.exports.programs.program import Language, LeftAlone, Program, Surroundings, Target, text_start
from truearm.wings.exports.programs.rapid import Rapid
from truearm.wings.exports.programs.solving import NO_POSTURE, ROBOT, Machine, Solver, ends_of
from truearm.wings.exports.programs.subdivision import check_subdivision, divide
from truearm.wings.exports.programs.urscript import URScript
from truearm.wings.exports.programs.yaskawa_jbi import YaskawaJob
from truearm.wings.exports.targets import TargetDirection, Untrained
from truearm.wings.exports.targets.correction import input_remarks
from truearm.wings.exports.targets.edits import Edit, with_edits
from truearm.wings.exports.targets.manifest import MARKER

LANGUAGES: tuple[Language, ...] = (Rapid(), Krl(), FanucListing(), YaskawaJob(), PolyScope(), URScript())
# Files that are no program in a text of their own, by their endings.
UNREADABLE = {
    ".ls": "a Fanuc program begins with /PROG: this is a log, or a part of a program",
    ".tp": "a program .TP is binary: save it on the controller as text (.ls)",
}
MAX_BYTES = 64 * 2**20
# The digits of a target leave the joints uncertain by so much [deg, mm].
_ON_BORDER = 1e-3
# A model that equals the nominal arm changes joints by rounding: such a target keeps its bytes [rad].
_UNCHANGED = 1e-9
# A tool that is shorter, and not the flange itself, was written in metres, and a work frame so near the base [mm].
_NO_FLANGE, _SHORTEST_TOOL, _NEAREST_WORK = 1e-6, 1.0, 5.0
_MARK = re.compile(rb"truearm (command|feedback) ([0-9a-f]{8})")
# What lengths are multiplied by, if a program has them in another unit than its language. Smaller ones than stated are
# no explanation: near the origin of a work frame all is within reach.
_OTHER_UNITS = {"inches": 25.4, "m": 1000.0}
# Most of the targets of a program for this robot are within its reach.
_MOST = 0.5
# So many may have another unit.
_MANY = 0.1
MEANING = {
    "command": "command: the arm goes where the program says. Do not correct the new program again.",
    "feedback": "feedback: targets taught on the arm, as the nominal arm has them. Do not send them to the controller.",
}


@one_blas_thread()
def correct_program(
    model: ModelLike,
    program: str | Path,
    *,
    direction: TargetDirection = "command",
    frames: str | Path | None = None,
    start: npt.ArrayLike | None = None,
    subdivide_mm: float | None = None,
    untrained: Untrained = "refuse",
) -> CorrectedProgram:
    """Correct the targets of a robot program in the language of its controller.

    Parameters
    ----------
    model : Compensator, str or Path
        A fitted model or its file.
    program : str or Path
        A program of a known language, recognised by its content.
    direction : {"command", "feedback"}
        ``"command"``: what to send, so that the arm goes to the targets. ``"feedback"``: the reverse.
    frames : str or Path, optional
        TOML file of tools and work frames that are not in the program (docs/programs.md).
    start : (n,) array, optional
        Joints near Cartesian targets that state no configuration, as the controller counts them [rad, or mm].
    subdivide_mm : float, optional
        Largest distance between two targets of a straight move: further ones are written between them [mm].
    untrained : {"refuse", "accept"}
        What to do with targets outside the trained range.

    Returns
    -------
    CorrectedProgram

    Raises
    ------
    InputError
        If the program is of no known language, damaged, of another robot, or corrected in this direction already.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("irb2600-12-165", poses=40, strategy="measuring", seed=1).session
    >>> model = ta.fit("irb2600-12-165", session, model="kinematic").model
    >>> with open("pick.mod", "w") as file:
    ...     print("MODULE Pick", file=file)
    ...     print("CONST jointtarget jHome:=[[0,0,15,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]];", file=file)
    ...     print("ENDMODULE", file=file)
    >>> corrected = ta.correct_program(model, "pick.mod")
    >>> len(corrected.changes), corrected.is_complete
    (1, True)
    """
    fitted = to_model_of_tip(model)
    check_has_kinematics(fitted.arm_, "corrected targets need")
    path = Path(program)
    file = read_limited(path, limit_bytes=MAX_BYTES)
    language = language_of(file)
    if language is None:
        known = f"a program of {', '.join(one.title for one in LANGUAGES)}"
        hint = "it is in UTF-16: save it as UTF-8 or ANSI" if _is_utf16(path, file) else known
        hint = UNREADABLE.get(path.suffix.lower(), hint)
        raise InputError("the file is a program of no known language", file=path, hint=hint)
    Machine.of(fitted.arm_, fitted.arm_.chain, language)
    if maker_of(fitted.arm_.title) not in language.title:  # no maker is in every title
        raise InputError(
            f"the program is one of {language.title}, the model that of {fitted.arm_.title}",
            file=path,
            hint="give the model of the robot that runs this program",
        )
    if subdivide_mm is not None:
        check_subdivision(language, subdivide_mm, direction)
    stated = FramesFile() if frames is None else read_document(frames, FramesFile)
    beside = Surroundings(path, stated, fitted.arm_.chain.with_tip(np.zeros(3)))
    with InputError.of_file(path):
        text = language.unpacked(file)
        if MARKER.encode() in text:
            raise InputError(
                "truearm correct --as wrote these targets: they are corrected already",
                hint="correct the original program",
            )
        read = language.read(text, beside)
        before = {one[0].decode() for one in _MARK.findall(text)} | {direction_of_check_digits(read.targets)} - {None}
        if direction in before:
            raise InputError(
                f"the program is corrected already ({direction}): twice would double the correction",
                hint="correct the program as planned; --direction of the other sense is the reverse",
            )
        if read.controller is not None:
            fitted = with_controller(fitted, read.controller)
        solver = Solver(fitted, language, read.controller, direction, untrained, stated)
        near = None if start is None else _start_of(start, solver.machine.n_axes)
        read = _without_placeholders(read, solver, near)
        return _Correction(solver, read, is_first=not before).result(path, file, near, subdivide_mm)


def _without_placeholders(program: Program, solver: Solver, start: FloatArray | None) -> Program:
    """The program without configurations that no posture has, and their like, where its controller checks none."""
    if not program.unwatched:
        return program
    _, reasons = solver.nominal(program.targets, start, program.moves)
    bad = [row for row in program.unwatched if NO_POSTURE in reasons[row]]
    if not bad:
        return program
    placeholders = {program.targets[row].conditions for row in bad}
    targets = [
        replace(one, conditions=()) if row in program.unwatched and one.conditions in placeholders else one
        for row, one in enumerate(program.targets)
    ]
    first = program.targets[min(bad)].name
    said = (
        f"{number_of(len(bad), 'configuration')} of no posture, the first that of {first}: the program switches their "
        "check off, and where only such moves go none of the same numbers counts."
    )
    return replace(program, targets=tuple(targets), notes=(*program.notes, said))


def language_of(data: bytes) -> Language | None:
    """The language of a file, by its content."""
    text = data[text_start(data) :]
    return next((language for language in LANGUAGES if language.recognises(text)), None)


def is_program(path: Path) -> bool:
    """Whether a file is a program: of a known language, or one that cannot be read."""
    file = read_limited(path, limit_bytes=MAX_BYTES)
    return path.suffix.lower() in UNREADABLE or _is_utf16(path, file) or language_of(file) is not None


def _is_utf16(path: Path, file: bytes) -> bool:
    return file.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) and any(
        path.suffix.lower() in one.endings for one in LANGUAGES
    )


def read_corrected(path: str | Path) -> None:
    """Check that a file is a corrected program, which may be replaced.

    Raises
    ------
    InputError
        If it is another file.
    """
    file = read_limited(path, limit_bytes=MAX_BYTES)
    language = language_of(file)
    if language is None or not _MARK.search(language.unpacked(file)):
        raise InputError("it is no program that truearm has corrected", file=path)


def _start_of(start: npt.ArrayLike, n_axes: int) -> FloatArray:
    joints = np.asarray(start, dtype=float)
    if joints.shape != (n_axes,) or not np.isfinite(joints).all():
        raise InputError(f"expected {n_axes} start joints, got {start!r:.60}")
    return joints


@dataclass(frozen=True, eq=False)
class TargetChange:
    """A corrected target.

    Attributes
    ----------
    target : Target
    numbers : mapping of str to bytes
        New texts of the numbers that change.
    edits : tuple of Edit
        All bytes that change: numbers and configuration.
    shift_mm : float
        How far the correction moves the tip.
    joints, nominal : (6,) array
        Of the controller's arm: corrected, and before [rad].
    """

    target: Target
    numbers: Mapping[str, bytes]
    edits: tuple[Edit, ...]
    shift_mm: float
    joints: FloatArray
    nominal: FloatArray


@dataclass(frozen=True, eq=False)
class _Correction:
    """The correction of a program's targets by a model."""

    solver: Solver
    program: Program
    is_first: bool  # not the reverse of another one

    def result(self, path: Path, file: bytes, start: FloatArray | None, spacing_mm: float | None) -> CorrectedProgram:
        """Correct all targets, and write the new program."""
        solver, program = self.solver, self.program
        nominal, reasons = solver.nominal(program.targets, start, program.moves)
        self._check_robot(nominal, reasons, start)
        corrected, shifts = solver.corrected(program.targets, nominal, reasons)
        changes, refused = self._changes(nominal, corrected, shifts, reasons)
        self._check_reversed(refused)
        edits = [edit for change in changes for edit in change.edits]
        notes = [*self._short_frames(), *self._bend(nominal, corrected)]
        good = np.array([not reason for reason in reasons], dtype=bool)
        if good.any():
            readings = solver.targets_of(corrected[good])
            notes += input_remarks(solver.model, readings.session(readings.joints), "in the file of --frames")
        if edits and spacing_mm is not None:
            rows = {id(target): row for row, target in enumerate(program.targets)}
            texts = {rows[id(change.target)]: change.numbers for change in changes}
            done = np.isin(np.arange(len(nominal)), list(texts))[:, None]
            before, after = (np.where(done, joints, np.nan) for joints in (nominal, corrected))
            more, note = divide(solver, program, before, after, texts=texts, spacing_mm=spacing_mm)
            edits += more
            notes.append(note)
        if edits:
            edits += self._marks()
        return CorrectedProgram(
            model=solver.model,
            file=path,
            language=solver.language.title,
            direction=solver.direction,
            changes=tuple(changes),
            refused=tuple(refused),
            left=tuple(sorted(program.left)),
            notes=(*self._other_model(), *program.notes, *notes),
            content=solver.language.packed(with_edits(program.data, edits), file) if edits else file,
        )

    def _check_reversed(self, refused: Sequence[LeftAlone]) -> None:
        """Refuse a reversal after which some targets would still have the correction, without a mark that says so."""
        lacking = [one for one in self.program.left if one.is_literal and "--" in one.reason]
        remain = [] if self.is_first else sorted([*refused, *lacking])
        if remain:
            raise InputError(
                f"{len(remain)} targets would keep the correction, the first {remain[0].name}: {remain[0].reason}",
                line=remain[0].line,
                hint="reverse it with the options that it was corrected with, or take the planned program",
            )

    def _other_model(self) -> Iterator[str]:
        """A note where the correction to be taken away is that of another model."""
        own = model_file_fingerprint(self.solver.model)[:8]
        for mark in _MARK.finditer(self.program.data):
            if mark[2].decode() != own:
                yield (
                    f"The program was corrected with another model ({mark[2].decode()}, this is {own}): what is taken "
                    "away is not what was added."
                )

    def _short_frames(self) -> Iterator[str]:
        """A note of frames that were probably written in metres, each named by the first target that uses it."""
        found: dict[str, str] = {}
        for target in self.program.targets:
            for T, least, said in (
                (target.T_flange_tool, _SHORTEST_TOOL, "tool of {} is {:.4g} mm long"),
                (target.T_base_work, _NEAREST_WORK, "work frame of {} is {:.4g} mm from the base"),
            ):
                length = 0.0 if T is None else float(np.linalg.norm(T[:3, 3]))
                if _NO_FLANGE < length < least:
                    found.setdefault(f"{said}{length:.4g}", said.format(target.name, length))
        for one in found.values():
            yield f"The {one}: correct it if it was meant in metres."

    def _bend(self, nominal: FloatArray, corrected: FloatArray) -> Iterator[str]:
        worst = self.solver.bend(self.program.targets, ends_of(self.program.moves), nominal, corrected)
        if worst is not None:
            yield (
                f"Between two corrected targets a straight move is off by at most {format_mm(worst[0])} (line "
                f"{worst[1]}); a target between them reduces that."
            )

    def _check_robot(self, nominal: FloatArray, reasons: Sequence[str], start: FloatArray | None) -> None:
        """Refuse the program of another robot, or one whose lengths have another unit, in which it has all targets."""
        arm = self.solver.model.arm_
        bad = self._of_others(nominal, reasons)
        is_other, other_unit = len(bad) > _MOST * len(reasons), ""
        for unit, factor in _OTHER_UNITS.items() if len(bad) > max(1, _MANY * len(reasons)) else ():
            scaled = [_scaled(target, factor) for target in self.program.targets]
            if not self._of_others(*self.solver.nominal(scaled, start, self.program.moves)):
                other_unit = f"all are if their lengths are in {unit}; otherwise "
        if is_other or other_unit:
            target, why = self.program.targets[bad[0]], reasons[bad[0]] or "a joint is beyond its limits"
            raise InputError(
                f"{len(bad)} of {len(reasons)} targets are none of {arm.name!r}, the first {target.name}: {why}",
                line=target.line,
                hint=f"{other_unit}give the model of the robot that runs this program, and its frames",
            )

    def _of_others(self, nominal: FloatArray, reasons: Sequence[str]) -> list[int]:
        """Targets that are none of this robot, by their numbers."""
        low, high = self.solver.model.arm_.limits.T
        beyond = ((nominal < low) | (nominal > high)).any(axis=1).tolist()
        return [row for row, reason in enumerate(reasons) if ROBOT in reason or beyond[row]]

    def _changes(
        self, nominal: FloatArray, corrected: FloatArray, shifts: FloatArray, reasons: Sequence[str]
    ) -> tuple[list[TargetChange], list[LeftAlone]]:
        """What changes, target by target in the order of the program, and what is refused."""
        language = self.solver.language
        before, after = (self.solver.machine.axes(joints) for joints in (nominal, corrected))
        poses = self.solver.poses(self.program.targets, corrected)
        stated = self.solver.machine.quantities(corrected).tolist()
        moved = (np.abs(corrected - nominal).max(axis=1) > _UNCHANGED).tolist()
        changes, refused = [], []
        for row, target in sorted(enumerate(self.program.targets), key=lambda one: (one[1].line, one[0])):
            numbers: Mapping[str, bytes] = {}
            edits: list[Edit] = []
            reason = reasons[row]
            if not reason and moved[row]:
                numbers = new_numbers(language, target, language.values(target, after[row], poses[row]))
                if self.is_first and not language.keeps_comments:
                    numbers = with_check_digits(numbers, self.solver.direction)
                edits = [Edit(*target.numbers[name][:2], text) for name, text in numbers.items()]
                try:
                    edits += self._configuration(target, stated[row])
                except InputError as error:
                    reason = error.problem
            if reason:
                refused.append(LeftAlone(target.line, target.name, reason, is_literal=True))
            else:
                changes.append(TargetChange(target, numbers, tuple(edits), float(shifts[row]), after[row], before[row]))
        return changes, refused

    def _configuration(self, target: Target, new: Sequence[float]) -> tuple[Edit, ...]:
        """Edits of the configuration, if a joint is across a border of it; at a border, both sides of it are right."""
        stated = dict(zip(QUANTITIES, new, strict=True))
        has_crossed = False
        for quantity, low, high in target.conditions:
            value = stated[quantity]
            within = min(max(value, low), float(np.nextafter(high, low)))
            if abs(within - value) <= _ON_BORDER:
                stated[quantity] = within
            else:
                has_crossed = True
        return tuple(self.solver.language.configuration(target, stated)) if has_crossed else ()

    def _marks(self) -> Iterator[Edit]:
        """The edit that says that the program is corrected, or that takes away that of the other direction."""
        data, language = self.program.data, self.solver.language
        marks = list(_MARK.finditer(data))
        for match in marks:
            comment = language.mark(self.program, match[0].decode()).text
            at = data.find(comment)
            if at >= 0:
                yield Edit(at, at + len(comment), b"")
            else:  # the controller wrote the line in its own way
                yield Edit(match.start(1), match.end(1), b"undone")
        if self.is_first:
            words = f"truearm {self.solver.direction} {model_file_fingerprint(self.solver.model)[:8]}"
            yield language.mark(self.program, words)


def _scaled(target: Target, factor: float) -> Target:
    """A target with all lengths of its pose multiplied."""
    if target.pose is None:
        return target
    pose = target.pose.copy()
    pose[:3, 3] *= factor
    return replace(target, pose=pose)


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedProgram(Record):
    """A program with corrected targets, and what was not corrected.

    Attributes
    ----------
    model : Compensator
    file : Path
        Of the program as it was.
    language : str
    direction : {"command", "feedback"}
    changes : tuple of TargetChange
        Corrected targets, in the order of the program.
    refused : tuple of LeftAlone
        Targets that cannot be corrected, with reasons.
    left : tuple of LeftAlone
        What has no literal numbers, or whose frames are not known, with reasons.
    notes : tuple of str
    content : bytes
        The new file.
    """

    model: Compensator
    file: Path
    language: str
    direction: TargetDirection
    changes: tuple[TargetChange, ...]
    refused: tuple[LeftAlone, ...]
    left: tuple[LeftAlone, ...]
    notes: tuple[str, ...]
    content: bytes

    @cached_property
    def is_complete(self) -> bool:
        """Whether every target with literal numbers was corrected."""
        return not self.refused and not any(one.is_literal for one in self.left)

    def save(self, path: str | Path) -> None:
        """Write the corrected program.

        Raises
        ------
        InputError
            If no target was corrected, the name has another ending than the program, or cannot be written.
        """
        self.check_output(path)
        if not self.changes:
            raise InputError(self.summary()[:-1], file=path)
        with atomic_file(path) as beside:
            beside.write_bytes(self.content)

    def check_output(self, path: str | Path) -> None:
        """Check that the program can have a file name."""
        if Path(path).suffix.lower() != self.file.suffix.lower():
            raise InputError(
                f"expected a file name that ends in {self.file.suffix}, got {Path(path).name!r}", file=path
            )

    def summary(self) -> str:
        """The answer in one sentence."""
        n = len(self.changes) + len(self.refused) + sum(one.is_literal for one in self.left)
        if not self.changes:
            return f"None of {n} targets corrected: there is nothing to write."
        shifts = [change.shift_mm for change in self.changes]
        return (
            f"{len(self.changes)} of {n} targets corrected ({self.language}); the tip moves by "
            f"{format_mm(float(np.mean(shifts)))} on average, {format_mm(max(shifts))} at most."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        if self.changes:
            yield f"direction {MEANING[self.direction]}"
        yield from listed("refused", [_describe(one) for one in self.refused], "refused targets")
        literal = [_describe(one) for one in self.left if one.is_literal]
        yield from listed("not corrected", literal, "targets that are not corrected")
        others = [_describe(one) for one in self.left if not one.is_literal]
        yield from listed("not changed", others, "motions without numbers of their own")
        yield from self.notes
        yield from self.model.doubts()

    def difference(self) -> TextTable:
        """Old and new numbers of every target that changes, and how far the tip moves."""
        rows = []
        for change in self.changes:
            names = [name for name in change.target.numbers if name in change.numbers]
            old = " ".join(change.target.numbers[name].text.decode("latin-1") for name in names)
            new = " ".join(change.numbers[name].decode("latin-1") for name in names)
            if names:
                rows.append([str(change.target.line), change.target.name, old, new, f"{change.shift_mm:.3f}"])
        return TextTable(("line", "target", "old", "new", "change [mm]"), rows, left_aligned=(1, 2, 3))

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "language": self.language,
            "direction": self.direction,
            "n_corrected": len(self.changes),
            "corrected": [
                {
                    "target": change.target.name,
                    "line": change.target.line,
                    "shift_mm": change.shift_mm,
                    "numbers": {name: text.decode("latin-1") for name, text in change.numbers.items()},
                }
                for change in self.changes
            ],
            "refused": [one._asdict() for one in self.refused],
            "not_changed": [one._asdict() for one in self.left],
            "notes": list(self.notes),
        }


def _describe(one: LeftAlone) -> str:
    place = f"line {one.line}"
    name = one.name.removesuffix(f" in {place}")  # of a target without a name of its own
    return f"{place}, {name}: {one.reason}"
