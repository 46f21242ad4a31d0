"""The page about many arms: its list, its commands and what they print."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from truearm.cli.main import run

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "fleet.md"


def block(name: str) -> str:
    found = re.search(
        rf"```(?:console |csv ){re.escape(name)}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    assert found is not None, name
    return found[1]


def test_its_walk_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arms.csv").write_text(block("arms.csv"), encoding="utf-8")
    for command in re.findall(r"^\$ truearm (.*)$", block("list"), flags=re.MULTILINE):
        with pytest.raises(SystemExit, match="0"):
            run(shlex.split(command))
    for step in block("fleet").split("$ truearm ")[1:]:
        command, _, said = step.partition("\n")
        capsys.readouterr()
        with pytest.raises(SystemExit, match="0"):
            run(shlex.split(command))
        assert capsys.readouterr().out == said
    with pytest.raises(SystemExit, match="0"):
        run(["fleet", "status", "fleet", "--json"])
    assert '"in force"' in capsys.readouterr().out


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
        ("fleet add . A", "expected one arm"),
        ("fleet add . A ur10 --list arms.csv", "expected one arm"),
    ],
)
def test_a_mistake_is_named(command, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        run(shlex.split(command))
    assert message in capsys.readouterr().err
