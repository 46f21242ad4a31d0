"""A film of the live page, `python docs/live_film.py`: the demo, from the first reading to the fitted model.

Needs playwright and a Chromium; the film is kept beside this file, so that the site is built without them.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

FILM = Path(__file__).parent / "live_page.gif"
SIZE = {"width": 1240, "height": 860}
WIDTH, COLOURS, FRAME_MS = 760, 128, 350
POSES = 12


def shoot(page: Page, frames: list[Image.Image], n: int) -> None:
    """Take n pictures, one every `FRAME_MS`."""
    for _ in range(n):
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        frames.append(picture.resize((WIDTH, WIDTH * SIZE["height"] // SIZE["width"]), Image.Resampling.LANCZOS))
        page.wait_for_timeout(FRAME_MS)


def main() -> None:
    """Open the demo, bring the arm from pose to pose, fit, and write the film."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    demo = [sys.executable, "-m", "truearm", "live", "--demo", "--port", "0"]
    with subprocess.Popen(demo, stdout=subprocess.PIPE, text=True) as live, sync_playwright() as steer:  # noqa: S603, our own command
        assert live.stdout is not None
        address = next(found[1] for line in live.stdout if (found := re.search(r"Open (http://\S+)", line)))
        page = steer.chromium.launch(executable_path=browser, args=["--no-sandbox"]).new_page(viewport=SIZE)
        page.goto(address)
        page.wait_for_timeout(2500)
        frames: list[Image.Image] = []
        shoot(page, frames, 3)
        for pose in range(POSES):
            page.keyboard.press("g")
            if pose < 3 or pose == POSES - 1:
                shoot(page, frames, 6)
            else:
                page.wait_for_timeout(2600)
                shoot(page, frames, 1)
        page.keyboard.press("r")
        shoot(page, frames, 4)
        page.get_by_text("on held-out readings").first.wait_for(timeout=60_000)
        shoot(page, frames, 4)
        live.terminate()
    palette = frames[-1].quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    pictures = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lengths = [*[FRAME_MS] * (len(pictures) - 1), 3000]
    pictures[0].save(FILM, save_all=True, append_images=pictures[1:], duration=lengths, loop=0, optimize=True)


if __name__ == "__main__":
    main()
