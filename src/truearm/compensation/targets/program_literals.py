"""Joint targets in the literal forms of four robot languages, to be copied into a program.

========= =================================================================== ==========================
language  a target                                                            sources
========= =================================================================== ==========================
urscript  ``movej([q1, .., q6], a=.., v=..)``, rad                            URScript manual, movej
rapid     ``CONST jointtarget c1 := [[q1, .., q6],[9E9, .., 9E9]];``, deg     RAPID manual, jointtarget
krl       ``DECL AXIS XC1={A1 .., .. A6 ..}``, deg                            KRL, structure AXIS
fanuc     ``P[1]{ GP1: UF : 0, UT : 1, J1= .. deg, .. };``, deg               ASCII .LS, /POS
========= =================================================================== ==========================

All four are for six turning joints. The angles are those of the arm's model: a controller with another zero, sign or
coupling (Fanuc counts J3 from the horizontal, so that it changes with J2) needs them converted first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray

N_JOINTS = 6
_FREE = ",".join(["9E9"] * 6)  # external axes that are not there


@dataclass(frozen=True)
class Language:
    """How a language writes targets.

    Attributes
    ----------
    suffix : str
        Of its files.
    comment : str
        What begins a comment.
    before, after : tuple of str
        Lines around the targets.
    literal : callable
        The line of a target, from its number and its joints (6,) [rad].
    note : str
        What a person must do before the program runs.
    instead : callable
        Lines in place of a refused target, from what is to be said of it.
    """

    suffix: str
    comment: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    literal: Callable[[int, FloatArray], str]
    note: str
    instead: Callable[[str], tuple[str, ...]] = lambda _: ()


def _rad(joints: FloatArray) -> str:
    return ", ".join(f"{q:.9f}" for q in joints.tolist())


def _deg(joints: FloatArray) -> list[str]:
    return [f"{q:.6f}" for q in np.degrees(joints).tolist()]


def _rapid(number: int, joints: FloatArray) -> str:
    return f"    CONST jointtarget c{number} := [[{','.join(_deg(joints))}],[{_FREE}]];"


def _krl(number: int, joints: FloatArray) -> str:
    return f"DECL AXIS XC{number}={{{','.join(f'A{i} {q}' for i, q in enumerate(_deg(joints), 1))}}}"


def _fanuc(number: int, joints: FloatArray) -> str:
    angles = [f"\tJ{i}= {q} deg" for i, q in enumerate(_deg(joints), 1)]
    lines = [",".join(angles[:3]), ",".join(angles[3:])]
    return f"P[{number}]{{\n   GP1:\n\tUF : 0, UT : 1,\n" + ",\n".join(lines) + "\n};"


def _stop(text: str) -> tuple[str, ...]:
    """The program would move from the target before to the one after, on a way that nobody planned."""
    quoted = text.replace('"', "'").replace("\\", "/")
    return (f'  popup("{quoted}", title="Refused target", error=True, blocking=True)', "  halt")


LANGUAGES: dict[str, Language] = {
    "urscript": Language(
        ".script",
        "#",
        ("def corrected_targets():", "  acceleration = 0.3", "  speed = 0.2"),
        ("end",),
        lambda _, joints: f"  movej([{_rad(joints)}], a=acceleration, v=speed)",
        "acceleration in rad/s^2, speed in rad/s: set them for your cell",
        _stop,
    ),
    "rapid": Language(
        ".mod",
        "!",
        ("MODULE CorrectedTargets",),
        ("ENDMODULE",),
        _rapid,
        "use them with MoveAbsJ; the tool and its load are those of your program",
    ),
    "krl": Language(
        ".dat",
        ";",
        ("DEFDAT CORRECTED_TARGETS PUBLIC",),
        ("ENDDAT",),
        _krl,
        "use them with PTP; $TOOL and the robot's own accuracy option must be as they were in the readings",
    ),
    "fanuc": Language(
        ".ls",
        "!",
        ("/POS",),
        ("/END",),
        _fanuc,
        "copy the positions into the /POS part of a program; J3 here does not change with J2: convert it first",
    ),
}


def program_text(
    language: str,
    joints: FloatArray,
    *,
    labels: Sequence[str],
    reasons: Sequence[str],
    prismatic: BoolArray,
    header: Sequence[str],
) -> str:
    """Targets in a robot language. Refused ones are comments that name them: nothing moves there.

    A program of motions (URScript) stops in their place with the reason; the other languages declare targets, and one
    that is absent is an error of the program that uses it.

    Parameters
    ----------
    language : str
        One of `LANGUAGES`.
    joints : (n, 6) array
        [rad]; those of refused targets are not used.
    labels, reasons : sequence of str
        Name of each target, and why it was refused; empty for the others.
    prismatic : (n_joints,) bool array
    header : sequence of str
        Lines for comments at the beginning.

    Raises
    ------
    InputError
        If the language is unknown, or the arm has other than six turning joints.
    """
    chosen = check_language(language, prismatic)
    lines = [f"{chosen.comment} {line}" for line in (*header, chosen.note)]
    lines += chosen.before
    for number, (q, label, reason) in enumerate(zip(joints, labels, reasons, strict=True), 1):
        name = _printable(label)
        if reason:
            lines.append(f"{chosen.comment} {number} {name}: REFUSED, {_printable(reason)}")
            lines += chosen.instead(f"{number} {name}: {_printable(reason)}")
        else:
            lines += [f"{chosen.comment} {number} {name}", chosen.literal(number, q)]
    return "\n".join([*lines, *chosen.after]) + "\n"


def check_language(language: str, prismatic: BoolArray) -> Language:
    """The language of a name, if it can state the joints of the arm.

    Raises
    ------
    InputError
        As `program_text`.
    """
    if language not in LANGUAGES:
        raise InputError(f"expected a language among {', '.join(LANGUAGES)}, got {language!r}")
    if len(prismatic) != N_JOINTS or prismatic.any():
        joints = f"{len(prismatic)} joints, {int(prismatic.sum())} of them sliding"
        raise InputError(
            f"literals of {language} are for six turning joints, and the arm has {joints}",
            hint="write a .csv, and map the joints to those of the controller yourself",
        )
    return LANGUAGES[language]


def _printable(text: str) -> str:
    """A text of one line of ASCII: names come from files, and a line break would end the comment."""
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)
