"""``truearm docs``: the guide's pages, which come with the program."""

from __future__ import annotations

import io
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from truearm.cli.console import print_line

# What a search for a topic leaves out: pages that only lay out the site.
LAYOUT_PAGES = ("index", "start/index", "guide", "files", "reference", "changelog", "api", "commands")


def docs(
    topic: Annotated[str | None, Argument(metavar="[TOPIC]", help="Name of a page; all are listed without.")] = None,
    open_page: Annotated[bool, Option("--open", help="Open the page in the browser instead.")] = False,
) -> None:
    """Print a page of the guide.

    Without a topic, the pages are listed. Messages of other commands name them, for example docs/session-file.md.
    """
    from truearm.errors import InputError
    from truearm.workflows.record import TextTable

    pages = guide_pages()
    if topic is None:
        rows = [[name, title_of(page)] for name, page in pages.items()]
        print_line(str(TextTable(["topic", "page"], rows, left_aligned=(0, 1))))
        return
    name = topic.removeprefix("docs/").removesuffix(".md")
    if name not in pages:
        near = ", ".join(page for page in pages if name in page) or ", ".join(pages)
        raise InputError(f"the guide has no page {topic!r}", hint=f"one of {near}")
    if open_page:
        typer.launch(rendered_page(pages[name]).as_uri())
    else:
        print_line(pages[name].read_text(encoding="utf-8").rstrip())


def guide_pages() -> dict[str, Path]:
    """Pages of the guide by their topics: those installed with the program, or those of a checkout."""
    installed = Path(str(files("truearm"))) / "guide"
    folder = installed if installed.is_dir() else Path(__file__).parents[3] / "docs"
    found = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}
    built = ("_build/", "gallery/", "generated/")
    return {name: path for name, path in found.items() if name not in LAYOUT_PAGES and not name.startswith(built)}


def title_of(page: Path) -> str:
    """The first heading of a page."""
    with page.open(encoding="utf-8") as lines:
        return next((line.lstrip("# ").strip() for line in lines if line.startswith("# ")), page.stem)


def rendered_page(page: Path) -> Path:
    """An HTML file with a page's text, in the folder for temporary files."""
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(record=True, width=110, file=io.StringIO())
    console.print(Markdown(page.read_text(encoding="utf-8")))
    out = Path(tempfile.mkdtemp(prefix="truearm-docs-")) / f"{page.stem}.html"
    out.write_text(console.export_html(), encoding="utf-8")
    return out
