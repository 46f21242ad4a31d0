"""What readings say of their tips, as identification takes it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.references.reading_references import (
    references_of,
    roughly_aligned_chain,
    rows_with_orientation,
    state_of,
    surfaces_with_too_few_readings,
    tool_terms,
)
from truearm.readings import Lengths, Session

NAN = np.nan


@pytest.fixture
def angles(rng):
    return load_arm("gao2017").working + 0.5 * rng.uniform(-1, 1, (12, 6))


def lengths(*pairs):
    a, b = zip(*pairs, strict=True)
    return Lengths(np.array(a), np.array(b), np.full(len(a), 300.0), np.full(len(a), 0.01))


def seats(*names):
    return np.array([*names, *[""] * (12 - len(names))])


def test_points_are_those_of_the_readings_that_have_one(angles):
    points = np.arange(36.0).reshape(12, 3)
    points[[2, 5]] = NAN
    std = np.where(np.isnan(points), NAN, 0.01)
    (found,) = references_of(Session(angles, points, std), None)
    rows = np.delete(np.arange(12), [2, 5])
    assert found.kind == "point"
    assert found.rows.tolist() == rows.tolist()
    np.testing.assert_array_equal(found.points, points[rows])
    np.testing.assert_array_equal(found.std.T, std[rows])
    assert references_of(Session(angles, points), None)[0].std.tolist() == np.zeros((3, 10)).tolist()


def test_a_reading_with_a_point_and_a_seat_says_both(angles):
    points = np.full((12, 3), NAN)
    points[:2] = 1.0
    seen, held = references_of(Session(angles, points, seat=seats("a", "", "a", "b", "b", "a")), None)
    assert seen.rows.tolist() == [0, 1]
    assert held.kind == "seat"
    assert held.rows.tolist() == [0, 2, 3, 4, 5]
    assert held.names == ("a", "b")
    assert held.seat.tolist() == [0, 0, 1, 1, 0]
    assert held.lengths == ()


def test_a_length_between_seats_that_an_instrument_saw_counts(angles):
    readings = Session(angles, np.ones((12, 3)), seat=seats("a", "b", "b"))
    assert [one.kind for one in references_of(Session(angles, np.ones((12, 3)), seat=seats("a", "b")), None)] == [
        "point"
    ]
    seen, held = references_of(readings, lengths(("a", "b")))
    assert seen.rows.tolist() == list(range(12))
    assert held.rows.tolist() == [0, 1, 2]
    assert len(held.lengths) == 1


def test_a_seat_of_one_reading_counts_only_by_its_length(angles):
    readings = Session(angles, seat=seats("a", "a", "b", "c", "d", "d"))
    (found,) = references_of(readings, None)
    assert found.names == ("a", "d")
    (found,) = references_of(readings, lengths(("a", "b"), ("d", "e")))  # no reading is in e
    assert found.names == ("a", "b", "d")
    assert [(one.a, one.b, one.length_mm, one.std_mm) for one in found.lengths] == [(0, 1, 300.0, 0.01)]
    assert found.rows.tolist() == [0, 1, 2, 4, 5]


def test_one_pose_again_and_again_in_a_seat_says_nothing(angles):
    """Its tips are one whatever the arm; their scatter, zero, would pass for the noise of all seats."""
    names = seats("a", "a", "a", "b", "b", "b")
    angles[:3] = angles[0]
    assert references_of(Session(angles, seat=names), None)[0].names == ("b",)
    assert references_of(Session(angles, seat=names), lengths(("a", "b")))[0].names == ("a", "b")
    warming = Session(angles, seat=names, temperature_degC=np.linspace(20, 30, 12))
    assert references_of(warming, None)[0].names == ("a", "b")
    pulled = Session(angles, seat=names, directions=np.where(np.arange(12)[:, None] % 2, 1.0, -1.0) * np.ones(6))
    assert references_of(pulled, None)[0].names == ("a", "b")
    loaded = Session(angles, seat=names, columns={"load_1_Nm": np.arange(12.0)})
    assert references_of(loaded, None)[0].names == ("a", "b")


@pytest.mark.parametrize(("kind", "n"), [("sphere", 5), ("plane", 4), ("line", 3)])
def test_surfaces_are_for_the_readings_that_touch_one(kind, n, angles):
    names = np.array(["", *["k"] * n, *[""] * (11 - n)])
    (found,) = references_of(Session(angles, **{kind: names}), None)
    assert found.kind == kind
    assert found.rows.tolist() == list(range(1, n + 1))


def test_every_kind_of_reference_is_there_once(angles):
    quaternion = np.full((12, 4), NAN)
    quaternion[[0, 3]] = [1.0, 0, 0, 0]
    points = np.full((12, 3), NAN)
    points[0] = 1
    readings = Session(angles, points, seat=seats("a", "a", "a", "b", "b"), quaternion=quaternion)
    found = references_of(readings, lengths(("a", "b")))
    assert [one.kind for one in found] == ["point", "seat", "orientation"]
    assert found[2].rows.tolist() == [0, 3]
    assert rows_with_orientation(readings.quaternion).tolist() == [0, 3]
    assert len(tool_terms(load_arm("gao2017"), readings)) == 3
    assert tool_terms(load_arm("gao2017"), Session(angles)) == []


@pytest.mark.parametrize("seat", [None, [""] * 12, ["a", "b", *[""] * 10]])
def test_readings_that_say_nothing_are_refused(seat, angles):
    with pytest.raises(InputError, match="seats of two readings or more, four distances to an anchor, spheres of four"):
        references_of(Session(angles, seat=None if seat is None else np.array(seat)), None)


def test_a_state_has_what_the_readings_have_and_else_what_is_given(angles, rng):
    arm = load_arm("gao2017")
    plain = state_of(arm, Session(angles))
    assert plain.chain is arm.chain
    assert plain.temperature_degC is None
    assert plain.columns == {}
    measured, load_1 = rng.normal(25, 1, 12), rng.normal(size=12)
    readings = Session(angles, temperature_degC=measured, columns={"load_1_Nm": load_1})
    own = state_of(arm, readings, temperature_degC=21.0, columns={"load_1_Nm": 5.0, "load_2_Nm": 7.0})
    np.testing.assert_array_equal(own.temperature_degC, measured)
    np.testing.assert_array_equal(own.columns["load_1_Nm"], load_1)
    np.testing.assert_array_equal(own.columns["load_2_Nm"], np.full(12, 7.0))
    assert own.directions is None
    came = np.sign(rng.normal(size=(12, 6)))
    np.testing.assert_array_equal(state_of(arm, Session(angles, directions=came), direction=0.0).directions, came)
    assert not state_of(arm, readings, direction=0.0).directions.any()
    given = state_of(arm, Session(angles), temperature_degC=21.0)
    np.testing.assert_array_equal(given.temperature_degC, np.full(12, 21.0))


def test_an_arm_is_placed_by_points_and_its_tool_by_orientations(angles):
    arm = load_arm("gao2017")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix(), [500.0, -70, 20]
    truth = arm.chain.with_reference_frame(T)
    readings = Session(angles, truth.tip_in_base(angles))
    np.testing.assert_allclose(
        roughly_aligned_chain(arm, readings, ("base",)).tip_in_base(angles), readings.points, atol=1e-8
    )
    assert roughly_aligned_chain(arm, readings, ()) is arm.chain


@pytest.mark.parametrize(("kind", "least"), [("sphere", 4), ("plane", 3), ("line", 2)])
def test_surfaces_of_too_few_readings_are_left_out_and_told(kind, least, angles):
    """Readings with a point count by it: what is left of A is one too few, of B just enough."""
    names = np.array([*["A"] * 5, *["B"] * least, *[""] * (7 - least)])
    points = np.full((12, 3), NAN)
    points[: 6 - least] = 1.0
    readings = Session(angles, points, **{kind: names})
    seen, found = references_of(readings, None)
    assert seen.rows.tolist() == list(range(6 - least))
    assert (found.kind, found.names, found.rows.tolist()) == (kind, ("B",), list(range(5, 5 + least)))
    assert surfaces_with_too_few_readings(readings) == [(kind, "A", least - 1)]
    assert [one.kind for one in references_of(readings.rows(range(least + 4)), None)] == ["point"]
    with pytest.raises(InputError, match="spheres of four"):
        references_of(readings.rows(range(6 - least, 5)), None)
