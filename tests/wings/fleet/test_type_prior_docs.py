"""The page about types: twenty arms, their prior, and the next arm."""

import re
import shlex

import pytest

from page_transcripts import NUMBER, block

pytest.importorskip("sqlalchemy", reason="a fleet is an extra: pip install 'truearm[fleet]'")

LOOP = re.compile(r"for i in \$\(seq (\d+)\); do (.*); done")


def unrolled(line, n_arms):
    """The commands of a line of the shell; models of the fleet are nominal, on which its prior does not depend."""
    if (loop := LOOP.fullmatch(line)) is None:
        return [line]
    body = loop[2].replace("--model kinematic", "--model nominal")  # a fifth of the time
    return [one.replace("$i", f"{i}") for i in range(1, min(int(loop[1]), n_arms) + 1) for one in body.split("; ")]


@pytest.mark.parametrize("n_arms", [4, pytest.param(20, marks=pytest.mark.weekly)])
def test_its_walk_prints_what_it_says(truearm, tmp_path, monkeypatch, n_arms):
    """With fewer arms the same words with other numbers, and the prior helps as well."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "as-built.toml").write_text(block("type-prior.md", "toml as-built.toml"), encoding="utf-8")
    text = block("type-prior.md", "console fleet") + block("type-prior.md", "console next")
    for step in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        line, _, said = step.partition("\n")
        printed = "".join(truearm(*shlex.split(one)[1:]).done().out for one in unrolled(line, n_arms))
        said = said.removesuffix("...\n")
        if n_arms == 20:
            assert printed.startswith(said)
        else:
            assert NUMBER.sub("#", printed).startswith(NUMBER.sub("#", said))


def test_a_prior_without_gain_is_not_written(truearm, tmp_path, monkeypatch):
    """Arms that follow their drawing, each with errors of its own."""
    monkeypatch.chdir(tmp_path)
    lines = ["fleet init f"]
    for i in range(3):
        lines.append(f"simulate ur10 --strategy uniform --poses 20 --arm-seed {i} --seed {i} --out {i}.csv")
        lines.append(f"fleet add f virtual-research-{i} ur10 --session {i}.csv --model nominal")
    for line in [*lines, "fleet run f"]:
        truearm(*line.split()).done()
    ran = truearm("fleet", "prior", "f", "--out", "p.toml")
    assert ran.code == 1
    assert ran.out.startswith("No gain: what 3 arms of type ur10 have in common does not help")
    assert not (tmp_path / "p.toml").exists()
