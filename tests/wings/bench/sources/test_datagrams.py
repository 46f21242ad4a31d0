"""EGM and RSI: datagrams of robots, whole and broken, through a port of this computer."""

import socket
import struct
import threading
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count, islice

import numpy as np
import pytest
from devices import samples_of
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.bench.sources import Sample, datagrams, open_source
from truearm.wings.bench.sources.sample import Repeats

ANGLES = [10.0, -20.5, 30.25, 0.0, 45.0, -170.125]


def field(number: int, content: bytes) -> bytes:
    """A field of Protocol Buffers with a length."""
    return bytes([number << 3 | 2, len(content) & 0x7F | 0x80, len(content) >> 7]) + content


def egm(angles=ANGLES, packed=False, number=150, ms=1) -> bytes:
    """A message EgmRobot with a header, the feedback and the planned joints, which are others."""
    numbers = [struct.pack("<d", angle) for angle in angles]
    joints = field(1, b"".join(numbers)) if packed else b"".join(b"\x09" + one for one in numbers)
    planned = field(3, field(1, b"\x09" + struct.pack("<d", 99.0)))
    header = field(1, b"\x08" + varint(number) + b"\x10" + varint(ms) + b"\x18\x02")
    return header + field(2, field(1, joints) + field(4, b"\x08\x01\x10" + varint(1000 * ms))) + planned


def varint(value: int) -> bytes:
    """A whole number of Protocol Buffers, in five bytes."""
    return bytes(value >> 7 * k & 0x7F | 0x80 for k in range(4)) + bytes([value >> 28 & 0x7F])


RSI = (
    b'<Rob Type="KUKA"><RIst X="1" Y="2" Z="3" A="0" B="0" C="0"/><RSol X="1"/><AIPos A1="10.0" A2="-20.5" A3="30.25" '
    b'A4="0.0" A5="45.0" A6="-170.125"/><ASPos A1="1" A2="1" A3="1" A4="1" A5="1" A6="1"/><Delay D="0"/>'
    b"<IPOC>4208163634</IPOC></Rob>"
)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def rsi(number: int) -> bytes:
    """The message of the robot at another time."""
    return RSI.replace(b"4208163634", b"%d" % (4208163634 + 4 * number))


@contextmanager
def robot(port, *datagrams):
    """A robot that sends these datagrams, or those of a number that counts, again and again."""
    ends = threading.Event()

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            for number in count():
                if ends.wait(0.005):
                    return
                for datagram in datagrams:
                    one.sendto(datagram(number) if callable(datagram) else datagram, ("127.0.0.1", port))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        ends.set()
        sender.join()


def counted(number, **keys):
    return egm(number=number, ms=4 * number, **keys)


COUNTING = [("egm", counted), ("egm", partial(counted, packed=True)), ("rsi", rsi)]


@pytest.mark.parametrize(("kind", "datagram"), COUNTING)
def test_the_joints_that_the_robot_reads(kind, datagram):
    port = free_port()
    with robot(port, b"\xff\x00", datagram, b""):
        samples, notices = samples_of(open_source(f"{kind}:{port}"), 5)
    for sample in samples:
        assert np.degrees(sample.joint_angles_rad) == pytest.approx(ANGLES, abs=1e-12)
    assert any("ignored" in text for text in notices)


@pytest.mark.parametrize(
    ("kind", "frozen"),
    [
        ("egm", lambda _: egm()),
        ("egm", lambda number: egm(number=number, ms=4 * min(number, 5))),  # counted on, of one time
        ("rsi", lambda _: RSI),
    ],
)
def test_a_controller_that_is_frozen_is_said_and_gives_no_samples(kind, frozen, monkeypatch):
    monkeypatch.setattr("truearm.wings.bench.sources.sample.SILENT_S", 0.05)
    port = free_port()
    with robot(port, frozen):
        heard = list(islice(open_source(f"{kind}:{port}").samples(), 9))
    assert sum(isinstance(one, Sample) for one in heard) <= 6, "those before the clock stood still"
    assert "the device repeats a message" in str(heard[-1])


@pytest.mark.parametrize("stamps", [(b"", b"", b""), (b"1", b"", b""), (b"1", b"0", b"0")])
def test_what_its_sender_does_not_count_is_no_repetition(stamps):
    """Without stamps, with constant ones while the arm moves, or with a time that was set once."""
    repeats = Repeats()
    assert not any(repeats([float(angle)], *stamps) for angle in range(9))
    repeats = Repeats()
    assert not any(repeats([1.0], b"%d" % number, b"1" if number else b"0") for number in range(9))


def test_egm_is_read_as_the_library_of_protocol_buffers_writes_it():
    """ABBRobotEGM has ABB's message types, compiled; it shares no code with ours."""
    messages = pytest.importorskip("ABBRobotEGM._egm_protobuf.egm_pb2", reason="ABBRobotEGM is not installed")
    robot_ = messages.EgmRobot()
    robot_.header.seqno, robot_.header.tm, robot_.header.mtype = 7, 2**31, messages.EgmHeader.MSGTYPE_DATA
    robot_.feedBack.joints.joints.extend(ANGLES)
    for axis in "xyz":
        setattr(robot_.feedBack.cartesian.pos, axis, 1.0)
    robot_.feedBack.time.sec, robot_.feedBack.time.usec = 2**40, 5
    robot_.planned.joints.joints.extend([1.0] * 6)
    robot_.utilizationRate = 0.5
    angles, stamps = datagrams.decode_egm(robot_.SerializeToString())
    assert angles == ANGLES
    assert stamps[0] == b"\x07"
    assert all(stamps)


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"x",
        egm()[:-3],
        egm([]),
        egm([float("nan")] * 6),
        egm([1e9] * 6),
        egm([1.0] * 33),
        b"\xff" * 20,
        b"\x12\xff\xff\xff\xff\xff\xff\xff\xff\x7f",
        RSI,
    ],
)
def test_what_is_no_egm_is_no_sample(datagram):
    refused(open_source(f"egm:{(port := free_port())}"), port, datagram, counted)


@pytest.mark.parametrize(
    "datagram",
    [
        b"<Rob",
        b"<Rob/>",
        b"<Rob><AIPos/></Rob>",
        b'<Rob><AIPos A2="1"/></Rob>',
        b'<Rob><AIPos A1="x"/></Rob>',
        b'<Rob><AIPos A1="nan"/></Rob>',
        b'<Rob><AIPos A1="1e5"/></Rob>',
        b'<!DOCTYPE r [<!ENTITY a "1">]><Rob><AIPos A1="&a;"/></Rob>',
        '<!DOCTYPE r [<!ENTITY a "1">]><Rob><AIPos A1="&a;"/></Rob>'.encode("utf-16"),
        b'<?xml version="1.0" encoding="nothing"?><Rob><AIPos A1="1"/></Rob>',
        RSI + b" " * 9000,
        egm(),
    ],
)
def test_what_is_no_rsi_is_no_sample(datagram):
    refused(open_source(f"rsi:{(port := free_port())}"), port, datagram, rsi)


def refused(source, port, datagram, good):
    """Whether the samples are those of the good datagrams alone."""
    with robot(port, datagram, good):
        samples, notices = samples_of(source, 3)
    assert all(len(one.joint_angles_rad) == 6 for one in samples)
    assert any("ignored" in text for text in notices)


@given(st.binary(max_size=200))
def test_any_bytes_are_angles_or_a_value_error(data):
    for decode in (datagrams.decode_egm, datagrams.decode_rsi):
        with suppress(ValueError):
            assert all(isinstance(angle, float) for angle in decode(data)[0])


@pytest.mark.parametrize("address", ["", "x", "0", "70000", "127.0.0.1:", "host:x"])
def test_what_is_no_port_is_refused(address):
    for source in (datagrams.abb_egm, datagrams.kuka_rsi):
        refuses("expected a port", source, address)
