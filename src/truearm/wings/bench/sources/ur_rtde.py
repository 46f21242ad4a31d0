"""Universal Robots' real-time data exchange (RTDE), protocol version 2: joint angles, temperatures, payload; read only.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide". A packet is its size (2 bytes, with this header), its
type (1 byte) and its content, big-endian.
"""

from __future__ import annotations

import struct
import time
from functools import partial
from math import isfinite

import numpy as np

from truearm.errors import InputError
from truearm.wings.bench.sources.connections import Connection, connected, connector
from truearm.wings.bench.sources.sample import Sample, Source, Stream

PORT = 30004
RATE_HZ = 125.0
SILENT_S = 1.0
MOST_BYTES = 4096  # of a packet
LARGEST_RAD = 100.0
JOINTS = 6

_VERSION, _OUTPUTS, _START, _TEXT, _DATA = b"VOSMU"
# Fields of the controller in the order in which they are asked for; older controllers lack the last ones.
FIELDS = {"actual_q": "VECTOR6D", "joint_temperatures": "VECTOR6D", "payload": "DOUBLE"}
_NUMBERS = {"VECTOR6D": 6, "DOUBLE": 1}
_TEMPERATURES = [f"load_temperature_{joint}_degC" for joint in range(1, JOINTS + 1)]


def ur_rtde(address: str, rate: str = "") -> Source:
    """Samples of a Universal Robots controller.

    Parameters
    ----------
    address : str
        ``HOST`` or ``HOST:PORT``.
    rate : str
        Samples a second, 125 by default; an e-Series controller gives up to 500.

    Raises
    ------
    InputError
        If the rate is no number of 1 to 500.
    """
    try:
        rate_hz = float(rate or RATE_HZ)
    except ValueError:
        rate_hz = 0.0
    if not 1 <= rate_hz <= 500:
        raise InputError(f"expected 1 to 500 samples a second, got {rate!r:.40}", hint=f"rtde:{address}@125")
    connection = f"tcp:{address}" if ":" in address else f"tcp:{address}:{PORT}"
    talk = partial(_samples, rate_hz)
    return Source(f"rtde:{address}", partial(connected, connector(connection), connection, talk))


class _Packets:
    """Packets of a connection; OSError where it is silent or out of step."""

    def __init__(self, link: Connection) -> None:
        self._link, self._buffer = link, bytearray()

    def send(self, kind: int, content: bytes) -> None:
        self._link.send(struct.pack(">HB", 3 + len(content), kind) + content)

    def next(self) -> tuple[int, bytes]:
        while True:
            if len(self._buffer) >= 3:
                size, kind = struct.unpack_from(">HB", self._buffer)
                if not 3 <= size <= MOST_BYTES:
                    raise ConnectionError(f"a packet of {size} bytes is none of RTDE")
                if len(self._buffer) >= size:
                    content = bytes(self._buffer[3:size])
                    del self._buffer[:size]
                    return kind, content
            data = self._link.receive(SILENT_S)
            if not data:
                raise ConnectionError("nothing was received for a second")
            self._buffer += data

    def answer(self, kind: int, content: bytes) -> bytes:
        """Ask, and return the answer; texts and data that come before it are ignored."""
        self.send(kind, content)
        for _ in range(1000):
            got, answer = self.next()
            if got == kind:
                return answer
        raise ConnectionError("the controller does not answer")


def _samples(rate_hz: float, link: Connection) -> Stream:
    packets = _Packets(link)
    if packets.answer(_VERSION, struct.pack(">H", 2)) != b"\x01":
        raise ConnectionError("the controller does not know version 2 of RTDE")
    recipe, names = _recipe(packets, rate_hz)
    if packets.answer(_START, b"") != b"\x01":
        raise ConnectionError("the controller does not start to send")
    form = struct.Struct(f">x{sum(_NUMBERS[FIELDS[name]] for name in names)}d")
    while True:
        kind, content = packets.next()
        if kind != _DATA or content[:1] != recipe:
            continue
        if len(content) != form.size:
            raise ConnectionError(f"expected data of {form.size} bytes, got {len(content)}")
        yield _sample(names, form.unpack(content))


def _recipe(packets: _Packets, rate_hz: float) -> tuple[bytes, list[str]]:
    """The number of the recipe of the fields that the controller has, and their names."""
    names = list(FIELDS)
    for _ in FIELDS:
        answer = packets.answer(_OUTPUTS, struct.pack(">d", rate_hz) + ",".join(names).encode())
        types = answer[1:].decode("ascii", "replace").split(",")
        known = dict(zip(names, types, strict=False))
        if known == {name: FIELDS[name] for name in names}:
            return answer[:1], names
        names = [name for name in names if known.get(name) == FIELDS[name]]
        if "actual_q" not in names:
            break
    raise ConnectionError("the controller has no field actual_q")


def _sample(names: list[str], numbers: tuple[float, ...]) -> Sample:
    angles, rest = numbers[:JOINTS], numbers[JOINTS:]
    if not (all(map(isfinite, rest)) and all(abs(angle) < LARGEST_RAD for angle in angles)):
        raise ConnectionError("the controller sends numbers that are no angles")
    columns, temperature = dict[str, float](), None
    if "joint_temperatures" in names:
        columns |= zip(_TEMPERATURES, rest[:JOINTS], strict=True)
        temperature, rest = sum(rest[:JOINTS]) / JOINTS, rest[JOINTS:]
    if "payload" in names:
        columns["payload_kg"] = rest[0]
    return Sample(time.monotonic(), np.array(angles), temperature_degC=temperature, columns=columns)
