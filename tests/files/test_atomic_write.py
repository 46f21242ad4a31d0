"""Files that appear whole or not at all: on the disk, readable, with the rights they had, and nothing beside them."""

import os
import signal
import subprocess
import sys

import pytest

from refusals import refuses
from truearm.errors import InputError, ProgramFault
from truearm.files.atomic_write import PART, atomic_file, check_new_file

posix = pytest.mark.skipif(os.name == "nt", reason="rights, locks and signals of POSIX")


def write(path, text, **options):
    with atomic_file(path, **options) as beside:
        beside.write_text(text)


@posix
def test_the_content_is_on_the_disk_before_the_name_and_the_name_before_the_return(tmp_path, monkeypatch):
    path, done = tmp_path / "a.txt", []
    path.write_text("old")
    fsync, replace = os.fsync, os.replace

    def synced(handle):
        status = os.fstat(handle)
        done.append(("fsync", status.st_ino, status.st_size))
        fsync(handle)

    def renamed(source, target, **options):
        done.append(("rename", os.stat(source).st_ino))
        replace(source, target, **options)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    write(path, "whole")
    inode = path.stat().st_ino
    assert done[:2] == [("fsync", inode, 5), ("rename", inode)]
    assert [one[:2] for one in done[2:]] == [("fsync", tmp_path.stat().st_ino)]


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_replaced_file_keeps_its_rights_and_a_new_one_has_those_of_the_umask(tmp_path, mode):
    path, new = tmp_path / "a.txt", tmp_path / "new.txt"
    path.write_text("old")
    path.chmod(mode)
    before = os.umask(0o027)
    try:
        write(path, "new")
        write(new, "new")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == mode
    assert new.stat().st_mode & 0o777 == 0o640


def test_what_its_reader_cannot_read_replaces_nothing_and_is_a_fault_of_the_program(tmp_path):
    path = tmp_path / "a.txt"

    def read(beside):
        if (text := beside.read_text()) != "right":
            raise InputError(f"expected right, got {text}", file=beside)

    write(path, "right", read=read)
    with pytest.raises(ProgramFault, match=r"cannot read back what it wrote \(expected right, got wrong\)"):
        write(path, "wrong", read=read)
    assert path.read_text() == "right"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_write_within_a_write_appears_with_it(tmp_path):
    path = tmp_path / "a.txt"

    def interrupted():
        with atomic_file(path) as beside:
            write(beside, "inner")
            assert not path.exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not os.listdir(tmp_path)
    with atomic_file(path) as beside:
        write(beside, "inner")
    assert path.read_text() == "inner"


KILLED = """
import os, signal, sys
from truearm.files.atomic_write import atomic_file
with atomic_file(sys.argv[1]) as beside:
    beside.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@posix
def test_the_next_write_removes_what_a_killed_one_left_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    foreign = [".a-12345678.txt", ".hidden", "truearm-part-a.txt"]
    for name in foreign:
        (tmp_path / name).write_text("")
    killed = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_text() == "old"
    assert len([name for name in os.listdir(tmp_path) if name.startswith(PART)]) == 1
    with atomic_file(path) as living:  # whose part another writer, by another handle, leaves alone
        write(tmp_path / "b.txt", "b")
        assert [name for name in os.listdir(tmp_path) if name.startswith(PART)] == [living.name]
        living.write_text("a")
    assert sorted(os.listdir(tmp_path)) == sorted([*foreign, "a.txt", "b.txt"])
    assert path.read_text() == "a"


@posix
def test_a_file_system_without_locks_keeps_what_may_be_anothers(tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.files.atomic_write.lock", lambda _: None)
    other = tmp_path / f"{PART}b-12345678.txt"
    other.write_text("half")
    write(tmp_path / "a.txt", "a")
    assert sorted(os.listdir(tmp_path)) == [other.name, "a.txt"]


def test_a_new_file_replaces_none_without_force(tmp_path):
    path = tmp_path / "a.csv"
    check_new_file(path, endings=(".csv",))
    path.write_text("readings of a whole day")
    refuses(r"the file exists already\. Try: another name, or --force to replace it", check_new_file, path)
    check_new_file(path, force=True)
    refuses(r"ends in \.csv", check_new_file, tmp_path / "plan.xlsx", endings=(".csv",))
    refuses("does not exist", check_new_file, tmp_path / "nowhere" / "plan.csv")
