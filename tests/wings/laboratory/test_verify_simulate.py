"""``truearm verify`` before anything is measured: what virtual arms would pass, and the plan to edit."""

import json
import re

import pytest
from made_up_verification import ARTEFACTS, MPE

from page_transcripts import block
from truearm.wings.laboratory.standards.verification_plan import PLANS, plan_text

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.mark.parametrize("name", PLANS)
def test_a_plan_is_printed_to_edit(truearm, tmp_path, name):
    ran = truearm("verify", "plan", name).done()
    assert ran.out == plan_text(name)
    mine = tmp_path / "mine.toml"
    mine.write_text(ran.out.replace("value = 3", "value = 1"))
    ran = truearm("verify", "simulate", "perfect", "--test-plan", mine, "--arms", 1).done()


def test_perfect_arms_conform_and_research_arms_do_not(truearm):
    for preset, share in (("perfect", 1.0), ("research", 0.0)):
        ran = truearm("verify", "simulate", preset, "--arms", 2, "--json")
        found = json.loads(ran.out)
        assert (ran.code, ran.err) == (0, "")
        assert found["all"]["conform"] == share
        assert (found["arm"], found["arms"], found["artefacts"]) == ("measuring7", 2, "example")
        assert [row["label"] for row in found["rows"]][:2] == ["P_Size.Sph.1x25", "P_Form.Sph.1x25"]


def test_files_of_ones_own_are_used(truearm, tmp_path):
    artefacts, mpe = tmp_path / "artefacts.toml", tmp_path / "mpe.toml"
    artefacts.write_text(ARTEFACTS)
    mpe.write_text(MPE)
    common = ["verify", "simulate", "shop", "--arm", "gao2017", "--artefacts", artefacts, "--mpe", mpe, "--arms", 2]
    found = json.loads(truearm(*common, "--json").out)
    limits = {row["label"]: row["limit"] for row in found["rows"]}
    assert limits["P_Size.Sph.1x25"] == 0.015
    assert limits["E_Uni, 1700"] == pytest.approx(0.03625, abs=1e-6)
    assert (found["specification"], found["arm"]) == ("measuring arm 2.5 m", "gao2017")
    assert json.loads(truearm(*common, "--json").out) == found
    assert json.loads(truearm(*common, "--seed", 1, "--json").out)["rows"] != found["rows"]
    told = truearm(*common).out
    assert "of 2 virtual arms gao2017 (the preset shop) conform" in told
    assert "examples" not in told
    assert "check against your copy of the standard" in told


def test_a_model_takes_the_test_too(truearm, refused, made):
    """Far outside the box of its training a model errs as the nominal arm may, by millimetres, and by something."""
    found = json.loads(truearm("verify", "simulate", made / "kinematic.truearm", "--arms", 3, "--json").out)
    assert found["arm"] == "gao2017"
    assert all(0 < row["median"] < 3 for row in found["rows"])
    refused(["verify", "simulate", made / "network.truearm", "--arms", 3], "a network has no terms")


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        ([], "expected --measured, --test-plan, --artefacts, --mpe"),
        (["--measured", "points.csv"], "expected --test-plan, --artefacts, --mpe"),
        (
            ["--measured", "points.csv", "simulate", "shop"],
            "--measured applies to measured points, not to simulate. Try: truearm verify simulate --help",
        ),
        (["--simulate", "shop"], "--simulate is a command now. Try: truearm verify simulate MODEL|PRESET"),
        (["--print-plan=iso10360-12"], "--print-plan is a command now. Try: truearm verify plan NAME"),
        (
            ["simulate", "shopp"],
            "a specification (.toml) or a preset (perfect, research, shop, worn, printed), got 'shopp'",
        ),
        (["simulate", "ur10"], "got the arm 'ur10'. Try: shop, with --arm ur10"),
        (["simulate", "mine.urdf"], "got the arm 'mine.urdf'. Try: shop, with --arm mine.urdf"),
        (["simulate", "shop", "--page", "page.html"], "No such option"),
        (["simulate", "shop", "--arm", "panda2"], "there is no arm 'panda2'"),
        (["simulate", "shop", "--test-plan", "iso"], "there is no plan 'iso'"),
        (["simulate", "shop", "--mpe", "none.toml"], "none.toml"),
        (["plan", "iso"], "there is no plan 'iso'. Try: use iso10360-12 or asme-b89.4.22"),
    ],
)
def test_what_does_not_fit_is_refused(refused, tmp_path, monkeypatch, arguments, phrase):
    monkeypatch.chdir(tmp_path)
    refused(["verify", *arguments], phrase)


def test_an_arm_too_short_for_the_limits_is_refused_with_its_reach(refused, tmp_path):
    mpe = tmp_path / "mpe.toml"
    mpe.write_text(MPE.replace("measuring_range_mm = 2500", "measuring_range_mm = 4000"))
    refused(
        ["verify", "simulate", "shop", "--test-plan", "asme-b89.4.22", "--mpe", mpe],
        "does not reach",
        "; volumetric, position 2 4 ",
        "the reach of 1291 mm",
        "without a specification",
    )


def shown_and_printed(truearm, *more):
    """What the page shows of a simulated test, and what the program prints: the words are the same to the letter."""
    command, _, printed = block("verification.md", "console simulated").partition("\n")
    ran = truearm(*command.split()[2:], *more)
    beginning, end = (part.splitlines() for part in printed.split("...\n"))
    lines = ran.out.splitlines()
    whole = next(i for i, line in enumerate(lines) if line.startswith("whole test"))
    assert end[0].startswith("whole test")
    out = "\n".join([*lines[: len(beginning)], *lines[whole : whole + len(end)]])  # the remarks are not shown
    printed = "\n".join([*beginning, *end])
    words = [re.sub(r"[\d.]+", "", " ".join(text.split())) for text in (out, printed)]
    assert words[0] == words[1]
    return out, printed


def test_the_page_shows_the_words_that_the_program_prints(truearm):
    shown_and_printed(truearm, "--arms", 8)


@pytest.mark.weekly
def test_the_page_shows_what_the_program_prints(truearm):
    """Numbers to 3 um and shares to 3 arms, as other processors round otherwise."""
    out, printed = shown_and_printed(truearm)
    number = r"(?<![\w.-])\d+(?:\.\d+)?(?= ?%|\s|$)"
    ours, page = (re.findall(number, text) for text in (out, printed))
    assert len(ours) == len(page)
    for one, other in zip(ours, page, strict=True):
        assert float(one) == pytest.approx(float(other), abs=0.003 if "." in one else 3)


# The sheet -----------------------------------------------------------------------------------------------------------


def test_a_sheet_is_written_for_ones_own_artefacts(truearm, tmp_path):
    artefacts, mpe, out = (tmp_path / name for name in ("artefacts.toml", "mpe.toml", "sheet.html"))
    artefacts.write_text(ARTEFACTS)
    mpe.write_text(MPE)
    ran = truearm("verify", "sheet", "iso10360-12", "--page", out, "--artefacts", artefacts, "--mpe", mpe).done()
    heading = "Articulated arm with tactile probe (plan not confirmed against ISO 10360-12:2016)"
    assert ran.out == f"{out}: operator's sheet, 310 points of {heading}\n"
    command, _, printed = block("verification.md", "console sheet").partition("\n")
    assert command == "$ truearm verify sheet iso10360-12 --page sheet.html --artefacts artefacts.toml --mpe mpe.toml"
    assert ran.out.replace(str(out), out.name) == printed
    html = out.read_text()
    for phrase in ("K-101", "measuring arm 2.5 m", "2028-01-15", "150, 450, 900, 1300, 1700"):
        assert phrase in html
    ran = truearm("verify", "sheet", "asme-b89.4.22", "--page", out).done()
    assert "measuring range and artefacts: examples" in ran.out


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        (["sheet", "iso10360-12"], "--page is the page to write now"),
        (["sheet", "iso10360-12", "--page", "s.html", "--tip-diameter", 6], "--tip-diameter applies to --out only"),
        (["sheet", "iso10360-12", "--page", "sheet.pdf"], "ends in .html"),
        (["sheet", "iso10360-12", "--page", "away/sheet.html"], "away"),
        (["sheet", "iso", "--page", "sheet.html"], "there is no plan 'iso'"),
    ],
)
def test_a_sheet_that_cannot_be_written_is_refused(truearm, tmp_path, monkeypatch, arguments, phrase):
    monkeypatch.chdir(tmp_path)
    assert phrase in truearm("verify", *arguments).refused().err
    assert list(tmp_path.iterdir()) == []
