"""The live page in a real browser: a virtual arm is steered to the next pose, learned from, fitted, and saved."""

import re
import threading

import numpy as np
import pytest

import truearm as ta
from truearm.wings.bench.live_server.http_operations import HttpOperations
from truearm.wings.bench.live_server.live import FRAMES_HZ, LiveRecording, drawn_arm, live_page
from truearm.wings.bench.live_server.request_checks import RequestChecks
from truearm.wings.bench.live_server.server import LiveServer
from truearm.wings.bench.recording.recording import Recording
from truearm.wings.bench.sources import StandstillRule
from truearm.wings.bench.sources.virtual_arm import virtual_arm

pytest.importorskip("websockets", reason="websockets is not installed")

N_BEFORE = 14


@pytest.fixture
def recording(tmp_path):
    """A session of a virtual arm with errors that is continued."""
    simulation = ta.simulate("ur10", poses=N_BEFORE, seed=1)
    ta.Session(simulation.session.angles, points=simulation.session.points).save(tmp_path / "before.csv")
    [*ta.record(f"replay:{tmp_path / 'before.csv'}@max", tmp_path / "session.csv", arm="ur10")]
    virtual = simulation.virtual
    return Recording(
        virtual_arm(virtual.nominal, measured_tip=lambda q: virtual.true_tip(q[None])[0], speed=4.0, is_at_rest=True),
        tmp_path / "session.csv",
        arm="ur10",
        rank=True,
        out_model=tmp_path / "arm.truearm",
        rule=StandstillRule(window_s=0.2),
        samples_hz=FRAMES_HZ,
        on="key",
    )


def test_a_virtual_arm_is_steered_learned_from_fitted_and_saved_by_keyboard(chromium, recording, tmp_path):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    drawn = drawn_arm(recording.arm, recording.model)
    shown, events = LiveRecording(recording, drawn), []
    operations = HttpOperations(recording, shown.newest_pose)

    def run():
        events.extend(shown.follow(server))

    with LiveServer(live_page(recording, drawn), RequestChecks("127.0.0.1"), 0, operations) as server:
        thread = threading.Thread(target=run)
        thread.start()
        tab = chromium.new_context(viewport={"width": 1400, "height": 900}).new_page()
        complaints = []
        tab.on("console", lambda message: complaints.append(message.text))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        try:
            tab.goto(server.url)
            tab.locator("#learned").filter(has_text=re.compile(r"in the volume \d\.\d{3} -> \d\.\d{3} mm")).wait_for()
            tab.locator("#next").filter(has_text="would leave").wait_for()
            assert "Tip of the nominal arm" in tab.locator("#tip-title").inner_text()
            first = tab.locator(".angle").first.inner_text()
            tab.locator("#joints input").first.focus()
            tab.keyboard.press("Home")
            tab.locator(".angle").first.filter(has_not_text=first).wait_for()
            tab.keyboard.press("g")
            tab.locator(".to-go").first.filter(has_text=re.compile(r"^[+\u2212]?[01]$")).wait_for()
            foretold = float(
                re.search(r"would leave an uncertainty of (\d\.\d{3})", tab.locator("#next").inner_text())[1]
            )
            before = tab.locator("#learned").inner_text()
            tab.locator("#condition").filter(has_text="still").wait_for()
            tab.keyboard.press("t")
            tab.locator("#condition").filter(has_text=f"{N_BEFORE + 1} readings").wait_for()
            tab.locator("#learned").filter(has_not_text=before).wait_for()
            found = float(re.search(r"-> (\d\.\d{3})", tab.locator("#learned").inner_text())[1])
            assert found == pytest.approx(foretold, rel=0.1)  # but for what the noise turns out to be
            tab.keyboard.press("r")
            tab.locator("#events li").filter(has_text="new model in force").wait_for(timeout=120_000)
            tab.locator("#tip-title").filter(has_text="Corrected tip").wait_for()
            tab.locator("figcaption").filter(has_text="identified arm, in the frame of the reference").wait_for()
            assert "coloured by residual" in tab.locator("figcaption").inner_text()
            assert re.search(
                r"\d\.\d{3} mm on held-out readings, nominal arm", tab.locator("#model-words").inner_text()
            )
            assert re.search(r"mm after \d+, \d\.\d{3} mm after", tab.locator("#curve").get_attribute("aria-label"))
            tab.keyboard.press("w")
            tab.locator("#events li").filter(has_text="model in ").first.wait_for()
            tab.set_viewport_size({"width": 420, "height": 900})
            tab.emulate_media(color_scheme="dark")
            assert tab.evaluate("document.documentElement.scrollWidth") <= 420
            found = axe.Axe().run(tab).response["violations"]
            assert [one["id"] for one in found if one["impact"] in ("serious", "critical")] == []
            assert complaints == []
        finally:
            tab.context.close()
            server._commands.put("end")
            thread.join()
    assert ta.load_model(tmp_path / "arm.truearm").training_ is not None
    assert np.isfinite(ta.read_session(tmp_path / "session.csv").points[-1]).all()
    assert events[-1].kind == "end"
