"""The page about many arms: its list, its commands and what they print."""

import contextlib

import pytest

import truearm as ta
from page_transcripts import block, walk
from truearm.wings.fleet.arm_list import read_arm_list

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")


N_ARMS = 4


@pytest.fixture(scope="module")
def walked(truearm, tmp_path_factory):
    """Where the walk was walked, with the first of its twenty arms."""
    folder = tmp_path_factory.mktemp("walk")
    made, asked = block("fleet.md", "python readings"), block("fleet.md", "console fleet")
    assert (made.count("range(1, 21)"), asked.count("20 ")) == (1, 4)
    with contextlib.chdir(folder):
        exec(made.replace("range(1, 21)", f"range(1, {N_ARMS + 1})"), {})
        walk(truearm, asked.replace("20 ", f"{N_ARMS} "))
    return folder


def test_its_walk_prints_what_it_says(truearm, walked):
    assert truearm("fleet", "status", walked / "fleet", "--json").done().out.count('"in force"') == N_ARMS


@pytest.mark.weekly
def test_a_cluster_gives_the_same_models(walked, tmp_path, monkeypatch, capsys):
    """Three of the arms, from another folder, on a cluster of two workers: to the last bit."""
    pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    serial = ta.Fleet(walked / "fleet").registry.fits()
    monkeypatch.chdir(tmp_path)
    ta.Fleet.create("fleet").add_all(read_arm_list(walked / "arms.csv")[:3], beside=walked)
    capsys.readouterr()
    exec(block("fleet.md", "python cluster"), {})
    assert capsys.readouterr().out == "3 arms fitted, 0 failed; 0 arms are unchanged.\n"
    fits = ta.Fleet("fleet").registry.fits()
    assert len(fits) == 3
    assert all(row.model_sha256 == serial[key].model_sha256 for key, row in fits.items())


def test_a_failed_arm_is_the_exit_code(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("q1_deg,q2_deg\n1,2\n")
    *_, ran, status = (
        truearm("fleet", *command.split())
        for command in ("init f", "add f A ur10 --session bad.csv", "run f", "status f")
    )
    assert (ran.code, status.code) == (1, 0)
    assert "A: " in ran.out + ran.err + status.out


def test_a_group_of_commands_alone_shows_its_help(truearm):
    ran = truearm("fleet")
    assert "Commands:" in ran.out + ran.err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("fleet run .", "expected the folder of a fleet"),
        ("fleet run . --workers 2 --scheduler tcp://x:1", "expected --workers or --scheduler"),
        ("fleet add .", "expected one arm"),
        ("fleet add . A ur10 --list arms.csv", "expected one arm"),
    ],
)
def test_a_mistake_is_named(refused, command, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(command.split(), message)
