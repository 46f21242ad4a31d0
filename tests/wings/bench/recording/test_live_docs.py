"""The page about connected arms: its commands print what it says, its files can be read."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest

from truearm.command_line import run
from truearm.files.toml_documents import parse_toml
from truearm.wings.bench.sources.line_pattern import LinesDocument, line_parser
from truearm.wings.bench.sources.mqtt import MqttDocument, decoded
from truearm.wings.bench.sources.ros2 import Ros2Document
from truearm.wings.bench.sources.source_names import KINDS

PAGE = Path(__file__).resolve().parents[4] / "docs" / "live.md"


def block(name: str) -> str:
    found = re.search(rf"```(?:console|toml) {re.escape(name)}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None, name
    return found[1]


def test_its_commands_print_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for step in (block("record") + block("try")).split("$ truearm ")[1:]:
        command, _, said = step.partition("\n")
        reading, writing = os.pipe()
        os.close(writing)
        with os.fdopen(reading) as nothing, monkeypatch.context() as patched:
            patched.setattr("sys.stdin", nothing)
            with pytest.raises(SystemExit, match="0"):
                run(shlex.split(command))
        out = capsys.readouterr().out
        if said:
            assert re.fullmatch(re.escape(said).replace(re.escape("..."), "(?s:.*?)"), out), out


def test_its_files_can_be_read():
    document = parse_toml(block("lines.toml").encode(), LinesDocument)
    parse, n_joints = line_parser(document)
    assert n_joints == 3
    comment = block("lines.toml").splitlines()[0].removeprefix("# ")
    assert parse(comment, 0.0).temperature_degC == 21.5
    parse, _ = line_parser(parse_toml(block("tracker.toml").encode(), LinesDocument))
    assert parse("P1;1;2;3;;", 0.0).tip_in_reference_mm.tolist() == [1, 2, 3]
    assert len(parse_toml(block("ros2.toml").encode(), Ros2Document).joints) == 6
    document = parse_toml(block("mqtt.toml").encode(), MqttDocument)
    message = block("mqtt.toml").splitlines()[0].removeprefix("# ").encode()
    assert decoded(document, document.decoder(3), message, 0.0).temperature_degC == 21.5


def test_its_table_has_every_source():
    named = set(re.findall(r"^\| `([a-z0-9]+):", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert named == {kind.name for kind in KINDS}
