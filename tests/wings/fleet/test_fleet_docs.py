"""The page about many arms: its list, its commands and what they print."""

import pytest

import truearm as ta
from page_transcripts import block, walk
from truearm.wings.fleet.arm_list import read_arm_list

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")


def test_its_walk_prints_what_it_says_and_a_cluster_gives_the_same_models(truearm, tmp_path, monkeypatch, capsys):
    """Twenty arms one by one; three of them, from another folder, on a cluster of two workers: to the last bit."""
    pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    monkeypatch.chdir(tmp_path)
    exec(block("fleet.md", "python readings"), {})
    walk(truearm, block("fleet.md", "console fleet"))
    assert truearm("fleet", "status", "fleet", "--json").done().out.count('"in force"') == 20
    serial = ta.Fleet("fleet").registry.fits()
    few = tmp_path / "cluster"
    few.mkdir()
    monkeypatch.chdir(few)
    ta.Fleet.create("fleet").add_all(read_arm_list(tmp_path / "arms.csv")[:3], beside=tmp_path)
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
