"""MQTT: our source against a broker in a thread, which speaks the packets of MQTT 3.1.1."""

import json
import socket
import struct
import time

import numpy as np
import pytest
from devices import samples_of, tcp_device

from refusals import refuses
from truearm.wings.bench.sources import connections, open_source

pytest.importorskip("paho.mqtt.client", reason="paho-mqtt is not installed")

ANGLES = [10.0, -20.0, 30.0]
GOOD = json.dumps({"axes": [{"deg": angle} for angle in ANGLES], "t": 21.5, "clock": 3.25}).encode()
FILE = """broker = "127.0.0.1:{port}"
topic = "cell/arm"
joints = ["axes.0.deg", "axes.1.deg", "axes.2.deg"]
temperature_degC = "t"
"""


class Broker:
    """What a broker says to one client: it is let in, subscribes, and gets messages.

    Parameters
    ----------
    messages : bytes
    code : int
        Of the answer to CONNECT; 0 lets it in.
    topic_code : int
        Of the answer to SUBSCRIBE; 128 refuses.
    """

    def __init__(self, *messages, code=0, topic_code=0):
        self.messages, self.code, self.topic_code, self.topics = messages, code, topic_code, []

    def __call__(self, client: socket.socket) -> None:
        kind, content = self._packet(client)
        assert (kind, content[:6]) == (0x10, b"\0\4MQTT")
        client.sendall(bytes([0x20, 2, 0, self.code]))
        if self.code:
            return
        kind, content = self._packet(client)
        assert kind == 0x82
        (size,) = struct.unpack_from(">H", content, 2)
        self.topics.append(content[4 : 4 + size].decode())
        client.sendall(b"\x90\x03" + content[:2] + bytes([self.topic_code]))
        for message in self.messages:
            body = struct.pack(">H", 8) + b"cell/arm" + message
            size = b""
            left = len(body)
            while left or not size:
                size += bytes([left & 0x7F | (0x80 if left > 0x7F else 0)])
                left >>= 7
            client.sendall(b"\x30" + size + body)
            time.sleep(0.002)

    @staticmethod
    def _packet(client):
        head = client.recv(2)
        if len(head) < 2 or head[1] > 127:
            raise OSError("the client has gone")
        data = b""
        while len(data) < head[1]:
            data += client.recv(head[1] - len(data))
        return head[0], data


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)


def source(tmp_path, port, more=""):
    file = tmp_path / "mqtt.toml"
    file.write_text(FILE.format(port=port) + more)
    return open_source(f"mqtt:{file}")


def test_angles_and_temperature_in_json(tmp_path):
    broker = Broker(GOOD, GOOD, GOOD)
    with tcp_device(broker) as port:
        samples, _ = samples_of(source(tmp_path, port, "sign = [1, -1, 1]\n"), 3)
    for sample in samples:
        assert np.degrees(sample.joint_angles_rad) == pytest.approx([10, 20, 30])
        assert sample.temperature_degC == 21.5
    assert broker.topics[0] == "cell/arm"


def test_the_clock_of_the_device_is_used_where_the_file_names_it(tmp_path):
    with tcp_device(Broker(GOOD)) as port:
        (sample,), _ = samples_of(source(tmp_path, port, 'time_s = "clock"\n'), 1)
    assert sample.time_s == 3.25
    since_1970 = GOOD.replace(b"3.25", b"1795756800.25")
    with tcp_device(Broker(since_1970)) as port:
        (sample,), _ = samples_of(source(tmp_path, port, 'time_s = "clock"\n'), 1)
    assert sample.time_s == 1795756800.25


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"{",
        b"[1, 2, 3]",
        b'{"axes": []}',
        b'{"axes": {"0": {"deg": 1}}}',
        GOOD.replace(b"10.0", b'"10"'),
        GOOD.replace(b"10.0", b"NaN"),
        GOOD.replace(b"10.0", b"1e300"),
        GOOD.replace(b"10.0", b"true"),
        GOOD.replace(b"10.0", b"1" * 400),
        GOOD.replace(b"10.0", b"1" * 5000),
        GOOD.replace(b"21.5", b"null"),
        b"[" * 60_000,
        GOOD[:-1] + b" " * 70_000 + b"}",
        b"\xff\xfe\xfd",
    ],
)
def test_what_is_no_message_of_the_arm_is_said_and_is_no_sample(tmp_path, message):
    with tcp_device(Broker(message, GOOD)) as port:
        samples, notices = samples_of(source(tmp_path, port), 1)
    assert len(samples[0].joint_angles_rad) == 3
    assert any("1 messages lack a number at axes.0.deg" in text for text in notices), notices


def test_a_lost_broker_and_a_refusal_are_said_and_it_connects_again(tmp_path):
    with tcp_device(Broker(code=5), Broker(topic_code=128), Broker(GOOD), Broker(GOOD, GOOD)) as port:
        samples, notices = samples_of(source(tmp_path, port), 3)
    assert len(samples) == 3
    assert "nothing was received for a second" not in notices
    assert any("the broker refuses: Not authorized" in text for text in notices), notices
    assert any("the broker refuses cell/arm: " in text for text in notices), notices
    assert any("the broker closed the connection" in text for text in notices), notices


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("127.0.0.1:{port}", "127.0.0.1:port"), "expected a broker as HOST or HOST:PORT"),
        (("127.0.0.1:{port}", "127.0.0.1:0"), "expected a broker as HOST or HOST:PORT"),
        (("topic = ", "topics = "), "topic"),
        (("cell/arm", "cell/#/arm"), "expected a topic"),
        (("cell/arm", "cell+"), "expected a topic"),
        (('"axes.2.deg"]', '"axes.2.deg"]\nsign = [1, 1]'), "expected 3 entries of sign"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, change, said):
    file = tmp_path / "mqtt.toml"
    file.write_text(FILE.replace(*change).format(port=1))
    refuses(said, open_source, f"mqtt:{file}")
