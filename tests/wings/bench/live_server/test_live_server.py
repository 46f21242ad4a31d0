"""The server of the live page: who is let in, who may command, and what hostile clients get."""

import json
import queue
import socket
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from http import HTTPStatus
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import TruearmError
from truearm.wings.bench.live_server import server
from truearm.wings.bench.live_server.messages import Command, Pose, Refused, Said, State
from truearm.wings.bench.live_server.request_checks import RequestChecks
from truearm.wings.bench.live_server.server import LARGEST_MESSAGE, MOST_CLIENTS, LiveServer

client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
exceptions = pytest.importorskip("websockets.exceptions")

TOKEN = "sixteen-letters-"
STATE = State({}, (), None, None, None, (), (), {}, "")
NOTHING = SimpleNamespace(answer=lambda *_: (HTTPStatus.NOT_FOUND, "{}"))  # no operations


@contextmanager
def served(token=""):
    """A server, and the commands that it was given."""
    given_commands: queue.Queue[str] = queue.Queue()
    with LiveServer("<p>the page</p>", RequestChecks("127.0.0.1", token), 0, NOTHING) as server:

        def read():
            for command in server.commands():
                given_commands.put(command)

        reader = threading.Thread(target=read)
        reader.start()
        yield server, given_commands
    reader.join()


def connected(server, **options):
    path, _, query = server.url.removeprefix("http").partition("?")
    return client.connect(f"ws{path}live?{query}", ping_interval=None, proxy=None, close_timeout=1, **options)


def answer(server, head):
    """The first line and the body of the answer to a request."""
    port = int(server.url.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port), timeout=30) as sent:
        sent.sendall(head.replace("PORT", str(port)).encode())
        received = b"".join(iter(lambda: sent.recv(65536), b""))
    first, _, rest = received.decode().partition("\r\n")
    return first, rest.partition("\r\n\r\n")[2]


def get(target="/", host="127.0.0.1:PORT", more=""):
    return f"GET {target} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n"


def said(socket_):
    return json.loads(socket_.recv(timeout=30))


def test_the_page_is_served_and_may_not_be_framed():
    with served() as (server, _):
        first, body = answer(server, get())
        assert (first, body) == ("HTTP/1.1 200 OK", "<p>the page</p>")
        assert answer(server, get(host="localhost:PORT"))[0] == "HTTP/1.1 200 OK"
        assert answer(server, get("/../../etc/passwd"))[0] == "HTTP/1.1 404 Not Found"
        assert answer(server, get("//[")) == ("HTTP/1.1 404 Not Found", "{}")


def test_many_connections_that_say_nothing_leave_the_server_alive(monkeypatch):
    monkeypatch.setattr(server, "MOST_THREADS", 8)
    with served() as (one, _), ExitStack() as opened:
        port, before = int(one.url.split(":")[2].split("/")[0]), threading.active_count()
        silent = [opened.enter_context(socket.create_connection(("127.0.0.1", port), 30)) for _ in range(60)]
        assert silent[-1].recv(1) == b""  # cut off
        assert threading.active_count() < before + 35
        opened.close()
        until_s = time.monotonic() + 60
        while threading.active_count() > before and time.monotonic() < until_s:
            time.sleep(0.01)
        assert answer(one, get())[0] == "HTTP/1.1 200 OK"


@pytest.mark.parametrize(
    "head",
    [
        get(host="evil.example:PORT"),
        get(host="127.0.0.1.evil.example"),
        get(more="Host: 127.0.0.1\r\n"),
        get(more="Origin: http://evil.example\r\n"),
        get(more="Origin: null\r\n"),
        get("/live", more="Upgrade: websocket\r\nOrigin: https://127.0.0.1:PORT\r\n"),
        "GET / HTTP/1.1\r\n\r\n",
        "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1\r\n\r\nx",
        get(more="X: " + "x" * 100_000 + "\r\n"),
        "\x00\xff\r\n\r\n",
    ],
)
def test_other_names_other_origins_and_other_requests_are_refused(head):
    with served() as (server, _):
        try:
            first, body = answer(server, head)
        except ConnectionError:  # it was cut off before all was sent
            first = body = ""
        assert "200" not in first
        assert "101" not in first
        assert "page" not in body
        assert answer(server, get())[0] == "HTTP/1.1 200 OK"


@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", f"?token={TOKEN}x", "?" + "a=1&" * 50, "?token=%ff"])
def test_without_the_token_there_is_neither_page_nor_socket(query):
    with served(TOKEN) as (server, _):
        status, text = answer(server, get(f"/{query}"))
        assert status == "HTTP/1.1 403 Forbidden"
        assert "expected the token" in text
        with pytest.raises(exceptions.InvalidStatus, match="403"):
            client.connect(server.url.split("?")[0].replace("http", "ws") + f"live{query}", proxy=None)
        assert answer(server, get(f"/?token={TOKEN}"))[0] == "HTTP/1.1 200 OK"
        with connected(server) as one:
            assert said(one)["message"] == "role"


def test_another_address_needs_a_token_that_nobody_guesses():
    refuses("give a --token, too", RequestChecks, "0.0.0.0")
    refuses("at least 16 characters, got 5", RequestChecks, "0.0.0.0", "guess")
    RequestChecks("0.0.0.0", TOKEN)
    RequestChecks("localhost")
    refuses("printable", RequestChecks, "0.0.0.0", "\udcff" * 16)


def test_a_token_of_any_signs_opens_the_address_that_is_printed():
    with served("a+b&c=d #%2f;\u00e9 ?/token=") as (server, _):
        assert answer(server, get("/?" + server.url.partition("?")[2]))[0] == "HTTP/1.1 200 OK"
        with connected(server) as one:
            assert said(one)["message"] == "role"


@given(st.text(), st.lists(st.text(), max_size=2), st.lists(st.text(), max_size=2))
def test_whatever_a_request_says_it_is_answered_or_refused(target, hosts, origins):
    RequestChecks("127.0.0.1").refusal(target, hosts, origins)
    assert RequestChecks("127.0.0.1", TOKEN).refusal(target, hosts, origins) is not None


def test_the_first_client_commands_and_the_others_only_read():
    with served() as (server, commands), connected(server) as first, ExitStack() as opened:
        assert said(first)["may_command"]  # it is known to be the first before the second comes
        second = opened.enter_context(connected(server))
        assert not said(second)["may_command"]
        state = {"message": "state", "drawn": {}, "readings": [], "learned": None, "next": None, "model": None}
        state |= {"uncertainties_mm": [], "events": [], "files": {}, "ended": ""}
        assert said(first) == said(second) == state
        second.send(Command(command="undo").model_dump_json())
        assert said(second)["message"] == "refused"
        first.send(Command(command="seat", text="cone A").model_dump_json())
        assert commands.get(timeout=30) == "seat cone A"
        server.send(Said({"event": "notice", "text": "seat cone A"}), STATE)
        assert said(first) == said(second)
        assert commands.empty()


def test_who_comes_when_the_first_has_gone_commands():
    with served() as (server, _):
        with connected(server) as first:
            assert said(first)["may_command"]
        with connected(server) as second:
            assert said(second)["may_command"]


def order(socket_, command):
    socket_.send(Command(command=command).model_dump_json())


def test_the_command_is_given_to_the_page_that_asks_for_it():
    with served() as (server, commands), connected(server) as first, connected(server) as second:
        roles = {one: said(one) for one in (first, second)}
        one, other = (first, second) if roles[first]["may_command"] else (second, first)
        said(one), said(other)
        order(one, "give")
        assert said(one) == {"message": "refused", "text": "no other page asks for the command"}
        order(other, "give")
        assert said(other)["message"] == "refused"
        order(other, "ask")
        assert (said(one)["is_asked"], said(other)["may_command"]) == (True, False)
        order(other, "take")
        assert said(other)["text"] == "another page commands; this one only shows"
        order(one, "give")
        assert (said(one)["may_command"], said(other)["may_command"]) == (False, True)
        order(one, "take")
        assert said(one)["message"] == "refused"
        order(other, "undo")
        assert commands.get(timeout=30) == "undo"
        order(one, "ask")
        assert said(one)["may_command"] is False
        assert said(other)["is_asked"]
        other.close()
        assert said(one)["may_command"]


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{", '{"command": "end"}', '{"command": "take", "x": 1}', "[" * 4000, '{"command": 1}', b"\xff\x00"],
)
def test_what_is_no_command_is_refused_and_nothing_is_done(text):
    with served() as (server, commands), connected(server) as one:
        said(one), said(one)
        one.send(text)
        assert said(one) == {"message": "refused", "text": "this is no command"}
        one.send(Command(command="take").model_dump_json())
        assert commands.get(timeout=30) == "take"


def close_code(server, texts):
    """With which code a client that sends these is cut off."""
    with connected(server) as bad:
        with suppress(exceptions.ConnectionClosed):
            for text in texts:
                bad.send(text)
            while True:
                bad.recv(timeout=30)
        return bad.close_code


def test_a_large_message_and_many_messages_end_the_connection_and_nothing_else():
    with served() as (server, commands), connected(server) as good:
        assert said(good)["may_command"]
        assert close_code(server, ["x" * (LARGEST_MESSAGE + 1)]) == 1009
        assert close_code(server, ["x" * 2_000_000]) == 1009
        assert close_code(server, ["x"] * 10_000) == 1008
        good.send(Command(command="take").model_dump_json())
        assert commands.get(timeout=30) == "take"


def test_a_client_that_does_not_read_delays_nobody():
    tip = {"tip_in_base_mm": [0.0] * 3, "corrected_mm": None, "U_mm": None, "not_corrected": ""}
    joints = {"joints": [0.0] * 6, "pivots": [0.0] * 6, "to_go": None, "temperature_degC": None}
    pose = Pose(**tip, **joints, outside_training=False, is_still=True, is_fitting=False)
    with served() as (server, _), connected(server, max_queue=1) as stuck, connected(server) as good:
        said(good), said(good)
        said(stuck)
        for number in range(3000):
            server.send_newest(pose)
            if number % 10 == 0:
                server.send(Refused("x" * 5000), STATE)
                while said(good)["message"] == "pose":
                    pass


def test_only_so_many_clients_are_let_in():
    with served() as (server, _), ExitStack() as opened:
        for _ in range(MOST_CLIENTS):
            said(opened.enter_context(connected(server)))
        with pytest.raises(exceptions.InvalidStatus, match="503"):
            opened.enter_context(connected(server))


def test_a_port_that_is_taken_is_said():
    with served() as (server, _):
        port = int(server.url.split(":")[2].rstrip("/"))
        with pytest.raises(TruearmError, match="Try: another --port"):
            LiveServer("", RequestChecks("127.0.0.1"), port, NOTHING)
