"""POST requests, which the package websockets does not read: one a connection, bounded in size and in time."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from email.message import Message
from http import HTTPStatus
from http.client import HTTPException, parse_headers
from io import BytesIO

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
