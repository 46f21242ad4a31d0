"""The maker's own constants of a MicroScribe, which the arm states: a modified Denavit-Hartenberg table, identified."""

from __future__ import annotations

from contextlib import closing
from math import pi

import numpy as np

from truearm.arm import Arm, DHTable
from truearm.arm.denavit_hartenberg import motion_across
from truearm.arm.rigid_motions import screw_z
from truearm.errors import InputError, TruearmError
from truearm.typing import FloatArray
from truearm.wings.bench.sources.connections import Connection, connector
from truearm.wings.bench.sources.microscribe import counts_per_turn, read_until, sign_on

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
    n: int,
    alpha: FloatArray,
    a: FloatArray,
    d: FloatArray,
    beta: FloatArray,
    title: str,
    serial_number: str,
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
