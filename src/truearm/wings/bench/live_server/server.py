"""The server of the page: one HTML document and a WebSocket, for a few clients of which one may command."""

from __future__ import annotations

import logging
import queue
import secrets
import threading
from collections.abc import Iterator
from contextlib import suppress
from http import HTTPStatus
from socket import SHUT_RDWR, socket
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, cast
from urllib.parse import quote

from pydantic import ValidationError

from truearm.errors import InputError, TruearmError
from truearm.wings.bench.live_server.http_operations import HttpOperations, refused
from truearm.wings.bench.live_server.messages import Command, Message, Refused, Role, State, encode
from truearm.wings.bench.live_server.request_checks import RequestChecks, RequestRate, is_post, read_post, send_answer

if TYPE_CHECKING:
    import email.message

    from websockets.datastructures import Headers
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection

MOST_CLIENTS = 16
MOST_THREADS = 128  # a client has 4, a request 1: without an end to them no file could be opened
LARGEST_MESSAGE = 4096  # bytes; a command has 100
MOST_A_SECOND = 20  # messages of one client
MOST_WAITING = 256  # messages to a client, and commands
PING_S = 5.0
HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
HTML = {**HEADERS, "Content-Type": "text/html; charset=utf-8"}
JSON = {**HEADERS, "Content-Type": "application/json"}


class LiveServer:
    """Sends messages to all clients and yields the commands of one.

    Parameters
    ----------
    page : str
        The HTML document.
    checks : RequestChecks
    port : int
        0: a free one.
    operations : HttpOperations
        For other programs, beside the WebSocket.

    Attributes
    ----------
    url : str
        Of the page, with the token.

    Raises
    ------
    TruearmError
        If the package websockets is missing, or the port cannot be opened.
    """

    def __init__(self, page: str, checks: RequestChecks, port: int, operations: HttpOperations) -> None:
        self._operations = operations
        self._page, self._checks, self._run = page.encode(), checks, secrets.token_hex(8)
        self._lock = threading.Lock()
        self._clients: list[_Client] = []
        self._commander: _Client | None = None
        self._asks: _Client | None = None
        self._state: State = State({}, (), None, None, None, (), (), {}, "")
        self._commands: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self._most_threads = threading.active_count() + MOST_THREADS
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
        silent = logging.getLogger("truearm.wings.bench.live_server")  # of a hostile client nothing needs to be said
        silent.propagate, silent.disabled = False, True
        try:
            return serve(
                self._serve,
                self._checks.host,
                port,
                process_request=self._answer,
                create_connection=cast(Any, self._connect),  # a factory, of which websockets knows the type only
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
        """The commands of the client that may, as they come; until the server is closed."""
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

    def _connect(self, sock: socket, *arguments: Any, **options: Any) -> ServerConnection:
        """A connection that websockets reads; a request with a body, which it does not read, is answered here."""
        from websockets.sync.server import ServerConnection

        if threading.active_count() > self._most_threads:
            raise ConnectionAbortedError("there are too many")  # websockets closes it
        if not is_post(sock):
            return ServerConnection(sock, *arguments, **options)
        request = read_post(sock)
        if isinstance(request, HTTPStatus):
            status, text = refused(request)
            send_answer(sock, status, JSON, text.encode())
        else:
            send_answer(sock, *self._reply("POST", request.target, request.headers, request.body))
        raise ConnectionAbortedError("it is answered")

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """The answer to a request without a body; None: a WebSocket."""
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        status, headers, body = self._reply(
            getattr(request, "method", "GET"),  # older websockets refuse others themselves
            request.path,
            request.headers,
        )
        if status == HTTPStatus.SWITCHING_PROTOCOLS:
            return None
        fields = Headers({**headers, "Content-Length": str(len(body)), "Connection": "close"})
        return Response(status.value, status.phrase, fields, body)

    def _reply(
        self, method: str, target: str, headers: Headers | email.message.Message, body: bytes = b""
    ) -> tuple[HTTPStatus, dict[str, str], bytes]:
        """What a request is answered: status, headers and body."""
        hosts, origins = (headers.get_all(name) or [] for name in ("Host", "Origin"))
        problem = self._checks.refusal(target, hosts, origins)
        path = target.partition("?")[0]
        if problem is None and (method, path) == ("GET", "/live") and "Upgrade" in headers:
            full = len(self._clients) >= MOST_CLIENTS
            problem = HTTPStatus.SERVICE_UNAVAILABLE if full else HTTPStatus.SWITCHING_PROTOCOLS
        if problem is not None:
            status, text = refused(problem)
        elif (method, path) == ("GET", "/"):
            return HTTPStatus.OK, HTML, self._page
        else:
            status, text = self._operations.answer(method, path, body)
        return status, JSON, text.encode()

    def _serve(self, connection: ServerConnection) -> None:
        """Read the messages of a client until it goes."""
        from websockets.exceptions import ConnectionClosed

        client = _Client(connection)
        with self._lock:
            if self._commander is None:
                self._commander = client
            client.offer(encode(self._role(client)))
            client.offer(encode(self._state))
            self._clients.append(client)
        try:
            with suppress(ConnectionClosed):
                for text in connection:
                    if client.rate.is_exceeded():
                        connection.close(1008, "too many messages")
                        break
                    if problem := self._receive(client, text):
                        client.offer(encode(Refused(problem)))
        finally:
            with self._lock:
                self._clients.remove(client)
                if self._asks is client:
                    self._asks = None
                if self._commander is client:
                    self._commander, self._asks = self._asks, None
                self._say_roles()
            client.finish()

    def _receive(self, client: _Client, text: str | bytes) -> str:
        """Take a command; why it is refused, or nothing."""
        try:
            command = Command.model_validate_json(text)
            if command.command in ("ask", "give"):
                return self._hand_over(client, is_asked=command.command == "ask")
            if client is not self._commander:
                return "another page commands; this one only shows"
            self._commands.put_nowait(command.line)
        except ValidationError:
            return "this is no command"
        except queue.Full:
            return "too many commands wait"
        return ""

    def _hand_over(self, client: _Client, *, is_asked: bool) -> str:
        """Ask for the command, or give it to the client that asked last; why not, or nothing."""
        with self._lock:
            if is_asked and self._asks is client:
                return ""
            if is_asked and self._commander is not None:
                self._asks = None if self._commander is client else client
            elif is_asked:
                self._commander = client
            elif client is self._commander and self._asks is not None:
                self._commander, self._asks = self._asks, None
            else:
                return "no other page asks for the command"
            self._say_roles()
        return ""

    def _role(self, client: _Client) -> Role:
        is_commander = client is self._commander
        asks = self._asks is client
        return Role(is_commander, is_commander and self._asks is not None, asks, self._commander is None, self._run)

    def _say_roles(self) -> None:
        for client in self._clients:
            client.offer(encode(self._role(client)))


class _Client:
    """A connection, with the messages that wait for it and a thread that sends them."""

    def __init__(self, connection: ServerConnection) -> None:
        self._connection = connection
        self._outgoing: queue.Queue[str | None] = queue.Queue(MOST_WAITING)
        self.rate = RequestRate(MOST_A_SECOND)
        self._writer = threading.Thread(target=self._write, name="truearm client", daemon=True)
        self._writer.start()

    def _write(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed, OSError):
            for text in iter(self._outgoing.get, None):
                self._connection.send(text)
            self._connection.close(1001)  # older websockets leave it open when the server ends

    def finish(self) -> None:
        """Send what waits, for half a second at most, and close the connection."""
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
