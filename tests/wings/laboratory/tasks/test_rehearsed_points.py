"""A rehearsed verification: a perfect arm finds its artefacts, whatever the tip of its stylus."""

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.wings.laboratory.standards.artefacts import Artefacts, example_artefacts
from truearm.wings.laboratory.standards.points_form import fill_points_form
from truearm.wings.laboratory.standards.specification import example_specification
from truearm.wings.laboratory.standards.verification_plan import Count

RANGE_MM, TIP_MM = 2500.0, 6.0


@pytest.fixture(scope="module")
def artefacts():
    return example_artefacts(RANGE_MM)


@pytest.fixture(scope="module")
def plan():
    """Two tests of the standard, one on a ball and one on bars, with few positions."""
    whole = ta.load_verification_plan("asme-b89.4.22")
    few = Count(confirmed=True, source="a test", value=4)
    volumetric = whole.tests["volumetric"].model_copy(update={"positions": few})
    return whole.model_copy(update={"single_point": None, "volumetric": volumetric})


@pytest.fixture(scope="module")
def perfect(plan, artefacts, tmp_path_factory):
    """A form, and the readings of a perfect arm."""
    form = tmp_path_factory.mktemp("form") / "points.csv"
    ta.operator_sheet(plan, artefacts=artefacts).save_points(form, tip_diameter_mm=TIP_MM)
    return form, ta.rehearse("measuring7", form, artefacts=artefacts, preset="perfect")


def test_the_readings_have_the_order_of_the_file(plan, artefacts, perfect):
    _, simulated = perfect
    layout = ta.operator_sheet(plan, artefacts=artefacts).sheet.layout
    points = np.concatenate([one.points for one in layout])
    on_ball = np.concatenate([np.full(len(one.points), one.test == "effective_diameter") for one in layout])
    away = np.linalg.norm(simulated.measurement.true_tips - points, axis=1)
    assert simulated.session.points is None
    # Artefacts stand where they are planned, within their fixtures and form deviations.
    assert away[on_ball] == pytest.approx(np.full(on_ball.sum(), TIP_MM / 2), abs=0.02)
    assert away[~on_ball].max() < 0.02


def test_a_perfect_arm_finds_the_artefacts_through_the_tip_of_its_stylus(plan, artefacts, perfect):
    form, simulated = perfect
    tips = ta.load_arm("measuring7").chain.tip_in_base(simulated.session.angles)
    fill_points_form(form, tips, day=artefacts.bars[0].date, artefact_degC=20.0)
    result = ta.verify(form, plan=plan, artefacts=artefacts, specification=example_specification(RANGE_MM))
    assert result.verification.verdict.value == "conform"
    for row in result.rows:
        # What is left are the deviations of the artefacts from their certificates, six standard uncertainties at most.
        assert abs(row.value) < 3 * row.uncertainty


def test_an_artefact_without_certificate_is_refused(perfect, artefacts):
    none = Artefacts(spheres=artefacts.spheres, bars=(), seats=artefacts.seats)
    refuses("the file of artefacts has no", ta.rehearse, "measuring7", perfect[0], artefacts=none, preset="perfect")
