"""What a page says of an identified arm: uncertainty in the metrologist's words, terms, joints, what is open."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from html_outline import Outline
from truearm.arm import load_arm
from truearm.identification.judgement.held_out_errors import HeldOutErrors
from truearm.identification.judgement.outliers import Outlier
from truearm.models import PhysicalModel
from truearm.models.model_archive import model_bytes
from truearm.models.model_file import load_model
from truearm.models.uncertainty import UncertaintyBudget
from truearm.pages.html import render
from truearm.pages.page import Page
from truearm.pages.plotting import svg_element
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import VirtualArm, load_preset
from truearm.wings.reports.identification_sections import (
    joint_error_figure,
    joint_errors_section,
    outlier_section,
    terms_section,
    uncertainty_section,
    unidentifiable_section,
)
from truearm.wings.reports.seat_page import SeatComparison, seats_page
from truearm.wings.reports.term_effects import Effect, JointError, effects

ARCSEC = np.pi / 180 / 3600


def made_up_error(joint=1, *, amplitude=30.0, std=1.0, orders=(1, 2, 17, 128)):
    """A joint's error whose amplitudes fall with the order [arcsec]."""
    angles, orders = np.linspace(-2, 1, 400), np.array(orders)
    amplitudes = amplitude * ARCSEC / np.sqrt(orders)
    error = np.sin(orders * angles[:, None]) @ amplitudes
    spread = np.full(len(orders), std * ARCSEC)
    return JointError(joint, angles, error, np.full(400, std * ARCSEC), orders, amplitudes, spread)


def made_up_budget(**changed):
    budget = {
        "of_parameters_mm": 0.03,
        "unexplained_mm": 0.04,
        "combined_mm": 0.05,
        "largest_mm": 0.08,
        "is_relative": False,
        "n_points": 200,
        "n_covered": 190,
    }
    return UncertaintyBudget(**(budget | changed))


def words(section):
    return render(Page("A page", sections=(section,)))


def test_uncertainty_is_stated_with_its_coverage_factor_and_its_parts():
    held_out = HeldOutErrors(200, 20, 0.081, 0.003, 0.17, 0.4)
    section = uncertainty_section(made_up_budget(), held_out)
    assert "U = 0.10 mm (k = 2)" in section.text
    assert "Coverage: 95\u202f% of the 200 readings" in section.text
    assert "frame" not in section.text
    values = {row.label: row.value for row in section.rows}
    assert values["standard uncertainty of a coordinate from the arm's parameters"] == 0.03
    assert values["standard uncertainty of a coordinate, residual"] == 0.04
    assert values["expanded uncertainty U of a coordinate, k = 2"] == 0.1
    assert values["half axis of a point's 95\u202f% ellipsoid, 2.80 u"] == pytest.approx(0.05 * 2.7955, rel=1e-4)
    assert values["mean error of 200 readings held out in 20 groups"] == 0.081
    assert all(row.unit == "mm" for row in section.rows)


def test_nothing_is_said_of_points_or_groups_that_there_are_not():
    section = uncertainty_section(made_up_budget(n_points=0, n_covered=0, is_relative=True), None, name="mine")
    assert section.title == "Uncertainty: mine"
    assert "Coverage" not in section.text
    assert "after a frame was fitted to the points" in section.text
    assert not [row for row in section.rows if "held out" in row.label]
    alone = uncertainty_section(made_up_budget(), HeldOutErrors(5, 1, 0.1, np.inf, 0.2, 0.2))
    assert alone.rows[-3].uncertainty is None
    assert "gross" not in alone.rows[-3].label
    without = uncertainty_section(made_up_budget(), HeldOutErrors(5, 1, 0.1, np.inf, 0.2, 0.2, n_excluded=2))
    assert without.rows[-3].label == "mean error of 5 readings held out in 1 group, without 2 gross errors"


def test_terms_have_a_row_each_and_those_not_needed_are_named():
    found = [
        Effect("tip", 3, 3.0, None, None, None),
        Effect("bending", 12, 7.4, 10 * ARCSEC, None, 0.05),
        Effect("wobble, translations", 20, 0.0, None, None, None),
    ]
    section = terms_section(found)
    (table,) = section.tables
    assert [row[0] for row in table.rows] == ["tip", "bending"]
    assert table.rows[1][3] == pytest.approx(10.0)
    assert "Offered and pruned: wobble, translations." in section.text
    assert "The readings determined 10 of 35 coefficients" in section.text
    assert terms_section([found[2]]) is None


def test_a_joint_has_its_curve_and_its_spectrum_with_units():
    figure = joint_error_figure(
        {"model": [made_up_error(1), made_up_error(3)]}, np.zeros((5, 3)), names=["a", "b", "c"]
    )
    assert len(figure.panels) == 4
    for curve, spectrum in zip(figure.panels[::2], figure.panels[1::2], strict=True):
        assert curve.axes[0].get_xlabel() == "joint angle [deg]"
        assert curve.axes[0].get_ylabel() == "error [arcsec]"
        assert spectrum.axes[0].get_ylabel() == "amplitude [arcsec]"
    assert "b: no error larger than its uncertainty" in figure.caption
    # The largest of the curve is within the axes, in arcsec, and the axes are not ten times as large.
    low, high = figure.panels[0].axes[0].get_ylim()
    largest = np.abs(made_up_error().error).max() / ARCSEC
    assert largest < high < -low < 2 * largest
    assert "a: " in svg_element(figure.panels[0], "p-")
    assert ">17<" in svg_element(figure.panels[1], "p-")


def test_joints_of_two_models_share_panels_and_say_whose_they_are():
    errors = {"July": [made_up_error()], "November": [made_up_error(std=5.0)]}
    figure = joint_error_figure(errors, np.random.default_rng(0).uniform(-2, 1, (50, 2)))
    assert len(figure.panels) == 2
    assert "July" in svg_element(figure.panels[0], "p-")
    assert "November" in svg_element(figure.panels[0], "p-")


def test_a_joint_of_which_nothing_is_told_is_not_drawn():
    """An error smaller than its uncertainty, and one without an order that was kept."""
    vague, none = made_up_error(2, std=100.0), made_up_error(1, orders=())
    assert not vague.is_significant
    assert not none.is_significant
    assert joint_errors_section({"model": [none, vague]}, np.zeros((4, 2)), ["J1", "J2"]) is None


def test_what_is_open_and_what_is_far_off_is_told_with_its_reason():
    section = unidentifiable_section(
        [("hysteresis", "the joints' directions are not known")],
        [(("d1", "base z"), "only together"), (("zero",), "not told")],
    )
    assert "the joints&#39; directions are not known" in words(section)
    assert section.tables[0].rows == (("d1, base z", "only together"), ("zero", "not told"))
    assert unidentifiable_section([], []) is None
    far = [Outlier(f"line {i}", 1.0 / i, 10.0 / i, "point") for i in range(1, 40)]
    section = outlier_section({"the readings of this page": far, "others": []})
    (table,) = section.tables
    assert len(table.rows) == 20
    assert table.rows[0] == ("line 1", 1.0, 10.0)
    assert "39 outliers among the readings of this page, the 20 largest" in table.caption
    assert outlier_section({"others": []}) is None


def test_the_page_of_seats_says_how_well_they_agree(rng):
    """Three seats; one model that is out by 1 mm in x in half of the poses, and one that is right."""
    seat = np.repeat(["S1", "S2", "S3"], 8)
    points = np.repeat(rng.uniform(-300, 300, (3, 3)), 8, axis=0)
    off = points + np.tile([[0.5, 0, 0], [-0.5, 0, 0]], (12, 1))
    seated = SeatComparison(
        angles=rng.uniform(-1, 1, (24, 6)),
        seat=seat,
        predicted={"nominal": off, "good": points},
        lengths=[("S1", "S2", 500.0, 0.005)],
        length_errors={"nominal": np.array([-0.2]), "good": np.array([0.01])},
        joint_names=[f"J{i}" for i in range(1, 7)],
        lower=np.full(6, -np.inf),
        upper=np.full(6, np.inf),
        sliding=[False] * 6,
    )
    page = seats_page(seated, title="Seats", subtitle="", facts=[], remarks=["Look."])
    titles = [section.title for section in page.sections]
    assert titles[:3] == ["Where the points disagree", "Agreement in the seats", "Lengths"]
    agreement, lengths = page.sections[1:3]
    assert agreement.text.startswith("Look.")
    (_, mean, rms, p95, largest, n) = agreement.tables[0].rows[0]
    assert (mean, rms, p95, largest, n) == pytest.approx((0.5, 0.5, 0.5, 0.5, 24))
    assert agreement.tables[0].rows[1][1] < 1e-12
    assert agreement.tables[1].rows[2][:2] == ("S3", 8)
    assert lengths.tables[0].rows == (("S1", "S2", 500.0, 0.005, -0.2, 0.01),)
    assert page.summary[-1].value == 0.01
    outline = Outline(render(page))
    assert outline.tags.count("figure") == 6
    without = seats_page(
        SeatComparison(**{**vars(seated), "lengths": [], "length_errors": {}}), title="Seats", subtitle="", facts=[]
    )
    assert "Lengths" not in [section.title for section in without.sections]


def test_terms_of_what_was_the_same_at_all_readings_have_a_row_of_their_own(tmp_path):
    """A report of readings at one temperature: growth, not learned, is a group beside those of the readings."""
    arm = load_arm("gao2017")
    readings = VirtualArm.draw(arm, load_preset("shop"), seed=1).measure(
        measuring_poses(arm, 40, seed=1).angles, seed=1
    )
    model = PhysicalModel(arm, highest=4).fit_readings(replace(readings.readings, temperature_degC=np.full(40, 20.0)))
    found = {effect.group: effect for effect in effects(model.fit_, model.state(readings.readings))}
    assert found["thermal expansion, not learned"].determined == 0.0
    assert found.keys() == {group.name for group in model.fit_.groups}

    # Early files have these terms in the group of those that are learned, and list the same groups.
    terms = (replace(term, group=term.group.removesuffix(", not learned")) for term in model.fit_.perturbed_chain.terms)
    early = copy(model)
    early.fit_ = replace(model.fit_, perturbed_chain=replace(model.fit_.perturbed_chain, terms=tuple(terms)))
    (tmp_path / "early").write_bytes(model_bytes(early))
    again = load_model(tmp_path / "early")
    assert effects(again.fit_, again.state(readings.readings)) == effects(model.fit_, model.state(readings.readings))
