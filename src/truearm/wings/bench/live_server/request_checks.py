"""Which requests the server answers: those of its own page, by its own name, with the token where there is one.

A page of another site that the same browser shows can send requests here: its Origin gives it away. A name that its
owner points to this computer (DNS rebinding) would make the origins agree: it is not a name of this server. The package
websockets reads no POST requests: they are read here, one a connection, bounded in size and in time.
"""

from __future__ import annotations

import secrets
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from email.message import Message
from http import HTTPStatus
from http.client import HTTPException, parse_headers
from io import BytesIO
from ipaddress import ip_address
from urllib.parse import parse_qs, urlsplit

from truearm.errors import InputError

READ_S = 3.0  # for a whole request
LARGEST_HEAD = 8192
LARGEST_BODY = 65536


@dataclass(frozen=True)
class PostRequest:
    """A POST request with a JSON body.

    Attributes
    ----------
    target : str
        Path and query.
    headers : Message
    body : bytes
    """

    target: str
    headers: Message
    body: bytes


def is_post(connection: socket.socket) -> bool:
    """Whether a request with a body follows, by its first letter, which stays to be read.

    Raises
    ------
    OSError
        If nothing comes in time.
    """
    connection.settimeout(READ_S)
    first = connection.recv(1, socket.MSG_PEEK)
    connection.settimeout(None)
    return first == b"P"


def read_post(connection: socket.socket) -> PostRequest | HTTPStatus:
    """The request, or why it is refused.

    Raises
    ------
    OSError
        If it does not come whole in time.
    """
    receive = _receiver(connection)
    data = b""
    while b"\r\n\r\n" not in data:
        if len(data) > LARGEST_HEAD:
            return HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
        data += receive()
    head, _, body = data.partition(b"\r\n\r\n")
    line, _, fields = head.partition(b"\r\n")
    try:
        method, target, version = line.decode("ascii").split(" ")
        headers = parse_headers(BytesIO(fields + b"\r\n\r\n"))
        (stated,) = headers.get_all("Content-Length", [])
        length = int(stated) if stated.isascii() and stated.isdecimal() else -1
    except (ValueError, HTTPException):
        return HTTPStatus.BAD_REQUEST
    if method != "POST" or not version.startswith("HTTP/1.") or "Transfer-Encoding" in headers:
        return HTTPStatus.NOT_IMPLEMENTED
    if headers.get_content_type() != "application/json":
        return HTTPStatus.UNSUPPORTED_MEDIA_TYPE
    if not 0 <= length <= LARGEST_BODY:
        return HTTPStatus.REQUEST_ENTITY_TOO_LARGE
    while len(body) < length:
        body += receive()
    return PostRequest(target, headers, body[:length])


def _receiver(connection: socket.socket) -> Callable[[], bytes]:
    """What returns the next bytes, until the time of the request is over."""
    until_s = time.monotonic() + READ_S

    def receive() -> bytes:
        connection.settimeout(max(0.001, until_s - time.monotonic()))
        data = connection.recv(LARGEST_HEAD)
        if not data or time.monotonic() > until_s:
            raise TimeoutError("the request did not come whole")
        return data

    return receive


def send_answer(connection: socket.socket, status: HTTPStatus, headers: dict[str, str], body: bytes) -> None:
    """Send an answer, after which the connection is closed."""
    fields = {**headers, "Content-Length": str(len(body)), "Connection": "close"}
    head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
    connection.sendall(f"HTTP/1.1 {status.value} {status.phrase}\r\n{head}\r\n".encode() + body)


LOOPBACK = ("127.0.0.1", "::1", "localhost")
LEAST_TOKEN = 16
MOST_FIELDS = 8


@dataclass(frozen=True)
class RequestChecks:
    """What a request must have.

    Parameters
    ----------
    host : str
        Address, or name, on which the server listens.
    token : str
        In the query of the request; empty: none is needed, on this computer's own address only.

    Raises
    ------
    InputError
        If an address that other computers reach has no token, or the token is short.
    """

    host: str
    token: str = ""

    def __post_init__(self) -> None:
        if self.host not in LOOPBACK and not self.token:
            raise InputError(f"--host {self.host} lets other computers in", hint="give a --token, too")
        if not self.token.isprintable():
            raise InputError("expected a token of printable characters", hint="letters and digits")
        if self.token and len(self.token) < LEAST_TOKEN:
            raise InputError(f"expected a token of at least {LEAST_TOKEN} characters, got {len(self.token)}")

    def refusal(self, target: str, hosts: list[str], origins: list[str]) -> HTTPStatus | None:
        """Why a request is refused; None if it is answered.

        Parameters
        ----------
        target : str
            Path and query.
        hosts, origins : list of str
            All headers of these names. A browser sends an origin with every WebSocket; other programs send none.
        """
        if len(hosts) != 1 or len(origins) > 1 or not self._is_own(hosts[0]):
            return HTTPStatus.MISDIRECTED_REQUEST
        if origins and origins[0] != f"http://{hosts[0]}":
            return HTTPStatus.FORBIDDEN
        if self.token and not secrets.compare_digest(_token(target).encode(), self.token.encode()):
            return HTTPStatus.FORBIDDEN
        return None

    def _is_own(self, host: str) -> bool:
        """Whether a Host header is the name of the server, or an address, which no DNS server can point elsewhere."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in ("localhost", self.host.lower()):
            return True
        try:
            ip_address(name)
        except ValueError:
            return False
        return True


def _token(target: str) -> str:
    try:
        return parse_qs(urlsplit(target).query, max_num_fields=MOST_FIELDS).get("token", [""])[0]
    except ValueError:
        return ""


class RequestRate:
    """How many requests there were in the last second.

    Parameters
    ----------
    most : int
        How many there may be.
    """

    def __init__(self, most: int) -> None:
        self._received_s: deque[float] = deque(maxlen=most)

    def is_exceeded(self) -> bool:
        """Count a request; whether there were more than may be."""
        now_s, received_s = time.monotonic(), self._received_s
        is_full = len(received_s) == received_s.maxlen and now_s - received_s[0] < 1.0
        received_s.append(now_s)
        return is_full
