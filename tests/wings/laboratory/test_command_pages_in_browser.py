"""Every page that a command writes, in a real browser: no complaint, no network, no serious fault, dark and narrow."""

import os

import pytest
from made_up_certificate import ABOUT, CONFIRMED_PLAN
from made_up_check import LENGTHS, write_days, write_model
from made_up_verification import ARTEFACTS, MPE, Made

from browser import LOOKS, check_page

VERIFIED = "--test-plan plan.toml --measured points.csv --artefacts artefacts.toml --mpe mpe.toml".split()  # noqa: SIM905
COMMANDS = {
    "arm": ["arms", "measuring7", "--page", "arm.html"],
    "plan": ["plan", "measuring7", "--artefact", "bar", "--bar", 500, "--poses", 12, "--out", "p.csv",
             "--page", "plan.html"],
    "report": ["report", "nominal.truearm", "kinematic.truearm", "test.csv", "--page", "report.html"],
    "sheet": ["verify", "sheet", "iso10360-12", "--page", "sheet.html", *VERIFIED[4:]],
    "verification": ["verify", *VERIFIED, "--page", "verification.html"],
    "certificate": ["certificate", *VERIFIED, "--about", "about.toml", "--out", "c.xml", "--page", "certificate.html"],
    "check": ["check", "arm.truearm", "day01.csv", "--lengths", "bar.csv", "--history", "h.sqlite",
              "--page", "check.html"],
    "task": ["task", "shop", "--feature", "sphere", "--diameter", 25, "--arms", 100, "--page", "task.html"],
}  # fmt: skip
WITH_VIEW = {"arm", "plan", "report", "verification", "check", "task"}


@pytest.fixture(scope="module")
def folder(chromium, truearm, made, quick_plans, tmp_path_factory):  # without a browser nothing is made
    """A folder with the page of each command, by its name."""
    made_in, before = tmp_path_factory.mktemp("pages"), os.getcwd()
    texts = {
        "points.csv": Made(too_large=60e-6).iso().text("10017"),
        "artefacts.toml": ARTEFACTS,
        "mpe.toml": MPE,
        "about.toml": ABOUT,
        "plan.toml": CONFIRMED_PLAN,
        "bar.csv": LENGTHS,
    }
    for name, text in texts.items():
        (made_in / name).write_text(text, encoding="utf-8")
    write_days(made_in, [0.0])
    write_model(made_in)
    os.chdir(made_in)
    try:
        for arguments in COMMANDS.values():
            given = [
                made / one if one in ("nominal.truearm", "kinematic.truearm", "test.csv") else one for one in arguments
            ]
            ran = truearm(*given)
            assert ran.err == "", ran
    finally:
        os.chdir(before)
    return made_in


@pytest.mark.parametrize("looks", LOOKS)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_keeps_what_all_pages_promise(chromium, folder, name, looks):
    page = folder / f"{name}.html"
    assert ('class="scene"' in page.read_text(encoding="utf-8")) == (name in WITH_VIEW)
    check_page(chromium, page, looks)
