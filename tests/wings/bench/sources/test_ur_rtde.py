"""RTDE: our client against a controller that is emulated, and that emulation against an independent client."""

import importlib.util
import os
import socket
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
from devices import samples_of, tcp_device

from refusals import refuses
from truearm.wings.bench.sources import connections
from truearm.wings.bench.sources.ur_rtde import ur_rtde

ANGLES = np.array([0.1, -1.5, 2.0, -0.5, 1.25, 3.0])
VALUES = {
    "timestamp": (12.5,),
    "actual_q": tuple(ANGLES),
    "joint_temperatures": (30.0, 31.0, 32.0, 33.0, 34.0, 35.0),
    "payload": (2.5,),
}


class Controller:
    """What a controller answers to one client.

    Parameters
    ----------
    values : dict
        Its fields; another one is NOT_FOUND.
    n : int
        Packets of data that it sends, before it closes the connection.
    torn : bool
        Whether its bytes come in pieces of five.
    """

    def __init__(self, values=VALUES, n=3, torn=False, version=True, noise=b"") -> None:
        self.values, self.n, self.torn, self.version, self.noise = values, n, torn, version, noise
        self.rates = []

    def __call__(self, client: socket.socket) -> None:
        names = []
        while True:
            size, kind = struct.unpack(">HB", self._exactly(client, 3))
            content = self._exactly(client, size - 3)
            if kind == ord("V"):
                self._send(client, "V", bytes([self.version and content == b"\0\2"]))
            elif kind == ord("v"):
                self._send(client, "v", struct.pack(">4I", 5, 12, 0, 0))
            elif kind == ord("O"):
                self.rates.append(struct.unpack_from(">d", content)[0])
                names = [name for name in content[8:].decode().split(",") if name]
                self._send(client, "O", b"\7" + ",".join(map(self._type, names)).encode())
            elif kind == ord("I"):
                self._send(client, "I", b"\1" + b",".join([b"DOUBLE"] * len(content.split(b","))))
            elif kind == ord("S"):
                self._send(client, "S", b"\1")
                break
        for number in range(self.n):
            self._send(client, "M", b"\5hello\0\1")  # a text between the data
            numbers = [one for name in names for one in self.values[name]]
            self._send(client, "U", b"\7" + struct.pack(f">{len(numbers)}d", *numbers))
            if number == 0 and self.noise:
                client.sendall(self.noise)
            time.sleep(0.002)

    def _type(self, name: str) -> str:
        n = len(self.values.get(name, ()))
        return {0: "NOT_FOUND", 1: "DOUBLE", 6: "VECTOR6D"}[n]

    def _send(self, client: socket.socket, kind: str, content: bytes) -> None:
        packet = struct.pack(">HB", 3 + len(content), ord(kind)) + content
        for start in range(0, len(packet), 5 if self.torn else len(packet)):
            client.sendall(packet[start : start + (5 if self.torn else len(packet))])

    @staticmethod
    def _exactly(client: socket.socket, n: int) -> bytes:
        data = b""
        while len(data) < n:
            more = client.recv(n - len(data))
            if not more:
                raise OSError("the client has gone")
            data += more
        return data


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)


@pytest.mark.parametrize("torn", [False, True])
def test_angles_temperatures_and_payload(torn):
    controller = Controller(torn=torn)
    with tcp_device(controller) as port:
        samples, _ = samples_of(ur_rtde(f"127.0.0.1:{port}", "250"), 3)
    for sample in samples:
        assert sample.joint_angles_rad.tolist() == ANGLES.tolist()
        assert sample.temperature_degC == 32.5
        assert sample.columns["payload_kg"] == 2.5
        assert sample.columns["load_temperature_6_degC"] == 35.0
    assert controller.rates[0] == 250


def test_an_older_controller_lacks_fields():
    old = {name: values for name, values in VALUES.items() if name not in ("payload", "joint_temperatures")}
    with tcp_device(Controller(old)) as port:
        (sample,), _ = samples_of(ur_rtde(f"127.0.0.1:{port}"), 1)
    assert sample.joint_angles_rad.tolist() == ANGLES.tolist()
    assert (sample.temperature_degC, dict(sample.columns)) == (None, {})


@pytest.mark.parametrize(
    ("controller", "said"),
    [
        (Controller(version=False), "does not know version 2"),
        (Controller({"payload": (1.0,)}), "no field actual_q"),
        (Controller({**VALUES, "actual_q": (np.nan,) * 6}), "numbers that are no angles"),
        (Controller(noise=b"\0\1garbage"), "a packet of 1 bytes is none of RTDE"),
        (Controller(noise=b"\xff\xff" + b"x" * 200), "a packet of 65535 bytes is none of RTDE"),
        (Controller(noise=struct.pack(">HB", 5, ord("U")) + b"\7x"), "expected data of 105 bytes, got 2"),
        (lambda client: client.recv(100), "the device closed the connection"),
    ],
)
def test_what_is_no_rtde_is_said_and_the_client_connects_again(controller, said):
    with tcp_device(controller, Controller()) as port:
        samples, notices = samples_of(ur_rtde(f"127.0.0.1:{port}"), 4)
    assert any(said in text for text in notices), notices
    assert all(sample.joint_angles_rad.tolist() == ANGLES.tolist() for sample in samples)


def test_a_rate_that_no_controller_has_is_refused():
    for rate in ("0", "501", "fast", "nan"):
        refuses("1 to 500 samples a second", ur_rtde, "127.0.0.1", rate)


CLIENT = """
import sys
from rtde_receive import RTDEReceiveInterface
client = RTDEReceiveInterface(sys.argv[1], 125.0, ["timestamp", "actual_q", "joint_temperatures"])
print(client.getActualQ(), client.getJointTemperatures())
client.disconnect()
"""


def test_the_emulated_controller_is_understood_by_ur_rtde():
    """The client of SDU Robotics shares no code with ours; in a process of its own, as it keeps Python waiting."""
    if importlib.util.find_spec("rtde_receive") is None:
        pytest.skip("ur-rtde is not installed: pip install ur-rtde")
    # The client knows one port only; each run of the tests has a loopback address of its own.
    host = f"127.{os.getpid() // 2**16 % 256}.{os.getpid() // 2**8 % 256}.{os.getpid() % 2**8}"
    try:
        socket.create_server((host, 30004)).close()
    except OSError:
        pytest.skip(f"port 30004 of {host} is not free, or this system has one loopback address only")
    with tcp_device(Controller(n=2000), host=host, port=30004):
        client = [sys.executable, "-c", CLIENT, host]
        ran = subprocess.run(client, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines()[-1] == f"{ANGLES.tolist()} {list(VALUES['joint_temperatures'])}"
