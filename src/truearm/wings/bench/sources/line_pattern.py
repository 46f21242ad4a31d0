"""Numbers in lines of text from any connection: a line with names in braces for them, in a TOML file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial, reduce
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from truearm.errors import InputError
from truearm.files.toml_documents import read_document
from truearm.readings.readings import LOAD
from truearm.wings.bench.sources.connections import Connection, connected, connector
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS, JointScale
from truearm.wings.bench.sources.sample import SILENT_S, Sample, Source, Stream, samples_in


def text_lines(file: Path, connection: str = "") -> Source:
    """Samples from lines of text.

    Parameters
    ----------
    file : Path
        Of a `LinesDocument`.
    connection : str
        In place of that of the file.

    Raises
    ------
    InputError
        If the file breaks a rule of its format, or no connection is given.
    """
    document = read_document(file, LinesDocument)
    connection = connection or document.connection
    if not connection:
        raise InputError("the key connection is missing", file=file, hint="or write it after the name: FILE@CONNECTION")
    with InputError.of_file(file):
        parse, n_joints = line_parser(document)
        opened = partial(connected, connector(connection), connection, partial(_samples, parse, document.pattern))
        return Source(
            f"lines:{file}@{connection}",
            opened,
            document.prismatic(n_joints),
            has_points="{x_mm}" in document.pattern,
            has_own_clock="{time_s}" in document.pattern,
        )


def lines_of(link: Connection) -> Iterator[str | None]:
    """Lines as they arrive; None once a second while nothing does. What is too long is one line that fits nothing."""
    buffer, skipping = bytearray(), False
    while True:
        data = link.receive(SILENT_S)
        if not data:
            yield None
            continue
        buffer += data.replace(b"\r", b"\n")
        *lines, rest = buffer.split(b"\n")
        for line in lines:
            if line and not skipping:
                yield line[:MOST_CHARACTERS].decode("latin-1")
            skipping = False
        if len(rest) > MOST_CHARACTERS:
            if not skipping:
                yield rest[:MOST_CHARACTERS].decode("latin-1")
            rest, skipping = bytearray(), True
        buffer = rest


def _samples(parse: Parse, pattern: str, link: Connection) -> Stream:
    return samples_in(lines_of(link), parse, f"lines do not fit the pattern {pattern[:60]!a}")


MOST_CHARACTERS = 1000  # of a line; what is longer is noise
LARGEST = 1e9  # of a number
LARGEST_S = 1e10  # of a clock: some state the seconds since 1970

_POINT = ("x_mm", "y_mm", "z_mm")
# No text matches in two ways: the time to refuse a line would grow with a power of its length.
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
# What stands in a number, and so separates none from another; from {skip}, a sign neither.
_IN_NUMBER, _SIGNED = re.compile(r"[\d.eE]*"), re.compile(r"[\d.eE+-]*")
_FIELD = re.compile(r"\{([^{}]*)\}")
_HINT = "pattern = 'A {J1},{J2},{J3} T {temperature_degC}'; docs/live.md lists the names"
Parse = Callable[[str, float], Sample | None]


class LinesDocument(JointScale):
    """The file of a source of text lines.

    Attributes
    ----------
    connection : str
        As of `truearm.wings.bench.sources.connections.connector`; another one may be given on the command line.
    pattern : str
        A line with names in braces for its numbers: J1 .. Jn, x_mm, y_mm, z_mm, temperature_degC, button, time_s,
        payload_kg, load_..; ``{skip}`` is anything without a blank or comma, ``{rest}`` all that follows. Blanks
        before a number do not matter, and any number of them stands where the pattern has one.
    checksum : str
        ``nmea``: lines end in ``*`` and the exclusive or of the characters between ``$`` and ``*``, in two digits.
    """

    connection: str = ""
    pattern: Annotated[str, Field(min_length=1, max_length=MOST_CHARACTERS)]
    checksum: Literal["nmea"] | None = None


def line_parser(document: LinesDocument) -> tuple[Parse, int]:
    """What turns a line and the time of its arrival into a sample, or None, and the number of joints.

    Raises
    ------
    InputError
        If the pattern has an unknown name, a name twice, or neither joints J1 .. Jn nor a point, or a line could fit it
        in two ways.
    """
    names = [name for name in _FIELD.findall(document.pattern) if name not in ("skip", "rest")]
    joints = sorted(int(name[1:]) for name in names if re.fullmatch(r"J[1-9]\d?", name))
    points = [name for name in names if name in _POINT]
    known = {f"J{joint}" for joint in joints} | {*_POINT, "temperature_degC", "button", "time_s"}
    if unknown := [name for name in names if name not in known and not LOAD.fullmatch(name)]:
        raise InputError(f"unknown name in the pattern: {{{unknown[0]:.40}}}", hint=_HINT)
    if len(set(names)) != len(names):
        raise InputError("a name is twice in the pattern", hint=_HINT)
    if joints != [*range(1, len(joints) + 1)] or len(joints) > MOST_JOINTS or len(points) not in (0, 3):
        raise InputError("expected the joints J1, J2, .. or x_mm, y_mm and z_mm in the pattern", hint=_HINT)
    if not joints and not points:
        raise InputError("the pattern names neither joints nor a point", hint=_HINT)
    _check_separated(document.pattern.strip())
    expression, decode = _expression(document.pattern), document.decoder(len(joints))
    extra = [name for name in names if LOAD.fullmatch(name)]

    def parse(line: str, arrived_s: float) -> Sample | None:
        checked = _without_checksum(line) if document.checksum else line
        match = None if checked is None else expression.fullmatch(checked.strip())
        numbers = {} if match is None else dict(zip(names, map(float, match.groups()), strict=True))
        time_s = numbers.pop("time_s", arrived_s)
        if not numbers or max(map(abs, numbers.values())) > LARGEST or abs(time_s) > LARGEST_S:
            return None
        return Sample(
            time_s,
            decode([numbers[f"J{joint}"] for joint in joints]),
            np.array([numbers[axis] for axis in _POINT]) if points else None,
            numbers.get("temperature_degC"),
            numbers.get("button", 0) != 0,
            columns={name: numbers[name] for name in extra},
        )

    return parse, len(joints)


def _check_separated(pattern: str) -> None:
    """Refuse fields of which a line does not show where one ends: it could fit in many ways, which are all tried."""
    parts = _FIELD.split(pattern)
    names, literals = parts[1::2], parts[2::2]
    if "rest" in names and (names.index("rest") < len(names) - 1 or literals[-1]):
        raise InputError("{rest} is all that follows, and has to be the last in the pattern", hint=_HINT)
    after_skip = False
    for name, literal, following in zip(names, literals, [*names[1:], ""], strict=True):
        if name == "skip" and after_skip:
            raise InputError(
                "two {skip} with neither a blank nor , nor ; between them match the same characters",
                hint="one {skip} for both",
            )
        of_numbers = _IN_NUMBER if name != "skip" else _SIGNED
        if following not in ("", "rest") and not literal.isspace() and of_numbers.fullmatch(literal.strip()):
            raise InputError(
                f"what separates {{{name:.40}}} from {{{following:.40}}} may belong to either",
                hint="separate them by what the device writes between them, such as a comma or a blank",
            )
        is_parted = literal.isspace() or "," in literal or ";" in literal
        after_skip = (name == "skip" or after_skip) and not is_parted


def _expression(pattern: str) -> re.Pattern[str]:
    """The pattern as a regular expression with a group for each number. Nothing in it can match in two ways."""
    parts = _FIELD.split(pattern.strip())
    text = ""
    for literal, name in zip(parts[::2], [*parts[1::2], ""], strict=True):
        blank = r"\s+" if literal.isspace() else r"\s*"
        text += blank.join(re.escape(piece) for piece in re.split(r"\s+", literal))
        text += {"": "", "skip": r"[^\s,;]*", "rest": r".*"}.get(
            name, f"({_NUMBER})" if literal[-1:].isspace() else rf"\s*({_NUMBER})"
        )
    return re.compile(text, re.ASCII)


def _without_checksum(line: str) -> str | None:
    """The line between ``$`` and ``*``, with both; None if the checksum is not its."""
    body, star, check = line.strip().rpartition("*")
    start = body.find("$") + 1
    value = reduce(lambda total, character: total ^ ord(character), body[start:], 0)
    return body if star and f"{value:02X}" == check.upper() else None
