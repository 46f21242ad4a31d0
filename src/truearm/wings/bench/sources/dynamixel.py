"""Dynamixel X servos, protocol 2.0 (ViperX, OpenManipulator): present position and temperature by a group read.

A packet is FF FF FD 00, the servo's number, the number of bytes that follow (2 bytes, little-endian), instruction,
content and CRC-16 (polynomial 0x8005). In the content FF FF FD is followed by another FD.
Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from pathlib import Path

from truearm.wings.bench.sources.sample import Source
from truearm.wings.bench.sources.servo_bus import States, servo_bus

HEADER = b"\xff\xff\xfd\x00"
BROADCAST, GROUP_READ, STATUS = 0xFE, 0x82, 0x55
PRESENT_POSITION, SIZE = 132, 15  # position (4 bytes, little-endian, signed), .., temperature
_TEMPERATURE = 14
_LONGEST = 64  # of an answer, stuffing included


def dynamixel(file: Path, connection: str = "") -> Source:
    """Samples of an arm of Dynamixel X servos; see `truearm.wings.bench.sources.servo_bus`."""
    return servo_bus("dynamixel", file, connection, group_read, states_in)


def crc16(data: bytes) -> int:
    """CRC-16 of ROBOTIS: polynomial 0x8005, start 0, not reflected."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x8005 if value & 0x8000 else 0)) & 0xFFFF
    return value


def packet(number: int, content: bytes) -> bytes:
    """A packet to or from a servo; `content` begins with the instruction."""
    stuffed = content.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    whole = HEADER + bytes([number]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return whole + crc16(whole).to_bytes(2, "little")


def group_read(ids: tuple[int, ...]) -> bytes:
    """The request for the states of servos."""
    address = PRESENT_POSITION.to_bytes(2, "little") + SIZE.to_bytes(2, "little")
    return packet(BROADCAST, bytes([GROUP_READ]) + address + bytes(ids))


def states_in(data: bytes) -> States:
    """The states in all whole answers, wherever they begin."""
    states = {}
    start = data.find(HEADER)
    while start >= 0:
        end = start + 7 + int.from_bytes(data[start + 5 : start + 7], "little")
        whole = data[start:end]
        if 11 < end - start == len(whole) <= _LONGEST and crc16(whole[:-2]).to_bytes(2, "little") == whole[-2:]:
            content = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            if content[0] == STATUS and len(content) == SIZE + 2:  # instruction and error come first
                states[whole[4]] = int.from_bytes(content[2:6], "little", signed=True), content[2 + _TEMPERATURE]
        start = data.find(HEADER, start + 1)
    return states
