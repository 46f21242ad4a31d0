"""The HTTP operations of the live page: corrected coordinates for other programs, and what they refuse."""

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

import numpy as np
import pytest

import truearm as ta
from truearm.wings.bench.live_server import http_operations
from truearm.wings.bench.live_server.http_operations import HttpOperations
from truearm.wings.bench.live_server.live import live
from truearm.wings.bench.live_server.messages import MOST_POSES
from truearm.wings.bench.live_server.request_checks import LARGEST_BODY
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Sample, Source

pytest.importorskip("websockets", reason="websockets is not installed")

SESSION = ta.simulate("ur10", poses=40, seed=1).session
POSE_DEG, OTHER_DEG = np.degrees(SESSION.angles[:2]).tolist()
TOKEN = "sixteen-letters-"


@pytest.fixture(scope="module")
def model():
    return ta.fit("ur10", SESSION, model="kinematic").model


@contextmanager
def bench(out, *, token="", is_silent=False, **options):
    """The address of the page of an arm that stands."""
    ends = threading.Event()

    def samples():
        while not ends.wait(0.02):
            if not is_silent:
                yield Sample(time.monotonic(), np.radians(POSE_DEG))

    events = live(Source("bench", samples), out, port=0, token=token, **options)
    url = next(events).values["url"]
    reader = threading.Thread(target=lambda: [*events])
    reader.start()
    try:
        yield url
    finally:
        ends.set()
        reader.join(60)
        assert not reader.is_alive()


def ask(url, method, path, body=None, **headers):
    """Status and JSON of an answer."""
    place = urlsplit(url)
    client = http.client.HTTPConnection(place.hostname, place.port, timeout=30)
    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    try:
        client.request(method, f"{path}?{place.query}", data, {"Content-Type": "application/json", **headers})
        answer = client.getresponse()
        text = answer.read().decode()
    finally:
        client.close()
    return answer.status, json.loads(text) if answer.headers["Content-Type"] == "application/json" else text


def tip_of(url):
    """The answer of the tip, once the first sample has come."""
    until_s = time.monotonic() + 60
    while (answer := ask(url, "GET", "/tip"))[0] == 503 and time.monotonic() < until_s:
        time.sleep(0.05)
    assert answer[0] == 200
    return answer[1]


@pytest.fixture(scope="module")
def url(model, tmp_path_factory):
    with bench(tmp_path_factory.mktemp("bench") / "session.csv", model=model, token=TOKEN) as address:
        yield address


def test_the_tip_is_what_the_model_predicts(url, model):
    said = tip_of(url)
    assert said["joints"] == pytest.approx(POSE_DEG)
    status, answer = ask(url, "POST", "/predict", {"joints": [POSE_DEG]})
    (predicted,) = answer["tips"]
    angles = np.radians([POSE_DEG])
    point, covariance = model.predict(angles, return_cov=True)
    assert status == 200
    assert predicted["corrected_mm"] == pytest.approx(point[0])
    assert predicted["U_mm"] == pytest.approx(2 * np.sqrt(np.diagonal(covariance[0])))
    assert predicted["tip_in_base_mm"] == pytest.approx(model.arm_.forward(angles).tip_in_base[0])
    assert {name: said[name] for name in predicted} == {
        name: pytest.approx(value) if isinstance(value, list) else value for name, value in predicted.items()
    }


def test_targets_are_those_of_the_verb(url, model):
    joints = [POSE_DEG, OTHER_DEG]
    status, said = ask(url, "POST", "/correct", {"joints": joints})
    wanted = ta.correct(model, np.radians(joints))
    assert status == 200
    assert [one["joints"] for one in said["targets"]] == pytest.approx(np.degrees(wanted.joints))
    assert [one["refused"] for one in said["targets"]] == ["", ""]
    sent = [one["joints"] for one in said["targets"]]
    _, back = ask(url, "POST", "/correct", {"joints": sent, "direction": "feedback"})
    assert [one["joints"] for one in back["targets"]] == pytest.approx(np.array(joints), abs=1e-5)
    points = model.predict(np.radians(joints)).tolist()
    _, placed = ask(url, "POST", "/correct", {"joints": joints, "points_mm": points})
    reached = model.predict(np.radians([one["joints"] for one in placed["targets"]]))
    assert reached == pytest.approx(np.array(points), abs=1e-3)


def test_a_target_beyond_reach_is_refused_by_itself(url, model):
    points = [model.predict(np.radians([POSE_DEG]))[0].tolist(), [9000.0, 0.0, 0.0]]
    body = {"joints": [POSE_DEG] * 2, "points_mm": points, "untrained": "accept"}
    near, far = ask(url, "POST", "/correct", body)[1]["targets"]
    assert (near["refused"], far["joints"], far["U_mm"]) == ("", None, None)
    assert far["refused"] != ""


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("/predict", b"", 400, "Invalid JSON"),
        ("/predict", b"\xff\xfe", 400, "Invalid JSON"),
        ("/predict", b"[" * 60_000, 400, "Invalid JSON"),
        ("/predict", {"joints": []}, 400, "joints: List should have at least 1"),
        ("/predict", {"joints": [POSE_DEG] * (MOST_POSES + 1)}, 400, "joints: List should have at most"),
        ("/predict", {"joints": [["1"] * 6]}, 400, "joints.0.0: Input should be a valid number"),
        ("/predict", b'{"joints": [[NaN, 0, 0, 0, 0, 0]]}', 400, "finite number"),
        ("/predict", {"joints": [[1e300] * 6]}, 400, "joints.0.0: Input should be less than or equal to 1000000000"),
        ("/predict", {"joints": [POSE_DEG], "angle": 1}, 400, "angle: Extra inputs are not permitted"),
        ("/predict", {"joints": [POSE_DEG[:5]]}, 422, "expected 6 joints, got 5 in list 1"),
        (
            "/predict",
            {"joints": [POSE_DEG], "loads": {"load_wind": 1}},
            422,
            "the model knows no load load_wind; it knows",
        ),
        ("/correct", {"joints": [POSE_DEG], "points_mm": [[1, 2, 3]] * 2}, 422, "expected 1 points"),
        ("/correct", {"joints": [POSE_DEG], "direction": "up"}, 400, "direction: Input should be 'command' or"),
        ("/nothing", {}, 404, "Not Found"),
        ("/tip", {}, 405, "Method Not Allowed"),
    ],
)
def test_what_is_wrong_is_said(url, path, body, status, said):
    answered, refused = ask(url, "POST", path, body)
    assert answered == status, refused
    assert said in refused["text"]


def test_the_checks_are_those_of_the_page(url):
    body = {"joints": [POSE_DEG]}
    for wrong, sent, headers, status, said in (
        (url.replace(TOKEN, "x" * 16), body, {}, 403, "the token"),
        (url, body, {"Origin": "http://evil.example"}, 403, "no Origin of another site"),
        (url, body, {"Host": "evil.example"}, 421, "the host"),
        (url, b"{}", {"Content-Type": "text/plain"}, 415, "expected the header Content-Type: application/json"),
        (url, b"x" * (LARGEST_BODY + 1), {}, 413, "at most 65536 bytes"),
    ):
        answered, refused = ask(wrong, "POST", "/predict", sent, **headers)
        assert answered == status
        assert said in refused["text"]
    assert ask(url.replace(TOKEN, ""), "GET", "/openapi.json")[0] == 403
    assert ask(url, "PUT", "/predict", body)[0] == 501
    with suppress(http.client.RemoteDisconnected):  # older websockets close the connection
        assert ask(url, "DELETE", "/tip")[0] == 405
    assert ask(url, "GET", "/predict")[0] == 405


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (b"POST / HTTP/1.1\r\n\r\n", b"400"),
        (b"POST /predict\r\nContent-Length: 2\r\n\r\n{}", b"400"),
        (b"POST /predict HTTP/1.1\r\nContent-Length: 2\r\nContent-Length: 2\r\n\r\n{}", b"400"),
        (b"POST /predict HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: -2\r\n\r\n{}", b"413"),
        (b"POST /predict HTTP/1.1\r\nContent-Length: 0\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", b"501"),
        (b"P" * 20_000, b"431"),
        (b"P\xff \r\n\r\n", b"400"),
    ],
)
def test_what_is_no_request_is_refused(url, request_, said):
    with socket.create_connection(("127.0.0.1", urlsplit(url).port), timeout=30) as client:
        client.sendall(request_)
        first = client.recv(100)
    assert first.startswith(b"HTTP/1.1 " + said), first


def test_a_request_that_does_not_come_whole_ends(url, monkeypatch):
    monkeypatch.setattr("truearm.wings.bench.live_server.request_checks.READ_S", 0.1)
    for begun in (
        b"P",
        b"POST /predict HTTP/1.1\r\n",
        b"POST / HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", urlsplit(url).port), timeout=30) as client:
            client.sendall(begun)
            assert client.recv(100) == b""


def test_without_samples_and_without_a_model_it_says_so(tmp_path):
    with bench(tmp_path / "session.csv", arm="ur10", is_silent=True) as url:
        assert ask(url, "GET", "/tip") == (503, {"text": "the arm sends no samples"})
        (tip,) = ask(url, "POST", "/predict", {"joints": [POSE_DEG]})[1]["tips"]
        assert (tip["corrected_mm"], tip["not_corrected"]) == (None, "no model is in force")
        status, refused = ask(url, "POST", "/correct", {"joints": [POSE_DEG]})
        assert (status, "truearm live --model-file MODEL" in refused["text"]) == (422, True)


def test_too_many_requests_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(http_operations, "MOST_A_SECOND", 3)
    recording = Recording("virtual:ur10", tmp_path / "session.csv", arm="ur10")
    operations = HttpOperations(recording, lambda: None)
    body = json.dumps({"joints": [POSE_DEG]}).encode()
    assert [operations.answer("POST", "/predict", body)[0] for _ in range(5)] == [200, 200, 200, 429, 429]


def test_openapi_describes_what_is_answered(url):
    validator = pytest.importorskip("openapi_spec_validator", reason="openapi-spec-validator is not installed")
    jsonschema = pytest.importorskip("jsonschema")
    status, document = ask(url, "GET", "/openapi.json")
    assert status == 200
    validator.validate(document)
    assert set(document["paths"]) == {"/tip", "/predict", "/correct"}
    schemas = document["components"]["schemas"]
    assert "One list a pose [deg, or mm of sliding joints]" in schemas["Correct"]["description"]
    assert "expanded uncertainties (k = 2) [mm]" in schemas["Pose"]["description"]
    for path, body in (("/tip", None), ("/predict", {"joints": [POSE_DEG]}), ("/correct", {"joints": [POSE_DEG]})):
        (described,) = document["paths"][path].values()
        if body is not None:
            schema = described["requestBody"]["content"]["application/json"]["schema"]
            jsonschema.validate(body, {**schema, "components": document["components"]})
        for code, said in (
            ("200", tip_of(url) if body is None else ask(url, "POST", path, body)[1]),
            ("default", {"text": "no"}),
        ):
            schema = described["responses"][code]["content"]["application/json"]["schema"]
            jsonschema.validate(said, {**schema, "components": document["components"]})
