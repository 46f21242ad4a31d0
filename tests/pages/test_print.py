"""The pages on paper: the rules for it, and what a browser makes of them as PDF."""

import re

from browser import printed
from made_up_page import made_up_page
from truearm.pages.html import render
from truearm.pages.page import Column, Page, Section, Table


def paper_rules():
    html = render(Page("a page"))
    style = html[html.index("<style>") : html.index("</style>")]
    page, _, rest = style[style.index("@page") :].partition("@media print")
    return re.sub(r"\s+", " ", page), re.sub(r"\s+", " ", rest)


def test_every_page_brings_its_rules_for_paper():
    page, rules = paper_rules()
    assert "size: A4" in page
    assert 'counter(page) " / " counter(pages)' in page
    assert "thead { display: table-header-group; }" in rules  # heads are repeated
    assert re.search(r"figure, tr[^}]*break-inside: avoid", rules)  # nothing is cut in two
    assert re.search(r"\.caption, thead \{ break-after: avoid", rules)
    assert re.search(r"h2[^}]*break-after: avoid", rules)
    assert "print-color-adjust: exact" in rules
    assert "overflow: visible" in rules  # a table is not cut where a screen would scroll
    assert "nav { display: none; }" in rules  # links into the page lead nowhere on paper


def test_a_long_table_goes_over_pages_with_its_head_and_loses_no_row(chromium, tmp_path):
    rows = tuple((f"point number {i}", 1.5 * i) for i in range(1, 101))
    table = Table((Column("what was touched"), Column("height", "mm")), rows, "Every point.")
    sheets = printed(chromium, Page("a long table", sections=(Section("Points", tables=(table,)),)), tmp_path)
    assert len(sheets) == 3
    assert [sheet.count("what was touched") for sheet in sheets] == [1, 1, 1]
    assert [f"{i}/3" in sheet.replace(" ", "") for i, sheet in enumerate(sheets, start=1)] == [True] * 3
    told = [int(number) for sheet in sheets for number in re.findall(r"point number (\d+)", sheet)]
    assert told == list(range(1, 101))


def test_headings_and_captions_stay_with_what_they_belong_to(chromium, tmp_path):
    tables = tuple(
        Table((Column("name"), Column("value")), tuple((f"value {k}.{i}", i) for i in range(9)), f"Caption {k}.")
        for k in range(12)
    )
    sections = tuple(Section(f"Chapter {k}", f"About chapter {k}.", tables=(table,)) for k, table in enumerate(tables))
    sheets = printed(chromium, Page("chapters", sections=sections), tmp_path)
    assert len(sheets) > 2
    for k in range(12):
        (sheet,) = [sheet for sheet in sheets if f"Chapter {k}\n" in sheet]
        for part in (f"About chapter {k}.", f"Caption {k}.", *(f"value {k}.{i}" for i in range(9))):
            assert part in sheet, (k, part)


def test_a_report_with_figures_prints(chromium, tmp_path):
    sheets = printed(chromium, made_up_page(60), tmp_path)
    assert 3 <= len(sheets) <= 7
    assert all(sheet.strip() for sheet in sheets)
