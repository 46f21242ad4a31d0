"""The page about connected arms: its commands print what it says, its files can be read."""

import os
import re

from page_transcripts import DOCS, block, walk
from truearm.files.toml_documents import parse_toml
from truearm.wings.bench.sources.line_pattern import LinesDocument, line_parser
from truearm.wings.bench.sources.mqtt import MqttDocument, decoded
from truearm.wings.bench.sources.ros2 import Ros2Document
from truearm.wings.bench.sources.source_names import KINDS


def toml(name):
    return block("live.md", f"toml {name}.toml")


def test_its_commands_print_what_it_says(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    reading, writing = os.pipe()
    os.close(writing)
    with os.fdopen(reading) as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        walk(truearm, block("live.md", "console record") + block("live.md", "console try"))


def test_its_files_can_be_read():
    document = parse_toml(toml("lines").encode(), LinesDocument)
    parse, n_joints = line_parser(document)
    assert n_joints == 3
    comment = toml("lines").splitlines()[0].removeprefix("# ")
    assert parse(comment, 0.0).temperature_degC == 21.5
    parse, _ = line_parser(parse_toml(toml("tracker").encode(), LinesDocument))
    assert parse("P1;1;2;3;;", 0.0).tip_in_reference_mm.tolist() == [1, 2, 3]
    assert len(parse_toml(toml("ros2").encode(), Ros2Document).joints) == 6
    document = parse_toml(toml("mqtt").encode(), MqttDocument)
    message = toml("mqtt").splitlines()[0].removeprefix("# ").encode()
    assert decoded(document, document.decoder(3), message, 0.0).temperature_degC == 21.5


def test_its_table_has_every_source():
    named = set(re.findall(r"^\| `([a-z0-9]+):", (DOCS / "live.md").read_text(encoding="utf-8"), re.MULTILINE))
    assert named == {kind.name for kind in KINDS}
