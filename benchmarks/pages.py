"""Pages in a headless Chromium: how large, how tall while folded, how soon the view can be turned, how fast it turns.

``words`` counts the guide; the other row needs the extra ``browser`` and Chromium. The demo's page is that of a short
training, which has as many figures; the report is one of 12,000 readings of a virtual arm by a kinematic model of 300.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import truearm as ta
from benchmarks.figures import guide
from benchmarks.rows import ROOT, RowResult, Rows, Target, scratch
from truearm.pages.html import write_page
from truearm.pages.page import Page
from truearm.wings.gao2017.demo import DemoResult, Settings, experiment
from truearm.wings.reports.arms import describe_arm

ROWS = Rows()
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


def measured(chromium: Any, path: Path, runs: int) -> dict[str, Any]:
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


@ROWS.row("pages", quick={"runs": 1, "pages": ("arm",)})
def pages(runs: int = 5, pages: tuple[str, ...] = ("arm", "demo", "report of 12,000 readings")) -> RowResult:
    """Size, height and times of three pages."""
    from playwright.sync_api import sync_playwright

    made: dict[str, Callable[[], Page]] = {
        "arm": describe_arm("gao2017").page,
        "demo": lambda: DemoResult(experiment(seed=0, settings=SHORT), quick=True).page(),
        "report of 12,000 readings": large_report,
    }
    table, targets, file = [], [], scratch() / "page.html"
    with sync_playwright() as steer:
        path = shutil.which("chromium")
        chromium = steer.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        for what in pages:
            write_page(made[what](), file)
            row = measured(chromium, file, runs)
            table.append({"page": what, **row})
            if what == "demo":
                targets.append(Target("demo, first frame that can be turned [s]", row["first frame [s]"], 1.5))
            elif what != "arm":
                targets.append(Target(f"{what} [MB]", row["size [MB]"], 3))
                targets.append(Target(f"{what}, folded, 1400 px wide [px]", row["height [px]"], 4000))
        chromium.close()
    return RowResult(table, targets)


@ROWS.row("words")
def words() -> RowResult:
    """Words of the guide, and those outside blocks of code, without marks, generated pages and the house's own."""
    others = {"benchmarks.md", "changelog.md", "house.md", "api.md", "commands.md", "papers.md"}
    table: list[dict[str, Any]] = []
    for page in guide():
        if page.name not in others and not {"gallery", "generated"} & set(page.parts):
            text = re.sub(r"<!--.*?-->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
            outside = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
            words, prose = (sum(bool(re.search(r"\w", word)) for word in one.split()) for one in (text, outside))
            table.append({"page": str(page.relative_to(ROOT)), "words": words, "outside code": prose})
    table.sort(key=lambda one: -one["words"])
    whole = {key: sum(one[key] for one in table) for key in ("words", "outside code")}
    return RowResult([{"page": "all"} | whole, *table])
