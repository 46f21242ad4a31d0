"""Robots that send datagrams with their joints to this computer, and are not answered: KUKA RSI and ABB EGM.

KUKA, "RobotSensorInterface" (XML): the element AIPos of the robot's message has the actual axes A1 to A6 in degrees,
IPOC its time. The configuration on the robot needs ONLYSEND: otherwise RSI stops a robot that is not answered.

ABB, "Application manual: Externally Guided Motion", and its egm.proto: a datagram is a message EgmRobot of Protocol
Buffers (protobuf.dev, "Encoding"), of which feedBack.joints.joints are the angles in degrees, header.seqno, header.tm
and feedBack.time its number and times.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, takewhile
from xml.etree import ElementTree

import numpy as np

from truearm.wings.bench.sources.connections import Connection, connected, datagram_connector
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS
from truearm.wings.bench.sources.sample import REPEATED, SILENT_S, Notice, Repeats, Sample, Source, Stream, samples_in

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


MOST_BYTES = 8192


def kuka_rsi(address: str) -> Source:
    """Samples of a KUKA robot whose RSI sends to this computer.

    Parameters
    ----------
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer; see `truearm.wings.bench.sources.datagrams.datagram_source`.
    """
    return datagram_source("rsi", address, decode_rsi, "datagrams have no element AIPos with the axes A1 ..")


def decode_rsi(datagram: bytes) -> tuple[list[float], tuple[str]]:
    """The angles in a message of the robot [deg], and its time as it is written.

    Raises
    ------
    ValueError
        If it is none.
    """
    # No entities, which could grow without bound, and no encoding in which they are not seen.
    if len(datagram) > MOST_BYTES or not datagram.isascii() or b"\0" in datagram or b"<!" in datagram:
        raise ValueError("no message of RSI")
    try:
        message = ElementTree.fromstring(datagram)  # noqa: S314, it has no entities
    except (ElementTree.ParseError, LookupError) as error:  # or an encoding that Python does not know
        raise ValueError("no XML") from error
    element = message.find("AIPos")
    axes = {} if element is None else element.attrib
    names = takewhile(axes.__contains__, (f"A{axis}" for axis in count(1)))
    return [float(axes[name]) for name in names], (message.findtext("IPOC", ""),)


LARGEST_DEG = 7200.0

# The joint angles in a datagram [deg], and what counts and dates it; ValueError if it is none of the protocol.
Decode = Callable[[bytes], tuple[list[float], tuple[object, ...]]]


def datagram_source(kind: str, address: str, decode: Decode, misfit: str) -> Source:
    """Samples of the datagrams that come to a port.

    Parameters
    ----------
    kind : str
        Of the source.
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer, as of `truearm.wings.bench.sources.connections.datagram_connector`.
    decode : callable
    misfit : str
        What is wrong with datagrams that have none, in the plural.

    Raises
    ------
    InputError
        If it is no such address.
    """

    def sample(repeats: Repeats, datagram: bytes, arrived_s: float) -> Sample | Notice | None:
        try:
            angles, stamps = decode(datagram)
        except ValueError:
            return None
        if not (0 < len(angles) <= MOST_JOINTS and all(abs(angle) <= LARGEST_DEG for angle in angles)):
            return None
        if repeats(angles, *stamps):
            return REPEATED
        return Sample(arrived_s, np.radians(angles))

    def talk(link: Connection) -> Stream:
        return samples_in(_datagrams(link), partial(sample, Repeats()), misfit)

    return Source(f"{kind}:{address}", partial(connected, datagram_connector(address), f"udp:{address}", talk))


def _datagrams(link: Connection) -> Iterator[bytes | None]:
    while True:
        yield link.receive(SILENT_S) or None
