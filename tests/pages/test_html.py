"""The page stands alone, is well formed, escapes what others wrote, and is the same each time."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from html_outline import HOSTILE, Outline
from made_up_page import made_up_page
from refusals import refuses
from truearm.pages.drawings import error_figures as figures
from truearm.pages.drawings import joint_figures
from truearm.pages.drawings.workspace_figures import error_in_workspace
from truearm.pages.html import paragraphs, render, with_places, write_page
from truearm.pages.page import Column, LabelledValue, Page, PageVerdict, Section, Table


def test_the_page_is_well_formed_and_holds_all_it_was_given(html):
    outline = Outline(html)
    assert outline.tags.count("figure") == len(outline.labels) == 8
    assert all(len(label) > 40 for label in outline.labels)
    assert outline.tags.count("table") == 2
    assert outline.tags.count("h1") == 1
    assert "script" not in outline.tags
    for text in ("One.", "Two.", "Error of each model", "data fingerprint", "virtual", "limit 0.05 mm"):
        assert text in html


def test_ids_are_unique_and_every_inner_link_has_its_target(html):
    outline = Outline(html)
    assert len(outline.ids) == len(set(outline.ids))
    inner = [link[1:] for link in outline.links if link.startswith("#")]
    assert len(inner) > 100  # dots are drawn by reference
    named = re.findall(r"url\(#([^)]+)\)", html) + re.findall(r'aria-labelledby="([^"]+)"', html)
    assert set(inner + named) <= set(outline.ids)


def test_the_page_needs_nothing_from_outside(html):
    outline = Outline(html)
    assert all(link.startswith(("#", "data:")) for link in outline.links)
    assert "default-src 'none'" in html
    assert not re.search(r"https?://|@import|<!--|file:", html)


def test_every_number_column_states_its_unit_and_lines_up(html):
    heads = re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", html)
    assert 'mean <span class="unit">[mm]</span>' in heads
    cells = re.findall(r'<span class="n">([^<]*)<span class="fraction" style="min-width:(\d+)ch">([^<]*)</span>', html)
    assert ("0", "7") not in {(whole, room) for whole, room, _ in cells}
    assert all(len(fraction) <= int(room) for _, room, fraction in cells)
    assert ("20", "3", ".31") in cells  # 20.31 °C with u = 0.12 °C


def test_columns_of_a_group_stand_under_one_head_with_their_unit():
    table = Table(
        (
            Column("row"),
            Column("paper", "mm", group="mean error"),
            Column("ours", "mm", group="mean error"),
            Column("paper", "s", group="time"),
            Column("ours", "s", group="time"),
            Column("verdict"),
        ),
        ((1, 8.5, 8.25, 124.0, 2.0, "reproduced"),),
        "t",
    )
    html = render(Page("P", sections=(Section("S", tables=(table,)),)))
    first, second = re.findall(r"<tr[^>]*>(.*?)</tr>", html.partition("</thead>")[0], flags=re.DOTALL)
    spans = [int(span) for span in re.findall(r'<th scope="colgroup" colspan="(\d+)"', first)]
    assert spans == [2, 2]
    assert sum(spans) + first.count("<td></td>") == second.count("<th ") == 6
    assert 'mean error <span class="unit">[mm]</span>' in first
    assert "unit" not in second


def test_the_same_page_has_the_same_bytes_in_another_process(html, tmp_path):
    # Another process has another seed of hashes, which must not show.
    code = "import made_up_page as m, truearm.pages.html as h, sys; h.write_page(m.made_up_page(), sys.argv[1])"
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parent), *filter(None, sys.path)])
    subprocess.run(
        [sys.executable, "-B", "-c", code, str(tmp_path / "page.html")],
        check=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == html


def test_a_page_of_12000_readings_stays_small():
    # 3 MB is what a mail still takes; dots by the thousand are pictures, not elements.
    assert len(render(made_up_page(12000)).encode()) < 3_000_000


def test_what_others_wrote_is_text_and_not_markup():
    lengths = {HOSTILE: np.linspace(0.1, 1, 20)}
    page = Page(
        HOSTILE,
        HOSTILE,
        summary=(LabelledValue(HOSTILE, HOSTILE, HOSTILE),),
        sections=(
            Section(
                HOSTILE,
                HOSTILE,
                (LabelledValue(HOSTILE, 1.0, HOSTILE),),
                (
                    figures.before_after(lengths),
                    joint_figures.joint_ranges(np.ones((3, 1)), names=[HOSTILE]),
                    error_in_workspace(np.ones((20, 3)), lengths[HOSTILE], name='" onload="x'),
                ),
                (Table((Column(HOSTILE, HOSTILE),), ((HOSTILE,),), HOSTILE),),
            ),
        ),
        facts=((HOSTILE, HOSTILE),),
    )
    html = render(page)
    assert "script" not in Outline(html).tags
    assert html.count("&lt;script&gt;") > 10


def test_names_with_control_signs_make_a_page_that_can_be_written(tmp_path):
    page = Page("a\x00b\ud800c\x1b\u202ed")
    write_page(page, tmp_path / "page.html")
    assert r"a\x00b\ud800c\x1b\u202ed" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_an_empty_page_is_a_page():
    html = render(
        Page("Nothing yet", sections=(Section("Empty"), Section("T", tables=(Table((Column("a"),), (), "no rows"),))))
    )
    assert Outline(html).tags.count("table") == 1


def test_paragraphs_part_at_empty_lines():
    assert paragraphs("one\ntwo\n\n\nthree\r\n\r\nfour") == ["one two", "three", "four"]
    assert paragraphs("  ") == []
    assert paragraphs("0.45\u202fmm\n and  5\u00a0%") == ["0.45\u202fmm and 5\u00a0%"]  # they stay on one line


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: LabelledValue("x", float("nan")), "row 'x', got nan. Try: use None for no value"),
        (lambda: LabelledValue("x", 1.0, uncertainty=float("inf")), "uncertainty of row 'x', got inf"),
        (lambda: LabelledValue("x", 1.0, limit=float("nan")), "limit of row 'x', got nan"),
        (lambda: LabelledValue("x", [1.0]), r"row 'x', got \[1.0\]"),
        (lambda: Table((Column("a"), Column("b")), ((1,),), "t"), "2 cells in row 1 of the table 't', got 1"),
        (
            lambda: Table((Column("mean"),), ((1.0,), (np.inf,)), "t"),
            "column 'mean': .* row 2 of the table 't', got inf",
        ),
    ],
)
def test_what_a_page_cannot_hold_is_refused(make, told):
    refuses(told, make)


def test_the_page_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    target = tmp_path / "page.html"
    write_page(Page("first"), target)
    refuses("does not exist", write_page, Page("second"), tmp_path / "none" / "page.html")
    broken = Page("second", sections=(Section("S", figures=(object(),)),))
    with pytest.raises(Exception, match="no attribute"):
        write_page(broken, target)
    assert "first" in target.read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


# Verdicts and folded parts -------------------------------------------------------------------------------------------


def test_a_verdict_is_the_first_text_of_the_page_in_words_with_a_sign_and_escaped():
    verdict = PageVerdict(f"Not conform {HOSTILE}", "bad", f"Measure again {HOSTILE}")
    html = render(Page("Title", verdict=verdict, sections=(Section("S", verdict=PageVerdict("It fits.", "good")),)))
    body = re.sub(r"<[^>]+>", " ", html.partition("<body>")[2])
    assert body.split()[:2] == ["Not", "conform"]
    assert "script" not in Outline(html).tags
    assert html.count("&lt;script&gt;") == 2
    # A sign that differs in shape, and a word for those who do not see it.
    signs = re.findall(r'<svg class="sign (\w+)" viewBox="0 0 24 24" role="img" aria-label="(\w+)">(.*?)</svg>', html)
    assert [sign[:2] for sign in signs] == [("bad", "bad"), ("good", "good")]
    assert signs[0][2] != signs[1][2]


@pytest.mark.parametrize("state", ["good", "doubtful", "bad", "none"])
def test_every_state_marks_verdicts_key_numbers_and_rows(state):
    table = Table((Column("a"),), (("x",), ("y",)), "t", states=(state, "none"))
    page = Page(
        "P",
        verdict=PageVerdict("In words.", state),
        summary=(LabelledValue("n", 1, state=state),),
        sections=(Section("S", tables=(table,), rows=(LabelledValue("m", 2, state=state),)),),
    )
    html = render(page)
    assert f'<div class="verdict {state}">' in html
    assert html.count('<svg class="sign') == (0 if state == "none" else 4)
    assert html.count(f'<tr class="{state}">') == (0 if state == "none" else 2)


def test_folded_tables_show_the_first_sentence_of_their_caption_and_keep_the_rest():
    table = Table((Column("a"),), ((1,),), "Table 2, effort. Medians of the starts.", folded=True)
    html = render(Page("P", sections=(Section("S", tables=(table,)),), facts=(("versions", "1"),)))
    assert re.search(r"<summary[^>]*>Table 2, effort</summary>\s*<p class=\"caption\">Medians of the starts.</p>", html)
    assert Outline(html).tags.count("details") == 2  # and the data and settings
    assert "details::details-content { display: block;" in html  # on paper they are open


def test_a_table_without_headings_has_no_head():
    html = render(Page("P", sections=(Section("S", tables=(Table((Column(""),) * 2, (("arm", ""),), ""),)),)))
    assert "<thead>" not in html
    assert '<th scope="row">arm</th>' in html


def test_single_panels_stand_beside_their_text_or_their_neighbour(html):
    (single,) = (figures.before_after({"a": np.linspace(0.1, 1, 20)}),)
    text = Page("P", sections=(Section("S", "A short text.", figures=(single,)),))
    assert '<div class="beside">' in render(text)
    assert '<div class="beside">' not in render(Page("P", sections=(Section("S", "word " * 300, figures=(single,)),)))
    assert [place for _, place in with_places((single, single))] == ["half", "half"]
    wide = replace(single, columns=2)
    assert [place for _, place in with_places((single, wide, single))] == ["alone", "full", "alone"]
    assert "max-width:644px" in html  # 4.6 inches
