"""Laws of workbooks, arrays, records and recordings: cells come exactly, bad files are refused once with a remedy."""

import contextlib
import io
import json
import struct
import sys
import tempfile
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.wings.importing.foreign import JointScale
from truearm.wings.importing.tables import array_files, read_table
from truearm.wings.importing.tables.array_files import table_of_frame
from truearm.wings.importing.tables.named_arrays import table_of_arrays
from truearm.wings.importing.tables.table import TableForm

formats = pytest.importorskip("benchmarks.table_formats", reason="benchmarks are not beside the tests")
ods, saved, xlsx = formats.ods, formats.saved, formats.xlsx

ROWS = [[1.5, 2.5, "a"], [3.5, 4.5, "b"]]
HEADED = [["J1", "J2", "name"], *ROWS]


def written(path, data):
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def refused(path, **form):
    """The sentence and the remedy of a refusal."""
    caught = refuses(None, read_table, path, TableForm(**form))
    assert caught.file == path
    assert caught.hint
    return caught.problem


# Workbooks ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [xlsx, ods])
def test_the_sheet_with_a_table_is_taken_and_said(tmp_path, write):
    path = written(
        tmp_path / "a.xlsx",
        write({"Notes": [["Warm day"]], "Data": HEADED, "Other": [["dx", "dy"], [1.5, 2.5], [3.5, 2.25]]}),
    )
    table = read_table(path)
    assert table.names == ("J1", "J2", "name")
    assert table.columns[0].tolist() == [1.5, 3.5]
    assert table.columns[2].tolist() == ["a", "b"]
    assert (table.place, table.lines.tolist(), table.header_line) == ("row", [2, 3], 1)
    assert "sheet Data" in table.assumed
    assert read_table(path, TableForm(part="Other")).names == ("dx", "dy")


def test_two_sheets_alike_are_asked(tmp_path):
    path = written(tmp_path / "a.xlsx", xlsx({"Mon": HEADED, "Tue": HEADED}))
    assert "Mon, Tue" in refused(path)
    assert len(read_table(path, TableForm(part="Tue"))) == 2
    assert "no sheet 'Wed'" in refused(path, part="Wed")


@given(st.lists(st.floats(-1e6, 1e6).map(lambda v: round(v, 3)), min_size=2, max_size=8))
def test_typed_numbers_come_exactly_whatever_stands_beside_them(values):
    sheet = [["x", "y"], *([value, "1,235"] for value in values), [0.5, "12,5"]]
    with tempfile.TemporaryDirectory() as folder:
        table = read_table(written(Path(folder) / "a.xlsx", xlsx({"A": sheet})))
    assert table.numbers(0).tolist() == [*values, 0.5]
    assert table.numbers(1).tolist() == [*[1.235] * len(values), 12.5]


def test_three_typed_decimals_are_no_thousands(tmp_path):
    table = read_table(written(tmp_path / "a.xlsx", xlsx({"A": [["x"], [1.235], [-12.446]]})))
    assert table.numbers(0).tolist() == [1.235, -12.446]


def test_skipped_rows_remarks_and_errors(tmp_path):
    sheet = [["x", "y"], [9.0, 9.0], ["x", "y"], ["# a remark"], [1.5, "#DIV/0!"], [2.5, 3.5]]
    table = read_table(written(tmp_path / "a.xlsx", xlsx({"A": sheet})), TableForm(skip_lines=2))
    assert table.lines.tolist() == [5, 6]
    assert np.isnan(table.numbers(1)[0])


def test_a_head_that_is_repeated_in_a_sheet_is_no_row(tmp_path):
    table = read_table(written(tmp_path / "a.xlsx", xlsx({"A": [*HEADED, *HEADED]})))
    assert table.lines.tolist() == [2, 3, 5, 6]
    assert "row 4 repeats the head: ignored" in table.assumed


def test_a_matlab_file_of_version_4_names_what_saves_a_later_one(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"q": np.ones((4, 2))}, format="4")
    assert "-v7" in refuses("version 5 to 7", read_table, tmp_path / "a.mat").hint


def far(cell):
    """A workbook with one cell far away."""
    unpacked = zipfile.ZipFile(io.BytesIO(xlsx({"A": HEADED})))
    members = {name: unpacked.read(name) for name in unpacked.namelist()}
    sheet = "xl/worksheets/sheet1.xml"
    members[sheet] = members[sheet].replace(b"</sheetData>", cell + b"</sheetData>")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return packed.getvalue()


def test_a_cell_in_the_last_corner_does_not_fill_the_memory(tmp_path):
    data = far(b"<row r=\"1048576\"><c r = 'XFD1048576'><v>1</v></c></row>")
    assert "spans 1.72e+10 cells" in refused(written(tmp_path / "a.xlsx", data))
    unpacked = zipfile.ZipFile(io.BytesIO(ods({"A": HEADED}))).read("content.xml")
    last = b'<table:table-row table:number-rows-repeated="9"><table:table-cell office:value-type="float" '
    last += b'table:number-columns-repeated="99999999" office:value="1"/></table:table-row></table:table>'
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("content.xml", unpacked.replace(b"</table:table>", last))
    assert "spans" in refused(written(tmp_path / "a.ods", packed.getvalue()))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (far(b" " * 2**21), "unpack to"),
        (xlsx({"A": HEADED})[:600], "cannot be read"),
        (b"PK\x05\x06" + bytes(18), "another zip file"),
        (b"\xd0\xcf\x11\xe0" + "EncryptedPackage".encode("utf-16-le"), "protected by a password"),
        (b"\xd0\xcf\x11\xe0" + bytes(600), "cannot be read"),
        (xlsx({"A": []}), "no sheet with cells"),
        (far(b"<c"), "cannot be read"),
    ],
    ids=["zip bomb", "cut off", "empty archive", "encrypted", "old and damaged", "empty", "broken XML"],
)
def test_a_bad_workbook_is_refused_once(tmp_path, data, said, monkeypatch):
    monkeypatch.setattr(array_files, "_UNPACKED", 2**20)
    assert said in refused(written(tmp_path / "a.xlsx", data))


def test_a_workbook_of_words_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected rows of numbers"):
        read_table(written(tmp_path / "a.xlsx", xlsx({"A": [["words", "only"], ["no", "numbers"]]})))


# Arrays ---------------------------------------------------------------------------------------------------------------


def test_arrays_of_one_length_are_the_table(tmp_path):
    q, p = np.arange(12.0).reshape(4, 3), np.ones((4, 1))
    np.savez(tmp_path / "a.npz", q=q, p=p, T=np.eye(3), name=np.array(list("abcd")), rate=125)
    table = read_table(tmp_path / "a.npz")
    assert table.names == ("q[0]", "q[1]", "q[2]", "p", "name")
    assert table.columns[1].tolist() == [1.0, 4.0, 7.0, 10.0]
    assert (table.place, table.lines.tolist()) == ("record", [1, 2, 3, 4])
    assert table.assumed == ("ignored, of another length than 4: T (3 x 3), rate (one value)",)


def test_two_lengths_are_asked(tmp_path):
    np.savez(tmp_path / "a.npz", train=np.zeros((40, 9)), test=np.zeros((20, 9)))
    assert "train (40 rows) and test (20 rows)" in refused(tmp_path / "a.npz")
    assert len(read_table(tmp_path / "a.npz", TableForm(part="test"))) == 20
    assert "no array 'x'" in refused(tmp_path / "a.npz", part="x")


def test_an_array_with_a_reading_in_each_column_is_turned_and_said(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"q": np.arange(180.0).reshape(6, 30), "t": np.arange(30.0)})
    table = read_table(tmp_path / "a.mat")
    assert table.names == ("q[0]", "q[1]", "q[2]", "q[3]", "q[4]", "q[5]", "t")
    assert table.columns[1].tolist() == np.arange(30.0, 60.0).tolist()
    assert "reading in each column" in table.assumed[0]


def test_matlab_structs_are_columns(tmp_path):
    readings = [{"q": [0.1 * i, 0.2 * i], "x": 1.0 * i} for i in range(5)]
    scipy.io.savemat(tmp_path / "a.mat", {"S": readings, "robot": {"name": "UR5"}}, do_compression=True)
    table = read_table(tmp_path / "a.mat")
    assert table.names == ("S.q[0]", "S.q[1]", "S.x")
    assert table.columns[2].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


HUGE = b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999999,6)}  \n"


def test_matlab_cells_of_unlike_arrays_are_ignored(tmp_path):
    cells = np.empty(3, object)
    cells[:] = [np.zeros(2), np.zeros(3), "text"]
    fields = np.zeros(4, dtype=[("x", object), ("q", object)])
    for i in range(4):
        fields[i] = (1.0 * i, np.array([0.1 * i, 0.2 * i]))
    scipy.io.savemat(tmp_path / "a.mat", {"C": cells, "S": fields, "z": 1j * np.ones(4), "ok": np.ones(4, bool)})
    table = read_table(tmp_path / "a.mat")
    assert table.names == ("S.x", "S.q[0]", "S.q[1]", "ok")
    assert table.columns[0].tolist() == [0.0, 1.0, 2.0, 3.0]


@given(st.lists(st.tuples(st.integers(0, 399), st.integers(0, 255)), min_size=1, max_size=6))
def test_a_damaged_matlab_file_is_read_or_refused(changes):
    """Damaged files crash the reader of SciPy (segmentation fault)."""
    data = bytearray(saved(lambda file: scipy.io.savemat(file, {"run": {"q": np.ones((4, 2)), "n": "UR5"}, "t": 1.0})))
    for at, byte in changes:
        data[128 + at % (len(data) - 128)] = byte
    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(InputError):
        read_table(written(Path(folder) / "a.mat", bytes(data)))


def compressed(size):
    packed = zlib.compress(bytes(size), 9)
    return b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.npy", saved(lambda file: np.save(file, np.array([{}], object), allow_pickle=True)), "pickle"),
        ("a.npz", saved(lambda file: np.savez(file, q=np.array([{}], object))), "pickle"),
        ("a.npy", saved(lambda file: np.save(file, np.zeros((9, 9))))[:200], "cannot be read"),
        ("a.npy", HUGE, "cannot be read"),
        ("a.npz", saved(lambda file: np.savez(file, q=np.zeros((9, 9))))[:150], "cannot be read"),
        ("a.mat", b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF", "MATLAB 7.3"),
        ("a.mat", compressed(2**21), "unpack to"),
        ("a.mat", compressed(64), "numeric arrays"),
        ("a.mat", b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + bytes(5), "expected"),
        ("a.mat", b"words", "cannot be read"),
        ("a.mat", saved(lambda file: scipy.io.savemat(file, {"name": "UR5"})), "numeric arrays"),
        ("a.npy", saved(lambda file: np.save(file, np.zeros((0, 9)))), "expected"),
        ("a.npy", saved(lambda file: np.save(file, np.zeros((9, 90, 90)))), "at most 4096 numbers"),
        ("a.parquet", b"PAR1" + bytes(99), "cannot be read"),
        ("a.feather", b"ARROW1" + bytes(99), "cannot be read"),
    ],
)  # fmt: skip
def test_a_bad_array_is_refused_once(tmp_path, name, data, said, monkeypatch):
    monkeypatch.setattr(array_files, "_UNPACKED", 2**20)
    assert said in refused(written(tmp_path / name, data))


# Data frames ----------------------------------------------------------------------------------------------------------


def test_a_frame_keeps_its_values():
    frame = pd.DataFrame(
        {
            "n": pd.array([1, None, 3], dtype="Int64"),
            ("a", "b"): [1.5, np.nan, 2.5],
            "text": ["x", None, "z"],
            "kind": pd.Categorical(["u", "v", "u"]),
            "ok": [True, False, True],
            "at": pd.to_datetime(["2024-05-01 10:00:00.25Z", None, "2024-05-01T11:00:00Z"], format="ISO8601"),
            "took": pd.to_timedelta([1.5, 2.0, 3.0], unit="s"),
            "tip": [[1.0, 2.0], [3.0, 4.0], None],
        },
        index=[7, 8, 9],
    )
    table = table_of_frame(frame)
    assert table.names == ("n", "a b", "text", "kind", "ok", "at", "took", "tip[0]", "tip[1]")
    cells = {name: column.tolist() for name, column in zip(table.names, table.columns, strict=True)}
    np.testing.assert_equal(cells["n"], [1.0, np.nan, 3.0])
    assert cells["text"] == ["x", "", "z"]
    assert cells["kind"] == ["u", "v", "u"]
    assert cells["ok"] == ["true", "false", "true"]
    assert cells["at"] == ["2024-05-01T10:00:00.250000+00:00", "", "2024-05-01T11:00:00+00:00"]
    assert cells["took"] == [1.5, 2.0, 3.0]
    np.testing.assert_equal(cells["tip[1]"], [2.0, 4.0, np.nan])


@given(st.lists(st.lists(st.floats(allow_nan=False), min_size=3, max_size=3), min_size=1, max_size=6))
def test_numbers_of_a_frame_come_exactly(values):
    table = table_of_frame(pd.DataFrame(values, columns=["a", "b", "c"]))
    assert np.column_stack(table.columns).tolist() == values


def test_a_frame_is_imported_as_a_file_is():
    frame = pd.DataFrame(np.arange(54.0).reshape(6, 9) * 5, columns=[*(f"J{i}" for i in range(1, 7)), "X", "Y", "Z"])
    session = ta.import_table(frame, scale=JointScale("deg"), point_unit="mm")
    assert np.degrees(session.angles[1]).tolist() == pytest.approx([45, 50, 55, 60, 65, 70])
    assert session.points[1].tolist() == [75, 80, 85]
    refuses("data frame, got list", ta.import_table, [1, 2])


def test_a_frame_without_rows_is_refused():
    refuses("expected rows of numbers", table_of_frame, pd.DataFrame({"a": []}))


# Records --------------------------------------------------------------------------------------------------------------


def test_json_lines_state_their_lines(tmp_path):
    text = '{"q": [1, 2], "x": null, "n": "a"}\n\n{"q": [3, 4], "x": 2.5}\n'
    table = read_table(written(tmp_path / "a.txt", text))
    assert table.names == ("q[0]", "q[1]", "x", "n")
    assert (table.place, table.lines.tolist()) == ("line", [1, 3])
    np.testing.assert_equal(table.columns[2].tolist(), [np.nan, 2.5])
    assert table.columns[3].tolist() == ["a", ""]


def test_several_lists_of_records_are_asked(tmp_path):
    path = written(tmp_path / "a.json", json.dumps({"a": [{"q": 1}], "b": {"c": [{"q": 2}]}}))
    assert "a, b.c" in refused(path)
    assert read_table(path, TableForm(part="b.c")).columns[0].tolist() == [2.0]


@pytest.mark.parametrize(
    ("text", "line"),
    [('{"q": 1}\n{"q": 2', 2), ('[{"q": 1},\n{"q" 2}]', 2), ("[" * 99999, None), ('{"q": 1' + "0" * 5000 + "}", 1)],
)
def test_broken_json_is_refused_with_its_line(tmp_path, text, line):
    assert refuses(None, read_table, written(tmp_path / "a.json", text)).line == line


@pytest.mark.parametrize("text", ["{}", "[]", '"words"', "[[1, 2], [3]]", '{"a": {"b": 1}}', "12", ""])
def test_json_without_a_table_is_refused(tmp_path, text):
    refuses(None, read_table, written(tmp_path / "a.json", text))


# LabVIEW --------------------------------------------------------------------------------------------------------------

LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\n\nChannels\t2\n"
    "Delta_X\t0,001\t0,001\n***End_of_Header***\nX_Value\tJ1\tJ2\tComment\n0,000\t1,235\t-988\n0,001\t1,236\t-987\n"
)


def test_the_decimal_sign_that_labview_states_settles_a_doubt(tmp_path):
    table = read_table(written(tmp_path / "a.lvm", LVM))
    assert table.names[:3] == ("X_Value", "J1", "J2")
    assert table.numbers(1).tolist() == [1.235, 1.236]
    assert table.lines.tolist() == [10, 11]


def test_several_segments_are_refused(tmp_path):
    assert "2 segments" in refused(written(tmp_path / "a.lvm", LVM + LVM[LVM.index("Channels") :]))


# Recordings -----------------------------------------------------------------------------------------------------------


@pytest.fixture(params=["MCAP", "SQLITE3"])
def bag(request, tmp_path):
    """A recording of joints, of a gripper under the same topic, and of a tracker."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    header, time, joints, stamped, point = (
        store.types[name]
        for name in (
            *("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/JointState"),
            *("geometry_msgs/msg/PointStamped", "geometry_msgs/msg/Point"),
        )
    )
    none = np.zeros(0)
    folder = tmp_path / "bag"
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin[request.param]) as writer:
        states = writer.add_connection("/joint_states", joints.__msgtype__, typestore=store)
        tracker = writer.add_connection("/tracker", stamped.__msgtype__, typestore=store)
        for i in range(5):
            at = header(stamp=time(sec=100 + i, nanosec=500_000_000), frame_id="")
            for names, values in ((["elbow", "wrist"], [0.1 * i, -0.2]), (["finger"], [0.01])):
                message = joints(header=at, name=names, position=np.array(values), velocity=none, effort=none)
                writer.write(states, (100 + i) * 10**9, store.serialize_cdr(message, joints.__msgtype__))
            message = stamped(header=at, point=point(x=1.0, y=2.0, z=0.5 * i))
            writer.write(tracker, (100 + i) * 10**9, store.serialize_cdr(message, stamped.__msgtype__))
    return folder


def test_a_recording_without_ros(bag):
    table = read_table(bag)
    assert table.names == ("time", "elbow/position", "wrist/position")
    assert table.units == ("s", "rad", "rad")
    assert table.columns[0].tolist() == [100.5, 101.5, 102.5, 103.5, 104.5]
    assert table.columns[1].tolist() == [0.1 * i for i in range(5)]
    assert table.assumed == ("topic /joint_states of 2", "5 messages of other joints ignored")
    points = read_table(bag, TableForm(part="/tracker"))
    assert points.names == ("time", "x", "y", "z")
    assert points.units == ("s", "m", "m", "m")
    assert points.columns[3].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert "/joint_states, /tracker" in refused(bag, part="/x")


def test_the_file_of_a_recording_alone_and_cut_off(bag, tmp_path):
    file = next(path for path in bag.iterdir() if path.suffix != ".yaml")
    assert read_table(file).names[0] == "time"
    data = file.read_bytes()
    assert "cannot be read" in refused(written(tmp_path / f"cut{file.suffix}", data[: len(data) // 2]))


def test_a_folder_that_is_no_recording(tmp_path):
    pytest.importorskip("rosbags.rosbag2")
    assert "cannot be read" in refused(tmp_path)


def test_what_is_not_installed_is_named(tmp_path, monkeypatch):
    for package in ("rosbags.rosbag1", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, package, None)
    assert "rosbags" in refused(written(tmp_path / "a.mcap", b"\x89MCAP0"))
    assert "pyarrow" in refused(written(tmp_path / "a.parquet", b"PAR1"))


@pytest.mark.parametrize("name", ["a.xlsx", "a.npz", "a.mat", "a.jsonl", "a.mcap", "a.csv"])
def test_a_missing_file_is_missing(tmp_path, name):
    refuses("does not exist", read_table, tmp_path / name)


@pytest.mark.parametrize(("rows", "is_said"), [(1, False), (2, True), (3, True)])
def test_arrays_of_columns_are_turned_and_it_is_said(rows, is_said):
    """A row of one number a reading is a column whichever way it lies: nothing is assumed."""
    angles = np.arange(10.0 * rows).reshape(rows, 10)
    found = table_of_arrays({"t": np.arange(10.0), "q": angles}, TableForm(), file=None)
    np.testing.assert_array_equal(np.stack(found.columns[1:]), angles)
    assert any("q has a reading in each column" in said for said in found.assumed) == is_said
