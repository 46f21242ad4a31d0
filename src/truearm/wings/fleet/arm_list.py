"""The arms of a fleet, and a table of arms to add to it, as a spreadsheet saves it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from truearm.choices import ModelName
from truearm.files.delimited import check_names, read_form


@dataclass(frozen=True)
class RegisteredArm:
    """An arm of the fleet.

    Attributes
    ----------
    serial_number, site : str
    arm : str
        The nominal arm: a name of the catalogue, or a file.
    model : str or None
        Kind of model that is fitted, as `truearm.fit` takes it; None stands for ``auto``, or as before.
    every_days : int or None
        Days after which readings are due again.
    session : str
        File of the last readings; empty if there are none.
    """

    serial_number: str
    arm: str
    site: str = ""
    model: ModelName | None = None
    every_days: int | None = None
    session: str = ""


_ARM = TypeAdapter(RegisteredArm)
_NEEDED = ("serial_number", "arm")
_OPTIONAL = tuple(one.name for one in fields(RegisteredArm) if one.name not in _NEEDED)


def read_arm_list(path: str | Path) -> list[RegisteredArm]:
    """Read a table with the columns of `RegisteredArm`, of which ``serial_number`` and ``arm`` are needed.

    Raises
    ------
    InputError
        If it cannot be read, a column is missing or unknown, or a cell is not what it must be.
    """
    return list(_arms(Path(path)))


def _arms(path: Path) -> Iterator[RegisteredArm]:
    sheet = read_form(path)
    check_names(sheet, _NEEDED, _OPTIONAL)
    for i, cells in enumerate(sheet.rows()):
        given = {name: cell.strip() for name, cell in zip(sheet.names, cells, strict=True) if cell.strip()}
        try:
            yield _ARM.validate_python({name: cell for name, cell in given.items() if not name.startswith("note")})
        except ValidationError as error:
            first = error.errors()[0]
            raise sheet.error(first["msg"][0].lower() + first["msg"][1:], i, column=str(first["loc"][0])) from None
