"""The page about types: twenty arms, their prior, and the next arm."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from truearm.command_line import run

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

PAGE = Path(__file__).resolve().parents[3] / "docs" / "type-prior.md"
LOOP = re.compile(r"for i in \$\(seq (\d+)\); do (.*); done")


def block(name: str) -> str:
    found = re.search(
        rf"```(?:console |toml ){re.escape(name)}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    assert found is not None, name
    return found[1]


def commands(line):
    """The commands of a line of the shell; models of the fleet are nominal, on which its prior does not depend."""
    if (loop := LOOP.fullmatch(line)) is None:
        return [line]
    body = loop[2].replace("--model kinematic", "--model nominal")  # a fifth of the time
    return [one.replace("$i", f"{i}") for i in range(1, int(loop[1]) + 1) for one in body.split("; ")]


def test_its_walk_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "as-built.toml").write_text(block("as-built.toml"), encoding="utf-8")
    for step in re.split(r"^\$ ", block("fleet") + block("next"), flags=re.MULTILINE)[1:]:
        line, _, said = step.partition("\n")
        capsys.readouterr()
        for one in commands(line):
            with pytest.raises(SystemExit, match="0"):
                run(shlex.split(one.removeprefix("truearm ")))
        if said:
            assert capsys.readouterr().out.startswith(said.removesuffix("...\n"))


def test_a_prior_without_gain_is_not_written(tmp_path, monkeypatch, capsys):
    """Arms that follow their drawing, each with errors of its own."""
    monkeypatch.chdir(tmp_path)
    lines = ["init f"]
    for i in range(3):
        simulated = f"simulate ur10 --strategy uniform --poses 20 --arm-seed {i} --seed {i} --out {i}.csv"
        with pytest.raises(SystemExit, match="0"):
            run(shlex.split(simulated))
        lines.append(f"add f virtual-research-{i} ur10 --session {i}.csv --model nominal")
    for line in [*lines, "run f"]:
        with pytest.raises(SystemExit, match="0"):
            run(["fleet", *line.split()])
    capsys.readouterr()
    with pytest.raises(SystemExit, match="1"):
        run(["fleet", "prior", "f", "--out", "p.toml"])
    assert capsys.readouterr().out.startswith("No gain: what 3 arms of type ur10 have in common does not help")
    assert not (tmp_path / "p.toml").exists()
