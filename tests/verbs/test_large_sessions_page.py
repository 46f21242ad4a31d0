"""The page about large sessions: its commands print what it says."""

import re

import pytest

from page_transcripts import block, walk

pytest.importorskip("pyarrow", reason="Parquet is an extra: pip install 'truearm[parquet]'")


def test_its_walk_prints_what_it_says(truearm, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, _, line = block("large-sessions.md", "console line").partition("\n")
    assert first == "$ mkdir line"
    (tmp_path / "line").mkdir()
    walk(truearm, line)
    walk(truearm, block("large-sessions.md", "console large"))
    refused(["predict", "large.truearm", "line/monday.csv", "--out", "p.csv", "--workers", 2], "to large sessions only")
    refused(["refit", "large.truearm", "line", "--out", "r.truearm"], "by parts")


def test_a_split_by_name_keeps_groups_together(truearm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line").mkdir()
    for day in "ab":
        rows = "".join(f"{i},{day}{i % 5},{i}\n" for i in range(50))
        (tmp_path / "line" / f"{day}.csv").write_text(f"q1_deg,position,note\n{rows}")
    split = ("split", "line", "--train")
    ran = truearm(*split, "train.csv", "--test", "test.csv", "--hold-out", 0.3, "--seed", 1).done()
    assert ran.out == "train.csv: 70 of 100 readings\ntest.csv: 30 of 100 readings\n"
    train, test = (set(re.findall(r"[ab]\d", (tmp_path / f"{part}.csv").read_text())) for part in ("train", "test"))
    assert (len(train), len(test)) == (7, 3)
    assert not train & test
    truearm(*split, "t.csv", "--test", "u.csv", "--by", "row").refused()  # one stretch is no two groups
    assert not (tmp_path / "t.csv").exists()
