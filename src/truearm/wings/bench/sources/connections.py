"""Connections to a device: TCP, UDP, a serial port, standard input. Reads are bounded in size and in time.

The packages that some of them need are imported when one is opened.
"""

from __future__ import annotations

import importlib
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any, Protocol, TypeVar

from truearm.errors import InputError, MissingTool
from truearm.wings.bench.sources.sample import Notice, Stream


def extra_package(module: str, extra: str, what: str) -> Any:
    """A module of a package of an extra.

    Parameters
    ----------
    module : str
    extra : str
        Of truearm, which installs it.
    what : str
        What needs it, for the message.

    Raises
    ------
    MissingTool
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingTool(
            f"{what} needs the package {PACKAGES.get(package, package)}, which is not installed",
            hint=f"pip install 'truearm[{extra}]'",
        ) from None


PACKAGES = {"serial": "pyserial", "paho": "paho-mqtt"}  # whose modules have another name


MOST_BYTES = 65536  # in one read
CONNECT_S = 3.0
RETRY_S = 0.5
DEFAULT_BAUD = 115200
PYSERIAL = ("serial", "live", "a serial port")
FORMS = "tcp:HOST:PORT, udp:PORT, serial:PORT:BAUD or stdin"


class Closable(Protocol):
    """What is closed where the connection is lost."""

    def close(self) -> None:
        """Close the connection."""


class Connection(Closable, Protocol):
    """Bytes from and to a device; every method raises OSError where the connection is lost."""

    def receive(self, timeout_s: float) -> bytes:
        """What has arrived, at most `MOST_BYTES`; empty if nothing came in time.

        Raises
        ------
        EOFError
            If the input has ended for good.
        """

    def send(self, data: bytes) -> None:
        """Send all bytes."""


class _Tcp:
    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), timeout=CONNECT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def receive(self, timeout_s: float) -> bytes:
        self._socket.settimeout(timeout_s)
        try:
            data = self._socket.recv(MOST_BYTES)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionError("the device closed the connection")
        return data

    def send(self, data: bytes) -> None:
        self._socket.settimeout(CONNECT_S)
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


class _Udp:
    """Datagrams to a port of this computer, one a read. The device is not answered."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise

    def receive(self, timeout_s: float) -> bytes:
        self._socket.settimeout(timeout_s)
        try:
            return self._socket.recv(MOST_BYTES) or b"\n"  # an empty one is not silence
        except TimeoutError:
            return b""

    def send(self, data: bytes) -> None:
        del data
        raise OSError("a device that sends datagrams is not answered")

    def close(self) -> None:
        self._socket.close()


class _UdpLines(_Udp):
    """Datagrams, each of which ends its line."""

    def receive(self, timeout_s: float) -> bytes:
        data = super().receive(timeout_s)
        return data + b"\n" if data else data


class _Serial:
    def __init__(self, port: str, baud: int) -> None:
        try:
            self._port: Any = extra_package(*PYSERIAL).Serial(port, baud, timeout=CONNECT_S, write_timeout=CONNECT_S)
        except (ValueError, OverflowError) as error:  # a rate that no port has
            raise OSError(str(error)) from None

    def receive(self, timeout_s: float) -> bytes:
        self._port.timeout = timeout_s
        return bytes(self._port.read(min(max(1, self._port.in_waiting), MOST_BYTES)))

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def close(self) -> None:
        self._port.close()


class _StandardInput:
    def receive(self, timeout_s: float) -> bytes:
        stdin = sys.stdin.fileno()
        # Windows cannot wait for a pipe; there a read waits for as long as it takes.
        if sys.platform != "win32" and not select.select([stdin], [], [], timeout_s)[0]:
            return b""
        data = os.read(stdin, MOST_BYTES)
        if not data:
            raise EOFError
        return data

    def send(self, data: bytes) -> None:
        del data
        raise OSError("standard input is not answered")

    def close(self) -> None:
        """Standard input stays open."""


def connector(connection: str) -> Callable[[], Connection]:
    """What opens a connection, such as ``tcp:192.168.0.7:5000`` or ``serial:COM3:115200``.

    Parameters
    ----------
    connection : str
        ``udp:PORT`` listens to this computer only, ``udp:0.0.0.0:PORT`` to the network.

    Returns
    -------
    callable
        It raises OSError if the device is not there.

    Raises
    ------
    InputError
        If it is no such text, or a serial port needs pyserial.
    """
    kind, _, rest = connection.partition(":")
    if kind == "stdin" and not rest:
        return _StandardInput
    host, _, number = rest.rpartition(":")
    if kind == "serial" and rest:
        extra_package(*PYSERIAL)
        port, baud = (host, int(number)) if host and number.isdecimal() else (rest, DEFAULT_BAUD)
        return lambda: _Serial(port, baud)
    if kind not in ("tcp", "udp") or not number.isdecimal() or int(number) > 65535 or (kind == "tcp" and not host):
        raise InputError(f"expected a connection, got {connection!r:.80}", hint=FORMS)
    if kind == "tcp":
        return lambda: _Tcp(host, int(number))
    return lambda: _UdpLines(host or "127.0.0.1", int(number))


def datagram_connector(address: str) -> Callable[[], Connection]:
    """What opens a port of this computer for the datagrams of a device.

    Parameters
    ----------
    address : str
        ``PORT``, from this computer only, or ``HOST:PORT``, the address of this computer on which it listens.

    Raises
    ------
    InputError
        If it is no such text.
    """
    host, _, number = address.rpartition(":")
    if not number.isdecimal() or not 0 < int(number) <= 65535:
        raise InputError(f"expected a port, got {address!r:.80}", hint="PORT, or 0.0.0.0:PORT for all networks")
    return lambda: _Udp(host or "127.0.0.1", int(number))


L = TypeVar("L", bound=Closable)


def connected(connect: Callable[[], L], name: str, talk: Callable[[L], Stream]) -> Stream:
    """What `talk` reads from a connection, which is opened again whenever it is lost.

    Parameters
    ----------
    connect : callable
        As `connector` returns it.
    name : str
        Of the connection, for notices.
    talk : callable
        Reads from the open connection; it raises OSError where the connection, or its synchronization, is lost.
    """
    while True:
        try:
            with closing(connect()) as link:
                yield Notice(f"connected to {name}")
                yield from talk(link)
        except EOFError:
            yield Notice("the input has ended")
            return
        except OSError as error:
            yield Notice(f"no connection to {name} ({error.strerror or error}); trying again")
        except UnicodeError as error:  # a name with a part that is empty, or of more than 63 characters
            raise InputError(f"{name} has no name that a host can have") from error
        time.sleep(RETRY_S)
