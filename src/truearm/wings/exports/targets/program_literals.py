"""Joint targets in the literal forms of four robot languages, to be copied into a program.

========= =================================================================== ==========================
language  a target                                                            sources
========= =================================================================== ==========================
urscript  ``movej([q1, .., q6], a=.., v=..)``, rad                            URScript manual, movej
rapid     ``CONST jointtarget c1 := [[q1, .., q6],[9E9, .., 9E9]];``, deg     RAPID manual, jointtarget
krl       ``DECL AXIS XC1={A1 .., .. A6 ..}``, deg                            KRL, structure AXIS
fanuc     ``P[1]{ GP1: UF : 0, UT : 1, J1= .. deg, .. };``, deg               ASCII .LS, /POS
========= =================================================================== ==========================

All four are for six turning joints, with the zeros and signs of the arm's model. A Fanuc controller counts J3 from the
horizontal: its forearm keeps its direction where J2 alone turns (ros-industrial/fanuc#186, fanuc_experimental#17). The
model's J3 is the angle between the links; which of both is written must be stated (`FanucJ3`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from truearm.errors import InputError
from truearm.typing import BoolArray, FloatArray
from truearm.wings.exports.targets import FanucJ3 as FanucJ3

N_JOINTS = 6
# Cosine of the angle between the axes of J2 and J3: real arms are a milliradian off parallel.
_PARALLEL = 0.999
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
    "fanuc": Language(".ls", "!", ("/POS",), ("/END",), _fanuc, "copy the positions into the /POS part of a program"),
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


def check_fanuc_j3(language: str | None, fanuc_j3: str | None) -> None:
    """Refuse targets for a Fanuc controller without a statement of how it counts J3, and the statement without them.

    Raises
    ------
    InputError
    """
    if language != "fanuc" and fanuc_j3 is not None:
        raise InputError("how a Fanuc controller counts J3 applies to targets for it only", hint="omit --fanuc-j3")
    if language == "fanuc" and fanuc_j3 not in get_args(FanucJ3):
        raise InputError(
            "a Fanuc controller counts J3 from the horizontal (coupled with J2), the model from the link before: state "
            f"which one to write, {' or '.join(get_args(FanucJ3))}",
            hint="--fanuc-j3 coupled for what the teach pendant shows; independent where your program converts it",
        )


def fanuc_joints(joints: FloatArray, fixed: FloatArray) -> FloatArray:
    """Joints as a Fanuc controller counts them: J3 as the direction of the forearm, which J2 alone does not turn.

    Parameters
    ----------
    joints : (n, 6) array
        Those of the model [rad].
    fixed : (7, 4, 4) array
        The constant motions of the nominal chain: its axes of J2 and J3 say in which sense both add up.

    Raises
    ------
    InputError
        If the axes of J2 and J3 are not parallel.
    """
    cosine = float(fixed[2][2, 2])  # of the axis of J3, in the frame of J2
    if abs(cosine) < _PARALLEL:
        raise InputError(
            "J3 cannot be counted from the horizontal: the axes of J2 and J3 of this arm are not parallel",
            hint="--fanuc-j3 independent writes the model's own J3",
        )
    counted = joints.copy()
    counted[:, 2] += np.sign(cosine) * joints[:, 1]
    return counted


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
