"""The server of the page: one HTML document and a WebSocket, for a few clients of which the first may command."""

from __future__ import annotations

import logging
import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from http import HTTPStatus
from socket import SHUT_RDWR
from types import TracebackType
from typing import TYPE_CHECKING, Self
from urllib.parse import quote, urlsplit

from pydantic import ValidationError

from truearm.errors import InputError, TruearmError
from truearm.live.messages import Command, Message, Refused, Role, State, encode
from truearm.live.request_checks import RequestChecks

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection

MOST_CLIENTS = 16
LARGEST_MESSAGE = 4096  # bytes; a command has 100
MOST_A_SECOND = 20  # messages of one client
MOST_WAITING = 256  # messages to a client, and commands
PING_S = 5.0
HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class LiveServer:
    """Sends messages to all clients and yields the commands of the first.

    Parameters
    ----------
    page : str
        The HTML document.
    checks : RequestChecks
    port : int
        0: a free one.

    Attributes
    ----------
    url : str
        Of the page, with the token.

    Raises
    ------
    TruearmError
        If the package websockets is missing, or the port cannot be opened.
    """

    def __init__(self, page: str, checks: RequestChecks, port: int) -> None:
        self._page, self._checks, self._run = page.encode(), checks, secrets.token_hex(8)
        self._lock = threading.Lock()
        self._clients: list[_Client] = []
        self._commander: _Client | None = None
        self._state: State = State({}, (), None, None, "")
        self._commands: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self._server = self._listen(port)
        address, port = self._server.socket.getsockname()[:2]
        address = f"[{address}]" if ":" in address else address
        self.url = f"http://{address}:{port}/" + (f"?token={quote(checks.token, safe='')}" if checks.token else "")

    def _listen(self, port: int) -> Server:
        try:
            from websockets.sync.server import serve
        except ImportError:
            raise InputError(
                "the live page needs the package websockets, which is not installed", hint="pip install 'truearm[live]'"
            ) from None
        silent = logging.getLogger("truearm.live")  # of a hostile client nothing needs to be said
        silent.propagate, silent.disabled = False, True
        try:
            return serve(
                self._serve,
                self._checks.host,
                port,
                process_request=self._answer,
                max_size=LARGEST_MESSAGE,
                compression=None,
                open_timeout=3,
                close_timeout=1,
                ping_interval=PING_S,
                ping_timeout=PING_S,
                logger=silent,
            )
        except (OSError, OverflowError) as error:
            raise TruearmError(f"{self._checks.host}, port {port}: {error}. Try: another --port") from None

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, name="truearm live", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(queue.Full):
            self._commands.put_nowait(None)
        with self._lock:
            clients = [*self._clients]
        for client in clients:
            client.finish()
        self._server.shutdown()

    def commands(self) -> Iterator[str]:
        """The commands of the first client, as they come; until the server is closed."""
        yield from iter(self._commands.get, None)

    def send(self, message: Message, state: State) -> None:
        """Send a message to all clients.

        Parameters
        ----------
        message : Message
        state : State
            What clients that come later must know, from now on.
        """
        text = encode(message)
        with self._lock:
            self._state = state
            for client in self._clients:
                client.offer(text)

    def send_newest(self, message: Message) -> None:
        """Send a message of which only the newest counts: a client that is slow gets fewer."""
        text = encode(message)
        with self._lock:
            for client in self._clients:
                if client.has_received_all:
                    client.offer(text)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, a refusal, or None: a WebSocket."""
        headers = request.headers
        problem = self._checks.refusal(request.path, headers.get_all("Host"), headers.get_all("Origin"))
        path = urlsplit(request.path).path
        if problem is None and path == "/live" and "Upgrade" in headers:
            if len(self._clients) < MOST_CLIENTS:
                return None
            problem = HTTPStatus.SERVICE_UNAVAILABLE
        elif problem is None and path != "/":
            problem = HTTPStatus.NOT_FOUND
        if problem is not None:
            return connection.respond(problem, f"{problem.phrase}\n")
        response = connection.respond(HTTPStatus.OK, "")
        response.body = self._page
        del response.headers["Content-Type"], response.headers["Content-Length"]
        response.headers.update({**HEADERS, "Content-Length": str(len(self._page))})
        return response

    def _serve(self, connection: ServerConnection) -> None:
        """Read the messages of a client until it goes."""
        from websockets.exceptions import ConnectionClosed

        client = _Client(connection)
        with self._lock:
            if self._commander is None:
                self._commander = client
            client.offer(encode(Role(self._commander is client, self._run)))
            client.offer(encode(self._state))
            self._clients.append(client)
        try:
            with suppress(ConnectionClosed):
                for text in connection:
                    if client.is_too_fast():
                        connection.close(1008, "too many messages")
                        break
                    if problem := self._receive(client, text):
                        client.offer(encode(Refused(problem)))
        finally:
            with self._lock:
                self._clients.remove(client)
                self._commander = None if self._commander is client else self._commander
            client.finish()

    def _receive(self, client: _Client, text: str | bytes) -> str:
        """Take a command; why it is refused, or nothing."""
        if client is not self._commander:
            return "another page commands; this one only shows"
        try:
            command = Command.model_validate_json(text)
            self._commands.put_nowait(command.line)
        except ValidationError:
            return "this is no command"
        except queue.Full:
            return "too many commands wait"
        return ""


class _Client:
    """A connection, with the messages that wait for it and a thread that sends them."""

    def __init__(self, connection: ServerConnection) -> None:
        self._connection = connection
        self._outgoing: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self._received_s: deque[float] = deque(maxlen=MOST_A_SECOND)
        self._writer = threading.Thread(target=self._write, name="truearm client", daemon=True)
        self._writer.start()

    def _write(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed, OSError):
            for text in iter(self._outgoing.get, None):
                self._connection.send(text)

    def finish(self) -> None:
        """Send what waits, for half a second at most, and nothing more."""
        self.offer(None)
        self._writer.join(timeout=0.5)

    @property
    def has_received_all(self) -> bool:
        """Whether nothing, or one message, waits for it."""
        return self._outgoing.qsize() < 2

    def offer(self, text: str | None) -> None:
        """Send a text after those before it; None ends the thread. A client that has not read for long is cut off."""
        try:
            self._outgoing.put_nowait(text)
        except queue.Full:
            with suppress(OSError):
                self._connection.socket.shutdown(SHUT_RDWR)

    def is_too_fast(self) -> bool:
        """Count a message; whether there were more than `MOST_A_SECOND` in the last second."""
        now_s, received_s = time.monotonic(), self._received_s
        is_full = len(received_s) == received_s.maxlen and now_s - received_s[0] < 1.0
        received_s.append(now_s)
        return is_full
