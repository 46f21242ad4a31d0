"""Errors of seats and lengths, by hand and against plain loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Lengths, length_errors, seat_errors


def test_two_seats_by_hand():
    """Seat A: two points 2 mm apart, each 1 mm from the mean. B: mean at the origin; 3, 3 and 0 mm from it."""
    points = [[10.0, 0, 1], [0, 3, 0], [10, 0, -1], [0, -3, 0], [0, 0, 0], [99, 99, 99], [5, 5, 5]]
    errors = seat_errors(points, ["A", "B", "A", "B", "B", "", "lone"])
    assert errors == {
        "seat_mean_mm": pytest.approx(8 / 5),
        "seat_rms_mm": pytest.approx(2.0),  # sqrt((1 + 1 + 9 + 9) / 5)
        "seat_max_mm": 3.0,
        "n_in_seats": 5,
        "seats": {
            "A": {"mean_mm": 1.0, "rms_mm": 1.0, "max_mm": 1.0, "n": 2},
            "B": {"mean_mm": 2.0, "rms_mm": pytest.approx(6**0.5), "max_mm": 3.0, "n": 3},
        },
    }
    lengths = Lengths(["B", "lone"], ["A", "B"], [9.5, 10.0], [0.1, 0.1])
    # The means are at (10, 0, 0) and 0; the seat with one reading is at (5, 5, 5).
    np.testing.assert_allclose(
        length_errors(points, ["A", "B", "A", "B", "B", "", "lone"], lengths), [0.5, 75**0.5 - 10]
    )


@settings(max_examples=50)
@given(names=st.lists(st.sampled_from(["", "a", "b", "c", "dd"]), min_size=2, max_size=30), seed=st.integers(0, 99))
def test_against_plain_loops(names, seed):
    points = np.random.default_rng(seed).normal(size=(len(names), 3)) * 100
    seats = {name: [points[i] for i, n in enumerate(names) if n == name] for name in sorted(set(names) - {""})}
    distances = {
        name: [np.linalg.norm(p - np.mean(inside, axis=0)) for p in inside]
        for name, inside in seats.items()
        if len(inside) > 1
    }
    if not distances:
        refuses("two or more readings", seat_errors, points, names)
        return
    errors = seat_errors(points, names)
    flat = np.concatenate(list(distances.values()))
    # Sums of some thirty numbers of the size of 100 in two orders: equal to 1e-12 relative.
    assert errors["seat_mean_mm"] == pytest.approx(flat.mean(), rel=1e-12)
    assert errors["seat_rms_mm"] == pytest.approx(np.sqrt(np.mean(flat**2)), rel=1e-12)
    assert errors["seat_max_mm"] == pytest.approx(flat.max(), rel=1e-12)
    assert errors["n_in_seats"] == len(flat)
    assert {name: row["n"] for name, row in errors["seats"].items()} == {n: len(d) for n, d in distances.items()}
    for name, found in distances.items():
        assert errors["seats"][name]["rms_mm"] == pytest.approx(np.sqrt(np.mean(np.square(found))), rel=1e-12)


def test_neither_the_frame_nor_the_order_matters(rng):
    points, names = rng.normal(size=(20, 3)), rng.choice(["a", "b", "c"], 20)
    lengths = Lengths(["a", "b"], ["b", "c"], [1.0, 2.0], [1.0, 1.0])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    order = rng.permutation(20)
    moved = points[order] @ turn.T + [1000, -2000, 3000]
    # Coordinates of some 1000 mm are right to 1e-13 of them.
    for name in ("seat_mean_mm", "seat_rms_mm", "seat_max_mm"):
        assert seat_errors(moved, names[order])[name] == pytest.approx(seat_errors(points, names)[name], abs=1e-11)
    np.testing.assert_allclose(
        length_errors(moved, names[order], lengths), length_errors(points, names, lengths), atol=1e-11
    )


def test_points_and_seats_that_do_not_fit_are_refused():
    lengths = Lengths(["a"], ["b"], [1.0], [1.0])
    for points, names in ((np.zeros((2, 3)), ["a"]), (np.zeros((2, 2)), ["a", "a"]), (np.zeros(3), ["a"])):
        refuses(r"points \(n, 3\) and a seat for each", seat_errors, points, names)
        refuses(r"points \(n, 3\) and a seat for each", length_errors, points, names, lengths)
    refuses("two or more readings, got none", seat_errors, np.zeros((3, 3)), ["a", "b", ""])
    refuses("no seat 'b'", length_errors, np.zeros((3, 3)), ["a", "a", ""], lengths)
    with pytest.raises(InputError, match="no seat 'x'"):
        length_errors(np.zeros((2, 3)), ["a", "b"], Lengths(["a", "x"], ["b", "y"], [1.0, 1.0], [1.0, 1.0]))
