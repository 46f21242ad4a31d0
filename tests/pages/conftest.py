"""What tests of pages share."""

import pytest

from made_up_page import made_up_page
from truearm.pages.html import render


@pytest.fixture(scope="session")
def html() -> str:
    """A page with every kind of figure."""
    return render(made_up_page())
