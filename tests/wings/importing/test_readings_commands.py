"""The commands import and split: what they print and write, and that a failure writes nothing."""

import numpy as np
import pytest
from typer.testing import CliRunner

from refusals import refuses
from truearm.command_line import make_app
from truearm.errors import InputError
from truearm.readings import read_session

TABLE = "name;a1;a2;px;py;pz;T\nA;0;1024;1,5;2;3;20\nA;1000;512;1,5;2,5;3;20\nB;2000;0;1;2;3;21\n"
COUNTS = [
    *("--separator", ";", "--decimal", ",", "--angles", "a1,a2", "--angle-unit", "counts"),
    *("--counts-per-turn", "4000,1024", "--sign", "+,-", "--zero", "0,1024"),
    *("--point", "px,py,pz", "--point-unit", "m", "--column", "temperature_degC=T", "--column", "position=name"),
]


def run(command, *arguments):
    result = CliRunner().invoke(make_app(command), [command, *map(str, arguments)], catch_exceptions=True)
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(TABLE)
    return path


def test_import_writes_a_session_file_and_shows_the_ranges(table):
    out = table.with_name("s.csv")
    said = run("import", table, "--out", out, *COUNTS, "--session-name", "May")
    readings = read_session(out, n_joints=2)
    np.testing.assert_allclose(np.degrees(readings.angles), [[0, 0], [90, 180], [180, 360]], atol=1e-12)
    np.testing.assert_array_equal(readings.points[0], [1500, 2000, 3000])
    assert readings.position.tolist() == ["A", "A", "B"]
    assert readings.session.tolist() == ["May"] * 3
    assert "3 readings of 2 joints from table.csv" in said
    lines = {line.split()[0]: line.split()[1:] for line in said.splitlines() if line}
    assert lines["J2"] == ["a2", "0.000", "360.000", "deg"]
    assert lines["y"] == ["reference", "2000.000", "2500.000", "mm"]
    assert lines["temperature"] == ["20.00", "21.00", "degC"]
    assert lines["positions:"] == ["2"]


def test_radians_and_sliding_joints_keep_their_units(tmp_path):
    path = tmp_path / "t.tsv"
    path.write_text("0.1\t5\n0.2\t6\n")
    options = ["--angles", "1,2", "--angle-unit", "rad,mm", "--separator", "TAB", "--no-header"]
    run("import", path, "--out", tmp_path / "s.csv", *options)
    assert (tmp_path / "s.csv").read_text() == "q1_rad,q2_mm\n0.1,5.0\n0.2,6.0\n"


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--sign", "+,x", "--sign expects + or - for each joint, got 'x'"),
        ("--zero", "1,two", "--zero expects numbers separated by commas, got '1,two'"),
        ("--angle-unit", "grad", "unknown unit of angles 'grad'"),
        ("--angles", "a1,a9", "no column 'a9'"),
    ],
)
def test_a_failed_import_writes_nothing(table, option, value, said):
    assert said in str(refuses(None, run, "import", table, "--out", table.with_name("s.csv"), *COUNTS, option, value))
    assert [p.name for p in table.parent.iterdir()] == ["table.csv"]


def test_split_writes_two_files_in_the_units_of_the_first(tmp_path):
    session, train, test = (tmp_path / f"{name}.csv" for name in ("s", "train", "test"))
    session.write_text("q1_rad,position\n" + "".join(f"0.{i},P{i % 4}\n" for i in range(8)))
    said = run("split", session, "--train", train, "--test", test, "--hold-out", 0.25, "--seed", 3)
    assert "2 of 8 readings" in said
    assert "6 of 8 readings" in said
    rows = sorted(train.read_text().splitlines()[1:] + test.read_text().splitlines()[1:])
    assert rows == sorted(session.read_text().splitlines()[1:])


def test_split_refuses_one_file_for_both_parts_and_a_missing_column(tmp_path):
    session = tmp_path / "s.csv"
    session.write_text("q1_rad\n1\n2\n")
    same = tmp_path / "x.csv"
    refuses("the same file", run, "split", session, "--train", same, "--test", same)
    refuses("no column 'position'", run, "split", session, "--train", same, "--test", tmp_path / "y.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["s.csv"]
