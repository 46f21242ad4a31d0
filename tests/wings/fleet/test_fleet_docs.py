"""The page about many arms: its list, its commands and what they print."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import truearm as ta
from truearm.command_line import run
from truearm.wings.fleet.arm_list import read_arm_list

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

PAGE = Path(__file__).resolve().parents[3] / "docs" / "fleet.md"


def block(name: str) -> str:
    found = re.search(
        rf"```(?:console|python) {re.escape(name)}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    assert found is not None, name
    return found[1]


def test_its_walk_prints_what_it_says_and_a_cluster_gives_the_same_models(tmp_path, monkeypatch, capsys):
    """Twenty arms one by one; three of them, from another folder, on a cluster of two workers: to the last bit."""
    pytest.importorskip("distributed", reason="Dask is an extra: pip install 'truearm[dask]'")
    monkeypatch.chdir(tmp_path)
    exec(block("readings"), {})
    for step in block("fleet").split("$ truearm ")[1:]:
        command, _, said = step.partition("\n")
        capsys.readouterr()
        with pytest.raises(SystemExit, match="0"):
            run(shlex.split(command))
        assert capsys.readouterr().out == said
    with pytest.raises(SystemExit, match="0"):
        run(["fleet", "status", "fleet", "--json"])
    assert capsys.readouterr().out.count('"in force"') == 20
    serial = ta.Fleet("fleet").registry.fits()
    few = tmp_path / "cluster"
    few.mkdir()
    monkeypatch.chdir(few)
    ta.Fleet.create("fleet").add_all(read_arm_list(tmp_path / "arms.csv")[:3], beside=tmp_path)
    exec(block("cluster"), {})
    assert capsys.readouterr().out == "3 arms fitted, 0 failed; 0 arms are unchanged.\n"
    fits = ta.Fleet("fleet").registry.fits()
    assert len(fits) == 3
    assert all(row.model_sha256 == serial[key].model_sha256 for key, row in fits.items())


def test_a_failed_arm_is_the_exit_code(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("q1_deg,q2_deg\n1,2\n")
    codes = []
    for command in ("init f", "add f A ur10 --session bad.csv", "run f", "status f"):
        with pytest.raises(SystemExit) as ended:
            run(["fleet", *command.split()])
        codes.append(ended.value.code)
    assert codes == [0, 0, 1, 0]
    assert "A: " in capsys.readouterr().out


def test_a_group_of_commands_alone_shows_its_help(capsys):
    with pytest.raises(SystemExit):
        run(["fleet"])
    assert "Commands:" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("fleet run .", "expected the folder of a fleet"),
        ("fleet run . --workers 2 --scheduler tcp://x:1", "expected --workers or --scheduler"),
        ("fleet add .", "expected one arm"),
        ("fleet add . A ur10 --list arms.csv", "expected one arm"),
    ],
)
def test_a_mistake_is_named(command, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        run(shlex.split(command))
    assert message in capsys.readouterr().err
