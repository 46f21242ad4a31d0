"""TOML files of the verification: read whole, checked against a model, every fault named by its key."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.files.toml_documents import parse_toml

MAX_BYTES = 1_000_000

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]


def reject_control_characters(text: str) -> str:
    """Refuse what a terminal would obey instead of showing it, and what breaks a line; else give the text back."""
    for sign in text:
        if unicodedata.category(sign) in ("Cc", "Zl", "Zp"):
            raise InputError(f"expected plain text in one line, got the control character {sign!r}")
    return text


Name = Annotated[str, Field(min_length=1, max_length=200, strict=True), AfterValidator(reject_control_characters)]


class Document(BaseModel):
    """A table of a file: no unknown keys, no change after it was read."""

    model_config = ConfigDict(extra="forbid", frozen=True)


D = TypeVar("D", bound=Document)


def read_document(path: str | Path, model: type[D]) -> D:
    """Read a TOML file as what `model` says it must be.

    Raises
    ------
    InputError
        If the file is missing, too long, not TOML, or breaks a rule of its format; with the key that is at fault.
    """
    try:
        return parse_toml(read_limited(path, limit_bytes=MAX_BYTES), model)
    except InputError as error:
        raise error.in_file(path) from None
