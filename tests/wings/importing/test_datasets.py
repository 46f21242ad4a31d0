"""Real data sets: where they are looked for, that their checksums must fit, and the traps of their formats."""

import gc
import hashlib
import threading
import warnings
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from typer.testing import CliRunner

from refusals import refuses
from truearm.command_line import make_app
from truearm.errors import InputError
from truearm.readings import read_lengths, read_session
from truearm.wings.importing import datasets

UR5_FILE = "tsinghua_ur5_wam/UR5/3D_UR5_uncalibrated_grid_cleaned.csv"
HEADER = "step_order,x_t,y_t,z_t,x_dif,y_dif,z_dif,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n"
TEXT = HEADER + "0,100,200,300,1,-2,0.5,10,20,30,40,50,60\n"


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """No data set is at hand, and the cache is empty."""
    monkeypatch.delenv("TRUEARM_DATA", raising=False)
    monkeypatch.setattr(datasets, "_local_folders", list)
    monkeypatch.setattr(datasets, "_cache", lambda: tmp_path / "cache")
    return tmp_path


@pytest.fixture
def published(nowhere, monkeypatch):
    """A server on this machine publishes one small set; its folder."""
    content = TEXT.encode()
    registry = {UR5_FILE: hashlib.sha256(content).hexdigest()}
    monkeypatch.setattr(datasets, "_registry", lambda: registry)
    repository = datasets.UPSTREAM["tsinghua_ur5_wam"]
    file = nowhere / "server" / repository / UR5_FILE.split("/", 1)[1]
    file.parent.mkdir(parents=True)
    file.write_bytes(content)

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(nowhere / "server"))) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        monkeypatch.setattr(datasets, "_RAW", f"http://127.0.0.1:{server.server_address[1]}")
        yield file
        server.shutdown()
    with warnings.catch_warnings():  # after a 404, pooch leaves its socket to the collector
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


def test_a_set_is_downloaded_once(published, nowhere):
    assert datasets.find_local("ur5") is None
    path = datasets.fetch("ur5")
    assert path == nowhere / "cache" / UR5_FILE
    published.unlink()  # the second time nothing is asked of the server
    assert datasets.fetch("ur5") == path
    readings = datasets.load_ur5()
    np.testing.assert_allclose(np.degrees(readings.angles), [[10, 20, 30, 40, 50, 60]], rtol=1e-15)
    np.testing.assert_array_equal(readings.points, [[101.0, 198.0, 300.5]])  # target plus difference


def test_what_is_sent_must_be_what_was_published(published, nowhere):
    published.write_text("<html>please log in</html>")
    refuses("differs from the published file", datasets.fetch, "ur5")
    assert not [p for p in (nowhere / "cache").rglob("*") if p.is_file()]


def test_a_failed_download_says_what_to_do(published, nowhere):
    published.unlink()
    assert "TRUEARM_DATA" in refuses("cannot be downloaded", datasets.fetch, "ur5").hint
    assert not [p for p in (nowhere / "cache").rglob("*") if p.is_file()]


def test_a_damaged_cache_is_refused(published, nowhere):
    datasets.fetch("ur5").write_text("damaged")
    assert refuses("differs from the published one", datasets.fetch, "ur5").file == nowhere / "cache" / UR5_FILE


def test_changed_line_ends_are_recognised(published):
    path = datasets.fetch("ur5")
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    refuses("in its line ends", datasets.fetch, "ur5")


def test_the_named_folder_comes_first(tmp_path, monkeypatch):
    mine = tmp_path / "mine" / UR5_FILE
    mine.parent.mkdir(parents=True)
    mine.write_text(TEXT)
    monkeypatch.setattr(datasets, "_registry", lambda: {UR5_FILE: hashlib.sha256(TEXT.encode()).hexdigest()})
    monkeypatch.setenv("TRUEARM_DATA", str(tmp_path / "mine"))
    assert datasets.find_local("ur5") == mine
    monkeypatch.setenv("TRUEARM_DATA", str(tmp_path / "no"))
    refuses("TRUEARM_DATA names a folder that does not exist", datasets.find_local, "ur5")


def test_a_folder_beside_the_working_directory_is_found(tmp_path, monkeypatch):
    beside = tmp_path / "shared" / "datasets" / UR5_FILE
    beside.parent.mkdir(parents=True)
    beside.write_text(TEXT)
    (tmp_path / "work").mkdir()
    monkeypatch.delenv("TRUEARM_DATA", raising=False)
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(datasets, "_registry", lambda: {UR5_FILE: hashlib.sha256(TEXT.encode()).hexdigest()})
    assert datasets.find_local("ur5") == beside


def test_unknown_names_are_refused_with_the_known_ones():
    assert "ur10-a" in refuses("no data set 'ur6'", datasets.load_readings, "ur6").hint
    refuses("series A or B", datasets.load_ur10_leica, "C")


def test_every_set_has_checksums_of_its_files():
    for name, data_set in datasets.DATASETS.items():
        files = datasets._files(data_set)
        assert files, name
        assert all(len(checksum) == 64 for checksum in files.values())
    assert sum(len(datasets._files(s)) for s in datasets.DATASETS.values()) == len(datasets._registry())


# The real files ------------------------------------------------------------------------------------------------------

# name: readings, joints, positions, has points, has uncertainties (as their publishers say)
REAL = {
    "ur10-a": (11911, 6, 619, True, False),
    "ur10-b": (1495, 6, 154, True, True),
    "ur5": (1000, 6, 1000, True, False),
    "wam": (216, 7, 216, True, False),
    "mukca-panda_1": (182, 7, 3, False, False),
    "mukca-panda_2": (559, 7, 9, False, False),
    "mukca-panda_3": (387, 7, 6, False, False),
    "mukca-dinova_1": (137, 6, 4, False, False),
}


def at_hand(name):
    if datasets.find_local(name) is None:
        pytest.skip(f"the data set {name} is not at hand (TRUEARM_DATA or ../shared/datasets)")


@pytest.mark.parametrize("name", REAL)
def test_a_real_set_holds_what_its_publisher_says(name):
    at_hand(name)
    readings = datasets.load_readings(name)
    n, joints, positions, points, std = REAL[name]
    assert readings.angles.shape == (n, joints)
    assert len(set(readings.position.tolist())) == positions
    assert (readings.points is not None, readings.point_std is not None) == (points, std)
    assert np.abs(readings.angles).max() < 2 * np.pi  # read as degrees, or not scaled, they would be far outside
    if not points:
        assert len(set(readings.seat.tolist())) == 2 * positions


def test_the_first_row_of_series_a_is_read_to_the_last_digit():
    at_hand("ur10-a")
    readings = datasets.load_readings("ur10-a")
    np.testing.assert_array_equal(readings.angles[1], [-2.14055, -2.08493, -0.837441, -0.218756, 0.393594, -0.00187856])
    np.testing.assert_array_equal(readings.points[1], [1685.2797, -1665.3456, -415.81103])
    assert readings.temperature_degC[1] == 23.6800003051758
    assert readings.position[1] == "0.8 0.6 0.9"


def test_the_wam_hangs_low():
    """The sign of the differences: added, the cable-driven arm is measured below where it was sent."""
    at_hand("wam")
    assert datasets.load_readings("wam").points[:, 2].mean() < 190  # the targets' mean height is 200.7 mm


def test_one_tool_position_can_be_loaded():
    at_hand("mukca-panda_1")
    readings = datasets.load_mukca("panda_1", "front")
    assert sorted(set(readings.seat.tolist())) == ["panda_1/front/hole_0", "panda_1/front/hole_1"]
    caught = refuses("no tool position 'attic'", datasets.load_mukca, "panda_1", "attic")
    assert "back-high, front, right" in caught.hint


@pytest.mark.parametrize("name", REAL)
def test_known_lengths_are_between_the_seats_of_the_set(name):
    at_hand(name)
    lengths = datasets.load_lengths(name)
    assert (lengths is None) == (not name.startswith("mukca"))
    if lengths is not None:
        seats = sorted(set(datasets.load_readings(name).seat.tolist()))
        assert sorted([*lengths.seat_a.tolist(), *lengths.seat_b.tolist()]) == seats
        assert set(lengths.length_mm.tolist()) == {50.0}
        assert set(lengths.u_mm.tolist()) == {0.1}


def test_lengths_are_those_of_the_tool_positions_asked_for():
    lengths = datasets.load_mukca_lengths("panda_1", "front")
    assert (lengths.seat_a.tolist(), lengths.seat_b.tolist()) == (["panda_1/front/hole_0"], ["panda_1/front/hole_1"])
    refuses("no tool position 'attic'", datasets.load_mukca_lengths, "panda_1", "attic")


def test_the_command_writes_lengths_beside_the_session(tmp_path, monkeypatch):
    at_hand("mukca-panda_1")
    out = tmp_path / "p.csv"
    result = CliRunner().invoke(make_app("fetch"), ["fetch", "mukca-panda_1", "--out", str(out)])
    assert result.exit_code == 0
    assert "3 lengths between its seats" in result.output
    assert f"lengths written to {tmp_path / 'p-lengths.csv'}" in result.output
    seats = read_session(out, n_joints=7).seat
    assert len(read_lengths(tmp_path / "p-lengths.csv", seats=seats.tolist())) == 3
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mukca-panda_1-lengths.csv").write_text("mine")
    refused = CliRunner().invoke(make_app("fetch"), ["fetch", "mukca-panda_1"])
    assert "the file exists already" in str(refused.exception)
    assert not (tmp_path / "mukca-panda_1.csv").exists()


def test_the_command_lists_the_sets_and_writes_one(published, nowhere, monkeypatch):
    listed = CliRunner().invoke(make_app("fetch"), ["fetch"]).output
    assert all(name in listed for name in datasets.DATASETS)
    monkeypatch.chdir(nowhere)
    result = CliRunner().invoke(make_app("fetch"), ["fetch", "ur5"])
    assert "1 reading of 6 joints, nominal arm ur5" in result.output
    assert "Cite: Jacobi" in result.output
    assert len(read_session(nowhere / "ur5.csv", n_joints=6)) == 1
    wrong = CliRunner().invoke(make_app("fetch"), ["fetch", "ur6", "--out", str(nowhere / "x.csv")])
    assert isinstance(wrong.exception, InputError)
    assert not (nowhere / "x.csv").exists()
