"""Further targets on the straight moves of a program, so that the tip keeps to the line between two corrected ends."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.typing import FloatArray
from truearm.wings.exports.programs.branches import QUANTITIES
from truearm.wings.exports.programs.number_texts import new_numbers
from truearm.wings.exports.programs.program import (
    COMES_FROM,
    WRITTEN_OTHERWISE,
    Language,
    Move,
    Passing,
    Program,
    Target,
)
from truearm.wings.exports.programs.solving import PathEnds, Solver, ends_of
from truearm.wings.exports.targets import TargetDirection
from truearm.wings.exports.targets.edits import Edit, with_edits

MIN_SPACING_MM = 1.0
_NAMED = 5
# A move is looked at in at least so many steps. In one of them a joint moves by at most so many times what it moves in
# those beside it, and a little [rad].
_FINEST, _TIMES, _STEP = 16, 2.0, np.radians(1.0)
# Corrected joints are further away only beside a singular pose [rad].
_CORRECTION = np.radians(5.0)


class _Path(NamedTuple):
    """A straight move that further targets divide into `n` parts, and places along it, `fine` of each part."""

    ends: PathEnds
    move: Move
    n: int
    fine: int

    @property
    def n_places(self) -> int:
        """Places between the ends, those of further targets included."""
        return self.n * self.fine - 1


def check_subdivision(language: Language, spacing_mm: float, direction: TargetDirection) -> None:
    """Check that a program takes further targets.

    Raises
    ------
    InputError
        If it does not.
    """
    if language.takes_no_targets:
        raise InputError(
            f"no target can be added to a {language.title}: {language.takes_no_targets}",
            hint="omit the subdivision, and teach targets between",
        )
    if not MIN_SPACING_MM <= spacing_mm < np.inf:
        raise InputError(f"expected a subdivision of at least {MIN_SPACING_MM:g} mm, got {spacing_mm:g}")
    if direction != "command":
        raise InputError("a subdivision applies to the direction command only")


def divide(
    solver: Solver,
    program: Program,
    nominal: FloatArray,
    corrected: FloatArray,
    *,
    texts: Mapping[int, Mapping[str, bytes]],
    spacing_mm: float,
) -> tuple[list[Edit], str]:
    """Moves to further targets, as edits, and a note on how far the tip is off with them.

    Parameters
    ----------
    solver : Solver
    program : Program
    nominal, corrected : (n, 6) array
        Joints of the program's targets; NaN where one is not corrected.
    texts : mapping of int to mapping
        New texts of the numbers of corrected targets.
    spacing_mm : float
    """
    language = solver.language
    paths, others = _paths(solver, program, nominal, spacing_mm)
    edits, away, n_added = [], [], 0
    for path, targets, joints, reasons in _followed(solver, program, nominal, paths):
        new, after, reason = joints, np.nan, next(filter(None, reasons), "")
        if not reason:
            new, _ = solver.corrected(targets, joints, reasons)
            reason = next(filter(None, reasons), "") or _jump(path, nominal, joints, new)
        if not reason:
            before, after = _bends(solver, program, path, corrected, (targets, new))
            reason = "" if after < before else "the tip keeps no nearer to the line"
        if reason:
            others[path.move.line] = reason
            continue
        between = new[path.fine - 1 :: path.fine]
        points = _points(solver, program, path, between, texts[path.ends.end])
        assert isinstance(path.move.passing, Passing)  # of a divided move
        zone = language.zone(spacing_mm)
        text = b"".join(path.move.passing.text(one, zone) for one in points)
        edits.append(Edit(path.move.passing.at, path.move.passing.at, text))
        away.append((after, path.ends))
        n_added += len(between)
    divided = {ends for _, ends in away}
    rest = [ends for ends in ends_of(program.moves) if ends not in divided]
    worst = solver.bend(program.targets, rest, nominal, corrected)
    worst = max([*([] if worst is None else [worst]), *((after, ends.line) for after, ends in away)], default=None)
    off = "" if worst is None else f": a straight move is off by at most {format_mm(worst[0])} (line {worst[1]})"
    note = _not_divided(others)
    if not n_added:
        return [], f"No move has a target added ({spacing_mm:g} mm).{note}"
    return edits, f"With {n_added} targets added between, {spacing_mm:g} mm apart at most{off}.{note}"


def _not_divided(others: Mapping[int, str]) -> str:
    """The lines of moves that are not divided, with their reasons."""
    lines = defaultdict(list)
    for line, reason in sorted(others.items()):
        lines[reason].append(line)
    if not lines:
        return ""
    shown = [
        f"line {', '.join(map(str, some[:_NAMED]))}{' and others' if len(some) > _NAMED else ''} ({reason})"
        for reason, some in lines.items()
    ]
    return f" Not divided: {'; '.join(shown)}."


def _paths(
    solver: Solver, program: Program, nominal: FloatArray, spacing_mm: float
) -> tuple[list[_Path], dict[int, str]]:
    """Straight moves longer than a spacing, and why others cannot be divided, by their lines."""
    targets, tools = program.targets, solver.tools(program.targets, nominal)
    blend = solver.language.blend_mm(spacing_mm)
    found, others = [], {}
    for last, move in pairwise([Move(0, "joint", None), *program.moves]):
        if move.kind == "circular":
            others[move.line] = "circular"
        if move.kind != "linear":
            continue
        if move.target is None or np.isnan(nominal[move.target]).any():
            others[move.line] = "its target is not corrected"
        elif last.target is None or np.isnan(nominal[last.target]).any():
            others[move.line] = "the target before it is not corrected" if last.line else COMES_FROM
        else:
            one, end = targets[last.target], targets[move.target]
            length = float(np.linalg.norm(tools[last.target, :3, 3] - tools[move.target, :3, 3]))
            n = ceil(length / spacing_mm - 1e-9)
            stay = [number.value for number in one.external] == [number.value for number in end.external]
            same = end.T_flange_tool is not None and one.T_flange_tool is end.T_flange_tool
            if n < 2:
                continue
            if isinstance(move.passing, str) or end.span is None:
                others[move.line] = move.passing if isinstance(move.passing, str) else WRITTEN_OTHERWISE
            elif not move.follows or not last.is_certain:
                others[move.line] = COMES_FROM
            elif not move.is_certain:
                others[move.line] = "its target may have several values"
            elif not (stay and same):
                others[move.line] = "another tool, or external axes that move"
            elif blend and not max(last.blend_mm, move.blend_mm) + blend < length / n:
                others[move.line] = "the blends of its ends would overlap those of targets between"
            elif move.target == last.target:
                continue
            else:
                ends = PathEnds(last.target, move.target, move.line)
                found.append(_Path(ends, move, n, 2 * ceil(_FINEST / n / 2)))
    return found, others


def _followed(
    solver: Solver, program: Program, nominal: FloatArray, paths: Sequence[_Path]
) -> Iterator[tuple[_Path, list[Target], FloatArray, list[str]]]:
    """Targets at all places of each path, and their joints: each those nearest to the ones before it."""
    tools = solver.tools(program.targets, nominal)
    at = [nominal[path.ends.start] for path in paths]
    found: list[list[Target]] = [[] for _ in paths]
    rows: list[list[FloatArray]] = [[] for _ in paths]
    reasons: list[list[str]] = [[] for _ in paths]
    for step in range(max((path.n_places for path in paths), default=0)):
        going = [k for k, path in enumerate(paths) if step < path.n_places and not any(reasons[k])]
        some = []
        for k in going:
            end, share = program.targets[paths[k].ends.end], (step + 1) / (paths[k].n_places + 1)
            pair = [paths[k].ends.start, paths[k].ends.end]
            some.append(solver.between(end, np.array([at[k], at[k]]), tools[pair], share))
        joints, why = solver.nominal(some, None)
        for k, target, q, reason in zip(going, some, joints, why, strict=True):
            at[k] = q
            found[k].append(target)
            rows[k].append(q)
            reasons[k].append(reason)
    for path, targets, followed, said in zip(paths, found, rows, reasons, strict=True):
        yield path, targets, np.array(followed), said


def _jump(path: _Path, nominal: FloatArray, joints: FloatArray, corrected: FloatArray) -> str:
    """Why a path is not one for further targets: a joint moves by far more in a step than in those beside it."""
    ends = nominal[[path.ends.start]], nominal[[path.ends.end]]
    steps = np.abs(np.diff(np.concatenate([ends[0], joints, ends[1]]), axis=0)).max(axis=1)
    beside = np.maximum(np.append(steps[1:], 0.0), np.insert(steps[:-1], 0, 0.0))
    far = (steps > _TIMES * beside + _STEP).any() or not (np.abs(corrected - joints).max() < _CORRECTION)
    return "a joint would jump" if far else ""


def _bends(
    solver: Solver, program: Program, path: _Path, corrected: FloatArray, places: tuple[list[Target], FloatArray]
) -> tuple[float, float]:
    """How far the tip is off the line between its ends, and off those between the targets that divide it [mm]."""
    start, end, _ = path.ends
    all_targets = [program.targets[start], *places[0], program.targets[end]]
    tips = solver.tools(all_targets, np.concatenate([corrected[[start]], places[1], corrected[[end]]]))[:, :3, 3]
    off = []
    for n_steps in (len(tips) - 1, path.fine):
        share = (np.arange(len(tips) - 1) % n_steps / n_steps)[:, None]
        first = np.arange(len(tips) - 1) // n_steps * n_steps
        line = tips[first] + share * (tips[first + n_steps] - tips[first])
        off.append(float(np.linalg.norm(tips[:-1] - line, axis=1).max()))
    return off[0], off[1]


def _points(
    solver: Solver, program: Program, path: _Path, joints: FloatArray, texts: Mapping[str, bytes]
) -> Iterator[bytes]:
    """What states the targets that divide a path, at corrected joints."""
    language, machine, end = solver.language, solver.machine, program.targets[path.ends.end]
    # With the numbers that it is corrected to: their decimals are those of targets beside it.
    corrected = {name: one._replace(text=texts.get(name, one.text)) for name, one in end.numbers.items()}
    end = replace(end, numbers=corrected)
    poses, all_quantities = solver.poses([end] * len(joints), joints), machine.quantities(joints).tolist()
    for axes, pose, quantities in zip(machine.axes(joints), poses, all_quantities, strict=True):
        numbers = new_numbers(language, end, language.values(end, axes, pose))
        stated = dict(zip(QUANTITIES, quantities, strict=True))
        configuration = language.configuration(end, stated) if end.conditions else ()
        yield _point(program.data, end, numbers, configuration)


def _point(data: bytes, end: Target, numbers: Mapping[str, bytes], configuration: Iterable[Edit]) -> bytes:
    """What states a target, in the form of another one."""
    assert end.span is not None  # of a divided move
    start, stop = end.span
    texts = {one.start: (one.end, numbers.get(name, one.text)) for name, one in end.numbers.items()}
    for edit in configuration:
        texts[edit.start] = (edit.end, edit.text)
    edits = [Edit(at - start, to - start, text) for at, (to, text) in texts.items() if start <= at < stop]
    return with_edits(data[start:stop], edits)
