"""MicroScribe: an arm that is emulated on a socket and on a pseudo terminal, with the counts per turn of a real one."""

import os
import select
import socket
import struct
import threading
from math import tau

import numpy as np
import pytest
from devices import samples_of, tcp_device
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.command_line import run
from truearm.errors import TruearmError
from truearm.wings.bench.sources import connections
from truearm.wings.bench.sources import microscribe as protocol
from truearm.wings.bench.sources.microscribe import microscribe
from truearm.wings.bench.sources.source_names import read_source_arm

# Those of a MicroScribe DX, serial number 40937, as its firmware states them; it has no sixth encoder.
TURNS = (16384, 16384, 8192, 4096, 4096)
COUNTS = (100, 16383, 4096, 0, 2048)


# Its constants: angles in 180 deg / 32768, lengths in thousandths of an inch.
ALPHA = (0, 16373, -7, 16357, -16382, -16372)
A = (0, 960, 10256, 533, -401, 399)
D = (8300, -878, -3, 9244, 320, -5274)
CONSTANTS = {
    0xC0: bytes([36]) + struct.pack(">18h", *ALPHA, *A, *D),
    0xD3: bytes([2]) + struct.pack(">h", 3),
    0xC8: b"MicroScribe\0",
    0xCA: b"DX\0",
    0xCB: b"40937\0",
    0xCC: b"Beta \x1b[31m\0",
    0xCD: b"Format DH0.5\0",
}


class Arm:
    """What the arm answers, byte by byte.

    Parameters
    ----------
    turns, counts : tuple of int
    faults : dict
        What is sent in place of the answer to a poll, by its number.
    """

    def __init__(self, turns=TURNS, counts=COUNTS, faults=None, polls=10**6) -> None:
        self.turns, self.counts, self.faults, self.left, self.polled = turns, counts, faults or {}, polls, 0
        self.heard, self.is_on = b"", False

    def answer(self, data: bytes) -> bytes:
        out = b""
        for byte in data:
            if not self.is_on:
                self.heard = (self.heard + bytes([byte]))[-5:]
                if self.heard.endswith(b"IMMC"):
                    out += b"IMMC"
                if self.heard == b"BEGIN":
                    self.is_on, out = True, out + b"MSCR\0"
            elif byte == 0xC5:
                self.is_on = False
            elif byte == 0xC6:
                out += (
                    b"\xc6"
                    + struct.pack(">BH9B", 3, 10000, *[0] * 9)
                    + struct.pack(">6H", *(n - 1 for n in (*self.turns, 1)[:6]))
                )
            elif byte in CONSTANTS:
                out += bytes([byte]) + CONSTANTS[byte]
            elif byte in (1, 3):
                out += self._state(byte)
        return out

    def _state(self, request: int) -> bytes:
        self.polled += 1
        self.left -= 1
        if self.left < 0:
            return b""
        whole = bytes([request | 0x80, 1 if self.polled % 5 == 0 else 0])
        for count in self.counts[: 6 if request == 3 else 5]:
            whole += bytes([count >> 7, count & 0x7F])
        return self.faults.get(self.polled, whole)

    def __call__(self, client: socket.socket) -> None:
        while data := client.recv(256):
            client.sendall(self.answer(data))


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)
    monkeypatch.setattr(protocol, "RATE_HZ", 1000.0)
    monkeypatch.setattr(protocol, "ANSWER_S", 5.0)  # on a busy machine, too


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(protocol, "ANSWER_S", 0.5)


def angles_of(counts, turns):
    return [tau * count / turn for count, turn in zip(counts, turns, strict=True)]


def test_counts_become_angles_by_the_counts_per_turn_of_the_arm():
    with tcp_device(Arm()) as port:
        samples, _ = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 10)
    for sample in samples:
        assert sample.joint_angles_rad == pytest.approx(angles_of(COUNTS, TURNS), abs=1e-15)
    assert [sample.is_button_pressed for sample in samples] == [number % 5 == 0 for number in range(1, 11)]


def test_an_arm_with_six_encoders():
    turns, counts = (*TURNS, 4096), (*COUNTS, 4095)
    with tcp_device(Arm(turns, counts)) as port:
        (sample,), _ = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 1)
    assert sample.joint_angles_rad == pytest.approx(angles_of(counts, turns), abs=1e-15)


def test_torn_and_disturbed_answers_are_no_samples(impatient):
    good = Arm().answer(b"IMMCBEGIN\x01")[-12:]
    faults = {2: b"", 3: good[:6], 4: b"\x07\x09" + good, 5: good[:4] + b"\xff" + good[5:], 7: b"\x81\x00" + good}
    with tcp_device(Arm(faults=faults)) as port:
        samples, _ = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 6)
    for sample in samples:
        assert sample.joint_angles_rad == pytest.approx(angles_of(COUNTS, TURNS), abs=1e-15)


def test_an_arm_that_is_switched_off_and_on_is_found_again(impatient, monkeypatch):
    monkeypatch.setattr(protocol, "MOST_ERRORS", 2)
    with tcp_device(Arm(polls=3), Arm()) as port:
        samples, notices = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 6)
    assert len(samples) == 6
    assert any("the arm does not answer" in text for text in notices)


@pytest.mark.parametrize("turns", [(16384, 16384, 100, 4096, 4096), (16384, 20000, 8192, 4096, 4096)])
def test_counts_per_turn_without_sense_are_said(turns):
    with tcp_device(Arm(turns), Arm()) as port:
        _, notices = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 1)
    assert any("states counts per turn" in text for text in notices)


def test_another_device_is_said(monkeypatch):
    monkeypatch.setattr(protocol, "SIGN_ON_S", 0.3)

    def noisy(client: socket.socket) -> None:
        while client.recv(256):
            client.sendall(b"\xc6IMM garbage\n" * 50)

    with tcp_device(noisy, Arm()) as port:
        _, notices = samples_of(microscribe(f"tcp:127.0.0.1:{port}"), 1)
    assert any("no MicroScribe answers" in text for text in notices)


def test_on_a_pseudo_terminal():
    pytest.importorskip("serial", reason="pyserial is an extra: pip install 'truearm[live]'")
    if not hasattr(os, "openpty"):
        pytest.skip("this system has no pseudo terminals")
    import tty

    device, port = os.openpty()
    tty.setraw(port)
    arm, ends = Arm(), threading.Event()

    def run() -> None:
        while not ends.is_set():
            if select.select([device], [], [], 0.05)[0]:
                os.write(device, arm.answer(os.read(device, 256)))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        (sample, _), _ = samples_of(microscribe(f"serial:{os.ttyname(port)}:38400"), 2)
    finally:
        ends.set()
        thread.join(60)
        os.close(device)
        os.close(port)
    assert sample.joint_angles_rad == pytest.approx(angles_of(COUNTS, TURNS), abs=1e-15)


def test_the_constants_of_the_maker_are_an_arm_file(truearm_in, tmp_path):
    file = tmp_path / "arm.toml"
    with tcp_device(Arm()) as port:
        ran = truearm_in("sources", "--try", f"microscribe:tcp:127.0.0.1:{port}", "--seconds", "1", "--out", file)
    assert ran == 0
    arm = ta.load_arm(file)
    assert (arm.n_joints, arm.serial_number, arm.title) == (5, "40937", "MicroScribe DX")
    table = arm.table
    assert np.degrees(table.alpha) == pytest.approx([0, 89.940, -0.038, 89.852, -89.989], abs=5e-4)  # as published
    assert table.a == pytest.approx([0, 24.38, 260.50, 13.54, -10.19], abs=5e-3)
    assert table.d == pytest.approx([210.82, -22.30, -0.08, 234.80, 8.13], abs=5e-3)
    assert np.degrees(table.beta[2]) == pytest.approx(0.016, abs=5e-4)
    angles = np.random.default_rng(1).uniform(-3, 3, (5, 5))
    assert arm.forward(angles).tip_in_base == pytest.approx(
        np.array([tip_by_the_formula(one) for one in angles]), abs=1e-6
    )


def tip_by_the_formula(angles):
    """The product of six matrices Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d), as the maker's library has it."""
    tip = np.eye(4)
    for row, (alpha, a, d, theta) in enumerate(zip(ALPHA, A, D, [*angles, 0.0], strict=True)):
        turned = Rotation.from_euler("XYZ", [np.pi * alpha / 32768, np.pi * 3 / 32768 if row == 2 else 0.0, theta])
        step = np.eye(4)
        step[:3, :3] = turned.as_matrix()
        step[:3, 3] = [a * 0.0254, 0, 0] + turned.apply([0, 0, d * 0.0254])
        tip = tip @ step
    return tip[:3, 3]


@pytest.fixture
def truearm_in(capsys):
    def run_it(*arguments):
        with pytest.raises(SystemExit) as ended:
            run([str(one) for one in arguments])
        return ended.value.code

    return run_it


@pytest.mark.parametrize(
    ("request_byte", "answer", "said"),
    [
        (0xCD, b"Format DH9\0", "expected constants in 'Format DH0.5'"),
        (0xC0, b"\x04abcd", "expected 36 bytes of constants, got 4"),
        (0xC0, b"\x24abcd", "the answer of the arm is cut short"),
    ],
)
def test_constants_that_cannot_be_read_are_refused(impatient, monkeypatch, request_byte, answer, said):
    monkeypatch.setitem(CONSTANTS, request_byte, answer)
    with tcp_device(Arm()) as port, pytest.raises(TruearmError, match=said):
        read_source_arm(f"microscribe:tcp:127.0.0.1:{port}")


def test_another_source_states_no_constants():
    refuses("states no constants", read_source_arm, "virtual:ur10")
