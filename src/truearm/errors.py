"""The errors a user can cause and mend, each one sentence of what was expected, what came and what to try."""

from __future__ import annotations

from pathlib import Path


class TruearmError(Exception):
    """An error the user can mend. The command line prints it in one line and exits with 2."""


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
    ur10
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

    def in_file(self, file: str | Path) -> InputError:
        """The same error, found in `file`."""
        return InputError(self.problem, file=file, line=self.line, column=self.column, hint=self.hint, row=self.row)

    def with_hint(self, hint: str) -> InputError:
        """The same error with another hint."""
        return InputError(self.problem, file=self.file, line=self.line, column=self.column, hint=hint, row=self.row)


class MissingTool(InputError):
    """A package or program that this needs is not installed; the hint says how to get it."""
