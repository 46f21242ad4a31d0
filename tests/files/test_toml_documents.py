"""TOML documents: every fault is reported with its key, in the terms of the file, and with a remedy."""

import datetime
import tomllib
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator

from refusals import refuses
from truearm.errors import MOST_FAULTS, InputError
from truearm.files.toml_documents import AS_TOML, MOST_KEYS, NotNegative, Positive, load_toml, parse_toml


class Ball(BaseModel):
    model_config = ConfigDict(extra="forbid")

    size_mm: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)]
    points: Annotated[int, Field(strict=True)] = 1
    date: datetime.date | None = None
    good: Annotated[bool, Field(strict=True)] = True
    colour: Literal["red", "blue"] = "red"
    note: Annotated[str, Field(strict=True, min_length=1, max_length=5)] = "none"


class Box(BaseModel):
    model_config = ConfigDict(extra="forbid")

    balls: Annotated[tuple[Ball, ...], Field(max_length=2)] = ()
    best: Ball | None = None
    names: dict[str, str] = {}

    @field_validator("names")
    @classmethod
    def _filled(cls, names: dict[str, str]) -> dict[str, str]:
        if names and not all(names.values()):
            raise InputError("a name is empty", hint="fill it in")
        return names


def refusal(text: str | bytes) -> InputError:
    return refuses(None, parse_toml, text if isinstance(text, bytes) else text.encode(), Box)


@pytest.mark.parametrize(
    "line", ["date = 15.01.2026", "size_mm = 25,0004", "good = no", "note = red", "x = { y = 1,5 }"]
)
def test_invalid_toml_is_reported_with_its_line_and_the_way_values_are_written(line):
    error = refusal(f"[best]\n{line}\n")
    assert error.problem.startswith("not valid TOML: ")
    assert (error.line, error.hint) == (2, AS_TOML)


def test_a_repeated_key_has_a_remedy_of_its_own():
    error = refusal("names = {}\nnames = {}\n")
    assert (error.problem, error.line, error.hint) == (
        "not valid TOML: Cannot overwrite a value",
        2,
        "remove the second of the two entries",
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('size_mm = "25"', "best.size_mm: expected a number, got '25'. Try: remove the quotes"),
        ("size_mm = true", "best.size_mm: expected a number, got true"),
        ("size_mm = nan", "best.size_mm: expected a finite number, got nan. Try: write a number with digits"),
        ("size_mm = 0", "best.size_mm: expected more than 0, got 0"),
        ("size_mm = 101.5", "best.size_mm: expected 100 or less, got 101.5"),
        ("size_mm = 1\npoints = 2.5", "best.points: expected a whole number, got 2.5"),
        ("size_mm = 1\ngood = 'yes'", "best.good: expected true or false, got 'yes'. Try: remove the quotes"),
        ("size_mm = 1\nnote = 3", "best.note: expected text in quotes, got 3. Try: write it in quotes"),
        ("size_mm = 1\nnote = ''", "best.note: expected text that is not empty, got ''. Try: fill it in"),
        ("size_mm = 1\nnote = 'longer'", "best.note: expected 5 characters or fewer, got 'longer'. Try: shorten"),
        ("size_mm = 1\ncolour = 'green'", "best.colour: expected 'red' or 'blue', got 'green'"),
        ("points = 1", "the key best.size_mm is missing. Try: add the key"),
        ("size = 1", "unknown key best.size. Try: use one of size_mm, points, date"),
        *(
            (
                f"size_mm = 1\ndate = {date}",
                f"best.date: expected a date as 2026-01-15, without a time and without quotes, got {shown}",
            )
            for date, shown in (
                ("2026-01-15T10:00:00", "2026-01-15T10:00:00"),
                ("10:00:00", "10:00:00"),
                ("'15.01.2026'", "'15.01.2026'"),
                ("20260115", "20260115"),
                ("{ day = 15 }", "a table"),
            )
        ),
    ],
)
def test_a_wrong_value_is_described_in_the_terms_of_the_file(line, message):
    assert str(refusal(f"[best]\n{line}\n")).startswith(message)


def test_a_value_in_place_of_a_table_or_list_names_the_expected_form():
    assert str(refusal("best = 25")).startswith("best: expected a table of size_mm, points, date")
    assert str(refusal("balls = 25")) == (
        "balls: expected a list in [ ] or entries under [[ ]], got 25. "
        "Try: write a list: key = [ .. ], or tables under [[key]]"
    )
    assert str(refusal("balls = [25]")).startswith("balls[1]: expected a table of size_mm, points, date")
    assert str(refusal("names = 1")) == "names: expected a table, got 1. Try: write a table: [key], or key = { .. }"
    assert "balls: expected 2 entries or fewer" in str(refusal("[[balls]]\nsize_mm = 1\n" * 3))
    assert str(refusal("names = { a = '' }")) == "names: a name is empty. Try: fill it in"


def test_one_message_names_all_keys_with_the_same_fault():
    assert str(refusal("[[balls]]\nsize_mm = 0\n[best]\nsize_mm = 0\n")) == (
        "balls[1].size_mm, best.size_mm: expected more than 0, got 0"
    )
    many = "names = {" + ", ".join(f"n{i} = 1" for i in range(MOST_KEYS + 5)) + "}"
    assert " and 5 more: expected text in quotes, got 1. Try: " in str(refusal(many))


def test_faults_of_different_kinds_are_numbered_in_one_error():
    error = refusal("size = 1\n[best]\nsize_mm = 0\npoints = 2.5\ncolour = 'green'\n[[balls]]\n")
    assert str(error).splitlines() == [
        "5 faults",
        f"  1. unknown key size. Try: use one of {', '.join(Box.model_fields)}",
        "  2. the key balls[1].size_mm is missing. Try: add the key",
        "  3. best.size_mm: expected more than 0, got 0",
        "  4. best.points: expected a whole number, got 2.5",
        "  5. best.colour: expected 'red' or 'blue', got 'green'",
    ]
    assert [fault.hint for fault in error.faults[:2]] == [f"use one of {', '.join(Box.model_fields)}", "add the key"]
    assert "(4) best.points: expected a whole number" in error.problem  # for those who quote it in one line
    assert str(error.in_file("box.toml")).startswith("box.toml: 5 faults\n  1. unknown key size.")
    many = refusal("\n".join(f"k{i} = 1" for i in range(100)))
    assert str(many).splitlines()[-1] == f"  {MOST_FAULTS + 1}. and {100 - MOST_FAULTS} more"


def test_a_misspelt_key_is_not_missing_as_well():
    assert str(refusal("[best]\nsize_m = 1\n")).startswith("unknown key best.size_m. Try")
    assert len(refusal("[best]\nsize_m = 1\npoint = 2\n").faults) == 2


def test_hostile_content_raises_an_input_error():
    assert "expected UTF-8" in str(refusal("best = 'Prüfkörper'".encode("latin-1")))
    assert "nested too deeply" in str(refusal("a = " + "[" * 3000 + "]" * 3000))
    assert "not valid TOML" in str(refusal("a = " + "9" * 5000))


@pytest.mark.parametrize(
    "deep", ["a." * 32 + "a = 1", "[" + "a . " * 32 + "a]", "x = {" + "'a b'.\"c\"." * 16 + "a = 1}"]
)
def test_a_key_of_many_parts_is_refused_before_the_parser_squares_them(deep):
    assert str(refusal(f"# a comment\n{deep}\n")).startswith("line 2: a key has more than 32 parts")


def test_dots_in_texts_and_numbers_are_no_parts_of_a_key():
    text = f"a.{'b.' * 25}c = ['{'1.2.840.113549.' * 20}', \"{'...' * 99}\", {'0.5, ' * 99} 1.5]"
    assert load_toml(text.encode()) == tomllib.loads(text)


def test_windows_line_ends_and_a_byte_order_mark_change_nothing():
    assert parse_toml(b"\xef\xbb\xbf[best]\r\nsize_mm = 2.5\r\n", Box).best.size_mm == 2.5


@pytest.mark.parametrize(("kind", "least", "below"), [(Positive, 1e-300, 0.0), (NotNegative, 0.0, -1e-300)])
def test_a_number_above_zero_is_positive_and_zero_is_not(kind, least, below):
    numbers = TypeAdapter(kind)
    assert numbers.validate_python(least) == least
    for wrong in (below, float("inf"), float("nan")):
        with pytest.raises(ValidationError):
            numbers.validate_python(wrong)
