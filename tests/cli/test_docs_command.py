"""`truearm docs`: the guide's pages come with the program."""

from __future__ import annotations

from pathlib import Path

import pytest

from truearm.cli.docs import guide_pages, rendered_page

CHECKOUT = Path(__file__).resolve().parents[2]


def test_docs_lists_every_page_of_the_guide(truearm):
    ran = truearm("docs")
    assert ran.code == 0
    listed = {line.split()[0] for line in ran.out.splitlines()[1:]}
    assert listed == set(guide_pages())
    assert {"session-file", "arm-file", "glossary", "start/technician"} <= listed


@pytest.mark.parametrize("topic", ["arm-file", "arm-file.md", "docs/arm-file.md"])
def test_docs_prints_a_page_by_the_name_that_messages_give(truearm, topic):
    ran = truearm("docs", topic)
    assert ran.code == 0
    assert ran.out.startswith("# The arm file\n")


def test_docs_refuses_an_unknown_topic_and_names_the_nearest(truearm):
    ran = truearm("docs", "file")
    assert (ran.code, ran.out) == (2, "")
    assert "session-file" in ran.err


def test_a_page_is_rendered_for_the_browser():
    page = rendered_page(guide_pages()["glossary"])
    assert "Glossary" in page.read_text(encoding="utf-8")


def test_every_page_that_a_message_names_is_in_the_guide():
    import re

    import truearm

    house = Path(truearm.__file__).parent
    named = {
        found for path in house.rglob("*.py") for found in re.findall(r"docs/([a-z0-9-]+)\.md", path.read_text("utf-8"))
    }
    assert named <= set(guide_pages())
