"""The live page in a real browser: the arm moves, readings are taken and undone, what is lost is said."""

import re
import threading
import time
from importlib.resources import files

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.bench.live_server import messages
from truearm.wings.bench.live_server.http_operations import HttpOperations
from truearm.wings.bench.live_server.live import FRAMES_HZ, LiveRecording, drawn_arm, live_page
from truearm.wings.bench.live_server.messages import encode
from truearm.wings.bench.live_server.request_checks import RequestChecks
from truearm.wings.bench.live_server.server import LiveServer
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import Sample, Source, StandstillRule

pytest.importorskip("websockets", reason="websockets is not installed")


class Bench:
    """An arm that a test moves and unplugs, with a page."""

    def __init__(self, out, *, port=0, **options):
        self.pose, self.is_silent, self.is_over = np.radians([0.0, -90.0, 90.0, 0.0, 90.0, 0.0]), False, False
        recording = Recording(
            Source("bench", self._samples, has_points=True),
            out,
            arm="ur10",
            rule=StandstillRule(window_s=0.1),
            samples_hz=FRAMES_HZ,
            on="key",
            **options,
        )
        self.arm = recording.arm
        drawn = drawn_arm(recording.arm, recording.model)
        self._live = LiveRecording(recording, drawn)
        self.server = LiveServer(
            live_page(recording, drawn),
            RequestChecks("127.0.0.1"),
            port,
            HttpOperations(recording, self._live.newest_pose),
        )
        self._thread = threading.Thread(target=self._run)

    def _samples(self):
        while not self.is_over:
            if not self.is_silent:
                point = self.arm.forward([self.pose]).tip_in_base[0]
                yield Sample(time.monotonic(), self.pose, point, temperature_degC=21.0)
            time.sleep(0.02)

    def _run(self):
        with self.server:
            self.events = [event.kind for event in self._live.follow(self.server)]

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.is_over = True
        self._thread.join()


@pytest.fixture(scope="module")
def files_of_arm(tmp_path_factory):
    """A model, and a plan of two poses."""
    folder = tmp_path_factory.mktemp("live")
    session = ta.simulate("ur10", poses=30, seed=1).session
    ta.fit("ur10", session, model="kinematic").model.save(folder / "model.truearm")
    head = [*(f"q{j}_deg" for j in range(1, 7)), "seat", "note", *(f"note_q{j}_deg" for j in range(1, 7))]
    rows = [[*[""] * 6, "S1", "elbow left", *[f"{10 * k + j}" for j in range(6)]] for k in (1, 2)]
    (folder / "plan.csv").write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    return folder


@pytest.fixture
def tab(chromium):
    page = chromium.new_context(viewport={"width": 1400, "height": 900}).new_page()
    page.complaints = []
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    yield page
    page.context.close()


def newest(page, text):
    page.locator("#events li").first.filter(has_text=text).wait_for()


def test_by_keyboard_alone_a_reading_is_taken_in_a_seat_and_undone(tab, tmp_path, files_of_arm):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    out = tmp_path / "session.csv"
    options = {"model": files_of_arm / "model.truearm", "plan": files_of_arm / "plan.csv"}
    with Bench(out, **options) as bench:
        tab.goto(bench.server.url)
        tab.locator("#x").filter(has_text=re.compile(r"\d\.\d{3}")).wait_for()
        tab.locator("#U-x").filter(has_text="U (k = 2) 0.").wait_for()
        assert "pose 1 of 2, elbow left" in tab.locator("#next").inner_text()
        assert (
            tab.locator("#todo").inner_text() == "Bring the arm to the translucent pose. Press t when it stands still."
        )
        assert tab.locator("#count").inner_text() == "0 of 2"
        assert re.fullmatch(r"[+\u2212]\d+|0", tab.locator(".to-go").first.inner_text())
        drawn = "(canvas) => new Promise(done => requestAnimationFrame(() => done(canvas.toDataURL())))"
        first = tab.locator(".space").evaluate(drawn)
        bench.pose = np.radians([40.0, -60.0, 60.0, 0.0, 90.0, 0.0])
        tab.locator(".angle").first.filter(has_text="40.00").wait_for()
        assert any(tab.locator(".space").evaluate(drawn) != first for _ in range(100))  # some frames later
        tab.keyboard.press("s")
        tab.keyboard.type("tun")
        tab.keyboard.press("Enter")
        newest(tab, "seat tun")
        tab.keyboard.press("t")
        newest(tab, "reading 1, seat tun: mean of")
        assert "coloured by residual, the largest" in tab.locator("figcaption").inner_text()
        assert ta.read_session(out).seat.tolist() == ["tun"]
        for width, scheme in ((420, "dark"), (1400, "light")):
            tab.set_viewport_size({"width": width, "height": 900})
            tab.emulate_media(color_scheme=scheme)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            found = axe.Axe().run(tab).response["violations"]
            assert [one["id"] for one in found if one["impact"] in ("serious", "critical")] == []
        tab.keyboard.press("u")
        tab.locator("button").filter(has_text="Remove reading 1?").wait_for()
        tab.keyboard.press("u")
        newest(tab, "reading 1 removed")
        assert tab.locator("[data-command=undo]").inner_text().startswith("Undo")
        assert tab.locator("[data-command=undo]").is_disabled()
        assert "Undo: there is no reading yet" in tab.locator("#off").inner_text()
        tab.keyboard.press("n")
        tab.locator("#next").filter(has_text="pose 2 of 2").wait_for()
        assert tab.complaints == []
    assert out.read_text().count("\n") == 1


def test_what_is_lost_is_said_and_comes_back(tab, tmp_path):
    with Bench(tmp_path / "session.csv") as bench:
        tab.goto(bench.server.url)
        tab.locator("#condition").filter(has_text="still").wait_for()
        assert "Tip of the nominal arm" in tab.locator("#tip-title").inner_text()
        bench.is_silent = True
        tab.locator("#fault").filter(has_text="The arm sends no samples").wait_for()
        bench.is_silent = False
        tab.locator("#fault:empty").wait_for(state="attached")
        tab.keyboard.press("t")
        newest(tab, "reading 1: mean of")
        tab.reload()
        tab.locator("figcaption").filter(has_text="coloured in their order").wait_for()
        newest(tab, "reading 1: mean of")
        assert tab.complaints == []
    tab.locator("#fault").filter(has_text="The recording has ended: 1 reading in").wait_for()
    assert "session.csv" in tab.locator("#files").inner_text()
    assert "truearm fit" in tab.locator("#after-command").inner_text()
    assert tab.locator("[data-command=take]").is_disabled()
    port = int(bench.server.url.split(":")[2].rstrip("/"))
    with Bench(tmp_path / "session.csv", port=port):
        tab.locator("#fault:empty").wait_for(state="attached")
        tab.locator("#condition").filter(has_text="1 reading").wait_for()


def test_a_second_page_knows_what_was_said_and_is_given_the_command(tab, tmp_path):
    with Bench(tmp_path / "session.csv") as bench:
        tab.goto(bench.server.url)
        tab.locator("#condition").filter(has_text="still").wait_for()
        tab.keyboard.press("t")
        newest(tab, "reading 1: mean of")
        other = tab.context.new_page()
        other.goto(bench.server.url)
        newest(other, "reading 1: mean of")
        other.locator("#role").filter(has_text="This page only shows").wait_for()
        assert other.locator("[data-command=take]").is_disabled()
        other.locator("#ask").click()
        tab.locator("#role").filter(has_text="Another page asks for the command").wait_for()
        tab.locator("#give").click()
        other.locator("#role:empty").wait_for(state="attached")
        tab.locator("#role").filter(has_text="This page only shows").wait_for()
        assert tab.locator("[data-command=take]").is_disabled()
        other.locator("#condition").filter(has_text="still").wait_for()
        other.keyboard.press("t")
        newest(tab, "reading 2: mean of")
        assert tab.complaints == []


def test_the_page_knows_every_message():
    script = files("truearm.wings.bench.live_server").joinpath("live.mjs").read_text("utf-8")
    receive = script[script.index("const receive = {") :]
    known = set(re.findall(r"^  (\w+)(?:\(|:)", receive[: receive.index("\n};")], re.MULTILINE))
    sent = {one.__name__.lower() for one in messages.Message.__args__}
    assert known == sent
    assert encode(messages.Refused("no")) == '{"message":"refused","text":"no"}'


def test_names_are_text_and_never_markup(tmp_path):
    source = Source("</script><script>alert(1)</script>", lambda: iter(()))
    recording = Recording(source, tmp_path / "<b>.csv", arm="ur10")
    page = live_page(recording, drawn_arm(recording.arm, None))
    assert "<script>alert" not in page
    assert "<b>" not in page
    assert "connect-src 'self'" in page


def test_without_an_arm_it_says_what_to_do():
    refuses("--arm ARM, or --model-file MODEL", drawn_arm, None, None)
