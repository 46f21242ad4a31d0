"""The errors a user can cause and mend, each one sentence of what was expected, what came and what to try."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

MOST_FAULTS = 20  # in one message


class TruearmError(Exception):
    """An error the user can mend. The command line prints it, a line for each fault, and exits with 2."""


class InputError(TruearmError, ValueError):
    """Input that is not what it must be.

    Parameters
    ----------
    problem : str
        What was expected and what came, in one sentence without a final full stop.
    file : path, optional
        The file at fault.
    line : int, optional
        The line in `file`, counted from 1, the header included.
    column : str or int, optional
        The column's name, or its number counted from 1.
    hint : str, optional
        What to try.
    row : str, optional
        Name of the row that has no line, as ``reading 12``.

    Examples
    --------
    >>> import truearm as ta
    >>> try:
    ...     ta.load_arm("ur11")
    ... except ta.InputError as error:
    ...     print(error.hint)
    ur10 or ur16e or ur10e; truearm arms lists all
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        column: str | int | None = None,
        hint: str | None = None,
        row: str | None = None,
    ) -> None:
        self.problem = problem
        self.file = None if file is None else Path(file)
        self.line = line
        self.column = column
        self.hint = hint
        self.row = row
        super().__init__(str(self))

    def __str__(self) -> str:
        where = [] if self.file is None else [str(self.file)]
        if self.line is not None:
            where.append(f"line {self.line}")
        if self.row is not None:
            where.append(self.row)
        if self.column is not None:
            where.append(f"column {self.column!r}" if isinstance(self.column, str) else f"column {self.column}")
        message = f"{', '.join(where)}: {self.problem}" if where else self.problem
        return f"{message}. Try: {self.hint}" if self.hint else message

    @property
    def faults(self) -> tuple[InputError, ...]:
        """All faults that were found, each an error of its own: this one alone, unless it is `SeveralFaults`."""
        return (self,)

    def in_file(self, file: str | Path, line: int | None = None) -> InputError:
        """The same error, found in `file`, in its own line or another one."""
        line = line if self.line is None else self.line
        return type(self)(self.problem, file=file, line=line, column=self.column, hint=self.hint, row=self.row)

    @classmethod
    @contextmanager
    def of_file(cls, file: str | Path | None, line: int | None = None) -> Iterator[None]:
        """The errors of a block are of a file and a line, unless they name one themselves; None: they stay."""
        try:
            yield
        except InputError as error:
            raise error if file is None or error.file is not None else error.in_file(file, line) from None

    def with_hint(self, hint: str) -> InputError:
        """The same error with another hint."""
        return type(self)(self.problem, file=self.file, line=self.line, column=self.column, hint=hint, row=self.row)


class Contradiction(InputError):
    """Readings that contradict what they are said to be of: a judgement, which a person may override with a reason."""

    @classmethod
    def of(cls, error: InputError) -> Contradiction:
        """The contradiction that an error states."""
        return cls(error.problem, file=error.file, line=error.line, column=error.column, hint=error.hint, row=error.row)


class SeveralFaults(InputError):
    """Several faults of the input, all that were found, so that a person mends them in one go.

    Parameters
    ----------
    faults : sequence of InputError
        Two or more.
    """

    def __init__(self, faults: Sequence[InputError]) -> None:
        self._faults = tuple(faults)
        files = {fault.file for fault in self._faults}
        file = files.pop() if len(files) == 1 else None
        self._entries = [str(fault if file is None else _without_file(fault)) for fault in self._faults[:MOST_FAULTS]]
        if len(self._faults) > MOST_FAULTS:
            self._entries.append(f"and {len(self._faults) - MOST_FAULTS} more")
        numbered = "; ".join(f"({number}) {entry}" for number, entry in enumerate(self._entries, start=1))
        super().__init__(f"{len(self._faults)} faults: {numbered}", file=file)

    def __str__(self) -> str:
        where = "" if self.file is None else f"{self.file}: "
        numbered = (f"  {number}. {entry}" for number, entry in enumerate(self._entries, start=1))
        return "\n".join([f"{where}{len(self._faults)} faults", *numbered])

    @property
    def faults(self) -> tuple[InputError, ...]:
        """All faults."""
        return self._faults

    def in_file(self, file: str | Path, line: int | None = None) -> SeveralFaults:
        """The same faults, found in `file`."""
        return SeveralFaults([fault.in_file(file, line) for fault in self._faults])

    def with_hint(self, hint: str) -> SeveralFaults:
        """The same faults, the last with another hint."""
        return SeveralFaults([*self._faults[:-1], self._faults[-1].with_hint(hint)])


class FaultCollector:
    """Faults of checks that are made one after the other, raised together.

    Examples
    --------
    >>> from truearm.errors import FaultCollector, InputError
    >>> found = FaultCollector()
    >>> for name in ("a", "b"):
    ...     with found.collect():
    ...         raise InputError(f"{name} is missing")
    >>> print(found.error())
    2 faults
      1. a is missing
      2. b is missing
    """

    def __init__(self) -> None:
        self._found: list[InputError] = []

    @contextmanager
    def collect(self, file: str | Path | None = None) -> Iterator[None]:
        """Keep the faults that the block raises, those of a `file` with its name, and go on after the block."""
        try:
            yield
        except InputError as error:
            self._found += error.faults if file is None else error.in_file(file).faults

    def error(self) -> InputError | None:
        """The error of all faults; None if there are none."""
        return joined(self._found)

    def raise_any(self) -> None:
        """Raise the error of all faults, if there are some.

        Raises
        ------
        InputError
        """
        if (error := self.error()) is not None:
            raise error from None


def joined(faults: Sequence[InputError]) -> InputError | None:
    """The error of some faults, each said once: None of none, itself of one, `SeveralFaults` of more."""
    faults = list({str(fault): fault for fault in faults}.values())
    if len(faults) > 1:
        return SeveralFaults(faults)
    return faults[0] if faults else None


def _without_file(fault: InputError) -> InputError:
    return type(fault)(fault.problem, line=fault.line, column=fault.column, hint=fault.hint, row=fault.row)


class MissingTool(InputError):
    """A package or program that this needs is not installed; the hint says how to get it."""


class ProgramFault(RuntimeError):
    """A fault of this program, not of its input, found before it did harm."""


def extra_module(name: str, needs: str, install: str, *, file: str | Path | None = None) -> Any:
    """A module of a package that is no dependency.

    Parameters
    ----------
    name : str
    needs : str
        What needs which package, as ``PDF files need the package pypdf``.
    install : str
        The hint: how to get it, or how to do without.
    file : path, optional
        That needs it.

    Raises
    ------
    MissingTool
        If it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise MissingTool(f"{needs}, which is not installed", file=file, hint=install) from None
