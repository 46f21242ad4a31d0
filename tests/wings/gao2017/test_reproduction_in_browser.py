"""The page of the reproduction in a real browser: no complaint, no network, no serious fault, dark and narrow."""

import pytest
from made_up_reproduction import made_up_results

from browser import LOOKS, check_page
from truearm.pages.html import write_page
from truearm.wings.gao2017.reproduction_page import reproduction_page


@pytest.fixture(scope="module")
def path(chromium, tmp_path_factory):  # without a browser nothing is made
    path = tmp_path_factory.mktemp("reproduction") / "page.html"
    write_page(reproduction_page(made_up_results()), path)
    return path


@pytest.mark.parametrize("looks", LOOKS)
def test_the_reproduction_keeps_what_all_pages_promise(chromium, path, looks):
    check_page(chromium, path, looks)
