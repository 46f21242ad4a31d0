"""Text lines: numbers in lines of text, by a pattern; from any connection."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from truearm.errors import InputError
from truearm.files.toml_documents import read_document
from truearm.wings.bench.sources.connections import Connection, connected, connector
from truearm.wings.bench.sources.decoded_messages import SILENT_S, samples_in
from truearm.wings.bench.sources.line_pattern import MOST_CHARACTERS, LinesDocument, Parse, line_parser
from truearm.wings.bench.sources.sample import Source, Stream


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
        opened = partial(connected, connector(connection), connection, partial(_samples, parse, document.pattern))
        return Source(
            f"lines:{file}@{connection}",
            opened,
            document.prismatic(n_joints),
            has_points="{x_mm}" in document.pattern,
            has_own_clock="{time_s}" in document.pattern,
        )
    except InputError as error:
        raise error.in_file(file) from None


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
