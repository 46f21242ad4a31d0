"""Names: two spellings of one thing and seats with one reading are said, different things are not questioned."""

import numpy as np
import pytest

import truearm as ta
from truearm.readings import Lengths, Session
from truearm.readings.session import similar_names, single_seats
from truearm.wings.importing.foreign import JointScale, TableColumns
from truearm.wings.importing.foreign.tables import as_tables, read_foreign_tables
from truearm.wings.importing.tables.table import TableForm


def session(**names):
    n = len(next(iter(names.values())))
    return Session(np.zeros((n, 2)), **{kind: np.array(of) for kind, of in names.items()})


@pytest.mark.parametrize("kind", ["seat", "tip", "session", "sphere", "plane"])
def test_two_spellings_of_a_name_are_said(kind):
    (said,) = similar_names(session(**{kind: ["B1a", "B1A", "B1a", "B2"]}))
    assert str(said).startswith(f"{kind.capitalize()} 'B1A' (1 reading) may be 'B1a' (2 readings)")
    assert len(list(similar_names(session(**{kind: ["B 1a", "b1_a", "B1a", "B1a"]})))) == 2


@pytest.mark.parametrize(
    "names",
    [["B1", "B2"], ["1 1", "11"], ["1.0 -2", "1.0 2"], ["-1 2", "1 2"], ["A", "a'"], ["1 12", "11 2"], ["", ""]],
)
def test_names_of_different_things_are_not_questioned(names):
    assert not list(similar_names(session(seat=names, position=names)))


def test_seats_with_a_single_reading_are_said_unless_a_length_ends_there():
    names = ["A", "A", "B", "C", "", ""]
    assert list(map(str, single_seats(session(seat=names), None))) == [
        "Seats 'B', 'C' have a single reading each, which ties no two poses: ignored as a seat."
    ]
    between = Lengths(np.array(["B"]), np.array(["C"]), np.array([100.0]), np.array([0.01]))
    assert not list(single_seats(session(seat=names), between))
    (said,) = single_seats(session(seat=[f"S{i}" for i in range(10)]), None)
    assert "'S4' and 5 more have" in str(said)
    assert said.numbers == {"n": 10}
    assert not list(single_seats(session(tip=["A"]), None))


def test_fit_and_import_say_them():
    measured = ta.simulate("ur10", poses=20, seed=3).session
    frame = measured.to_frame().assign(position=["P1a", "P1b"] * 10)
    frame.loc[4, "position"] = "P1A"
    said = "Position 'P1A' (1 reading) may be 'P1a' (9 readings)"
    assert any(said in one for one in ta.fit("ur10", Session.from_frame(frame), model="nominal").remarks)
    (table,) = as_tables([frame], TableForm(), ())
    assert any(said in one for one in read_foreign_tables([table], TableColumns(), JointScale()).remarks)
