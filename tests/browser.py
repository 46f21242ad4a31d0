"""A real browser for tests, without a network: the PDF that it prints of a page."""

import shutil
import subprocess

import pytest

from truearm.pages.html import write_page

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ALONE = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--no-first-run",
)
QUIET = (*ALONE, "--disable-background-networking", "--disable-quic", "--enable-logging=stderr")


def printed(page, folder):
    """The text of each sheet that a browser prints."""
    if BROWSER is None or shutil.which("pdftotext") is None:
        pytest.skip("no chromium or no pdftotext here (on Debian: apt-get install chromium poppler-utils)")
    write_page(page, folder / "page.html")
    out = folder / "page.pdf"
    asked = [f"--user-data-dir={folder / 'profile'}", "--no-pdf-header-footer", f"--print-to-pdf={out}"]
    subprocess.run(
        [BROWSER, *ALONE, *asked, (folder / "page.html").as_uri()], capture_output=True, timeout=120, check=True
    )
    text = subprocess.run(["pdftotext", "-layout", out, "-"], capture_output=True, text=True, timeout=60, check=True)
    return text.stdout.split("\f")[:-1]
