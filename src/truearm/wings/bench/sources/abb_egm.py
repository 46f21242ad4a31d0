"""ABB's externally guided motion (EGM): datagrams with the joints that the robot reads; it is not answered.

Source: ABB, "Application manual: Externally Guided Motion", and its egm.proto: a datagram is a message EgmRobot of
Protocol Buffers (protobuf.dev, "Encoding"), of which feedBack.joints.joints are the angles in degrees, header.seqno,
header.tm and feedBack.time its number and times.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from truearm.wings.bench.sources.datagrams import datagram_source
from truearm.wings.bench.sources.sample import Source

FEEDBACK, JOINTS_OF_FEEDBACK, JOINTS = 2, 1, 1  # numbers of the fields on the way to the angles
STAMPS = ((1, 1), (1, 2), (FEEDBACK, 4))  # and to the number of the datagram, its time, and that of the angles
_VARINT, _EIGHT_BYTES, _BYTES, _FOUR_BYTES = 0, 1, 2, 5  # how a field is written
_SIZES = {_EIGHT_BYTES: 8, _FOUR_BYTES: 4}


def abb_egm(address: str) -> Source:
    """Samples of an ABB robot that runs EGM towards this computer.

    Parameters
    ----------
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer; see `truearm.wings.bench.sources.datagrams.datagram_source`.
    """
    return datagram_source("egm", address, decode_egm, "datagrams are no message of EGM with joints")


def decode_egm(datagram: bytes) -> tuple[list[float], tuple[bytes, ...]]:
    """The angles in a message EgmRobot [deg], and its number and times as they are written.

    Raises
    ------
    ValueError
        If it is none.
    """
    angles: list[float] = []
    for feedback in _fields(datagram, FEEDBACK):
        for joints in _fields(feedback, JOINTS_OF_FEEDBACK):
            for numbers in _fields(joints, JOINTS):  # one number, or all packed
                if len(numbers) % 8:
                    raise ValueError("no double precision numbers")
                angles += struct.unpack(f"<{len(numbers) // 8}d", numbers)
    stamps = (
        b"".join(one for part in _fields(datagram, outer) for one in _fields(part, inner)) for outer, inner in STAMPS
    )
    return angles, tuple(stamps)


def _fields(message: bytes, wanted: int) -> Iterator[bytes]:
    """The contents of the fields with a number."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            size = _varint(message, at)[1] - at
        elif kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in _SIZES:
            size = _SIZES[kind]
        else:
            raise ValueError(f"a field cannot be written as {kind}")
        if at + size > len(message):
            raise ValueError("a field ends behind its message")
        if number == wanted:
            yield message[at : at + size]
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """The whole number that begins at a place, and where the next field begins."""
    value = 0
    for i, byte in enumerate(message[at : at + 10]):
        value |= (byte & 0x7F) << 7 * i
        if byte < 0x80:
            return value, at + i + 1
    raise ValueError("a number does not end")
