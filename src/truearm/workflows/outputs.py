"""Files that a verb writes: none of those it has read, and whole or not at all."""

from __future__ import annotations

import json
import os
import re
from abc import abstractmethod
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, get_args

from truearm.choices import FigureFormat
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_new_file, check_writable, is_same_file
from truearm.workflows.record import Record

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.pages.page import Page

T = TypeVar("T")
REPLACE = "another name, or --force to replace it"
FIGURE_ENDINGS = tuple(f".{form}" for form in get_args(FigureFormat))


def check_output_is_not_input(out: str | Path, *inputs: str | Path | None) -> None:
    """Check that a file to write is none of those that are read: readings cannot be measured again.

    Raises
    ------
    InputError
        If `out` is one of `inputs`, or would be one of the session files in a folder of them; those that are None are
        not given.
    """
    if any(is_same_file(out, path) for path in inputs if path is not None):
        raise InputError("the output file is an input file and would be overwritten", file=out, hint="another name")
    for folder in (Path(path) for path in inputs if path is not None and Path(path).is_dir()):
        _check_not_of_session(Path(out), folder)


def _check_not_of_session(out: Path, folder: Path) -> None:
    from truearm.readings.large_sessions import SUFFIXES, session_files  # no small session waits for these

    belongs = out.suffix.lower() in SUFFIXES and Path(os.path.realpath(out)).is_relative_to(os.path.realpath(folder))
    if belongs or any(is_same_file(out, file) for file in session_files(folder)):
        raise InputError("the output file would be one of the readings in the folder", file=out, hint="another folder")


def check_output(
    out: str | Path,
    *inputs: str | Path | None,
    endings: tuple[str, ...] = (),
    read: Callable[[Path], object] | None = None,
) -> None:
    """Check, before long work, that a file can be written that a command can make again.

    Parameters
    ----------
    out : path
    *inputs : path
        What the command reads; None is not given.
    endings : tuple of str
        Of the name; any by default.
    read : callable, optional
        The reader of such files: what it cannot read is another file, and is not replaced.

    Raises
    ------
    InputError
        If the name ends in none of `endings`, is one of `inputs`, or cannot be written; if another file has it.
    """
    out = Path(out)
    if endings and out.suffix not in endings:
        raise InputError(f"expected a file name that ends in {' or '.join(endings)}, got {out.name!r}", file=out)
    check_output_is_not_input(out, *inputs)
    check_writable(out)
    if read is not None and out.exists():
        _read_own(out, read, "another name")


def _read_own(out: Path, read: Callable[[Path], T], hint: str) -> T:
    """What is in a file that is to be replaced."""
    try:
        return read(out)
    except InputError as error:
        problem = f"the file exists already, and is not one that this command writes ({error.problem})"
        raise InputError(problem, file=out, hint=hint) from None


def check_new_output(out: str | Path, *inputs: str | Path | None, force: bool, endings: tuple[str, ...] = ()) -> None:
    """Check, before long work, a file of what people type or measure: it replaces no file, without `force`.

    Raises
    ------
    InputError
        As `check_output`, also with `force`; without it if the file exists.
    """
    check_output_is_not_input(out, *inputs)
    check_new_file(out, force=force, endings=endings)


def check_model_output(out: str | Path, arm: Arm | None, *inputs: str | Path | None, force: bool) -> None:
    """Check a model to be written: it replaces a model of the same arm, and nothing else, without `force`.

    Parameters
    ----------
    out : path
    arm : Arm, optional
        Of the model; None if that is not known yet.
    *inputs : path
    force : bool

    Raises
    ------
    InputError
        As `check_output`, also with `force`; without it if the file exists and is none of this arm's models.
    """
    from truearm.compensation.models.arm_check import other_arm
    from truearm.compensation.models.model_file import load_model

    out = Path(out)
    check_output(out, *inputs)
    if force or not out.exists():
        return
    kept = _read_own(out, load_model, REPLACE)
    if arm is not None and (difference := other_arm(kept.arm_, arm)):
        raise InputError(f"the file has a model of another arm: {difference}", file=out, hint=REPLACE)


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
        from truearm.pages.plotting import save_figure

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
            save_figure(figure, file)
        return files


def _for_file_name(title: str) -> str:
    """The first words of a title, as every file system takes them."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower())[:6]) or "figure"
