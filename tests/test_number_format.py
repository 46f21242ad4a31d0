"""Numbers carry the digits their uncertainty supports, by the Guide and by hand."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.number_format import (
    MINUS,
    THIN_SPACE,
    TIMES,
    format_exact,
    format_in_text,
    format_number,
    format_uncertainty,
)


@pytest.mark.parametrize(
    ("value", "uncertainty", "shown"),
    [
        (100.02147, 0.00035, "100.02147 g, u = 0.00035 g"),  # the Guide's own example, JCGM 100:2008, 7.2.2
        (10.0568762, 0.027, "10.057 g, u = 0.027 g"),  # and its example of rounding, 7.2.6
        (12.3456, 0.0123, "12.346 g, u = 0.012 g"),
        (12.3456, 0.0996, "12.35 g, u = 0.10 g"),  # rounding carries into the next decade
        (0.0003, 0.5, "0.00 g, u = 0.50 g"),  # nothing of the value is known
        (-0.0003, 0.5, "0.00 g, u = 0.50 g"),  # and zero has no sign
        (1234.5, 120.0, "1230 g, u = 120 g"),  # digits before the point go too
        (-3.14159, 0.02, f"{MINUS}3.142 g, u = 0.020 g"),
        (5.0, 0.0, "5.00 g"),  # the uncertainty is not known
    ],
)
def test_value_ends_at_the_decimal_of_its_uncertainty(value, uncertainty, shown):
    assert format_number(value, uncertainty=uncertainty) == shown.partition(" g")[0]
    if uncertainty:
        assert format_uncertainty(uncertainty) == shown.partition("u = ")[2].removesuffix(" g")


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.44921, 3, "0.449"),
        (0.0149, 2, "0.015"),
        (0.09996, 3, "0.100"),
        (12.345, 3, "12.3"),
        (1234.5, 3, "1234"),  # whole digits stay: nothing says that they are wrong
        (0.0, 3, "0"),
        (-2.5, 3, f"{MINUS}2.50"),
        (1.5e-9, 2, f"1.5 {TIMES} 10⁻⁹"),
        (-2.0e12, 2, f"{MINUS}2.0 {TIMES} 10¹²"),
    ],
)
def test_without_uncertainty_significant_digits_decide(value, digits, shown):
    assert format_number(value, digits=digits).replace(THIN_SPACE, " ") == shown


def test_counts_are_given_whole_and_parted_from_five_digits_on():
    assert format_number(3000) == "3000"
    assert format_number(np.int64(11911)) == f"11{THIN_SPACE}911"
    assert format_number(-1234567) == f"{MINUS}1{THIN_SPACE}234{THIN_SPACE}567"


@pytest.mark.parametrize(("value", "shown"), [(0.05, "0.05"), (22.0, "22"), (3, "3"), (-0.1, f"{MINUS}0.1")])
def test_a_chosen_number_keeps_its_digits(value, shown):
    assert format_exact(value) == shown


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), "0.1", None, True, [1.0]])
def test_what_is_no_finite_number_is_refused(bad):
    refuses("expected a finite number", format_number, bad)


def test_negative_uncertainty_is_refused():
    refuses(r"zero or more, got -0\.1", format_uncertainty, -0.1)


@given(st.floats(-1e4, 1e4), st.floats(1e-4, 1e2))
def test_rounding_moves_a_value_by_less_than_its_uncertainty(value, uncertainty):
    shown = format_number(value, uncertainty=uncertainty).replace(THIN_SPACE, "").replace(MINUS, "-")
    # Two digits of u remain, at least 10: half a unit of the second is 5 % of u; 1e-9 for the decimal itself.
    assert abs(float(shown) - value) <= 0.05 * uncertainty + 1e-9


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 6))
def test_every_finite_number_has_a_short_form(value, digits):
    shown = format_number(value, digits=digits)
    assert len(shown) <= 20
    assert re.fullmatch(rf"[{MINUS}0-9.{THIN_SPACE}{TIMES}⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", shown)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (8.0, "8"),
        (7.9999, "8.00"),  # measured, and its digits count
        (45, "45"),
        (-30.0, f"{MINUS}30"),
        (0.0, "0"),
        (0.00940, "0.00940"),
        (12345.0, f"12{THIN_SPACE}345"),
        (2.0e9, f"2.00{THIN_SPACE}{TIMES}{THIN_SPACE}10\u2079"),
    ],
)
def test_a_sentence_has_whole_numbers_without_decimals(value, shown):
    assert format_in_text(value) == shown
    assert format_in_text(value, unit="mm") == f"{shown}{THIN_SPACE}mm"
