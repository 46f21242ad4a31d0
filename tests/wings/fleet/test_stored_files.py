"""Session files here and elsewhere: read once as long as they are as they were, and from URLs as from this machine."""

import os

import pytest

import truearm as ta
from truearm.errors import InputError, MissingTool, TruearmError
from truearm.wings.fleet import stored_files
from truearm.wings.fleet.fleet import Fleet
from truearm.wings.fleet.stored_files import FileHashes, StorageError, check_stored, content_sha256, local_copy

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")
fsspec = pytest.importorskip("fsspec", reason="a fleet is an extra: pip install 'truearm[fleet]'")

ARM = "virtual-research-0"


@pytest.fixture(scope="module")
def readings(tmp_path_factory):
    path = tmp_path_factory.mktemp("readings") / "a.csv"
    ta.simulate("ur10", poses=12, seed=0, arm_seed=0).save(path)
    return path


@pytest.fixture
def fleet(tmp_path):
    found = Fleet.create(tmp_path / "fleet")
    yield found
    found.close()


@pytest.fixture
def memory():
    place = fsspec.filesystem("memory")
    yield place
    place.rm("/sessions", recursive=True)


def age(path, seconds=60):
    """As if the file had been written some time ago."""
    before = path.stat().st_mtime - seconds
    os.utime(path, (before, before))


@pytest.fixture
def hashed(monkeypatch):
    """The files that are read for their SHA-256, drawings excepted."""
    found = []

    def counted(name):
        if name.endswith(".csv"):
            found.append(name)
        return content_sha256(name)

    monkeypatch.setattr(stored_files, "content_sha256", counted)
    return found


def test_a_file_is_hashed_again_only_when_it_changed(fleet, readings, tmp_path, hashed):
    path = tmp_path / "a.csv"
    path.write_bytes(readings.read_bytes())
    age(path)
    fleet.add(ARM, "ur10", session=path, model="nominal")
    fleet.run()
    del hashed[:]
    assert fleet.status().arms[0].what == "in force"
    assert hashed == []
    fleet.status(verify=True)
    assert hashed == [str(path)]
    path.write_bytes(readings.read_bytes() + b"\n")
    age(path, 30)
    assert fleet.status().arms[0].what == "to be fitted"
    assert hashed == [str(path)] * 2
    fleet.status()
    assert len(hashed) == 2


def test_verify_reads_a_file_whose_size_and_time_were_put_back(fleet, readings, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(readings.read_bytes())
    age(path)
    fleet.add(ARM, "ur10", session=path, model="nominal")
    fleet.run()
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    path.write_bytes(readings.read_bytes().replace(b"1", b"2", 1))
    os.utime(path, ns=times)
    assert fleet.status().arms[0].what == "in force"
    assert fleet.status(verify=True).arms[0].what == "to be fitted"
    assert fleet.status().arms[0].what == "to be fitted"  # from now on


def test_a_file_of_this_moment_may_change_within_the_same_time(tmp_path):
    """As git has it: the clock of a file system is coarse."""
    path = tmp_path / "a.csv"
    path.write_bytes(b"1")
    age(path, -60)  # however long this test takes
    hashes = FileHashes({})
    hashes.sha256(str(path))
    assert hashes.new == {}
    age(path, 120)
    hashes.sha256(str(path))
    assert list(hashes.new) == [str(path)]


def test_a_session_on_another_storage_gives_the_model_of_a_file(fleet, readings, memory):
    fleet.add(ARM, "ur10", session=readings, model="nominal")
    (here,) = fleet.run().rows
    memory.pipe("/sessions/a.csv", readings.read_bytes())
    assert fleet.add(ARM, "ur10", session="memory://sessions/a.csv") == 1
    (arm,) = fleet.registry.arms()
    assert arm.session == "memory://sessions/a.csv"
    assert [row.key for row in fleet.run().unchanged] == [here.key]  # the same content is the same fit
    memory.pipe("/sessions/a.csv", readings.read_bytes() + b"\n")
    assert fleet.status().arms[0].what == "to be fitted"
    (row,) = fleet.run().rows
    assert (row.state, row.session) == ("fitted", "memory://sessions/a.csv")
    assert row.constants == here.constants


def test_what_is_wrong_with_a_file_elsewhere_names_its_url(fleet, memory):
    memory.pipe("/sessions/bad.csv", b"q1_deg,q2_deg\n1,2\n")
    fleet.add(ARM, "ur10", session="memory://sessions/bad.csv", model="nominal")
    (row,) = fleet.run().failures
    assert row.message.startswith("memory://sessions/bad.csv, line 1: expected 6 joints, got 2")
    assert row.state == "failed"


def test_a_storage_that_does_not_answer_is_tried_again(fleet, readings, memory, monkeypatch):
    memory.pipe("/sessions/a.csv", readings.read_bytes())
    fleet.add(ARM, "ur10", session="memory://sessions/a.csv", model="nominal")

    class Unreachable(Exception):
        """As the package of a storage has its own."""

    def refuse(*_, **__):
        raise Unreachable("no credentials")

    with monkeypatch.context() as patched:
        patched.setattr(type(memory), "info", refuse)
        patched.setattr(type(memory), "open", refuse)
        (row,) = fleet.run().failures
        assert fleet.status().arms[0].what == "failed"
    assert (row.state, "the file cannot be reached (no credentials)" in row.message) == ("lost", True)
    assert fleet.run().n_fitted == 1


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("memory://sessions/none.csv", StorageError, "cannot be reached"),
        ("nosuch://bucket/a.csv", TruearmError, "nosuch"),
        ("https://host/a.csv?X-Amz-Expires=60&X-Amz-Signature=0af3", InputError, "key or signature"),
        ("https://host/a.csv?sv=2024&sig=0af3%3D", InputError, "key or signature"),
        ("https://host/a.csv?access_token=", InputError, "key or signature"),
        ("https://token@host/a.csv", InputError, "key or signature"),
        (".", InputError, "expected a session of one file, got a folder"),
        ("ftp://user:secret@host/a.csv", InputError, "without a password"),
        ("simplecache::memory://a.csv", InputError, "URL of one place"),
        ("nowhere.csv", InputError, "does not exist"),
    ],
)
def test_a_session_that_cannot_be_is_refused(name, kind, message):
    with pytest.raises(kind, match=message) as found:
        check_stored(name)
    assert "secret" not in str(found.value)


def test_a_package_that_is_missing_is_named(monkeypatch):
    def missing(_):
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr(fsspec.core, "url_to_fs", missing)
    with pytest.raises(MissingTool, match="s3://b/a.csv: a package is not installed .Install s3fs"):
        check_stored("s3://b/a.csv")


@pytest.mark.parametrize("states_size", [True, False])
def test_a_file_elsewhere_has_the_limit_of_one_here(memory, monkeypatch, states_size):
    memory.pipe("/sessions/a.csv", b"12")
    monkeypatch.setattr(stored_files, "MAX_BYTES", 1)
    if not states_size:
        monkeypatch.setattr(stored_files, "_size", lambda _: None)
    with (
        pytest.raises(InputError, match="memory://sessions/a.csv: expected at most"),
        local_copy("memory://sessions/a.csv"),
    ):
        pass


def test_a_storage_that_shows_no_change_is_read_each_time(memory, monkeypatch):
    memory.pipe("/sessions/a.csv", b"1")
    monkeypatch.setattr(type(memory), "info", lambda *_: {"name": "/sessions/a.csv", "size": 1, "type": "file"})
    hashes = FileHashes({})
    before = hashes.sha256("memory://sessions/a.csv")
    memory.pipe("/sessions/a.csv", b"2")
    assert hashes.sha256("memory://sessions/a.csv") != before


def test_the_command_takes_a_url(truearm, fleet, readings, memory):
    memory.pipe("/sessions/a.csv", readings.read_bytes())
    truearm("fleet", "add", fleet.folder, ARM, "ur10", "--session", "memory://sessions/a.csv").done()
    assert "to be fitted" in truearm("fleet", "status", fleet.folder, "--verify").done().out
