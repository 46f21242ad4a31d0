"""TOML documents: read, checked against a pydantic model, every fault reported with its key and a remedy."""

from __future__ import annotations

import datetime
import difflib
import json
import re
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from truearm.errors import InputError, joined
from truearm.files.file_reading import parse_file, utf8_text

MAX_BYTES = 1_000_000
# The usual mistakes: 15.01.2026, 25,0004, yes, and a name without quotes.
AS_TOML = "write dates as 2026-01-15, decimals with a point, true or false, and text in quotes"
MOST_KEYS = 20  # in one message
# A key of more than 32 parts: Python's parser takes time and memory with the square of their number.
_DEEP_KEY = re.compile(
    r"""(?<![\w"'.-])(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""", re.ASCII
)

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]


def reject_control_characters(text: str) -> str:
    """Return the text; refuse characters that a terminal would obey instead of showing, and line breaks."""
    for sign in text:
        if unicodedata.category(sign) in ("Cc", "Zl", "Zp"):
            raise InputError(
                f"expected plain text in one line, got the control character {sign!r}", hint="remove the character"
            )
    return text


Name = Annotated[str, Field(min_length=1, max_length=200, strict=True), AfterValidator(reject_control_characters)]


def toml_text(text: str) -> str:
    """Return a text as TOML writes it; JSON's strings are TOML's, except DEL, which TOML requires escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class Document(BaseModel):
    """A table of a TOML file: unknown keys are refused, values cannot change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


# pydantic's error types, in the terms of a TOML file.
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

# What to do about each of them, where the sentence itself does not say it.
_REMEDIES = {
    "finite_number": "write a number with digits",
    "string_type": "write it in quotes",
    "string_too_short": "fill it in",
    "string_too_long": "shorten it",
    "dict_type": "write a table: [key], or key = { .. }",
    "list_type": "write a list: key = [ .. ]",
    "tuple_type": "write a list: key = [ .. ], or tables under [[key]]",
    "too_short": "add entries",
    "too_long": "remove entries",
}

M = TypeVar("M", bound=BaseModel)


def read_document(path: str | Path, model: type[M]) -> M:
    """Read a TOML file and check it against a model; all faults are raised at once.

    Parameters
    ----------
    path : path
        At most `MAX_BYTES`, UTF-8.
    model : type of BaseModel

    Raises
    ------
    InputError
        If the file is missing, too long, not TOML, or breaks a rule of its format: with the line or the key.
    """
    return parse_file(path, lambda content: parse_toml(content, model), limit_bytes=MAX_BYTES)


def parse_toml(content: bytes, model: type[M]) -> M:
    """Parse the content of a TOML file and check it against a model.

    Raises
    ------
    InputError
        If the content is not UTF-8, not TOML, or breaks a rule of the model: with the line or the keys.
    """
    try:
        return model.model_validate(load_toml(content))
    except tomllib.TOMLDecodeError as error:
        message, line = str(error), None
        if at := re.search(r" \(at line (\d+), column \d+\)$", message):
            message, line = message[: at.start()], int(at[1])
        # "Cannot overwrite a value": the key is there already.
        remedy = "remove the second of the two entries" if message.startswith("Cannot") else AS_TOML
        raise InputError(f"not valid TOML: {message}", line=line, hint=remedy) from None
    except RecursionError:
        raise InputError("the values are nested too deeply", hint="remove the inner brackets") from None
    except ValidationError as error:
        raise _input_error(error, model) from None
    except InputError:
        raise
    except ValueError as error:  # numbers of thousands of digits
        raise InputError(f"not valid TOML: {error}", hint=AS_TOML) from None


def load_toml(content: bytes) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises
    ------
    InputError
        If the content is not UTF-8, or a key has more than 32 parts.
    tomllib.TOMLDecodeError, ValueError, RecursionError
        If it is not TOML.
    """
    text = utf8_text(content)
    if found := _DEEP_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError("a key has more than 32 parts", line=line, hint="remove it, or put the text in quotes")
    return tomllib.loads(text)


def _input_error(error: ValidationError, model: type[BaseModel]) -> InputError:
    """Describe all broken rules, each in one sentence with all keys that break it in the same way."""
    errors = [one for one in error.errors() if not _follows_from_entries(one)]
    unknown = [one for one in errors if one["type"] == "extra_forbidden"]
    missing = _not_misspelt([one for one in errors if one["type"] == "missing"], unknown)
    faults = []
    for one in unknown:
        known = _model_at(model, one["loc"][:-1])
        remedy = f"use one of {', '.join(known.model_fields)}" if known else "remove the key"
        faults.append(InputError(f"unknown key {_path(one):.80}", hint=remedy))
    if missing:
        keys = f"key {_path(missing[0])} is" if len(missing) == 1 else f"keys {_listed(map(_path, missing))} are"
        add = "add the key" if len(missing) == 1 else "add the keys"
        faults.append(InputError(f"the {keys} missing", hint="; ".join([add, *_described(missing, model)])))
    alike: dict[tuple[str, str | None], list[str]] = {}
    for one in errors:
        if one["type"] not in ("extra_forbidden", "missing"):
            alike.setdefault(_describe(one, model), []).append(_path(one))
    for (problem, hint), paths in alike.items():
        keys = _listed(paths)
        faults.append(InputError(f"{keys}: {problem}" if keys else problem, hint=hint))
    found = joined(faults)
    assert found is not None
    return found


def _follows_from_entries(error: ErrorDetails) -> bool:
    """Whether a list only counts as too short because entries of it, which have faults of their own, do not count."""
    return error["type"] == "too_short" and len(error["input"]) >= error.get("ctx", {})["min_length"]


def _described(missing: list[ErrorDetails], model: type[BaseModel]) -> Iterator[str]:
    """What missing keys mean, where their fields say it."""
    for one in missing:
        table = _model_at(model, one["loc"][:-1])
        field = None if table is None else table.model_fields.get(str(one["loc"][-1]))
        if field is not None and field.description is not None:
            yield f"{one['loc'][-1]} is {field.description}"


def _not_misspelt(missing: list[ErrorDetails], unknown: list[ErrorDetails]) -> list[ErrorDetails]:
    """The missing keys without those that an unknown key of the same table stands for.

    A misspelt key is both unknown and missing; the unknown one is the better clue.
    """
    left = list(missing)
    for one in unknown:
        beside = {str(other["loc"][-1]): other for other in left if other["loc"][:-1] == one["loc"][:-1]}
        close = difflib.get_close_matches(str(one["loc"][-1]), beside, n=1)
        if close or len(beside) == 1:
            left.remove(beside[close[0] if close else next(iter(beside))])
    return left


def _listed(paths: Iterable[str]) -> str:
    """Keys separated by commas; of many, the first ones and the number of the others."""
    paths = list(paths)
    more = f" and {len(paths) - MOST_KEYS} more" if len(paths) > MOST_KEYS else ""
    return ", ".join(paths[:MOST_KEYS]) + more


def _describe(error: ErrorDetails, model: type[BaseModel]) -> tuple[str, str | None]:
    """The problem, without the key, and the remedy."""
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "value_error":
        inner = context["error"]
        return (inner.problem, inner.hint) if isinstance(inner, InputError) else (str(inner), None)
    quoted = kind in _NOT_QUOTED and isinstance(value, str)
    hint = "remove the quotes" if quoted else _REMEDIES.get(kind)
    if kind.startswith("date_"):
        expected = _DATE
    elif kind == "model_type":
        inner = _model_at(model, error["loc"])
        expected = "a table" + (f" of {', '.join(inner.model_fields)}" if inner else "")
    elif kind in _EXPECTED:
        expected = _EXPECTED[kind].format(**context)
    else:
        return f"{error['msg'][0].lower()}{error['msg'][1:]}, got {_shown(value)}", hint
    return f"expected {expected}, got {_shown(value)}", hint


def _path(error: ErrorDetails) -> str:
    """The key with the tables around it; entries of a list are counted from 1."""
    path = ""
    for part in error["loc"]:
        path += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def _shown(value: Any) -> str:
    """A value as it is written in a file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, dict):
        return "a table"
    return f"{value!r:.80}"


def _model_at(model: type[BaseModel], where: tuple[int | str, ...]) -> type[BaseModel] | None:
    """The model of the table at a position in the file; None where the position is no field of a model."""
    any_key = False
    for part in where:
        if isinstance(part, int) or any_key:  # an entry of a list, or of a table with free keys
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
