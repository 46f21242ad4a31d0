"""Pages of the standards in a real browser: no complaint, and no serious fault for keyboard and screen reader."""

import pytest
from test_operator_sheet import sheet_of
from test_verification_page import outcome, row

from browser import Tab
from truearm.pages.html import write_page
from truearm.wings.laboratory.pages.operator_sheet import operator_sheet_page
from truearm.wings.laboratory.pages.verification_page import verification_page
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan

PAGES = {
    "sheet": lambda: operator_sheet_page(sheet_of(load_verification_plan("asme-b89.4.22"))),
    "verification": lambda: verification_page(outcome([row(0.01), row(0.07, label="E_Bi, 900")])),
}


@pytest.mark.parametrize(("name", "scheme"), [("sheet", "light"), ("verification", "dark")])
def test_a_page_of_a_standard_has_no_serious_fault(chromium, tmp_path, name, scheme):
    write_page(PAGES[name](), tmp_path / "page.html")
    with Tab(chromium, tmp_path / "page.html", scheme=scheme) as tab:
        tab.page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        assert tab.faults() == []
        assert tab.complaints == []
