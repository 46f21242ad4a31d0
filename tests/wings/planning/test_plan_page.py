"""The page of a plan: a picture of every kind, the poses one by one, and names of any make."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm.catalogue import load_arm
from truearm.pages.html import render
from truearm.wings.planning.designs.plan import SessionPlan
from truearm.wings.planning.designs.prior import nominal_prior
from truearm.wings.planning.designs.proposal import Artefact, propose
from truearm.wings.planning.plan_page import course_figure, places_figure, plan_page, poses_figure

ARM = load_arm("gao2017")
ARTEFACTS = {"tracker": Artefact("tracker"), "seat": Artefact("seat", 2), "bar": Artefact("bar", 2, 200.0)}


@pytest.fixture(scope="module", params=["tracker", "seat", pytest.param("bar", marks=pytest.mark.weekly)])
def plan(request):
    return propose(ARM, nominal_prior(ARM, terms="constants", noise_mm=0.02), ARTEFACTS[request.param], 9, seed=2)


def chosen(plan):
    return plan.proposals["i-optimal"].poses


def page_of(plan, **options):
    return plan_page(SessionPlan(plan, "i-optimal", chosen(plan), "the nominal arm"), **options)


def test_a_page_states_gain_places_poses_and_limitations_and_folds_the_indices(plan):
    page = page_of(plan, facts=[("seed", "2")])
    assert [section.title for section in page.sections] == [
        "What these poses bring",
        "Where the tip is" if plan.artefact.kind == "tracker" else "Where to put the artefact",
        "Poses",
        "What this plan cannot determine",
        "Pose by pose",
        "Observability indices",
    ]
    assert [section.folded for section in page.sections] == [False] * 5 + [True]
    assert [len(section.figures) for section in page.sections] == [1, 1, 1, 0, 0, 0]
    assert [len(section.scenes) for section in page.sections] == [0, 0, 1, 0, 0, 0]
    listed = page.sections[-2].tables[0]
    assert len(listed.rows) == 9
    # Degrees, rounded.
    assert np.array([row[3:] for row in listed.rows]) == pytest.approx(np.degrees(chosen(plan).angles), abs=0.5001)
    cards = page.sections[-2].cards.cards
    assert [card.values[0][1] for card in cards] == [f"{row[3]}\u00a0deg".replace("-", "\u2212") for row in listed.rows]
    # The tip above the base, from the side and from above: ahead and to the left are the axes of a turned base.
    tips = ARM.chain.tip_in_base(chosen(plan).angles)
    ends = np.array([[line[-1] for line in card.lines] for card in cards])
    assert ends[:, 0, 1] == pytest.approx(tips[:, 2], abs=1e-9)
    assert np.linalg.norm(ends[:, 1], axis=1) == pytest.approx(np.linalg.norm(tips[:, :2], axis=1), abs=1e-9)
    assert ends[:, 0, 0] == pytest.approx(ends[:, 1, 0], abs=1e-9)
    compared = page.sections[0].tables[0]
    assert [row[0] for row in compared.rows] == ["i-optimal", "d-optimal", "technician", "random"]
    assert [row[0] for row in page.sections[-1].tables[0].rows] == [row[0] for row in compared.rows]
    assert page.summary[0].value == pytest.approx(plan.proposals["i-optimal"].rms_mm[-1])
    html = render(page)
    assert html == render(page_of(plan, facts=[("seed", "2")]))
    assert html.count("<figure") == 4
    assert ("apart from the scale" in html) == (plan.artefact.kind == "seat")


def test_seats_and_bars_are_named_and_listed(plan):
    poses = chosen(plan)
    page = page_of(plan)
    if plan.artefact.kind == "tracker":
        assert page.sections[1].tables == ()
        return
    (table,) = page.sections[1].tables
    assert [row[0] for row in table.rows] == list(dict.fromkeys(poses.seat.tolist()))
    assert sum(row[-1] for row in table.rows) == 9
    from_above = places_figure(plan, poses).panels[0].axes[0]
    named = {text.get_text() for text in from_above.texts}
    # A bar is named once, its ends are not.
    assert named == {name[:2] for name in poses.seat.tolist()}


def test_the_pictures_have_one_scale_and_everything_in_sight(plan):
    poses = chosen(plan)
    for figure in (places_figure(plan, poses), poses_figure(plan, poses.angles)):
        assert len(figure.panels) == 2
        for drawing in figure.panels:
            (axes,) = drawing.axes
            assert axes.get_aspect() == 1.0
            (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
            for line in axes.lines:
                x, y = line.get_data()
                assert left <= np.min(x) <= np.max(x) <= right
                assert low <= np.min(y) <= np.max(y) <= high


def test_a_course_is_a_line_a_strategy(plan):
    (axes,) = course_figure(plan.proposals).panels[0].axes
    assert [line.get_label() for line in axes.lines] == list(plan.proposals)
    for line, proposal in zip(axes.lines, plan.proposals.values(), strict=True):
        assert line.get_ydata() == pytest.approx(proposal.rms_mm[1:])


def test_names_are_text_whatever_they_hold(plan):
    named = replace(plan, arm=replace(ARM, name="<b>x</b>", joint_names=("<i>", "&", '"', "$q$", "a\u0300", "")))
    html = render(page_of(named))
    assert "<b>x" not in html
    assert "<i>" not in html


def test_one_pose_is_a_plan_too():
    plan = propose(ARM, nominal_prior(ARM, terms="constants", noise_mm=0.02), Artefact("tracker"), 1, seed=0)
    planned = SessionPlan(plan, "random", plan.proposals["random"].poses, "")
    assert "1 pose to measure" in render(plan_page(planned))
