"""Text lines: numbers in lines of text, by a pattern; from any connection."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from functools import partial, reduce
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from truearm.errors import InputError
from truearm.files.toml_documents import read_document
from truearm.readings.readings import LOAD
from truearm.sources.connections import Connection, connected, connector
from truearm.sources.joint_scale import MOST_JOINTS, JointScale
from truearm.sources.sample import Notice, Sample, Source, Stream

MOST_CHARACTERS = 1000  # of a line; what is longer is noise
LARGEST = 1e9  # of a number
SILENT_S = 1.0

_POINT = ("x_mm", "y_mm", "z_mm")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FIELD = re.compile(r"\{([^{}]*)\}")
_HINT = "pattern = 'A {J1},{J2},{J3} T {temperature_degC}'; docs/live.md lists the names"


class LinesDocument(JointScale):
    """The file of a source of text lines.

    Attributes
    ----------
    connection : str
        As of `truearm.sources.connections.connector`; another one may be given on the command line.
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
    try:
        parse, n_joints = line_parser(document)
        opened = partial(connected, connector(connection), connection, partial(_samples, parse))
        return Source(f"lines:{file}@{connection}", opened, document.prismatic(n_joints), "{x_mm}" in document.pattern)
    except InputError as error:
        raise InputError(error.problem, file=file, hint=error.hint) from None


def line_parser(document: LinesDocument) -> tuple[Callable[[str, float], Sample | None], int]:
    """What turns a line and the time of its arrival into a sample, or None, and the number of joints.

    Raises
    ------
    InputError
        If the pattern has an unknown name, a name twice, or neither joints J1 .. Jn nor a point.
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
    expression, decode = _expression(document.pattern), document.decoder(len(joints))
    extra = [name for name in names if LOAD.fullmatch(name)]

    def parse(line: str, arrived_s: float) -> Sample | None:
        checked = _without_checksum(line) if document.checksum else line
        match = None if checked is None else expression.fullmatch(checked.strip())
        numbers = {} if match is None else dict(zip(names, map(float, match.groups()), strict=True))
        if not numbers or max(map(abs, numbers.values())) > LARGEST:
            return None
        return Sample(
            numbers.get("time_s", arrived_s),
            decode([numbers[f"J{joint}"] for joint in joints]),
            np.array([numbers[axis] for axis in _POINT]) if points else None,
            numbers.get("temperature_degC"),
            numbers.get("button", 0) != 0,
            {name: numbers[name] for name in extra},
        )

    return parse, len(joints)


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


def _samples(parse: Callable[[str, float], Sample | None], link: Connection) -> Stream:
    ignored, last, said_s = 0, "", -SILENT_S
    for line in lines_of(link):
        now_s = time.monotonic()
        sample = None if line is None else parse(line, now_s)
        if sample is not None:
            yield sample
        elif line is None:
            yield Notice("nothing was received for a second")
        else:
            ignored, last = ignored + 1, line
        if ignored and now_s - said_s >= SILENT_S:
            yield Notice(f"{ignored} lines do not fit the pattern, the last {last[:60]!a}; ignored")
            ignored, said_s = 0, now_s
