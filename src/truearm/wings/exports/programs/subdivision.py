"""Further targets on the straight moves of a program, so that the tip keeps to the line between two corrected ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.typing import FloatArray
from truearm.wings.exports.programs.configurations import QUANTITIES
from truearm.wings.exports.programs.number_texts import new_numbers
from truearm.wings.exports.programs.program import Edit, Language, Move, Number, Program, Target, inverse, with_edits
from truearm.wings.exports.programs.solving import PathEnds, Solver, ends_of, straight_moves
from truearm.wings.exports.targets import TargetDirection

MIN_SPACING_MM = 1.0
_NAMED = 5


class _Divided(NamedTuple):
    """A move by the numbers of its ends, with the targets that divide it evenly."""

    ends: PathEnds
    move: Move
    between: list[Target]


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
    divided, others = _divided(solver, program, nominal, spacing_mm)
    between = [target for one in divided for target in one.between]
    note = ""
    if others:
        lines = ", ".join(map(str, others[:_NAMED])) + (" and others" if len(others) > _NAMED else "")
        note = (
            f" Not divided: line {lines} (circular, not certain where the arm comes from, or written in another way)."
        )
    if not between:
        return [], f"No move has a target added ({spacing_mm:g} mm).{note}"
    joints, reasons = solver.nominal(between, None)
    new, _ = solver.corrected(between, joints, reasons)
    axes, flanges = solver.machine.axes(new), solver.flange(new)
    quantities = solver.machine.quantities(new).tolist()
    edits, paths, n_added, first = [], {one: [one] for one in ends_of(program.moves)}, 0, 0
    for ends, move, some in divided:
        rows, first = range(first, first + len(some)), first + len(some)
        if any(reasons[row] for row in rows):
            continue
        assert move.passing is not None  # of a divided move
        end = _with_texts(program.targets[ends.end], texts[ends.end])
        points = []
        for row in rows:
            pose = None
            if end.T_base_work is not None and end.T_flange_tool is not None:
                pose = inverse(end.T_base_work) @ flanges[row] @ end.T_flange_tool
            numbers = new_numbers(language, end, language.values(end, axes[row], pose))
            stated = dict(zip(QUANTITIES, quantities[row], strict=False))
            configuration = language.configuration(end, stated) if end.conditions else ()
            points.append(
                move.passing.text(_point(program.data, end, numbers, configuration), language.zone(spacing_mm))
            )
        edits.append(Edit(move.passing.at, move.passing.at, b"".join(points)))
        places = [ends.start, *(len(nominal) + row for row in rows), ends.end]
        paths[ends] = [PathEnds(a, b, ends.line) for a, b in pairwise(places)]
        n_added += len(some)
    pairs = [pair for path in paths.values() for pair in path]
    everything = [*program.targets, *between]
    worst = solver.bend(everything, pairs, np.concatenate([nominal, joints]), np.concatenate([corrected, new]))
    off = "" if worst is None else f": a straight move is off by at most {format_mm(worst[0])} (line {worst[1]})"
    return edits, f"With {n_added} targets added between, {spacing_mm:g} mm apart at most{off}.{note}"


def _divided(
    solver: Solver, program: Program, nominal: FloatArray, spacing_mm: float
) -> tuple[list[_Divided], list[int]]:
    """Straight moves longer than a spacing, and the lines of moves that cannot be divided."""
    targets, tools = program.targets, solver.tools(program.targets, nominal)
    found, others = [], [move.line for move in program.moves if move.kind == "circular"]
    for ends, move in straight_moves(program.moves):
        one, end, pair = targets[ends.start], targets[ends.end], [ends.start, ends.end]
        length = np.linalg.norm(tools[ends.start, :3, 3] - tools[ends.end, :3, 3])
        if not length > spacing_mm:
            continue
        stay = [number.value for number in one.external] == [number.value for number in end.external]
        same = end.T_flange_tool is not None and one.T_flange_tool is end.T_flange_tool
        if move.passing is None or end.span is None or not (stay and same and move.follows):
            others.append(move.line)
            continue
        n = ceil(length / spacing_mm - 1e-9)
        between = [solver.between(end, nominal[pair], tools[pair], i / n) for i in range(1, n)]
        found.append(_Divided(ends, move, between))
    return found, sorted(set(others))


def _with_texts(target: Target, texts: Mapping[str, bytes]) -> Target:
    """A target with the numbers that it is corrected to, whose decimals are those of targets beside it."""
    numbers = {name: Number(one.start, one.end, texts.get(name, one.text)) for name, one in target.numbers.items()}
    return replace(target, numbers=numbers)


def _point(data: bytes, end: Target, numbers: Mapping[str, bytes], configuration: Iterable[Edit]) -> bytes:
    """What states a target, in the form of another one."""
    assert end.span is not None  # of a divided move
    start, stop = end.span
    texts = {one.start: (one.end, numbers.get(name, one.text)) for name, one in end.numbers.items()}
    for edit in configuration:
        texts[edit.start] = (edit.end, edit.text)
    edits = [Edit(at - start, to - start, text) for at, (to, text) in texts.items() if start <= at < stop]
    return with_edits(data[start:stop], edits)
