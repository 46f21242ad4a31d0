"""Sizes of lengths in shares of the measuring range: each bound of a plan is checked, and is met by itself."""

import numpy as np
import pytest

from truearm.wings.laboratory.standards.layout import length_fault
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan, load_verification_plan

RANGE = 2500.0


def fault(plan, test, *lengths_mm):
    found = length_fault(test, getattr(load_verification_plan(plan), test), lengths_mm, RANGE)
    return None if found is None else found[0]


@pytest.mark.parametrize(
    ("plan", "test", "lengths_mm", "said"),
    [
        ("iso10360-12", "uni", (150, 450, 900, 1300, 1700), None),
        ("iso10360-12", "uni", (500, 800, 1100, 1400, 1650), None),  # both bounds exactly
        ("iso10360-12", "bi", (150, 450, 900, 1300, 1649), "the longest length is 1649 mm, the plan asks for 1650 mm"),
        ("iso10360-12", "uni", (501, 800, 1100, 1400, 1700), "the shortest length is 501 mm, the plan asks for 500 mm"),
        ("iso10360-12", "uni", (100, 901, 1100, 1400, 1700), "the widest gap between two of its 5 lengths is 801 mm"),
        ("asme-b89.4.22", "volumetric", (625, 1875), None),  # 50 and 150 % of the reach exactly
        ("asme-b89.4.22", "volumetric", (624, 1500), "the shortest length is 624 mm, the plan asks for 625 mm or more"),
        (
            "asme-b89.4.22",
            "volumetric",
            (938, 1500),
            "the shortest length is 938 mm, the plan asks for 937.5 mm or less",
        ),
        (
            "asme-b89.4.22",
            "volumetric",
            (900, 1499),
            "the longest length is 1499 mm, the plan asks for 1500 mm or more",
        ),
        (
            "asme-b89.4.22",
            "volumetric",
            (900, 1876),
            "the longest length is 1876 mm, the plan asks for 1875 mm or less",
        ),
        ("asme-b89.4.22", "volumetric", (1700,), None),  # a single length is the longest
    ],
)
def test_each_bound_of_a_plan_is_checked(plan, test, lengths_mm, said):
    found = fault(plan, test, *lengths_mm)
    assert found is None if said is None else said in found


@pytest.mark.parametrize("n", [2, 3, 5, 11])
def test_even_lengths_have_no_wide_gap_however_many_they_are(n):
    assert fault("iso10360-12", "uni", *np.linspace(100, 1700, n)) is None


@pytest.mark.parametrize(
    ("plan", "test", "key"),
    [
        ("iso10360-12", "uni", "shortest_most_share"),
        ("iso10360-12", "bi", "gap_ratio"),
        ("asme-b89.4.22", "volumetric", "shortest_share"),
        ("asme-b89.4.22", "volumetric", "shortest_most_share"),
        ("asme-b89.4.22", "volumetric", "longest_most_share"),
    ],
)
def test_another_layout_is_an_own_plan(plan, test, key):
    given = load_verification_plan(plan).model_dump()
    given[test][key]["value"] *= 1.1
    changed = VerificationPlan.model_validate(given)
    assert changed.is_own
    assert "own plan" in changed.heading
    assert [name for name, entry in changed.differences() if entry.startswith(f"{key} = ")] == [test]
