"""Results that have a page of their own, and what their pages and folders have in common."""

from __future__ import annotations

import json
import re
from abc import abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_writable
from truearm.pages import FigureFormat
from truearm.verbs.outputs import check_output, check_output_is_not_input
from truearm.verbs.record import Record

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.pages.page import Page

FIGURE_ENDINGS = tuple(f".{form}" for form in get_args(FigureFormat))


def check_page_path(page: str | Path | None, *inputs: str | Path | None) -> None:
    """Check a page, if there is to be one, as `check_output` does."""
    if page is not None:
        check_output(page, *inputs, endings=(".html", ".htm"))


def check_folder(folder: str | Path, names: Iterable[str]) -> None:
    """Check, before long work, that files of these names can be written to a folder, or the folder be made.

    Raises
    ------
    InputError
        If it is a file, or protected.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError("expected a folder to write to, got a file", file=folder)
    if folder.is_dir():
        for name in names:
            check_writable(folder / name)
        return
    there = next(parent for parent in folder.absolute().parents if parent.exists())
    check_writable(there / folder.absolute().relative_to(there).parts[0])


def make_folder(folder: Path) -> None:
    """Make a folder for files to come, where it does not exist.

    Raises
    ------
    InputError
        If it cannot be made, or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder cannot be made ({error.strerror or error})", file=folder) from None


def input_files(*given: object) -> tuple[Path, ...]:
    """The files among the inputs of a verb, which takes objects, names and paths, of a URDF with its links."""
    from truearm.arm.catalogue import arm_path

    paths = (arm_path(one) for one in given if isinstance(one, str | Path))
    return tuple(path for path in paths if path.is_file())


def write_numbers(record: Record, file: Path) -> None:
    """Write what ``--json`` prints of a result."""
    with atomic_file(file) as beside:
        text = json.dumps(record.to_dict(), indent=1, allow_nan=False) + "\n"
        beside.write_text(text, encoding="utf-8", newline="\n")


def arm_row(arm: Arm) -> tuple[str, str]:
    """The row of a page that names the nominal arm and the source of its numbers."""
    return "arm", f"{arm.name}: {arm.title}. {arm.source}"


def version_row() -> tuple[str, str]:
    """The row of a page that names the programs that calculated it."""
    import numpy
    import scipy

    from truearm import __version__

    return "versions", f"truearm {__version__}, NumPy {numpy.__version__}, SciPy {scipy.__version__}"


class PageRecord(Record):
    """A record that has a page of its own: `page` lays it out, `save_page` writes it as HTML."""

    files: tuple[Path, ...] = ()

    @property
    def input_files(self) -> tuple[Path, ...]:
        """The files from which the result was calculated; no page is written over them."""
        return self.files

    @abstractmethod
    def page(self) -> Page:
        """The result with its figures, tables and sources."""

    def save_page(self, path: str | Path) -> None:
        """Write the page, one HTML file that needs nothing beside it, whole or not at all.

        Parameters
        ----------
        path : path
            Ends in ``.html``.

        Raises
        ------
        InputError
            If the name has another ending, is that of an input file, or cannot be written.
        """
        from truearm.pages.html import write_page
        from truearm.solve.threads import one_blas_thread

        check_page_path(path, *self.input_files)
        with one_blas_thread():
            write_page(self.page(), path)

    def save_figures(self, folder: str | Path, *, ending: str = ".svg") -> tuple[Path, ...]:
        """Write every figure of the page as a file of its own, for a text or a talk.

        Parameters
        ----------
        folder : path
            It is made where it does not exist.
        ending : str
            ``.svg``, ``.pdf`` or ``.png``.

        Returns
        -------
        tuple of Path
            ``01-TITLE.svg`` and so on, by the section of the page.

        Raises
        ------
        InputError
            If the page has no figure, the ending is another, or a file cannot be written.
        """
        folder = Path(folder)
        if ending not in FIGURE_ENDINGS:
            raise InputError(f"expected the ending {', '.join(FIGURE_ENDINGS)}, got {ending!r}")
        make_folder(folder)
        drawn = [(section.title, figure) for section in self.page().sections for figure in section.figures]
        if not drawn:
            raise InputError("this page has no figure")
        names = [f"{i:02d}-{_for_file_name(title)}{ending}" for i, (title, _) in enumerate(drawn, 1)]
        files = tuple(folder / name for name in names)
        for file in files:
            check_output_is_not_input(file, *self.input_files)
        for file, (_, figure) in zip(files, drawn, strict=True):
            figure.save(file)
        return files


def _for_file_name(title: str) -> str:
    """The first words of a title, as every file system takes them."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower())[:6]) or "figure"
