"""Sums over parts: field by field, and in whatever groups the parts are added."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from truearm.solve.sums import Sums, joined, one_below_the_other
from truearm.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Figures(Sums):
    n: int
    largest: float = field(metadata=joined(max))
    rows: FloatArray = field(metadata=joined(one_below_the_other))
    by_name: Mapping[str, int]
    inner: Figures | Mapping[str, int]


def of(value: int) -> Figures:
    name = "odd" if value % 2 else "even"
    inner = Figures(value, float(value), np.full((1, 2), value), {}, {})
    return Figures(1, float(value), np.full((1, 2), value), {name: value}, inner)


@given(st.lists(st.integers(-99, 99), min_size=3, max_size=9), st.data())
def test_parts_in_any_groups_have_the_sum_of_all(values, data):
    cut = data.draw(st.integers(1, len(values) - 1))
    first, second = values[:cut], values[cut:]

    def total(numbers):
        found, *others = map(of, numbers)
        for other in others:
            found = found + other
        return found

    both = total(first) + total(second)
    assert (both.n, both.largest, both.inner.n) == (len(values), max(values), sum(values))
    assert both.rows[:, 1].tolist() == both.inner.rows[:, 0].tolist() == values
    odd = [value for value in values if value % 2]
    even = [value for value in values if not value % 2]
    assert both.by_name == {name: sum(own) for name, own in (("odd", odd), ("even", even)) if own}
