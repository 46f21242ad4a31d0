"""What ``truearm correct`` does with a robot program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from truearm.files.file_reading import read_limited
from truearm.models import Compensator
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_output
from truearm.wings.exports.programs.correct_program import MAX_BYTES, correct_program, read_corrected
from truearm.wings.exports.programs.languages import UNREADABLE, language_of
from truearm.wings.exports.programs.program import N_AXES


def is_program(path: Path) -> bool:
    """Whether a file is a program: of a known language, or one that cannot be read."""
    return path.suffix.lower() in UNREADABLE or language_of(read_limited(path, limit_bytes=MAX_BYTES)) is not None


def slides_of(model: Compensator) -> list[bool]:
    """Which axes of a program are in mm: without the rail under a robot."""
    slides: list[bool] = model.arm_.chain.is_prismatic.tolist()
    return slides[1:] if len(slides) > N_AXES else slides


def run(
    model: Compensator,
    program: Path,
    out: Path,
    *,
    start: list[float] | None,
    frames: Path | None,
    subdivide_mm: float | None,
    diff: bool,
    as_json: bool,
    direction: Any,
    untrained: Any,
) -> int:
    """Correct a program and print what was done; returns the exit code of the command."""
    check_output(out, program, frames, endings=(program.suffix,), read=read_corrected)
    with progress(f"correcting {program.name}"):
        corrected = correct_program(
            model,
            program,
            direction=direction,
            frames=frames,
            start=start,
            subdivide_mm=subdivide_mm,
            untrained=untrained,
        )
        if corrected.changes:
            corrected.save(out)
    print_record(corrected, as_json=as_json, files={"program": out if corrected.changes else None})
    if diff and corrected.changes and not as_json:
        print_line(str(corrected.difference()))
    return 0 if corrected.is_complete else 1 if corrected.changes else 3
