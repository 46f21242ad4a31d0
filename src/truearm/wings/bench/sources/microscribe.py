"""MicroScribe arms (3D, 3DX, 3DL, G2): encoder counts by polling, over a serial port; read only.

Bytes of an answer's content are below 0x80, its first byte is the request with bit 7 set: an answer begins where such a
byte stands. A count is 14 bits in two bytes; the arm states its counts per turn, less one.

The maker's own constants of a MicroScribe, which the arm states: a modified Denavit-Hartenberg table, identified.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from math import pi, tau

import numpy as np

from truearm.arm import Arm, DHTable
from truearm.arm.denavit_hartenberg import motion_across
from truearm.arm.rigid_motions import screw_z
from truearm.errors import InputError, TruearmError
from truearm.typing import FloatArray
from truearm.wings.bench.sources.connections import Connection, connected, connector
from truearm.wings.bench.sources.sample import Sample, Source, Stream

GET_PARAMETERS, GET_EXTENDED = 0xC0, 0xD3
GET_NAME, GET_MODEL, GET_SERIAL_NUMBER, GET_COMMENT, GET_FORMAT = 0xC8, 0xCA, 0xCB, 0xCC, 0xCD
FORMAT, SIZE, ROWS = "Format DH0.5", 36, 6
ANGLE_RAD, LENGTH_MM = pi / 32768, 25.4 / 1000  # of a count
_BETA_ROW = 2  # the third axis is nearly parallel to the second


def microscribe_arm(connection: str) -> Arm:
    """The arm that is connected, with its maker's constants and serial number.

    Parameters
    ----------
    connection : str
        As of `truearm.wings.bench.sources.microscribe.microscribe`.

    Raises
    ------
    InputError
        If the arm states its constants in an unknown format.
    TruearmError
        If there is no such arm at the connection.
    """
    try:
        with closing(connector(connection)()) as link:
            return read_constants(link)
    except OSError as error:
        raise TruearmError(f"{connection}: no constants were read ({error.strerror or error})") from None


def read_constants(link: Connection) -> Arm:
    """The constants of the arm at an open connection; see `microscribe_arm`."""
    sign_on(link)
    n = len(counts_per_turn(link))
    asked = GET_NAME, GET_MODEL, GET_SERIAL_NUMBER, GET_COMMENT, GET_FORMAT
    name, model, serial_number, comment, form = (_text(link, request) for request in asked)
    if form != FORMAT:
        raise InputError(f"expected constants in {FORMAT!r}, got {form[:40]!a}")
    block = _block(link, GET_PARAMETERS)
    if len(block) != SIZE:
        raise InputError(f"expected {SIZE} bytes of constants, got {len(block)}")
    alpha, a, d = np.frombuffer(block, ">i2").astype(float).reshape(3, ROWS)
    beta = np.zeros(ROWS)
    if "Beta" in comment and len(extended := _block(link, GET_EXTENDED)) >= 2:
        beta[_BETA_ROW] = ANGLE_RAD * int.from_bytes(extended[:2], "big", signed=True)
    return _arm(n, ANGLE_RAD * alpha, LENGTH_MM * a, LENGTH_MM * d, beta, f"{name} {model}".strip(), serial_number)


def _arm(
    n: int, alpha: FloatArray, a: FloatArray, d: FloatArray, beta: FloatArray, title: str, serial_number: str
) -> Arm:
    flange = np.eye(4)
    for row in range(n, ROWS):  # without an encoder: the stylus
        flange = flange @ motion_across(a[row], alpha[row]) @ screw_z(0.0, d[row])
    table = DHTable(
        "mdh", a[:n], d[:n], alpha[:n], np.zeros(n), np.zeros(n, bool), np.eye(4), flange, np.zeros(3), beta[:n]
    )
    return Arm(
        name="microscribe",
        chain=table.chain(),
        title=title,
        source="constants of its maker, read from the arm",
        serial_number=serial_number,
        table=table,
    )


def _text(link: Connection, request: int) -> str:
    link.send(bytes([request]))
    data = read_until(link, lambda data: request in data and 0 in data[data.index(request) :])
    text = data[data.index(request) + 1 :].partition(b"\0")[0].decode("ascii", "replace")
    return "".join(sign for sign in text if sign.isprintable()).strip()


def _block(link: Connection, request: int) -> bytes:
    """A block of bytes after its request and its size."""

    def is_whole(data: bytes) -> bool:
        rest = data[data.find(request) + 1 :] if request in data else b""
        return len(rest) > 0 and len(rest) > rest[0]

    link.send(bytes([request]))
    data = read_until(link, is_whole)
    rest = data[data.index(request) + 1 :]
    return rest[1 : 1 + rest[0]]


RATE_HZ = 50.0
ANSWER_S = 0.5
SIGN_ON_S = 3.0
MOST_ERRORS = 10  # in a row

END_SESSION, GET_MAXES = 0xC5, 0xC6
_POLL = {5: 0x01, 6: 0x03}
_LEAST_COUNTS = 256  # a turn; an encoder with fewer is not there


def microscribe(connection: str) -> Source:
    """Samples of a MicroScribe; its buttons and pedals are the button.

    Parameters
    ----------
    connection : str
        ``serial:PORT:BAUD`` (9600 to 115200), or ``tcp:HOST:PORT`` of a serial server.

    Raises
    ------
    InputError
        As `truearm.wings.bench.sources.connections.connector`.
    """
    return Source(f"microscribe:{connection}", partial(connected, connector(connection), connection, _samples))


def _samples(link: Connection) -> Stream:
    sign_on(link)
    turns = counts_per_turn(link)
    request, errors, due_s = _POLL[len(turns)], 0, time.monotonic()
    while errors < MOST_ERRORS:
        link.send(bytes([request]))
        content = _content(link, request | 0x80, 1 + 2 * len(turns))
        errors = errors + 1 if content is None else 0
        if content is not None:
            pairs = np.frombuffer(content, np.uint8, offset=1).reshape(-1, 2).astype(int)
            counts = pairs[:, 0] << 7 | pairs[:, 1]
            yield Sample(time.monotonic(), tau * counts / turns, is_button_pressed=content[0] != 0)
        due_s = max(due_s + 1 / RATE_HZ, time.monotonic() - 1 / RATE_HZ)
        time.sleep(max(0.0, due_s - time.monotonic()))
    raise ConnectionError("the arm does not answer")


def sign_on(link: Connection) -> str:
    """Begin a session; returns the identity of the product.

    Raises
    ------
    ConnectionError
        If no MicroScribe answers.
    """
    heard, until_s = b"", time.monotonic() + SIGN_ON_S
    while b"IMMC" not in heard:
        if time.monotonic() > until_s:
            raise ConnectionError("no MicroScribe answers")
        link.send(bytes([END_SESSION]) + b"IMMC")
        heard = heard[-8:] + link.receive(0.1)
    while link.receive(0.1):  # further echoes
        if time.monotonic() > until_s:
            raise ConnectionError("the port is never silent: no MicroScribe")
    link.send(b"BEGIN")
    name = read_until(link, lambda data: b"\0" in data)
    return name.partition(b"\0")[0].decode("ascii", "replace")


def counts_per_turn(link: Connection) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(5,) or (6,) counts per turn of the encoders that the arm has.

    Raises
    ------
    ConnectionError
        If the answer is cut short or makes no sense.
    """
    link.send(bytes([GET_MAXES]))
    data = read_until(link, lambda data: GET_MAXES in data and len(data) - data.index(GET_MAXES) > 24)
    start = data.index(GET_MAXES) + 13  # buttons, timer (2) and analog inputs (9) come first
    turns = np.frombuffer(data[start : start + 12], ">u2").astype(np.int64) + 1
    n = 5 + int(turns[5] >= _LEAST_COUNTS)
    if (turns[:n] < _LEAST_COUNTS).any() or (turns > 2**14).any():
        raise ConnectionError(f"the arm states counts per turn of {turns.tolist()}")
    return turns[:n]


def _content(link: Connection, first: int, size: int) -> bytes | None:
    """The content of an answer; None if it is cut short. What comes before its first byte is ignored."""

    def is_whole(data: bytes) -> bool:
        return bytes([first]) in data and len(data) - data.rindex(bytes([first])) > size

    try:
        data = read_until(link, is_whole)
    except ConnectionError:
        return None
    start = data.rindex(bytes([first])) + 1
    content = data[start : start + size]
    return None if max(content) >= 0x80 else content


def read_until(link: Connection, is_whole: Callable[[bytes], bool]) -> bytes:
    """What arrives until it is whole; ConnectionError if it is cut short."""
    data = b""
    until_s = time.monotonic() + ANSWER_S
    while not is_whole(data):
        more = link.receive(max(0.001, until_s - time.monotonic()))
        data = (data + more)[-256:]
        if not is_whole(data) and time.monotonic() > until_s:
            raise ConnectionError("the answer of the arm is cut short")
    return data
