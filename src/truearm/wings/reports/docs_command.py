"""``truearm docs``: the guide's pages, which come with the program."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import tempfile
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.verbs.console import print_line

# What a search for a topic leaves out: pages that only lay out the site.
LAYOUT_PAGES = ("index", "start/index", "files", "reference", "changelog", "api", "commands")


def docs(
    topic: Annotated[
        str | None, Argument(metavar="[TOPIC]", help="Name of a page, guide for the first; all are listed without.")
    ] = None,
    open_page: Annotated[bool, Option("--open", help="Open the page in the browser instead.")] = False,
    run: Annotated[
        Path | None, Option("--run", metavar="FOLDER", help="Run the page's commands there, on its files, instead.")
    ] = None,
) -> None:
    """Print a page of the guide.

    Without a topic, the pages are listed; the page guide says which of them answers which question. Messages of other
    commands name them, for example docs/session-file.md.

    --run writes the files that the page shows into a folder, and runs its commands there with what they print.
    first-certificate goes from an empty folder to a certificate; example-data then adds what other pages need.
    """
    from truearm.verbs.record import TextTable

    pages = guide_pages()
    if topic is None:
        rows = [[name, title_of(page)] for name, page in pages.items()]
        print_line(str(TextTable(["topic", "page"], rows, left_aligned=(0, 1))))
        print_line("truearm docs TOPIC prints a page; truearm docs guide says which page answers which question.")
        return
    name = topic.removeprefix("docs/").removesuffix(".md")
    if name not in pages:
        near = ", ".join(page for page in pages if name in page) or ", ".join(pages)
        raise InputError(f"the guide has no page {topic!r}", hint=f"one of {near}")
    if run is not None:
        run_page(pages[name], run)
    elif open_page:
        typer.launch(rendered_page(pages[name]).as_uri())
    else:
        print_line(text_of(pages[name]).rstrip())


def text_of(page: Path) -> str:
    """A page without what only the site needs: lists of pages, and marks of where a figure comes from."""
    text = re.sub(r"^```\{toctree\}\n.*?^```\n?", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.sub(r"<!-- .*? -->\n?", "", text)


def guide_pages() -> dict[str, Path]:
    """Pages of the guide by their topics: those installed with the program, or those of a checkout."""
    installed = Path(str(files("truearm"))) / "guide"
    folder = installed if installed.is_dir() else Path(__file__).parents[4] / "docs"
    found = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}
    built = ("_build/", "gallery/", "generated/")
    return {name: path for name, path in found.items() if name not in LAYOUT_PAGES and not name.startswith(built)}


def run_page(page: Path, folder: Path) -> None:
    """Write a page's files into a folder and run its commands there, until one of them fails.

    Raises
    ------
    InputError
        If the page has no commands, or the folder holds a file that the page would write.
    """
    from truearm.command_line import FAULT, make_app

    steps = list(steps_of(page.read_text(encoding="utf-8")))
    if not any(isinstance(step, list) for step in steps):
        raise InputError(
            f"docs/{page.stem}.md has no commands that run as they stand", hint="first-certificate or example-data"
        )
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.chdir(folder):
        there = [step[0] for step in steps if isinstance(step, tuple) and Path(step[0]).exists()]
        if there:
            raise InputError(
                f"{there[0]} exists already, and may be yours", file=folder / there[0], hint="a new folder"
            )
        for step in steps:
            if isinstance(step, tuple):
                Path(step[0]).write_text(step[1], encoding="utf-8")
                continue
            print_line(f"$ {shlex.join(['truearm', *step])}")
            code = make_app(step[0])(step, standalone_mode=False, prog_name="truearm") or 0
            if code == 2 or code >= FAULT:  # 1 and 3 are verdicts
                raise InputError(f"the command ended with exit code {code}", file=page)


def steps_of(text: str) -> Iterator[list[str] | tuple[str, str]]:
    """The commands of a page, each a list of arguments, and its files, each a name with its text, in their order."""
    for kind, name, content in re.findall(r"^```(\w+) ?(\S*)\n(.*?)^```", text, flags=re.M | re.S):
        if kind == "console" and not name:
            lines = content.replace("\\\n", " ").splitlines()
            yield from (shlex.split(line)[2:] for line in lines if line.startswith("$ truearm "))
        elif "." in name:
            yield name, content


def title_of(page: Path) -> str:
    """The first heading of a page."""
    with page.open(encoding="utf-8") as lines:
        return next((line.lstrip("# ").strip() for line in lines if line.startswith("# ")), page.stem)


def rendered_page(page: Path) -> Path:
    """An HTML file with a page's text, in the folder for temporary files."""
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(record=True, width=110, file=io.StringIO())
    console.print(Markdown(text_of(page)))
    out = Path(tempfile.mkdtemp(prefix="truearm-docs-")) / f"{page.stem}.html"
    out.write_text(console.export_html(), encoding="utf-8")
    return out
