"""A table of another program, whatever kind of file holds it."""

from __future__ import annotations

from pathlib import Path

from truearm.files.tables.table import Table, TableForm
from truearm.files.tables.text_tables import read_text_table


def read_table(path: str | Path, form: TableForm | None = None) -> Table:
    """Read a table; its content decides its kind, then the suffix of its name.

    Parameters
    ----------
    path : path
        Delimited text.
    form : TableForm, optional
        What a person states about how it is written.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        If the file is missing, too large, no table, or its numbers have two readings; with the place and what to do.
    """
    return read_text_table(Path(path), form or TableForm())
