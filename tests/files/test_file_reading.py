"""Bounded reads: an ordinary file of a bounded size is read whole, anything else is refused with a message.

What cannot be read is not written over either.
"""

import os
import socket

import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.models.model_file import load_model
from truearm.readings import read_lengths, read_session
from truearm.wings.laboratory.certificate.dcc_reader import read_dcc

READERS = [
    (read_session, ".csv"),
    (read_session, ".parquet"),
    (read_lengths, ".csv"),
    (load_arm, ".toml"),
    (load_arm, ".urdf"),
    (load_model, ".truearm"),
    (read_dcc, ".xml"),
]


@pytest.fixture(params=["fifo", "device", "link to a device", "socket", "folder", "loop", "nothing"])
def special(request, tmp_path, monkeypatch):
    """A name that is no ordinary file, and what the message says of it."""

    def make(suffix):
        path = tmp_path / f"special{suffix}"
        match request.param:
            case "fifo":
                os.mkfifo(path)
            case "device":
                monkeypatch.chdir("/dev")
                return "/dev/zero", "device"
            case "link to a device":
                path.symlink_to("/dev/zero")
            case "socket":
                monkeypatch.chdir(tmp_path)  # the name of a socket must be short
                with socket.socket(socket.AF_UNIX) as made:
                    made.bind(path.name)
            case "folder":
                path.mkdir()
                return path, "folder"
            case "loop":
                path.symlink_to(path)
                return path, "leads back to itself"
            case "nothing":
                return path, "does not exist"
        return path, "a device, a pipe or a socket"

    return make


@pytest.mark.parametrize(("read", "suffix"), READERS)
def test_what_is_no_ordinary_file_is_refused(read, suffix, special):
    path, said = special(suffix)
    if str(path) == "/dev/zero" and read is load_arm:
        pytest.skip("an arm file is known by its suffix")
    assert str(refuses(said, read, path).file) == str(path)


def test_a_file_of_the_largest_size_is_read_and_a_larger_one_refused(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"12345678")
    assert read_limited(path, limit_bytes=8) == b"12345678"
    refuses("larger than", read_limited, path, limit_bytes=7)


def test_a_link_to_a_file_is_read(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    assert read_limited(tmp_path / "link", limit_bytes=100) == b"content"


def test_a_name_that_no_file_can_have_is_refused():
    refuses("cannot be read", read_limited, "a\0b", limit_bytes=100)


def test_the_remedy_for_a_missing_file_is_that_of_the_caller(tmp_path):
    refuses("Try: write it first", read_limited, tmp_path / "none", limit_bytes=1, hint="write it first")


def test_nothing_is_written_to_what_is_no_ordinary_file(special):
    path, said = special(".csv")
    if said == "does not exist":
        with atomic_file(path) as beside:
            beside.write_text("new")
        assert path.read_text() == "new"
        return
    with pytest.raises(InputError) as caught, atomic_file(path):
        pytest.fail("opened")
    assert any(kind in caught.value.problem for kind in ("a device or a pipe", "a folder", "leads back to itself"))


def test_a_name_that_no_file_can_have_is_not_written():
    with pytest.raises(InputError, match="cannot be written"), atomic_file("a\0b"):
        pytest.fail("opened")
