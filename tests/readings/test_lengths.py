"""Known lengths: what comes back is what was written, and a fault names its file, line, column and remedy."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.readings import Lengths, read_lengths, write_lengths

HEADER = "seat_a,seat_b,length_mm,u_mm\n"


def lengths_file(folder: Path, text: str | bytes) -> Path:
    path = folder / "lengths.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder, rows, *, header=HEADER, seats=None):
    path = lengths_file(folder, header + "\n".join(rows) + "\n")
    caught = refuses(None, read_lengths, path, seats=seats)
    assert caught.file == path
    return caught


names = st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1, max_size=8)


@settings(max_examples=50)
@given(
    ends=st.lists(st.tuples(names, names), min_size=1, max_size=5, unique_by=lambda pair: tuple(sorted(pair))).filter(
        lambda pairs: all(a != b for a, b in pairs)
    ),
    length=st.floats(1e-3, 1e5),
    u=st.floats(1e-9, 10),
)
def test_what_is_written_comes_back(tmp_path_factory, ends, length, u):
    path = tmp_path_factory.mktemp("round") / "lengths.csv"
    a, b = (np.array(part) for part in zip(*ends, strict=True))
    given_lengths = Lengths(a, b, length * np.arange(1, len(ends) + 1), np.full(len(ends), u))
    write_lengths(given_lengths, path)
    found = read_lengths(path)
    assert len(found) == len(ends)
    assert (found.file, found.called(0)) == (path, "line 2")
    for name in ("seat_a", "seat_b", "length_mm", "u_mm"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given_lengths, name))


def test_an_artefact_and_its_places_come_back(tmp_path):
    given_lengths = Lengths(
        ["A", "C", "E"], ["B", "D", "F"], [9.0, 9.0, 8.0], [0.1, 0.1, 0.2], ["bar", "bar", ""], [np.nan, 0.03, np.nan]
    )
    assert given_lengths.u_place_mm.tolist() == [Lengths.default_u_place_mm, 0.03, 0.0]
    write_lengths(given_lengths, tmp_path / "l.csv")
    assert (tmp_path / "l.csv").read_text().splitlines()[3] == "E,F,8.0,0.2,,"
    found = read_lengths(tmp_path / "l.csv", seats="CDEF")
    assert found.artefact.tolist() == ["bar", ""]
    assert found.u_place_mm.tolist() == [0.03, 0.0]
    plain = read_lengths(lengths_file(tmp_path, HEADER.strip() + ",artefact\nA,B,1,0.1,bar\nC,D,2,0.1,\n"))
    assert plain.artefact.tolist() == ["bar", ""]
    assert plain.u_place_mm.tolist() == [Lengths.default_u_place_mm, 0.0]


def test_expansions_come_back_and_are_known_or_not(tmp_path):
    given_lengths = Lengths(
        ["A", "C"], ["B", "D"], [9.0, 8.0], [0.1, 0.2], expansion_per_K=[1e-5, np.nan], u_expansion_per_K=[1e-6, np.nan]
    )
    write_lengths(given_lengths, tmp_path / "l.csv")
    found = read_lengths(tmp_path / "l.csv")
    for name in ("expansion_per_K", "u_expansion_per_K"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given_lengths, name))
    assert found.between("AB").expansion_per_K.tolist() == [1e-5]
    assert found.between("CD").expansion_per_K is None
    unknown = Lengths(["A"], ["B"], [9.0], [0.1], expansion_per_K=[np.nan], u_expansion_per_K=[np.nan])
    assert unknown.u_expansion_per_K is None  # as if the columns were not there
    write_lengths(unknown, tmp_path / "l.csv")
    assert (tmp_path / "l.csv").read_text().startswith(HEADER)


@pytest.mark.parametrize(
    ("row", "column", "said"),
    [
        ("A,B,100,0.1,,11.5,1e-6", "expansion_per_K", "expected -1e-05 to 5e-05 per K, got 11.5"),
        ("A,B,100,0.1,,1e-5,-1e-6", "u_expansion_per_K", "expected 0 to 1e-05 per K, got -1e-06"),
        ("A,B,100,0.1,,1e-5,", "u_expansion_per_K", "belong together, got no u_expansion_per_K"),
        ("A,B,100,0.1,,,1e-6", "expansion_per_K", "belong together, got no expansion_per_K"),
        ("A,B,100,0.1,bar,2e-5,1e-6", "expansion_per_K", "'bar' has expansion_per_K 1e-05 in line 2, got 2e-05"),
    ],
)
def test_an_expansion_that_is_none_is_found(tmp_path, row, column, said):
    header = HEADER.strip() + ",artefact,expansion_per_K,u_expansion_per_K\n"
    error = refusal(tmp_path, ["P,Q,100,0.1,bar,1e-5,1e-6", row], header=header)
    assert (error.line, error.column) == (3, column)
    assert said in error.problem


def test_columns_may_stand_in_any_order_beside_remarks(tmp_path):
    path = lengths_file(tmp_path, 'note,u_mm,length_mm,seat_b,seat_a\nlab 7,0.001,250,"B, left",A\n')
    found = read_lengths(path)
    assert (found.seat_a.tolist(), found.seat_b.tolist()) == (["A"], ["B, left"])
    assert (found.length_mm.tolist(), found.u_mm.tolist()) == ([250.0], [0.001])


@pytest.mark.parametrize(
    ("row", "column", "said"),
    [
        ("A,A,250,0.1", "seat_b", "expected a length between two seats, got 'A' twice"),
        (",B,250,0.1", "seat_a", "expected the name of a seat, got an empty cell"),
        ("A,,250,0.1", "seat_b", "expected the name of a seat, got an empty cell"),
        ("A,B,0,0.1", "length_mm", "expected a positive length, got 0 mm"),
        ("A,B,-250,0.1", "length_mm", "expected a positive length, got -250 mm"),
        ("A,B,250,0", "u_mm", "expected a positive standard uncertainty, got 0 mm"),
        ("A,B,250,-0.1", "u_mm", "expected a positive standard uncertainty, got -0.1 mm"),
        ("A,B,250,", "u_mm", "got an empty cell"),
        ("A,B,nan,0.1", "length_mm", "got 'nan'"),
        ("A,B,1e999,0.1", "length_mm", "got '1e999'"),
        ("A,B,1e300,0.1", "length_mm", "expected a positive length of at most 1e+09 mm, got 1e+300 mm"),
        ("A,B,250,1e300", "u_mm", "expected a positive standard uncertainty of at most 1e+09 mm, got 1e+300 mm"),
        ("A,B,two,0.1", "length_mm", "got 'two'"),
        ('A,B,"250,5",0.1', "length_mm", "decimal '.', got '250,5'"),
        ("P,Q,250,0.1", None, "the length between 'P' and 'Q' is stated in line 2 already"),
        ("Q,P,250,0.1", None, "the length between 'Q' and 'P' is stated in line 2 already"),
        ("A,B,250", None, "expected 4 values as in the line above, got 3"),
        (f"A,{'B' * 201},250,1", "seat_b", "a name of at most 200 characters, got one of 201"),
    ],
)
def test_a_row_that_is_no_length_is_found(tmp_path, row, column, said):
    error = refusal(tmp_path, ["P,Q,100,0.1", row, "P,R,100,0.1"])
    assert (error.line, error.column) == (3, column)
    assert said in error.problem


@pytest.mark.parametrize(
    ("row", "column", "said"),
    [
        ("A,B,99,0.1,bar,", "length_mm", "'bar' has length_mm 100 in line 2, got 99"),
        ("A,B,100,0.2,bar,", "u_mm", "'bar' has u_mm 0.1 in line 2, got 0.2"),
        ("A,B,100,0.1,bar,0", "u_place_mm", "a positive standard uncertainty of a place, got 0 mm"),
        ("A,B,100,0.1,,-1", "u_place_mm", "a positive standard uncertainty of a place, got -1 mm"),
        ("A,B,100,0.1,,nan", "u_place_mm", "got 'nan'"),
        (f"A,B,100,0.1,{'b' * 201},", "artefact", "a name of at most 200 characters"),
    ],
)
def test_rows_of_an_artefact_that_differ_are_found(tmp_path, row, column, said):
    header = HEADER.strip() + ",artefact,u_place_mm\n"
    error = refusal(tmp_path, ["P,Q,100,0.1,bar,", row], header=header)
    assert (error.line, error.column) == (3, column)
    assert said in error.problem


@pytest.mark.parametrize(
    ("header", "column", "said"),
    [
        ("seat_a,seat_b,length_mm", None, "the column u_mm is missing"),
        ("seat_a,seat_b,length_m,u_mm", "length_m", "unknown column 'length_m'"),
        ("seat_a,seat_b,length,u_mm", "length", "unknown column 'length'"),
        ("seat_a,seat_a,length_mm,u_mm", "seat_a", "two columns have this name"),
        ("seat_a,seat_b,,u_mm", 3, "the column has no name"),
        ("seat_a|seat_b|length_mm|u_mm", "seat_a|seat_b|length_mm|u_mm", "unknown column"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(tmp_path, header, column, said):
    width = header.count(",") + 1
    error = refusal(tmp_path, [",".join("AB12"[:width])], header=header + "\n")
    assert (error.line, error.column) == (1, column)
    assert said in error.problem
    assert not column or "seat_a" in error.hint or "delete" in error.hint


def test_what_only_sessions_can_be_done_with_is_not_advised(tmp_path):
    for text in (b"seat_a;seat_b;length_mm;u_mm\nA;B;250,1;0.1\n", HEADER.encode() + b"A,b\xfcchse,1,1\n"):
        caught = refuses(r"decimal|utf-8", read_lengths, lengths_file(tmp_path, text))
        assert "import" not in caught.hint
        assert "--" not in caught.hint


def test_empty_rows_are_skipped_at_the_end_alone(tmp_path):
    found = read_lengths(lengths_file(tmp_path, HEADER + "A,B,250,0.1\n,,,\n,,,\n\n"))
    assert found.length_mm.tolist() == [250.0]
    error = refusal(tmp_path, ["A,B,250,0.1", ",,,", "A,C,250,0.1"])
    assert (error.line, error.problem) == (3, "expected numbers, got an empty row")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"", "empty file"),
        (HEADER.encode(), "at least one row"),
        (b"PK\x03\x04rest", "spreadsheet"),
        (HEADER.encode() + b"A,b\xfcchse,1,1\n", "utf-8"),
    ],
)
def test_files_that_are_no_table_are_refused(tmp_path, text, said):
    assert refuses(said, read_lengths, lengths_file(tmp_path, text)).file == tmp_path / "lengths.csv"
    refuses("does not exist", read_lengths, tmp_path / "none.csv")


# The session's seats -------------------------------------------------------------------------------------------------


def test_a_seat_the_session_has_not_is_refused_with_the_one_that_was_meant(tmp_path):
    error = refusal(tmp_path, ["cone A,cone B,1,1", "cone A,Cone C,1,1"], seats=["cone A", "cone B", "cone C", ""])
    assert (error.line, error.column) == (3, "seat_b")
    assert error.problem == "the session has no seat 'Cone C'"
    assert error.hint == "'cone C', the name in the session: the two differ in capitals or blanks only"
    for meant, typed in (("Bar A", "bar A"), ("barA", "bar A"), ("bar A ", "bar A")):  # nearer than bar B
        error = refusal(tmp_path, [f"{typed},bar B,1,1"], seats=[meant, "bar B"])
        assert error.hint is not None
        assert error.hint.startswith(repr(meant)), error.hint
    error = refusal(tmp_path, ["cone A,cone B,1,1", "cone A,cone D2,1,1"], seats=["cone A", "cone B", "cone D"])
    assert error.hint == "cone D"
    error = refusal(tmp_path, ["wall,cone A,1,1"], seats=["cone A", "cone B"])
    assert (error.line, error.column) == (2, "seat_a")
    assert "as in the session" in error.hint


def test_lengths_elsewhere_are_left_out_and_the_rest_keeps_its_order(tmp_path):
    path = lengths_file(tmp_path, HEADER + "A,B,1,0.1\nP,Q,2,0.2\nC,A,3,0.3\n")
    found = read_lengths(path, seats=np.array(["A", "B", "C", "B", ""]))
    assert found.seat_a.tolist() == ["A", "C"]
    assert found.length_mm.tolist() == [1, 3]
    assert found.u_mm.tolist() == [0.1, 0.3]
    assert len(read_lengths(path, seats="ABCPQ")) == 3


@pytest.mark.parametrize("seats", [["X", "Y"], [""], []])
def test_lengths_of_another_session_altogether_are_refused(tmp_path, seats):
    error = refusal(tmp_path, ["A,B,1,0.1"], seats=seats)
    assert (error.line, error.column) == (2, "seat_a")
    assert "the session has no seat 'A'" in error.problem


# The record ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"seat_b": ["B"]}, "expected one seat_b for each length"),
        ({"u_mm": 0.1}, "expected one u_mm for each length"),
        ({"artefact": ["bar"]}, "expected one artefact for each length"),
        ({"u_place_mm": [0.1]}, "expected one u_place_mm for each length"),
        ({"artefact": ["bar", "bar"]}, "length 2, .*'bar' has length_mm 1 in length 1, got 2"),
        ({"u_place_mm": [0.0, np.inf]}, "length 2, .*expected a positive standard uncertainty of a place, got inf mm"),
        ({"u_place_mm": [0.0, 1e300]}, r"length 2, .*uncertainty of a place of at most 1e\+09 mm, got 1e\+300 mm"),
        ({"length_mm": [1, np.inf]}, "length 2, .*expected a positive length, got inf mm"),
        ({"u_mm": [np.nan, 1]}, "length 1, .*expected a positive standard uncertainty, got nan mm"),
        ({"seat_b": ["C", "A"]}, "length 2: the length between 'C' and 'A' is stated in length 1 already"),
        ({name: [] for name in ("seat_a", "seat_b", "length_mm", "u_mm")}, "one or more lengths, got none"),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields, said):
    whole = {"seat_a": ["A", "C"], "seat_b": ["B", "D"], "length_mm": [1, 2], "u_mm": [0.1, 0.1]}
    refuses(said, Lengths, **(whole | fields))


def test_what_could_not_be_read_is_not_written(tmp_path):
    lengths = Lengths(["A\nB"], ["C"], [1.0], [0.1])
    refuses("one line of text", write_lengths, lengths, tmp_path / "l.csv")
    refuses(r"ends in \.csv, got 'l.txt'", write_lengths, lengths, tmp_path / "l.txt")
    with pytest.raises(InputError, match="an artefact must be one line of text"):
        write_lengths(Lengths(["A"], ["C"], [1.0], [0.1], ["b\nr"]), tmp_path / "l.csv")
    assert not list(tmp_path.iterdir())


def test_the_example_in_the_manual_is_a_file_of_lengths(tmp_path):
    manual = (Path(__file__).parents[2] / "docs" / "session-file.md").read_text()
    example = manual.split("```csv lengths\n")[1].split("```")[0]
    found = read_lengths(lengths_file(tmp_path, example), seats=["cone A", "cone B"])
    assert found.length_mm.tolist() == [250.0132]
    assert found.artefact.tolist() == ["bar 7"]


@settings(max_examples=60)
@given(at=st.integers(0, 60), cut=st.integers(0, 8), junk=st.binary(max_size=8) | st.sampled_from([b'"', b",", b"\n"]))
def test_a_damaged_file_is_read_or_refused_but_nothing_else(tmp_path_factory, at, cut, junk):
    whole = HEADER.encode() + b"A,B,100,0.1\nA,C,250.5,1e-3\n"
    path = lengths_file(tmp_path_factory.mktemp("damaged"), whole[:at] + junk + whole[at + cut :])
    assert read_or_refused(path)


def read_or_refused(path: Path) -> bool:
    try:
        found = read_lengths(path)
    except InputError as error:
        return error.file == path
    return bool((found.length_mm > 0).all() and (found.u_mm > 0).all())
