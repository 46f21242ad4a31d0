"""`truearm docs`: the guide's pages come with the program."""

import re
from pathlib import Path

import pytest

from truearm.wings.reports.docs_command import guide_pages, rendered_page

CHECKOUT = Path(__file__).resolve().parents[3]


def test_docs_lists_every_page_of_the_guide(truearm):
    ran = truearm("docs").done()
    *lines, how = ran.out.splitlines()[1:]
    listed = {line.split()[0] for line in lines}
    assert how.startswith("truearm docs TOPIC prints a page; truearm docs guide ")
    assert listed == set(guide_pages())
    assert {"session-file", "arm-file", "glossary", "start/technician"} <= listed


def test_the_table_of_the_guide_and_the_side_bar_have_every_page():
    made_by_the_build = {"api", "commands", "papers"}
    pages = {path.stem for path in (CHECKOUT / "docs").glob("*.md")} - made_by_the_build
    entrances = {"index", "guide", "files", "reference"}
    text = {name: (CHECKOUT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in entrances}
    table = set(re.findall(r"\]\(([a-z0-9-]+)\.md", text["guide"]))
    assert pages - entrances - table == {"changelog"}
    trees = "\n".join(re.findall(r"```\{toctree\}\n(.*?)```", "\n".join(text.values()), flags=re.DOTALL))
    assert pages - {"index"} <= set(trees.split())


@pytest.mark.parametrize("topic", ["arm-file", "arm-file.md", "docs/arm-file.md"])
def test_docs_prints_a_page_by_the_name_that_messages_give(truearm, topic):
    assert truearm("docs", topic).done().out.startswith("# The arm file\n")


def test_docs_prints_the_front_page_without_the_layout_of_the_site(truearm):
    ran = truearm("docs", "guide").done()
    assert ran.out.startswith("# Guide\n")
    assert "| identify the arm |" in ran.out
    assert "toctree" not in ran.out


def test_docs_refuses_an_unknown_topic_and_names_the_nearest(truearm):
    assert "session-file" in truearm("docs", "file").refused().err


def test_a_page_is_rendered_for_the_browser():
    page = rendered_page(guide_pages()["glossary"])
    assert "Glossary" in page.read_text(encoding="utf-8")


def test_every_page_that_a_message_names_is_in_the_guide():
    import truearm

    house = Path(truearm.__file__).parent
    named = {
        found for path in house.rglob("*.py") for found in re.findall(r"docs/([a-z0-9-]+)\.md", path.read_text("utf-8"))
    }
    assert named <= set(guide_pages())


def test_a_page_is_run_in_a_folder_with_the_files_that_it_shows(truearm, tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text(
        "```csv a.csv\n1\n```\n\n```console\n$ truearm arms ur5 \\\n  --out arm.toml\nmore\n```\n\n```toml one\n```\n"
    )
    monkeypatch.setattr("truearm.wings.reports.docs_command.guide_pages", lambda: {"page": page})
    ran = truearm("docs", "page", "--run", str(tmp_path / "new" / "folder")).done()
    assert ran.out.startswith("$ truearm arms ur5 --out arm.toml\narm.toml: ur5, 6 joints")
    assert {path.name for path in (tmp_path / "new" / "folder").iterdir()} == {"a.csv", "arm.toml"}
    assert "a.csv exists already" in truearm("docs", "page", "--run", str(tmp_path / "new" / "folder")).refused().err


def test_a_page_whose_command_fails_stops_there_and_one_without_commands_is_refused(truearm, tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("```console\n$ truearm arms nosuch.toml\n$ truearm arms\n```\n")
    monkeypatch.setattr("truearm.wings.reports.docs_command.guide_pages", lambda: {"page": page})
    ran = truearm("docs", "page", "--run", str(tmp_path))
    assert ran.code == 2
    assert "nosuch.toml" in ran.err
    assert ran.out == "$ truearm arms nosuch.toml\n"
    page.write_text("# A page\n")
    assert "has no commands that run as they stand" in truearm("docs", "page", "--run", str(tmp_path)).err
