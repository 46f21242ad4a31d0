"""Bus servos: packets against published ones, emulated arms, and answers that are torn, disturbed or missing."""

import random
import socket
from math import pi

import pytest
from devices import samples_of, tcp_device
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.bench.sources import connections, dynamixel, feetech, servo_bus

IDS = (1, 2, 3, 4, 5, 6)
POSITIONS = dict(zip(IDS, (2048, 0, 4095, 1024, 3072, 2049), strict=True))


def feetech_answer(number: int, position: int, temperature: int = 31) -> bytes:
    content = position.to_bytes(2, "little") + bytes([0, 0, 0, 0, 120, temperature])
    return feetech.checked(bytes([number, 10, 0]) + content)


def dynamixel_answer(number: int, position: int, temperature: int = 31) -> bytes:
    content = position.to_bytes(4, "little", signed=True) + bytes(10) + bytes([temperature])
    return dynamixel.packet(number, bytes([0x55, 0]) + content)


PROTOCOLS = {
    "feetech": (feetech, feetech.feetech, feetech_answer),
    "dynamixel": (dynamixel, dynamixel.dynamixel, dynamixel_answer),
}
both = pytest.mark.parametrize("name", PROTOCOLS)


class Servos:
    """An arm whose servos answer a group read; `change` is done to the bytes of each answer."""

    def __init__(self, name: str, change=lambda n, answers: answers, n: int = 10**6) -> None:
        self.request = PROTOCOLS[name][0].group_read(IDS)
        self.answers = [PROTOCOLS[name][2](number, position) for number, position in POSITIONS.items()]
        self.change, self.n = change, n

    def __call__(self, client: socket.socket) -> None:
        heard = b""
        for asked in range(self.n):
            while self.request not in heard:
                data = client.recv(256)
                if not data:
                    return
                heard += data
            heard = heard.partition(self.request)[2]
            client.sendall(b"".join(self.change(asked, list(self.answers))))


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)
    monkeypatch.setattr(servo_bus, "RATE_HZ", 1000.0)
    monkeypatch.setattr(servo_bus, "ANSWER_S", 1.0)  # on a busy machine, too


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "so101.toml"
    path.write_text(
        "ids = [1, 2, 3, 4, 5, 6]\nzero = [2048, 2048, 2048, 2048, 2048, 2048]\nsign = [1, 1, -1, 1, 1, 1]\n"
    )
    return path


ANGLES = [0.0, -pi, -2047 * pi / 2048, -pi / 2, pi / 2, pi / 2048]


@both
def test_counts_of_the_servos_become_angles(name, file):
    with tcp_device(Servos(name)) as port:
        samples, _ = samples_of(PROTOCOLS[name][1](file, f"tcp:127.0.0.1:{port}"), 3)
    for sample in samples:
        assert sample.joint_angles_rad == pytest.approx(ANGLES, abs=1e-12)
        assert sample.temperature_degC == 31


@both
def test_disturbed_answers_are_no_samples(name, file, monkeypatch):
    monkeypatch.setattr(servo_bus, "ANSWER_S", 0.3)  # five are waited for in vain

    def change(asked: int, answers: list[bytes]) -> list[bytes]:
        whole = b"".join(answers)
        if asked == 1:  # a bit of a position
            return [whole[: len(whole) // 2], bytes([whole[len(whole) // 2] ^ 4]), whole[len(whole) // 2 + 1 :]]
        return {2: answers[:3], 3: [b"\xff\xff\xfd\x00\xff", *answers], 4: [whole[:20]], 5: [whole[5:]], 6: []}.get(
            asked, answers
        )

    with tcp_device(Servos(name, change)) as port:
        samples, notices = samples_of(PROTOCOLS[name][1](file, f"tcp:127.0.0.1:{port}"), 6)
    for sample in samples:
        assert sample.joint_angles_rad == pytest.approx(ANGLES, abs=1e-12)
    assert "no answer from servo 4, 5, 6" in notices


@both
def test_a_bus_without_power_is_found_again(name, file):
    with tcp_device(Servos(name, n=2), Servos(name)) as port:
        samples, notices = samples_of(PROTOCOLS[name][1](file, f"tcp:127.0.0.1:{port}"), 5)
    assert len(samples) == 5
    assert sum(text.startswith("connected") for text in notices) == 2


@both
@settings(max_examples=40, deadline=None)
@given(garbage=st.binary(max_size=60), position=st.integers(0, 4095))
def test_an_answer_is_found_wherever_it_begins(name, garbage, position):
    module, _, answer = PROTOCOLS[name]
    assert module.states_in(garbage + answer(7, position) + garbage)[7] == (position, 31)


@both
def test_random_bytes_are_no_answer(name):
    noise = random.Random(1)
    for _ in range(50):
        data = bytes(noise.choice((0xFF, 0xFD, 0x00, 0x0A, noise.randrange(256))) for _ in range(200))
        assert PROTOCOLS[name][0].states_in(data) == {}


def test_a_position_beyond_a_turn_has_a_sign():
    assert feetech.states_in(feetech_answer(1, 0x8000 | 100)) == {1: (-100, 31)}
    assert dynamixel.states_in(dynamixel_answer(1, -100)) == {1: (-100, 31)}


def test_a_content_that_looks_like_a_header_is_stuffed():
    position = int.from_bytes(b"\xff\xff\xfd\x01", "little", signed=True)
    packet = dynamixel_answer(1, position)
    assert b"\xff\xff\xfd\xfd\x01" in packet
    assert dynamixel.states_in(packet) == {1: (position, 31)}


def test_packets_are_those_of_the_manuals():
    # ROBOTIS e-Manual, Protocol 2.0: ping of servo 1, and sync read of the present positions of servos 1 and 2.
    assert dynamixel.packet(1, b"\x01").hex(" ") == "ff ff fd 00 01 03 00 01 19 4e"
    sync_read = bytes([0x82, 0x84, 0x00, 0x04, 0x00, 0x01, 0x02])
    assert dynamixel.packet(0xFE, sync_read).hex(" ") == "ff ff fd 00 fe 09 00 82 84 00 04 00 01 02 ce fa"
    # Feetech's communication protocol manual: ping of servo 1.
    assert feetech.checked(bytes([1, 2, 1])).hex(" ") == "ff ff 01 02 01 fb"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ids = [1, 1]", "an id is twice"),
        ("ids = []", "1 entries or more"),
        ("ids = [1, 254]", "252 or less"),
        ("ids = [1, 2]\nzero = [1.0, 2.0, 3.0]", "expected 2 entries of zero"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, text, said):
    path = tmp_path / "arm.toml"
    path.write_text(text)
    refuses(said, feetech.feetech, path, "tcp:127.0.0.1:9")
    path.write_text("ids = [1]")
    refuses("the key connection is missing", feetech.feetech, path)
