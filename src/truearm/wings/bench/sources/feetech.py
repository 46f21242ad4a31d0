"""Feetech bus servos (STS and SMS series: SO-100, SO-101): present position and temperature by a group read.

A packet is FF FF, the servo's number, the number of bytes that follow, error or instruction, content, and a check byte,
the complement of the sum of all after FF FF.
"""

from __future__ import annotations

from pathlib import Path

from truearm.wings.bench.sources.sample import Source
from truearm.wings.bench.sources.servo_bus import States, servo_bus

BROADCAST, GROUP_READ = 0xFE, 0x82
PRESENT_POSITION, SIZE = 56, 8  # position (2 bytes, little-endian), speed, load, voltage, temperature
_TEMPERATURE = 7


def feetech(file: Path, connection: str = "") -> Source:
    """Samples of an arm of Feetech servos; see `truearm.wings.bench.sources.servo_bus`."""
    return servo_bus("feetech", file, connection, group_read, states_in)


def checked(body: bytes) -> bytes:
    """A packet: the body between FF FF and the check byte."""
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def group_read(ids: tuple[int, ...]) -> bytes:
    """The request for the states of servos."""
    return checked(bytes([BROADCAST, len(ids) + 4, GROUP_READ, PRESENT_POSITION, SIZE, *ids]))


def states_in(data: bytes) -> States:
    """The states in all whole answers, wherever they begin; the request itself, which some adapters echo, is none."""
    states = {}
    start = data.find(b"\xff\xff")
    while start >= 0:
        packet = data[start : start + SIZE + 6]
        body = packet[2:-1]
        if len(packet) == SIZE + 6 and packet[3] == SIZE + 2 and checked(body) == packet:
            position = int.from_bytes(packet[5:7], "little")
            # Bit 15 is the sign of a position beyond a turn.
            signed = -(position & 0x7FFF) if position & 0x8000 else position
            states[packet[2]] = signed, packet[5 + _TEMPERATURE]
        start = data.find(b"\xff\xff", start + 1)
    return states
