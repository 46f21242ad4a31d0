"""TOML files of the verification: read whole, checked against a model, every fault named by its key."""

from __future__ import annotations

import re
import tomllib
import unicodedata
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from truearm.arm.bounded import read_bounded
from truearm.errors import InputError

MAX_BYTES = 1_000_000

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]


def without_controls(text: str) -> str:
    """Refuse what a terminal would obey instead of showing it, and what breaks a line; else give the text back."""
    for sign in text:
        if unicodedata.category(sign) in ("Cc", "Zl", "Zp"):
            raise InputError(f"expected plain text in one line, got the control character {sign!r}")
    return text


Name = Annotated[str, Field(min_length=1, max_length=200, strict=True), AfterValidator(without_controls)]


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
        return parsed(read_bounded(path, limit_bytes=MAX_BYTES), model)
    except InputError as error:
        raise error.in_file(path) from None


def parsed(content: bytes, model: type[D]) -> D:
    """Read the content of a TOML file, see `read_document`."""
    try:
        # Editors of some systems begin a file with a byte order mark.
        return model.model_validate(tomllib.loads(content.decode("utf-8-sig").replace("\r\n", "\n")))
    except UnicodeDecodeError as error:
        raise InputError("expected UTF-8 text", line=content[: error.start].count(b"\n") + 1) from None
    except tomllib.TOMLDecodeError as error:
        message, line = str(error), None
        if found := re.search(r" \(at line (\d+), column \d+\)$", message):
            message, line = message[: found.start()], int(found[1])
        raise InputError(f"not valid TOML: {message}", line=line) from None
    except RecursionError:
        raise InputError("its values are nested too deeply") from None
    except ValidationError as error:
        raise _input_error(error, model) from None
    except ValueError as error:  # numbers of thousands of digits
        raise InputError(f"not valid TOML: {error}") from None


def _input_error(error: ValidationError, model: type[Document]) -> InputError:
    """Say the first broken rule in one sentence with the key's path; entries of a list are counted from 1."""
    found = error.errors()
    # A misspelt key is an unknown one and a missing one; the first says more.
    first = next((one for one in found if one["type"] == "extra_forbidden"), found[0])
    path = ""
    for part in first["loc"]:
        path += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if path else part
    if first["type"] == "missing":
        return InputError(f"the key {path} is missing")
    if first["type"] == "extra_forbidden":
        known = _model_at(model, first["loc"][:-1])
        return InputError(f"unknown key {path:.80}", hint=f"one of {', '.join(known.model_fields)}" if known else None)
    if first["type"] == "value_error":
        said = first["ctx"]["error"]
        problem = said.problem if isinstance(said, InputError) else str(said)
        hint = said.hint if isinstance(said, InputError) else None
        return InputError(f"{path}: {problem}" if path else problem, hint=hint)
    return InputError(f"{path}: {first['msg'][0].lower()}{first['msg'][1:]}, got {first['input']!r:.80}")


def _model_at(model: type[Document], where: tuple[int | str, ...]) -> type[Document] | None:
    """The model of the table at a place of the file, if its name is a field's."""
    for part in where:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        inner = None if field is None else _document_in(field.annotation)
        if inner is None:
            return None
        model = inner
    return model


def _document_in(annotation: Any) -> type[Document] | None:
    if isinstance(annotation, type) and issubclass(annotation, Document):
        return annotation
    return next((found for one in get_args(annotation) if (found := _document_in(one)) is not None), None)
