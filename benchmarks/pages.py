"""Pages in a headless Chromium: how large, how tall while folded, how soon the view can be turned, how fast it turns.

    python benchmarks/pages.py [--json] [--runs 5]

Needs the extra ``browser`` and Chromium. The demo's page is that of a short training, which has as many figures; the
report is one of 12,000 readings of a virtual arm by a kinematic model of 300.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Browser, sync_playwright

import truearm as ta
from machine import Target, options_of, print_json, print_table, say_machine, say_targets
from truearm.pages.html import write_page
from truearm.pages.page import Page
from truearm.workflows.arms import describe_arm
from truearm.workflows.demo import DemoResult, Settings, experiment

WIDTH, HEIGHT = 1400, 900
SHORT = Settings(n_train=400, n_test=200, hidden=(6, 6), epochs=20)
TURN = """async () => {
  const view = document.querySelector('.space');
  const frame = () => new Promise(requestAnimationFrame);
  const started = performance.now();
  for (let i = 0; i < 20; i += 1) {
    view.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft'}));
    await frame();
  }
  await frame();
  return (performance.now() - started) / 20;
}"""


def large_report() -> Page:
    """The report of 12,000 readings."""
    arm = ta.load_arm("gao2017")
    train, test = (ta.simulate("gao2017", poses=n, seed=seed).session for n, seed in ((300, 1), (12_000, 2)))
    return ta.report(ta.KinematicModel(arm).fit_readings(train), test).page()


def measured(chromium: Browser, path: Path, runs: int) -> dict[str, Any]:
    """Size, height and times of one page."""
    first, cpu, turns, height = [], [], [], 0
    for _ in range(runs):
        tab = chromium.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        inspector = tab.context.new_cdp_session(tab)
        inspector.send("Performance.enable", {"timeDomain": "threadTicks"})  # CPU time, whatever else the machine does
        tab.goto(path.as_uri())
        metrics = {one["name"]: one["value"] for one in inspector.send("Performance.getMetrics")["metrics"]}
        cpu.append(metrics["TaskDuration"])
        first.append(tab.evaluate("performance.getEntriesByName('scenes drawn')[0].startTime") / 1000)
        turns.append(tab.evaluate(TURN))
        height = tab.evaluate("document.documentElement.scrollHeight")
        tab.close()
    return {
        "size [MB]": path.stat().st_size / 1e6,
        "height [px]": height,
        "first frame [s]": min(first),
        "median [s]": median(first),
        "CPU of the whole page [s]": min(cpu),
        "a turn [ms]": min(turns),
    }


def main() -> None:
    """Measure the pages and print them beside their targets."""
    options = options_of(__doc__, runs=5)
    found = {}
    with tempfile.TemporaryDirectory() as name, sync_playwright() as steer:
        pages = {
            "arm": describe_arm("gao2017").page,
            "demo": DemoResult(experiment(seed=0, settings=SHORT), quick=True).page,
            "report of 12,000 readings": large_report,
        }
        chromium = steer.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        for what, page in pages.items():
            write_page(page(), Path(name) / "page.html")
            found[what] = measured(chromium, Path(name) / "page.html", options.runs)
        chromium.close()
    largest, demo = found["report of 12,000 readings"], found["demo"]
    targets = [
        Target("demo, first frame that can be turned [s]", demo["first frame [s]"], 1.5),
        Target("report of 12,000 readings [MB]", largest["size [MB]"], 3),
        Target("report of 12,000 readings, folded, 1400 px wide [px]", largest["height [px]"], 4000),
    ]
    if options.json:
        print_json({"pages": found}, targets)
        return
    say_machine()
    heads = list(demo)
    print_table(["page", *heads], [[what, *(f"{row[head]:.4g}" for head in heads)] for what, row in found.items()])
    say_targets(targets)


if __name__ == "__main__":
    main()
