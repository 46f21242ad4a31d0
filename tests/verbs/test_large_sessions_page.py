"""The page about large sessions: its commands print what it says."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from truearm.command_line import run

pytest.importorskip("pyarrow", reason="Parquet is an extra: pip install 'truearm[parquet]'")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "large-sessions.md"


def block(name: str) -> str:
    found = re.search(rf"```console {name}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert found is not None, name
    return found[1]


def done(command: str) -> None:
    with pytest.raises(SystemExit, match="0"):
        run(shlex.split(command))


def test_its_walk_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert block("line").startswith("$ mkdir line\n")
    (tmp_path / "line").mkdir()
    for command in re.findall(r"^\$ truearm (.*)$", block("line"), flags=re.MULTILINE):
        done(command)
    for step in block("large").split("$ truearm ")[1:]:
        command, _, said = step.partition("\n")
        capsys.readouterr()
        done(command)
        shown = re.escape(said).replace(re.escape("...\n"), "(?s:.*)")
        assert re.fullmatch(shown, capsys.readouterr().out)
    for refused in (
        "predict large.truearm line/monday.csv --out p.csv --workers 2",
        "refit large.truearm line --out r.truearm",
    ):
        with pytest.raises(SystemExit, match="2"):
            run(shlex.split(refused))
    assert "by parts" in capsys.readouterr().err


def test_a_split_by_name_keeps_groups_together(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line").mkdir()
    for day in "ab":
        rows = "".join(f"{i},{day}{i % 5},{i}\n" for i in range(50))
        (tmp_path / "line" / f"{day}.csv").write_text(f"q1_deg,position,note\n{rows}")
    done("split line --train train.csv --test test.csv --hold-out 0.3 --seed 1")
    assert capsys.readouterr().out == "train.csv: 70 of 100 readings\ntest.csv: 30 of 100 readings\n"
    train, test = (set(re.findall(r"[ab]\d", (tmp_path / f"{part}.csv").read_text())) for part in ("train", "test"))
    assert (len(train), len(test)) == (7, 3)
    assert not train & test
    with pytest.raises(SystemExit, match="2"):
        run(shlex.split("split line --train t.csv --test u.csv --by row"))  # one stretch is no two groups
    assert not (tmp_path / "t.csv").exists()
