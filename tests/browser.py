"""A real browser for tests, without a network: what it shows and complains of, and the PDF that it prints of a page."""

import io
import shutil
import subprocess
from contextlib import contextmanager

import pytest
from matplotlib.image import imread

from truearm.pages.html import write_page

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def printed(chromium, page, folder):
    """The text of each sheet that a browser prints."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext here (on Debian: apt-get install poppler-utils)")
    write_page(page, folder / "page.html")
    with Tab(chromium, folder / "page.html") as tab:
        tab.page.pdf(path=folder / "page.pdf", prefer_css_page_size=True)
    asked = ["pdftotext", "-layout", folder / "page.pdf", "-"]
    text = subprocess.run(asked, capture_output=True, text=True, timeout=60, check=True)
    return text.stdout.split("\f")[:-1]


@contextmanager
def browser():
    """A Chromium that tests steer; they skip where it, or the package that steers it, is missing."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if BROWSER is None:
        pytest.skip("no chromium here (on Debian: apt-get install chromium)")
    with playwright.sync_playwright() as steer:
        chromium = steer.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        chromium.pages = {}
        yield chromium
        chromium.close()


class Tab:
    """A page in a browser with all that it complained of or asked the network for.

    Tests share one page with scripts and one without, which change their size and colours in place: a new one costs
    more than most tests.
    """

    def __init__(self, chromium, path, *, width=1400, scheme="light", scripts=True):
        self.complaints = []
        if scripts not in chromium.pages:
            chromium.pages[scripts] = chromium.new_context(java_script_enabled=scripts).new_page()
        self.page = chromium.pages[scripts]
        self.look(width, scheme)
        self.page.mouse.move(0, 0)
        self.listeners = {
            "console": lambda message: self.complaints.append(message.text),
            "pageerror": lambda error: self.complaints.append(str(error)),
            "request": lambda asked: self._asked(asked.url),
        }
        for event, listener in self.listeners.items():
            self.page.on(event, listener)
        self.page.goto(path.as_uri())

    def look(self, width, scheme):
        """Show the page this wide [px], light or dark."""
        self.page.set_viewport_size({"width": width, "height": 900})
        self.page.emulate_media(media="null", color_scheme=scheme)

    def _asked(self, url):
        if not url.startswith(("file:", "data:")):
            self.complaints.append(url)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for event, listener in self.listeners.items():
            self.page.remove_listener(event, listener)

    def picture(self, selector=".space"):
        """What a canvas shows, to compare, after the next frame was drawn."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return self.page.locator(selector).first.evaluate("(canvas) => canvas.toDataURL()")

    def pixels(self, **options):
        """What the browser shows: an array (height, width, 3) from 0 to 1."""
        return imread(io.BytesIO(self.page.screenshot(**options)))[..., :3]

    def faults(self):
        """Serious and critical faults that axe-core finds for readers who use keyboard or screen reader.

        Of texts that look alike, as the cells of a table do, it asks the contrast of one: to find what is behind a text
        is most of its time.
        """
        axe = pytest.importorskip(
            "axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed"
        )
        options = {"rules": {"color-contrast": {"enabled": False}}, "resultTypes": ["violations"]}
        found = axe.Axe().run(self.page, options=options).response["violations"]
        return [
            (one["id"], node["html"][:200])
            for one in [*found, *self.page.evaluate(_CONTRASTS)]
            if one["impact"] in ("serious", "critical")
            for node in one["nodes"]
        ]


# Of texts with the same colours, size and weight on the same colours one is asked; within drawings axe decides nothing.
_CONTRASTS = """async () => {
  const behind = new Map([[null, ""]]), texts = new Map();
  for (const one of document.querySelectorAll("body, body :not(svg, svg *, script, style)")) {
    const style = getComputedStyle(one);
    const own = [style.backgroundColor, style.backgroundImage, style.opacity, style.position].join();
    behind.set(one, own + "/" + (behind.get(one.parentElement) ?? ""));
    const isText = [...one.childNodes].some((child) => child.nodeType === Node.TEXT_NODE && child.data.trim());
    if (!isText && !one.matches("input, select, textarea")) continue;
    const look = [style.color, style.fontSize, style.fontWeight, behind.get(one)].join();
    if (one.checkVisibility() && !texts.has(look)) texts.set(look, one);
  }
  const options = {runOnly: ["color-contrast"], resultTypes: ["violations"]};
  return (await axe.run({include: [...texts.values()]}, options)).violations;
}"""


# A mail with the page must pass, and a telephone must open it.
MOST_BYTES = 3_000_000


# Text that ends beyond the right edge of the screen, outside tables that a reader moves sideways.
_BEYOND_THE_EDGE = """() => [...document.querySelectorAll("h1, h2, p, strong, summary, dd, li, button, label")]
  .filter((one) => !one.closest(".scroll, .still") && one.getBoundingClientRect().width > 0)
  .filter((one) => one.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((one) => one.textContent.slice(0, 60))"""


# Width [px] and colours of a telephone and of a screen; between them is weekly.
LOOKS = [[(420, "dark"), (1400, "light")], pytest.param([(900, "dark")], marks=pytest.mark.weekly)]


def check_page(chromium, path, looks):
    """Hold a page to what all pages promise in each of these looks; folded parts too.

    It asks no network and complains of nothing, fits its width, has no serious fault for keyboard and screen reader,
    and says what is known of a point. Without scripts the still figure of its view is there.
    """
    assert path.stat().st_size <= MOST_BYTES
    with Tab(chromium, path, width=looks[0][0], scheme=looks[0][1]) as tab:
        tab.page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        for width, scheme in looks:
            tab.look(width, scheme)
            assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
            assert tab.page.evaluate(_BEYOND_THE_EDGE) == []
            assert tab.faults() == []
        if views := tab.page.locator(".space").count():
            tab.picture()
            tab.page.locator(".space").first.press("n")
            if tab.page.locator(".selected").count():
                name, value, *_ = tab.page.locator(".readout").first.inner_text().splitlines()
                assert name
                assert any(sign.isdigit() for sign in value)
        assert tab.complaints == []
    with Tab(chromium, path, scripts=False) as tab:
        assert tab.page.locator("canvas").count() == 0
        assert tab.page.locator(".still").count() == views
        assert tab.complaints == []
