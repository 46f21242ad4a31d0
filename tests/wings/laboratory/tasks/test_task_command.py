"""``truearm task``: the answer in words, numbers for machines, a page, and wrong wishes refused."""

import json
import re
from contextlib import contextmanager

import pytest

from command_line import called
from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.models import KinematicModel, NominalModel
from truearm.wings.laboratory.verbs import commands as command
from truearm.wings.laboratory.verbs.commands import CODES
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset

pytestmark = pytest.mark.usefixtures("undrawn")

SHEET = """
name = "measuring arm 2.5 m"
source = "its data sheet"
measuring_range_mm = 2500

[limits]
"P_Form.Sph.1x25" = { B_um = 30 }
E_Uni = { A_um = 15, K_mm_per_um = 80, B_um = 50 }
"""


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    """A model of a shop arm."""
    arm = load_arm("gao2017")
    virtual = VirtualArm.draw(arm, load_preset("shop"), seed=1)
    readings = virtual.measure(measuring_poses(arm, 50, seed=1).angles, seed=1).readings
    path = tmp_path_factory.mktemp("task") / "arm.truearm"
    KinematicModel(arm).fit_readings(readings).save(path)
    return path


def ran(*args, **options):
    """Run it; the exit code."""
    return called("task", *args, **{"arms": 100, **options})


@pytest.mark.parametrize(("tolerance", "answer"), [(10.0, "yes"), (0.002, "no"), (0.08, "only with guard bands")])
def test_the_exit_code_is_the_answer(capsys, tolerance, answer):
    assert ran("shop", length=300.0, tolerance=tolerance) == CODES[answer]
    told = capsys.readouterr().out
    assert answer in told.lower()
    assert "fit for length" in told


def test_without_a_tolerance_there_is_no_verdict(capsys):
    assert ran("shop", length=300.0) == 0
    told = capsys.readouterr().out
    assert "fit for" not in told
    for word in ("length of 300 mm", "u systematic", "u random", "95 % of errors", "100 drawn arms", "standard errors"):
        assert word in told


def test_a_model_s_task(capsys, model_file):
    assert ran(str(model_file), length=300.0, at=["800,0,300"], tolerance=1.0, json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["source"] == "the model arm.truearm"
    assert found["tolerance"]["answer"] == "yes"
    (length,) = found["quantities"]
    assert 0.001 < length["u_mm"] < 0.05
    low, high = length["interval_mm"]
    assert low < 0 < high
    assert length["expanded_mm"] <= 1.05 * max(-low, high)
    points = found["points_mm"]
    assert points[0] == pytest.approx([800, -150, 300], abs=5)  # across the front, which is a degree off the x axis
    assert any("as the readings of the model show it" in remark for remark in found["remarks"])
    assert any("The part is perfect and at 20 degC" in remark for remark in found["remarks"])
    assert 0 < length["u_random_mm"] < length["u_mm"]
    assert found["expanded_at_limit_mm"] is None


def test_more_points_are_advised_by_what_the_readings_show_as_by_a_repeatability(capsys, model_file, tmp_path):
    ran(str(model_file), length=300.0, page=tmp_path / "page.html")
    told = capsys.readouterr().out
    page = (tmp_path / "page.html").read_text()
    for one in (told, page):
        assert "four times the points" in one
        assert "as the readings of the model show it" in one
    ran(str(model_file), length=300.0, repeatability=0.005)
    assert "0.0050 mm, as stated" in capsys.readouterr().out


def test_what_a_repeatability_changes(capsys, model_file):
    for repeatability in (0.0001, 0.005):
        ran(str(model_file), length=300.0, repeatability=repeatability, json=True)
    outs = capsys.readouterr().out
    found = [json.loads(part) for part in re.split(r"(?<=\n})\n", outs) if part.strip()]
    small, large = (one["quantities"][0]["u_random_mm"] for one in found)
    assert small == pytest.approx(0.0001 * 2**0.5, rel=0.4)
    assert large == pytest.approx(0.005 * 2**0.5, rel=0.4)


@pytest.mark.parametrize(
    ("feature", "options", "quantities"),
    [
        ("sphere", {"diameter": 25.0}, ["diameter", "form"]),
        ("plane", {"size": 200.0}, ["flatness", "direction"]),
        pytest.param("circle", {"diameter": 60.0}, ["diameter", "roundness"], marks=pytest.mark.weekly),
        ("length", {"at": ["700,-100,300", "800,200,350"]}, ["length"]),
    ],
)
def test_every_feature(capsys, feature, options, quantities):
    ran("shop", feature=feature, json=True, **options)
    found = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in found["quantities"]] == quantities


def test_a_specification_sheet_alone(capsys, tmp_path):
    (tmp_path / "mpe.toml").write_text(SHEET)
    code = ran(mpe=tmp_path / "mpe.toml", length=500.0, tolerance=0.5, page=tmp_path / "page.html")
    told = capsys.readouterr().out
    assert code == 0
    assert "the specification of measuring arm 2.5 m, arm measuring7" in told
    assert "The drawn arms conform to " in told
    assert "For arms whose worst test result equals its limit, U = " in told
    page = (tmp_path / "page.html").read_text()
    for word in (
        told.split(":")[0].replace("+-", "±"),  # the verdict
        "Would more points help?",
        "Assumptions",
        "P_Form.Sph.1x25",
        "<svg",
    ):
        assert word in page


def test_a_page_of_a_form(tmp_path):
    ran("shop", feature="plane", size=200.0, tolerance=0.1, page=tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "flatness" in page
    assert "direction" in page


@pytest.mark.parametrize(
    ("args", "options", "said"),
    [
        ((), {"length": 300.0}, "expected one of"),
        (("shop",), {"length": 300.0, "mpe": "x.toml"}, "expected one of"),
        (("nothing",), {"length": 300.0}, "expected a model file, a specification"),
        (("shop",), {}, "the size of the length is missing"),
        (("shop",), {"diameter": 3.0}, "--diameter does not apply to a length"),
        (
            ("shop",),
            {"feature": "sphere", "diameter": 25.0, "along": "0,0,1"},
            "a direction does not apply to a sphere",
        ),
        (("shop",), {"feature": "sphere", "diameter": 25.0, "at": ["1,2,3", "4,5,6"]}, "--at once"),
        (("shop",), {"length": 300.0, "at": ["1,2"]}, "three numbers"),
        (("shop",), {"length": 300.0, "at": ["1,2,nan"]}, "three numbers"),
        (("shop",), {"length": 300.0, "at": ["1,2,3", "4,5,6"]}, "does not apply to a length between two seats"),
        (("shop",), {"length": 300.0, "tolerance": -1.0}, "above zero"),
        (
            ("shop",),
            {"feature": "circle", "diameter": 30.0, "tolerance": 50.0},
            "smaller than the measured 30 mm, got 50",
        ),
        (("shop",), {"length": 300.0, "repeatability": 0.01}, "is for a model"),
        (("shop",), {"length": 300.0, "arms": 10}, "arms to draw"),
        (("shop",), {"length": 0.5}, "1 mm or more, got 0.5. Try: state it in mm"),
        (("shop",), {"length": 500.0, "at": ["0.6,0,0.3"]}, "does not reach .* Try: state its place in mm"),
        (("shop",), {"length": 9000.0}, "does not reach"),
        (("shop",), {"length": 300.0, "arm": "nowhere"}, "nowhere"),
    ],
)
def test_options_that_do_not_fit_are_refused(args, options, said):
    refuses(said, ran, *args, **options)


@pytest.mark.parametrize(
    ("option", "typed", "said"),
    [
        ("--tolerance", "0,2", "expected a number with a decimal point, such as 0.2"),
        ("--tolerance", "+-0.1", "expected a number with a decimal point, such as 0.2"),
        ("--length", "500,5", "expected a number with a decimal point, such as 0.2"),
        ("--repeatability", "5um", "expected a number with a decimal point, such as 0.2"),
    ],
)
def test_a_number_in_another_notation_is_refused_with_an_example(truearm, option, typed, said):
    said = f"truearm: Invalid value for '{option}': {said}. Try: truearm task --help\n"
    assert truearm("task", "shop", option, typed).refused().err == said


def test_the_bar_shows_through_all_of_it(monkeypatch, tmp_path, capsys):
    """Also while the poses of a specification's tests are found and the page is drawn."""
    seen = []

    @contextmanager
    def bar(what, total):
        seen.append(f"{what}, {total}")
        yield lambda done, note: None
        seen.append("end")

    def noted(name, function):
        monkeypatch.setattr(name, lambda *args, **named: (seen.append(function.__name__), function(*args, **named))[1])

    import truearm.pages.html
    from truearm.wings.laboratory.verbs import task as workflow

    monkeypatch.setattr(command, "progress", bar)
    noted("truearm.wings.laboratory.verbs.task.to_arm_distribution", workflow.to_arm_distribution)
    noted("truearm.pages.html.write_page", truearm.pages.html.write_page)
    ran("shop", length=300.0, page=tmp_path / "page.html")
    assert seen == ["measuring a length, 100", "to_arm_distribution", "write_page", "end"]
    assert "page.html" in capsys.readouterr().out


def test_a_page_must_have_a_page_s_name_and_be_none_of_the_files_read(tmp_path):
    refuses("ends in .html", ran, "shop", length=300.0, page=tmp_path / "page.pdf")
    sheet = tmp_path / "sheet.html"
    sheet.write_text(SHEET)
    refuses("is an input file", ran, mpe=sheet, length=300.0, page=sheet)
    assert sheet.read_text() == SHEET


def test_a_model_has_its_own_arm(model_file):
    refuses("a nominal arm is for a preset", ran, str(model_file), length=300.0, arm="gao2017")


def test_a_nominal_model_has_a_task_uncertainty_too(capsys, tmp_path):
    """Its errors are all unexplained: none of its terms is uncertain but base and tip."""
    arm = load_arm("gao2017")
    virtual = VirtualArm.draw(arm, load_preset("research"), seed=1)
    readings = virtual.measure(measuring_poses(arm, 40, seed=1).angles, seed=1).readings
    NominalModel(arm).fit_readings(readings).save(tmp_path / "n.truearm")
    ran(str(tmp_path / "n.truearm"), length=300.0, json=True)
    (length,) = json.loads(capsys.readouterr().out)["quantities"]
    assert length["u_mm"] > 0.05
