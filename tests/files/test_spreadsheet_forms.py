"""Laws of forms that a spreadsheet saved: the same cells in any country's dialect, or a refusal that says why."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.errors import InputError
from truearm.files.delimited import read_columns, read_form, write_columns

# What Windows' encoding has, and no cell that is a number.
words = st.text(st.sampled_from("aZ äöüß€é°_-/"), min_size=1, max_size=8).map(lambda word: f"s{word}")
numbers = st.floats(-1e6, 1e6, allow_subnormal=False)


def local_form(rows, *, separator, decimal, encoding, end, empty_columns, quoted):
    """Bytes that a spreadsheet writes: numbers with its decimal sign, empty columns and rows at the end."""
    out = io.StringIO()
    writer = csv.writer(
        out, delimiter=separator, lineterminator=end, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    )
    for row in rows:
        cells = [repr(cell).replace(".", decimal) if isinstance(cell, float) else cell for cell in row]
        writer.writerow(cells + [""] * empty_columns)
    writer.writerow([""] * (len(rows[0]) + empty_columns))
    return out.getvalue().encode(encoding)


@settings(max_examples=30)
@given(
    lengths=st.lists(numbers, min_size=1, max_size=8),
    word=words,
    separator=st.sampled_from(";\t"),
    decimal=st.sampled_from(".,"),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "cp1252"]),
    end=st.sampled_from(["\n", "\r\n"]),
    empty_columns=st.integers(0, 3),
    quoted=st.booleans(),
)
def test_a_form_written_in_two_dialects_reads_the_same(tmp_path_factory, lengths, word, **dialect):
    folder = tmp_path_factory.mktemp("forms")
    seats = [word] * (len(lengths) + 1)
    values = [*lengths, 0.125]  # not to be mistaken for thousands
    write_columns(folder / "own.csv", {"seat": np.array(seats), "x_mm": np.array(values)})
    rows = [["seat", "x_mm"], *([seat, float(value)] for seat, value in zip(seats, values, strict=True))]
    (folder / "local.csv").write_bytes(local_form(rows, **dialect))
    own, local = read_form(folder / "own.csv"), read_form(folder / "local.csv")
    assert own.names == local.names
    for one, other in zip(read_columns(own, [1], [0]), read_columns(local, [1], [0]), strict=True):
        np.testing.assert_array_equal(one[0], other[0])


def form(folder, text):
    path = folder / "form.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("decisive", ["0,125", "12,5", "1,2345", "-,5", "1,5E-05"])
def test_one_number_that_has_no_other_meaning_tells_the_decimal_sign(tmp_path, decisive):
    numbers = read_columns(read_form(form(tmp_path, f"a;b\n1,234;{decisive}\n")), [0, 1])[0]
    assert numbers.tolist() == [[1.234, float(decisive.replace(",", "."))]]


def test_a_comma_that_may_separate_thousands_is_refused_with_both_meanings(tmp_path):
    caught = refuses(r"'-1,234', which may be -1\.234 or -1234", read_form, form(tmp_path, "seat;b\nA;12\nB;-1,234\n"))
    assert (caught.line, caught.column) == (3, "b")
    assert "write -1,2340" in caught.hint


@pytest.mark.parametrize("other", ["1,234.5", "1,234,567", "2.5"])
def test_thousands_separators_are_refused(tmp_path, other):
    sheet = read_form(form(tmp_path, f"a;b\n1,234;{other}\n"))
    assert refuses("expected a number", read_columns, sheet, [0, 1]).line == 2


def test_both_decimal_signs_in_one_form_are_refused_at_the_second(tmp_path):
    caught = refuses(r"decimal ',', got '2\.5'", read_columns, read_form(form(tmp_path, "a;b\n1,5;2\n3;2.5\n")), [0, 1])
    assert (caught.line, caught.column) == (3, "b")
    assert caught.hint == "write all numbers with the same decimal sign"


def test_a_cell_below_no_name_is_refused(tmp_path):
    with pytest.raises(InputError, match="the column has no name") as caught:
        read_columns(read_form(form(tmp_path, "a;b;;\n1;2;;\n1;2;;3\n")), [0, 1])
    assert (caught.value.line, caught.value.column) == (1, 3)


def test_between_commas_only_utf8_and_decimal_points_are_read(tmp_path):
    refuses("expected text in utf-8", read_form, form(tmp_path, "a,b\n1,büchse\n".encode("cp1252")))
    refuses(r"decimal '\.', got '1,5'", read_columns, read_form(form(tmp_path, 'a,b\n"1,5",2\n')), [0, 1])


def test_bytes_that_windows_does_not_know_are_refused(tmp_path):
    refuses("expected text in cp1252", read_form, form(tmp_path, b"a;b\n1;b\x81\n"))
