"""Laws of distances to anchors as references: derivatives, multilateration, priors of the offsets."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.errors import InputError
from truearm.identification.references.distances import Distances, distances_of, is_offset
from truearm.readings import Session
from truearm.readings.anchors import locate_anchor
from truearm.typing import FloatArray

# A difference quotient of 1e-4 mm at half a metre: rounding 1e-16 * 500 / 1e-4 is 5e-10, curvature 1e-4 / 500 as well.
QUOTIENT = 1e-6
PARTS = ("rows", "anchor", "names", "distances", "distance_std", "offset_stds")


def some_distances() -> tuple[Distances, FloatArray]:
    rng = np.random.default_rng(3)
    tips = rng.uniform(-300, 300, (3, 9))
    anchor = np.array([0, 1, 0, 1, 0, 1, 0, 1, 1])
    places = np.array([[800.0, 0.0, 100.0], [-500.0, 700.0, 0.0]])
    distances = np.linalg.norm(tips.T - places[anchor], axis=1)
    made = Distances(np.arange(9), anchor, ("A", "B"), distances, np.full(9, 0.05), np.array([0.5, 2.0]))
    return made, tips


def test_derivatives_agree_with_difference_quotients() -> None:
    reference, tips = some_distances()
    unknowns = reference.initialise(tips)[1] + 0.3
    linear = reference.linearised(tips, unknowns, slice(None))
    step = 1e-4
    for axis in range(3):
        moved = tips.copy()
        moved[axis] += step
        quotient = (reference.linearised(moved, unknowns, slice(None)).residuals - linear.residuals) / step
        np.testing.assert_allclose(linear.by_tip[:, axis], quotient, atol=QUOTIENT)
    for unknown in range(len(unknowns)):
        moved = unknowns.copy()
        moved[unknown] += step
        quotient = (reference.linearised(tips, moved, slice(None)).residuals - linear.residuals)[0] / step
        own = np.where(linear.unknown == unknown, linear.by_unknown[0], 0.0).sum(axis=0)
        np.testing.assert_allclose(own, quotient, atol=QUOTIENT)


def test_constraints_are_the_priors_of_the_offsets() -> None:
    reference, _ = some_distances()
    x = np.arange(8.0)
    constraints = reference.constraints(x)
    assert constraints.residuals.tolist() == [3.0, 7.0]
    assert constraints.std.tolist() == [0.5, 2.0]
    np.testing.assert_array_equal(constraints.by_unknown @ x, constraints.residuals)
    assert all(is_offset(name) for name in constraints.names)


@settings(max_examples=10)
@given(
    st.integers(0, 1000),
    st.floats(-3.0, 3.0),
    st.tuples(*3 * [st.floats(-1500, 1500)]).filter(lambda place: np.linalg.norm(place) > 50),
)
def test_multilateration_recovers_an_anchor(seed: int, offset: float, place: tuple[float, ...]) -> None:
    tips = np.random.default_rng(seed).uniform(-400, 400, (30, 3))
    distances = np.linalg.norm(tips - np.array(place), axis=1) + offset
    found = locate_anchor(tips, distances, offset_std=1e3)
    # Without noise only the stop of the search remains, far below any wire.
    np.testing.assert_allclose(found.place, place, atol=1e-2)
    assert found.offset == pytest.approx(offset, abs=1e-2)


def test_multilateration_stands_a_gross_error() -> None:
    rng = np.random.default_rng(4)
    tips, place = rng.uniform(-400, 400, (40, 3)), np.array([1000.0, 200.0, 300.0])
    distances = np.linalg.norm(tips - place, axis=1) + 0.05 * rng.standard_normal(40)
    distances[[3, 17]] += [80.0, -40.0]
    found = locate_anchor(tips, distances, offset_std=1.0)
    # Forty wires of 0.05 mm: 0.05 mm across and some tenths along, where the offset compensates.
    assert np.linalg.norm(found.place - place) < 1.0


def test_tips_in_a_plane_leave_the_side_open() -> None:
    rng = np.random.default_rng(5)
    tips = np.column_stack([rng.uniform(-400, 400, (30, 2)), np.zeros(30)])
    place = np.array([300.0, 100.0, 700.0])
    found = locate_anchor(tips, np.linalg.norm(tips - place, axis=1), offset_std=1.0)
    np.testing.assert_allclose(np.abs(found.place), place, atol=1e-2)


def test_a_height_above_three_points_by_hand() -> None:
    # Corners of a square of side 2 and an anchor 3 above its centre: sqrt(1 + 1 + 9).
    tips = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    found = locate_anchor(tips, np.full(4, np.sqrt(11.0)), offset_std=1e-6)
    np.testing.assert_allclose(np.abs(found.place), [0.0, 0.0, 3.0], atol=1e-4)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"anchor": np.zeros(8, np.intp)}, "expected an anchor, a distance"),
        ({"anchor": np.full(9, 2)}, "expected one of 2 anchors"),
        ({"distances": np.zeros(9)}, "expected positive distances"),
        ({"distance_std": np.full(9, -1.0)}, "expected positive distances"),
        ({"offset_stds": np.array([0.5, 0.0])}, "expected positive standard uncertainties of the offsets"),
        ({"anchor": np.array([0] * 6 + [1] * 3)}, "expected at least 4 distances to anchor 'B'"),
    ],
)
def test_what_determines_no_anchor_is_refused(changed: dict[str, FloatArray], said: str) -> None:
    reference, _ = some_distances()
    parts = {name: getattr(reference, name) for name in PARTS}
    with pytest.raises(InputError, match=said):
        Distances(**(parts | changed))


def test_too_few_tips_locate_nothing() -> None:
    with pytest.raises(InputError, match="expected 4 or more distances"):
        locate_anchor(np.zeros((3, 3)), np.ones(3), offset_std=1.0)


def test_a_session_without_stated_uncertainties_has_those_of_the_noise_alone() -> None:
    session = Session(np.zeros((4, 1)), anchor=["A"] * 4, distance_mm=[1.0, 2.0, 3.0, 4.0])
    made = distances_of(session, np.arange(4))
    assert not made.std.any()
    assert made.offset_stds.tolist() == [1.0]
