"""TOML documents: read as what a model says they must be, every fault named by its key in plain words."""

from __future__ import annotations

import datetime
import re
import tomllib
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from truearm.errors import InputError

# What is written wrongly most often: 15.01.2026, 25,0004, yes, and a name without quotes.
AS_TOML = "dates as 2026-01-15, a point as decimal sign, true or false, text in quotes"
MOST_KEYS = 20  # named at once

# What pydantic's errors say, in the words of a file.
_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "text that is not empty",
    "string_too_long": "{max_length} characters or fewer",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "literal_error": "{expected}",
    "dict_type": "a table",
    "list_type": "a list in [ ]",
    "tuple_type": "a list in [ ] or entries under [[ ]]",
    "too_short": "{min_length} entries or more",
    "too_long": "{max_length} entries or fewer",
}
_DATE = "a date as 2026-01-15, without a time and without quotes"
_NOT_QUOTED = ("float_type", "int_type", "bool_type")

M = TypeVar("M", bound=BaseModel)


def parse_toml(content: bytes, model: type[M]) -> M:
    """Read the content of a TOML file as what `model` says it must be.

    Raises
    ------
    InputError
        If it is not UTF-8, not TOML, or breaks a rule of the model: with the line, or the keys that are at fault.
    """
    try:
        return model.model_validate(tomllib.loads(content.decode("utf-8-sig")))  # some editors write a byte order mark
    except UnicodeDecodeError as error:
        raise InputError("expected UTF-8 text", line=content[: error.start].count(b"\n") + 1) from None
    except tomllib.TOMLDecodeError as error:
        message, line = str(error), None
        if found := re.search(r" \(at line (\d+), column \d+\)$", message):
            message, line = message[: found.start()], int(found[1])
        hint = None if message.startswith("Cannot") else AS_TOML  # "Cannot overwrite a value": a key that stands twice
        raise InputError(f"not valid TOML: {message}", line=line, hint=hint) from None
    except RecursionError:
        raise InputError("its values are nested too deeply") from None
    except ValidationError as error:
        raise _input_error(error, model) from None
    except ValueError as error:  # numbers of thousands of digits
        raise InputError(f"not valid TOML: {error}") from None


def _input_error(error: ValidationError, model: type[BaseModel]) -> InputError:
    """Say the first broken rule in one sentence, with the keys of all that break it alike."""
    found = error.errors()
    # A misspelt key is an unknown one and a missing one; the first says more.
    first = next((one for one in found if one["type"] == "extra_forbidden"), found[0])
    if first["type"] == "extra_forbidden":
        known = _model_at(model, first["loc"][:-1])
        hint = f"one of {', '.join(known.model_fields)}" if known else None
        return InputError(f"unknown key {_path(first):.80}", hint=hint)
    if first["type"] == "missing":
        return InputError(f"the key {_path(first)} is missing")
    problem, hint = _said(first, model)
    alike = [_path(one) for one in found if one["type"] == first["type"] and _said(one, model) == (problem, hint)]
    more = f" and {len(alike) - MOST_KEYS} more" if len(alike) > MOST_KEYS else ""
    keys = ", ".join(alike[:MOST_KEYS]) + more
    return InputError(f"{keys}: {problem}" if keys else problem, hint=hint)


def _said(error: ErrorDetails, model: type[BaseModel]) -> tuple[str, str | None]:
    """What is wrong, without the key, and what to try."""
    kind, context, came = error["type"], error.get("ctx", {}), error["input"]
    if kind == "value_error":
        said = context["error"]
        return (said.problem, said.hint) if isinstance(said, InputError) else (str(said), None)
    hint = "without quotes" if kind in _NOT_QUOTED and isinstance(came, str) else None
    if kind.startswith("date_"):
        expected = _DATE
    elif kind == "model_type":
        inner = _model_at(model, error["loc"])
        expected = "a table" + (f" of {', '.join(inner.model_fields)}" if inner else "")
    elif kind in _EXPECTED:
        expected = _EXPECTED[kind].format(**context)
    else:
        return f"{error['msg'][0].lower()}{error['msg'][1:]}, got {_shown(came)}", hint
    return f"expected {expected}, got {_shown(came)}", hint


def _path(error: ErrorDetails) -> str:
    """The key with those of the tables that it is in; entries of a list are counted from 1."""
    path = ""
    for part in error["loc"]:
        path += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def _shown(value: Any) -> str:
    """A value as it stands in a file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, dict):
        return "a table"
    return f"{value!r:.80}"


def _model_at(model: type[BaseModel], where: tuple[int | str, ...]) -> type[BaseModel] | None:
    """The model of the table at a place of the file, if its name is a field's."""
    any_key = False
    for part in where:
        if isinstance(part, int) or any_key:  # an entry of a list, or of a table whose keys are anyone's
            any_key = False
            continue
        field = model.model_fields.get(part)
        inner = None if field is None else _model_in(field.annotation)
        if inner is None:
            return None
        any_key = field is not None and get_origin(field.annotation) is dict
        model = inner
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for one in get_args(annotation) if (found := _model_in(one)) is not None), None)
