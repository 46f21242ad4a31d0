"""Delimited text: physical lines are right whatever the line ends, and cells come back as they were written."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.files.delimited import append_rows, escape_formula, read_columns, read_form, write_columns

names = st.text(st.characters(blacklist_categories=("Cs", "Cc")) | st.sampled_from("'=+-@\t"), max_size=8)


@given(cells=st.lists(names, min_size=1, max_size=5))
def test_names_come_back_as_they_were_written(tmp_path_factory, cells):
    path = tmp_path_factory.mktemp("names") / "table.csv"
    write_columns(path, {"number": np.arange(float(len(cells))), "name": np.array(cells)})
    assert read_columns(read_form(path), [0], [1])[1][0].tolist() == np.array(cells).tolist()


@given(
    cells=st.lists(names | st.sampled_from(['"', "a,b", "a\nb", "%s", ""]), min_size=1, max_size=5),
    values=st.lists(st.floats(), min_size=5, max_size=5),
)
def test_a_table_is_written_as_the_writer_of_the_standard_library_does(cells, values):
    columns = {"50 %": np.array(values[: len(cells)]), "name": np.array(cells), "n": np.arange(len(cells))}
    for shown in (columns, {"name": columns["name"]}):
        ours, plain = io.StringIO(), io.StringIO()
        append_rows(ours, shown, decimals=3, header=True)
        writer = csv.writer(plain, lineterminator="\n")
        writer.writerow(shown)
        for value, cell, number in zip(values, columns["name"].tolist(), range(len(cells)), strict=False):
            row = ["" if np.isnan(value) else f"{value:.3f}", escape_formula(cell), number]
            writer.writerow(row if len(shown) > 1 else row[1:2])
        assert ours.getvalue() == plain.getvalue()


@pytest.mark.parametrize("cell", ["=cmd|' /C calc'!A0", "+1+cmd", "-2+3+cmd|x", "@SUM(A1)", "\t=1", "'=1"])
def test_what_a_spreadsheet_would_run_is_written_as_text(cell):
    assert escape_formula(cell) == f"'{cell}"


@pytest.mark.parametrize("cell", ["", "A", "-0.8 0.6 1.2", "+5", "'", "it's", "a=b", "5-3"])
def test_other_cells_are_written_as_they_are(cell):
    assert escape_formula(cell) == cell


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_lines_are_counted_whatever_they_end_in(tmp_path, end, mark):
    path = tmp_path / "table.csv"
    path.write_bytes((mark + end.join(["a,b", "1,x", "2,y", "three,z"]) + end).encode())
    caught = refuses("expected a number, got 'three'", read_columns, read_form(path), [0])
    assert (caught.line, caught.column) == (4, "a")


def test_a_quotation_mark_that_is_never_closed_is_found_where_it_opens(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text('a,b\n1,x\n2,"y\n' + "3,z\n" * 50_000)
    assert refuses("quotation mark", read_columns, read_form(path), [0]).line == 3


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_come_back_to_the_last_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("numbers") / "table.csv"
    write_columns(path, {"a": np.array(values)})
    np.testing.assert_array_equal(read_columns(read_form(path), [0])[0][:, 0], values)


def test_a_decimal_comma_is_one_and_a_point_is_not(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n1,5;-0,25e1\n")
    assert read_columns(read_form(path), [0, 1])[0].tolist() == [[1.5, -2.5]]
    path.write_text("a;b\n1,5;2\n1.5;2\n")
    refuses("decimal ',', got '1.5'", read_columns, read_form(path), [0, 1])


def test_a_header_without_rows_is_refused_at_its_line(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b\n")
    refused = refuses("expected at least one row of numbers, got none", read_columns, read_form(path), [0, 1], [])
    assert (refused.file, refused.line) == (path, 1)


@pytest.mark.parametrize(("end", "is_cut_short"), [("1,2\n5", True), ("1,2\n5\n", False), ("1\n5,6", False)])
def test_a_last_line_without_its_end_may_be_one_of_a_recording(tmp_path, end, is_cut_short):
    path = tmp_path / "session.csv"
    path.write_text(f"q1,q2\n{end}", encoding="utf-8")
    with pytest.raises(InputError, match="expected 2 values as in the line above, got 1") as refused:
        read_columns(read_form(path), [0, 1])
    assert ("recording" in str(refused.value)) is is_cut_short
