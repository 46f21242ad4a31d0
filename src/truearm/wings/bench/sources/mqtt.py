"""MQTT: messages in JSON of any shape on a topic of a broker; read only."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from truearm.errors import InputError
from truearm.files.toml_documents import read_document
from truearm.typing import FloatArray
from truearm.wings.bench.sources.connections import CONNECT_S, connected, extra_package
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS, JointScale
from truearm.wings.bench.sources.line_pattern import LARGEST, LARGEST_S
from truearm.wings.bench.sources.sample import SILENT_S, Sample, Source, Stream, samples_in

PORT, TLS_PORT = 1883, 8883
MOST_BYTES = 65536  # of a message
PASSWORD = "TRUEARM_MQTT_PASSWORD"  # noqa: S105, the name of an environment variable

# Keys of objects and indices of lists, from 0, with full stops between them: axes.0.angle
PathInJson = Annotated[str, Field(min_length=1, max_length=200)]


class MqttDocument(JointScale):
    """The file of an arm whose angles are in messages of a broker.

    Attributes
    ----------
    broker : str
        ``HOST`` or ``HOST:PORT``.
    topic : str
    joints : list of str
        Where in the message each joint is, base to tip: keys and indices, as ``axes.0.angle``.
    temperature_degC : str, optional
        Where the temperature of the arm is.
    time_s : str, optional
        Where the device's own clock is, in place of the time of arrival.
    username : str
        Its password is the environment variable TRUEARM_MQTT_PASSWORD.
    tls : bool
    """

    broker: Annotated[str, Field(min_length=1, max_length=300)]
    topic: Annotated[str, Field(min_length=1, max_length=1000)]
    joints: Annotated[tuple[PathInJson, ...], Field(min_length=1, max_length=MOST_JOINTS)]
    temperature_degC: PathInJson | None = None
    time_s: PathInJson | None = None
    username: str = ""
    tls: bool = False


def mqtt(file: Path) -> Source:
    """Samples from the messages of a broker.

    Parameters
    ----------
    file : Path
        Of an `MqttDocument`.

    Raises
    ------
    InputError
        If the file breaks a rule of its format, or the package paho-mqtt is missing.
    """
    document = read_document(file, MqttDocument)
    client = extra_package("paho.mqtt.client", "mqtt", "a broker of MQTT")
    host, colon, number = document.broker.rpartition(":")
    if colon and not (host and number.isdecimal() and 0 < int(number) <= 65535):
        raise InputError(f"expected a broker as HOST or HOST:PORT, got {document.broker!r:.80}", file=file)
    *levels, last = document.topic.split("/")
    if any({"+", "#"} & set(one) for one in levels if one != "+") or (
        last not in ("+", "#") and {"+", "#"} & set(last)
    ):
        raise InputError(f"expected a topic, got {document.topic!r:.80}", file=file, hint="cell/+/joints, or cell/#")
    address = (host, int(number)) if colon else (number, TLS_PORT if document.tls else PORT)
    with InputError.of_file(file):
        decode = partial(decoded, document, document.decoder(len(document.joints)))

    def talk(broker: _Broker) -> Stream:
        return samples_in(broker.messages(), decode, f"messages lack a number at {', '.join(document.joints)}")

    opened = partial(connected, partial(_Broker, client, address, document), f"{address[0]}:{address[1]}", talk)
    slides = document.prismatic(len(document.joints))
    return Source(f"mqtt:{file}", opened, slides, has_own_clock=document.time_s is not None)


def decoded(
    document: MqttDocument, decode: Callable[[Sequence[float]], FloatArray], message: bytes, arrived_s: float
) -> Sample | None:
    """The sample in a message, or None."""
    paths = [*document.joints, document.temperature_degC]
    try:
        if len(message) > MOST_BYTES:
            return None
        content = json.loads(message)
        *joints, temperature = [None if path is None else _number_at(content, path) for path in paths]
        time_s = arrived_s if document.time_s is None else _number_at(content, document.time_s, LARGEST_S)
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return None
    return Sample(time_s, decode([one for one in joints if one is not None]), temperature_degC=temperature)


def _number_at(content: Any, path: str, largest: float = LARGEST) -> float:
    for key in path.split("."):
        content = content[int(key)] if isinstance(content, list) else content[key]
    if isinstance(content, bool) or not isinstance(content, int | float) or not isfinite(content):
        raise TypeError("no number")
    if abs(content) > largest:
        raise ValueError("too large")
    return float(content)


class _Broker:
    """A subscription; OSError where the connection is lost."""

    def __init__(self, library: Any, address: tuple[str, int], document: MqttDocument) -> None:
        self._messages: list[bytes] = []
        self._refused = ""
        self._client = library.Client(library.CallbackAPIVersion.VERSION2)

        def on_connect(client: Any, _data: Any, _flags: Any, code: Any, _properties: Any) -> None:
            if code.is_failure:
                self._refused = f"the broker refuses: {code}"
            else:
                client.subscribe(document.topic)

        def on_subscribe(_client: Any, _data: Any, _mid: Any, codes: Any, _properties: Any) -> None:
            if any(code.is_failure for code in codes):
                self._refused = f"the broker refuses {document.topic:.80}: {codes[0]}"

        self._client.on_connect, self._client.on_subscribe = on_connect, on_subscribe
        self._client.on_message = lambda _client, _data, message: self._messages.append(message.payload)
        self._client.connect_timeout = CONNECT_S
        if document.username:
            self._client.username_pw_set(document.username, os.environ.get(PASSWORD))
        if document.tls:
            self._client.tls_set()
        self._client.connect(*address)

    def messages(self) -> Iterator[bytes | None]:
        """Messages as they arrive; None once a second while nothing does."""
        heard_s = time.monotonic()
        while True:
            lost = self._client.loop(SILENT_S)  # returns with each packet, too
            if not self._messages and (lost or self._refused):
                raise ConnectionError(self._refused or "the broker closed the connection")
            arrived, self._messages = self._messages, []
            if arrived or time.monotonic() - heard_s >= SILENT_S:
                yield from arrived or (None,)
                heard_s = time.monotonic()

    def close(self) -> None:
        """Leave the broker."""
        self._client.disconnect()
