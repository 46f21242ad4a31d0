"""A fair split: groups stay whole, every reading goes somewhere, the same seed gives the same split."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Session, read_session


def readings_of(names, by="position"):
    return Session(np.arange(len(names), dtype=float)[:, None], **{by: np.array(names, dtype=np.str_)})


@given(
    names=st.lists(st.sampled_from("abcdefg"), min_size=2, max_size=40).filter(lambda names: len(set(names)) > 1),
    by=st.sampled_from(["position", "seat", "session"]),
    fraction=st.floats(0.01, 0.99),
    seed=st.integers(0, 2**32),
)
def test_groups_stay_whole_and_nothing_is_lost(names, by, fraction, seed):
    train, test = readings_of(names, by).split(by=by, hold_out=fraction, seed=seed)
    assert not set(getattr(train, by)) & set(getattr(test, by))
    assert sorted([*train.angles[:, 0], *test.angles[:, 0]]) == list(range(len(names)))
    assert (np.diff(train.angles[:, 0]) > 0).all()
    assert len(train)
    assert len(test)
    # The nearest whole number of groups, but one at least on either side.
    n_groups = len(set(names))
    assert len(set(getattr(test, by))) == min(max(round(fraction * n_groups), 1), n_groups - 1)


def test_the_seed_decides():
    readings = readings_of([str(i) for i in range(100)])
    one, same, other = (readings.split(hold_out=0.3, seed=s)[1].angles for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    assert len(one) == 30


def test_rows_are_their_own_groups():
    train, test = Session(np.arange(10.0)[:, None]).split(by="row", hold_out=0.2, seed=0)
    assert (len(train), len(test)) == (8, 2)


def test_a_missing_column_is_said_with_those_that_are_there(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("q1_deg,seat\n1,A\n2,B\n")
    caught = refuses("no column 'position' to split by", read_session(path).split, hold_out=0.3, seed=0)
    assert caught.file == path
    assert "by seat or row" in caught.hint


def test_a_reading_without_a_name_belongs_nowhere(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("q1_deg,position\n1,A\n2,\n3,B\n")
    with pytest.raises(InputError, match="line 3, column .position.: the reading names no position") as caught:
        read_session(path).split(hold_out=0.3, seed=0)
    assert (caught.value.line, caught.value.column) == (3, "position")


def test_a_split_keeps_what_else_is_known_of_a_reading():
    """Rows without a point, orientations, loads and names go where their reading goes."""
    n = 8
    points = np.arange(3.0 * n).reshape(n, 3)
    points[::2] = np.nan
    whole = Session(
        np.arange(n, dtype=float)[:, None],
        points,
        seat=np.array(["", "A"] * 4),
        position=np.repeat(["P", "Q", "R", "S"], 2),
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        columns={"load_1_Nm": np.arange(n) * 2.0},
    )
    for part in whole.split(hold_out=0.25, seed=0):
        rows = part.angles[:, 0].astype(int)
        np.testing.assert_array_equal(part.points, points[rows])
        np.testing.assert_array_equal(part.columns["load_1_Nm"], rows * 2)
        assert part.has_point.tolist() == [bool(row % 2) for row in rows]
        assert len(part.quaternion) == len(rows)


def test_splits_that_make_no_sense_are_refused():
    refuses("at least two positions", readings_of(["a", "a"]).split, hold_out=0.5, seed=0)
    refuses("between 0 and 1", readings_of(["a", "b"]).split, hold_out=30, seed=0)
    refuses("expected a split by position", readings_of(["a", "b"]).split, by="colour", hold_out=0.5, seed=0)
