"""Laws of tables of text: how they are written never changes a number, and what has two readings is asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.wings.importing.tables import read_table
from truearm.wings.importing.tables.table import TableForm


def read(folder, content, name="table.csv", **form):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(path, TableForm(**form))


def values(table):
    return [table.numbers(i).tolist() for i in range(len(table.names))]


def refusal(folder, content, *columns, **form):
    def use():
        table = read(folder, content, **form)
        for column in columns:
            table.numbers(table.index(column))

    return refuses(None, use)


def written(value, decimals, decimal, thousands):
    """A number as a program of a country writes it."""
    whole, _, fraction = f"{value:,.{decimals}f}".partition(".")
    return whole.replace(",", thousands) + (decimal + fraction if fraction else "")


@settings(max_examples=30)
@given(
    columns=st.lists(
        st.tuples(
            st.integers(0, 5), st.booleans(), st.lists(st.floats(-99999, 99999, width=32), min_size=6, max_size=6)
        ),
        min_size=2,
        max_size=5,
    ),
    country=st.sampled_from([(".", ","), (",", "."), (",", " "), (".", "'"), (",", "\u00a0"), (".", "\u202f")]),
    separator=st.sampled_from(";\t"),
    n=st.integers(1, 6),
)
def test_a_table_of_one_country_is_never_read_wrong(tmp_path_factory, columns, country, separator, n):
    decimal, thousands = country
    cells = [
        [written(value, decimals, decimal, thousands if is_grouped else "") for value in column[:n]]
        for decimals, is_grouped, column in columns
    ]
    right = [[float(f"{value:.{decimals}f}") for value in column[:n]] for decimals, _, column in columns]
    head = separator.join(f"c{i}" for i in range(len(columns)))
    lines = [head, *(separator.join(row) for row in zip(*cells, strict=True))]
    table = read(tmp_path_factory.mktemp("tables"), "\n".join(lines) + "\n")
    assert len(table) == n
    for i in range(len(columns)):
        if i in table.questions:
            assert "--thousands" in table.questions[i].hint
        else:
            assert table.numbers(i).tolist() == right[i]


@settings(max_examples=20)
@given(
    rows=st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3), min_size=1, max_size=5
    )
)
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "|"])
def test_numbers_come_back_to_the_last_digit(tmp_path_factory, separator, rows):
    text = "\n".join([separator.join("abc"), *(separator.join(map(repr, row)) for row in rows)])
    table = read(tmp_path_factory.mktemp("tables"), text + "\n")
    np.testing.assert_array_equal(np.transpose(values(table)), rows)


def test_a_column_of_thousands_and_one_of_decimals_differ(tmp_path):
    table = read(tmp_path, "a;x\n12,5;1.235\n3,25;-988\n")
    assert values(table) == [[12.5, 3.25], [1235, -988]]
    assert "points between thousands in x" in table.assumed


@pytest.mark.parametrize(
    ("option", "value", "read_as"),
    [("decimal", ".", 1.235), ("decimal", ",", 1235.0), ("thousands", ".", 1235.0), ("thousands", "", 1.235)],
)
def test_a_person_settles_a_number_with_two_readings(tmp_path, option, value, read_as):
    content = "a;x\n0.5;1.235\n0.25;-988\n"
    asked = refusal(tmp_path, content, "x")
    assert (asked.line, asked.column) == (2, "x")
    assert "1.235 or 1235" in asked.problem
    assert "--decimal '.'" in asked.hint
    assert "--thousands '.'" in asked.hint
    table = read(tmp_path, content, **{option: value})
    assert table.numbers(1).tolist() == [read_as, -988]
    assert table.numbers(0).tolist() == [0.5, 0.25]


@pytest.mark.parametrize("other", ["1.235,50", "1.234.567", "12,5"])
def test_one_cell_with_one_reading_makes_points_thousands(tmp_path, other):
    assert read(tmp_path, f"a;x\nP1;1.235\nP2;{other}\nP3;7\n").numbers(1)[0] == 1235


@pytest.mark.parametrize("other", ["0.5", "1.2345", "1235", "12.5", "1.235e3", "1,234.5"])
def test_one_cell_with_one_reading_makes_points_decimal(tmp_path, other):
    assert read(tmp_path, f"a;x\nP1;1.235\nP2;{other}\nP3;7\n").numbers(1)[0] == 1.235


def test_a_question_of_a_column_that_nobody_uses_is_not_asked(tmp_path):
    table = read(tmp_path, "t;x\n1.235;1.5\n12;2.5\n")
    assert table.numbers(1).tolist() == [1.5, 2.5]
    assert table.words(0).tolist() == ["1.235", "12"]


def test_a_row_between_blanks_that_lacks_a_value_is_refused(tmp_path):
    """Which one is missing is not known."""
    error = refusal(tmp_path, "a b c\n1.5 2 3\n1 2.5\n10 2 3\n7 8\n")
    assert error.line == 3
    assert "--separator TAB" in error.hint


@pytest.mark.parametrize(
    ("content", "names", "cells"),
    [
        ("name,x,y\nP1,1.5,2,0.1\nP2,2.5,3,0.1\n", 3, 4),  # which column has no name is not known
        ("t,x,y\n0,008,1.0,2.0\n0,016,1.5,2.5\n", 3, 4),  # decimal commas in one column
        ("Joint 1 X Y Z\n1.5 2 3 4\n2.5 3 4 5\n", 5, 4),  # a name with a blank
    ],
)
def test_names_that_do_not_fit_the_columns_are_refused(tmp_path, content, names, cells):
    error = refusal(tmp_path, content)
    assert f"{names} names, expected as many cells, got {cells}" in error.problem
    assert error.line == 2
    assert "--no-header" in error.hint
    assert len(read(tmp_path, content, header=False).names) == cells


@pytest.mark.parametrize("ends", ["", ",", ",,"])
@pytest.mark.parametrize("names", ["J1,J2,J3,X,Y,Z", "J1,J2,J3,X,Y,Z,Comment", "J1,J2,J3,X,Y,Z,Comment,,Other"])
def test_separators_at_the_ends_of_lines_name_and_hold_nothing(tmp_path, names, ends):
    """Whether rows fill the columns that the header names or not."""
    for end in ("", ",", ",,", ",,,"):
        table = read(tmp_path, f"{names}{ends}\n1,2,3,4,5,6{end}\n3,4,5,6,7,8{end}\n4,5,6,7,8,9{end}\n")
        assert table.names[:6] == ("J1", "J2", "J3", "X", "Y", "Z")
        assert values(table)[5] == [6, 8, 9]


def test_a_first_reading_without_a_point_is_a_reading(tmp_path):
    table = read(tmp_path, "a,b,x,y,z\n1.5,2.5,,,\n1.5,2.5,,,\n1,2,3,4,5\n1,2,3,4,5\n1,2,3,4,5\n")
    assert table.lines.tolist() == [2, 3, 4, 5, 6]


def test_a_last_number_that_is_cut_off_is_no_reading(tmp_path):
    table = read(tmp_path, "a,b\n" + "1.25,1747.50\n" * 5 + "1.25,17")
    assert len(table) == 5
    assert "line 7 is cut off: ignored" in table.assumed


def test_points_that_are_called_after_statistics_are_rows(tmp_path):
    table = read(tmp_path, "name;x;y\nEnd 1;1.5;2\nMax 2;2.5;3\nEnd 3;3.5;4\n")
    assert len(table) == 3


def test_names_with_brackets_keep_them(tmp_path):
    table = read(tmp_path, "pose;x;y\nP[1];1.5;2\nP[2];2.5;3\n")
    assert table.words(0).tolist() == ["P[1]", "P[2]"]


def test_words_in_a_column_of_numbers_are_named_where_they_stand(tmp_path):
    error = refusal(tmp_path, "a;x\n1;12,5\n2;-\n3;about 3\n", "x")
    assert (error.line, error.column) == (4, "x")
    assert "about 3" in error.problem


def test_two_units_in_a_column_are_refused(tmp_path):
    error = refusal(tmp_path, "a;x\n1;12.5 mm\n2;0.5 m\n", "x")
    assert (error.line, error.column) == (3, "x")


@pytest.mark.parametrize("cell", ["1_000", "1e400", "inf", "0x10", "12:30", "5 apples", "1.2.3", "1,2,3"])
def test_what_is_no_number_is_not_read_as_one(tmp_path, cell):
    assert refusal(tmp_path, f"a;x\n1;2.5\n2;{cell}\n3;4.5\n", "x").line == 3


def test_a_header_in_comments_and_one_that_counts(tmp_path):
    assert read(tmp_path, "# a b c\n1.5 2 3\n2.5 3 4\n").names == ("a", "b", "c")
    assert read(tmp_path, "0,1,2,3\n1.5,2,3,4\n2.5,3,4,5\n").lines.tolist() == [2, 3]


def test_what_a_person_states_goes_before_what_is_recognised(tmp_path):
    content = "title\na;b\n1;2\n3;4\n"
    assert read(tmp_path, content, skip_lines=1, header=False).lines.tolist() == [3, 4]
    assert read(tmp_path, "1;2\n3;4\n", header=True).names == ("1", "2")
    assert read(tmp_path, "1,5;2\n3,5;4\n", separator=";", decimal=",").numbers(0).tolist() == [1.5, 3.5]
    assert read(tmp_path, "größe;x\n1;2.5\n".encode("cp850"), encoding="cp850").names[0] == "größe"


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", None),
        (b"\n \n", None),
        (b"no table at all\n", 1),
        (b"a,b\n", 1),
        (b"PK\x03\x04", None),
        (b"a,b\n\0\x01", 2),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, content, line):
    assert refusal(tmp_path, content).line == line


def test_a_quotation_that_does_not_end_is_refused(tmp_path):
    error = refusal(tmp_path, 'a,b\n1,2\n"1,2\n' + "1,2\n" * 50)
    assert error.line == 3
    assert "quot" in error.hint


def test_a_cell_of_a_million_characters_is_refused_at_once(tmp_path):
    assert refusal(tmp_path, f"a,b\n1,2\n{'1' * 1_000_000}x,2\n1,2\n").line == 3


@pytest.mark.parametrize(
    ("text", "encoding"),
    [("Größe", "cp1252"), ("Länge (°)", "cp1252"), ("关节角度", "gb18030"), ("轴", "gb18030"), ("é", "utf-16-le")],
)
def test_encodings_are_told_apart(tmp_path, text, encoding):
    assert read(tmp_path, f"{text},x\n1,2.5\n2,3.5\n".encode(encoding)).names == (text, "x")


def test_a_table_of_ten_thousand_columns_is_refused(tmp_path):
    assert "columns" in refusal(tmp_path, ",".join(["1.5"] * 10_000) + "\n").problem


@pytest.mark.parametrize(
    "content", ["a,b\ndeg,mm\n1,2\n", "a;b\n1.5;2\n", "title\n\na,b\n[deg],[mm]\n1,2\n", "name,a,b\nP1,1,2\n"]
)
def test_one_row_below_the_names_is_a_row(tmp_path, content):
    table = read(tmp_path, content)
    assert table.names[-2:] == ("a", "b")
    assert table.lines.tolist() == [content.count("\n")]


@pytest.mark.parametrize(("separator", "written"), [(",", "commas"), (" ", "blanks")])
def test_a_separator_may_also_group_digits_where_a_person_says_so(tmp_path, separator, written):
    rows = ["t x y", "1.5 1 234.5 -988.0", "2.5 12.0 -2 988.0", "3.5 1 200.0 5 100.5", "4.5 3.0 1 234 567.5"]
    content = "\n".join(rows).replace(" ", separator) + "\n"
    asked = refusal(tmp_path, content)
    assert asked.line == 2
    assert separator == " " or "--thousands ','" in asked.hint
    table = read(tmp_path, content, thousands=separator)
    assert values(table) == [[1.5, 2.5, 3.5, 4.5], [1234.5, 12, 1200, 3], [-988, -2988, 5100.5, 1234567.5]]
    assert f"thousands also between {written}" in table.assumed


def test_cells_that_may_be_joined_in_two_ways_are_refused(tmp_path):
    assert refusal(tmp_path, "t,x,y\n1.5,1,234,500\n2.5,12.0,-2.0\n", thousands=",").line == 2


@pytest.mark.parametrize(
    ("cell", "stated", "said"), [("1,5", ".", "decimal comma in x"), ("1.5", ",", "decimal point in x")]
)
def test_a_decimal_sign_other_than_the_stated_one_is_said(tmp_path, cell, stated, said):
    table = read(tmp_path, f"a;x\n1;{cell}\n2;{cell}\n", decimal=stated)
    assert table.numbers(1).tolist() == [1.5, 1.5]
    assert said in table.assumed


@pytest.mark.parametrize("form", [{"thousands": ";"}, {"thousands": "abc"}, {"decimal": ",", "thousands": ","}])
def test_signs_that_separate_no_thousands_are_refused(tmp_path, form):
    assert "--thousands" in refusal(tmp_path, "a;x\n1;1.5\n2;2.5\n", **form).hint


def test_quoted_decimal_commas_between_commas_as_stated(tmp_path):
    content = 'a,b\n"1,5","2,25"\n"3,5","4,25"\n'
    assert values(read(tmp_path, content, separator=",", decimal=",")) == [[1.5, 3.5], [2.25, 4.25]]


@pytest.mark.parametrize("again", ["a,b\n", "\nA, b\n", "a,b\ndeg,mm\n"])
def test_a_file_that_was_appended_to_itself(tmp_path, again):
    table = read(tmp_path, f"a,b\ndeg,mm\n1.5,2\n2.5,3\n{again}10,20\n11,21\n")
    assert table.numbers(0).tolist() == [1.5, 2.5, 10, 11]
    assert "repeats the head: ignored" in " ".join(table.assumed)


def test_another_table_below_an_empty_line_is_asked(tmp_path):
    text = "a,b,c\n1.5,2,3\n2.5,3,4\n\nc,d,e\n10,20,30\n11,21,31\n"
    caught = refuses("another table begins here", read, tmp_path, text)
    assert caught.line == 5
    assert "--part 1" in caught.hint
    assert "--skip-lines 4" in caught.hint
    first = read(tmp_path, text, part="1")
    assert first.lines.tolist() == [2, 3]
    assert "from line 5 on ignored" in first.assumed
    assert read(tmp_path, text, skip_lines=4).lines.tolist() == [6, 7]


@pytest.mark.parametrize(
    ("content", "form"),
    [("a,x\n1,1.5\n2,2.5\n", {"decimal": ","}), ("a;x\n1;1,5\n", {"decimal": ",", "separator": ","})],
)
def test_a_decimal_sign_that_also_separates_is_refused(tmp_path, content, form):
    error = refusal(tmp_path, content, **form)
    assert "both ','" in error.problem
    assert "--separator" in error.hint


def test_an_assignment_of_nested_lists_is_read(tmp_path):
    rows = np.random.default_rng(0).uniform(-150, 150, (20, 6)).round(4)
    listed = [f"    [{', '.join(f'{v:.4f}' for v in row)}]" for row in rows]
    table = read(tmp_path, "q = [\n" + ",\n".join(listed) + "\n]\n")
    np.testing.assert_array_equal(np.stack([table.numbers(i) for i in range(6)], axis=1), rows)
