"""A stated uncertainty in another unit is refused or said; a right one, or one off by a factor of two, is not."""

from dataclasses import replace

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.arm import Arm, load_arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.identification.judgement.stated_uncertainty import stated_ratio, unlike_stated_uncertainty
from truearm.models import KinematicModel, PhysicalModel
from truearm.readings import Session

ARM = load_arm("gao2017")


@pytest.fixture(scope="module", params=["shop", "research"])
def session(request) -> Session:
    found = ta.simulate("gao2017", poses=60, strategy="measuring", preset=request.param, seed=3).session
    return Session(found.angles, found.points, point_std=found.point_std)


def stating(session: Session, factor: float) -> Session:
    return replace(session, point_std=session.point_std * factor)


def test_micrometres_entered_as_millimetres_are_refused_at_every_door(session):
    wrong = stating(session, 1000.0)
    says = r"is \d+ times their scatter about the identified arm, as if micrometres were entered as mm"
    for fit in (
        lambda: PhysicalModel(ARM).fit_readings(wrong),
        lambda: ta.fit(ARM, wrong),
        lambda: ta.fit(ARM, wrong, model="nominal"),
    ):
        refuses(says, fit)


def test_one_axis_alone_is_refused(session):
    error = refuses(r"is \d+ times their scatter", ta.fit, ARM, stating(session, [1.0, 1.0, 1e6]), model="nominal")
    assert error.column == "sz_mm"


def test_an_axis_along_which_no_tip_moves_shows_no_scatter(rng):
    """A planar arm: z is 250 mm in all readings, as the drawing says."""
    planar = Arm("planar", chain_from_dh(a=[300, 250], alpha=[0, 0], d=[250, 0]))
    angles = rng.uniform(-1.5, 1.5, (40, 2))
    points = planar.chain.tip_in_base(angles) + 0.02 * rng.normal(size=(40, 3)) * [1, 1, 0]
    ta.fit(planar, Session(angles, points, point_std=np.full((40, 3), 0.02)), model="nominal")


@pytest.mark.parametrize("factor", [0.5, 1.0, pytest.param(2.0, marks=pytest.mark.weekly)])
def test_a_right_one_is_not_questioned(session, factor):
    model = KinematicModel(ARM).fit_readings(stating(session, factor))
    assert unlike_stated_uncertainty(model.fit_) == ()
    # What the arm does is part of the scatter.
    assert 0.1 * factor < stated_ratio(model.fit_) < 1.3 * factor


def test_what_the_constants_take_of_the_scatter_is_given_back():
    """An arm with wrong constants alone, 14 readings and some 25 constants: the scatter is the stated one to 25 %.

    Of 42 residuals some 17 are free, so that their own scatter is 0.63 of it.
    """
    rng = np.random.default_rng(5)
    motions = rng.normal(size=(ARM.chain.n_places, 6)) * ([3e-4] * 3 + [0.2] * 3)
    ratios = []
    for _ in range(4):
        angles = rng.uniform(-1.5, 1.5, (14, ARM.n_joints))
        points = ARM.chain.with_motions(motions).tip_in_base(angles) + 0.02 * rng.normal(size=(14, 3))
        model = KinematicModel(ARM).fit_readings(Session(angles, points, point_std=np.full((14, 3), 0.02)))
        ratios.append(stated_ratio(model.fit_))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.25)


def test_one_that_is_tens_of_times_too_large_is_said(session):
    result = ta.fit(ARM, stating(session, 30.0), model="kinematic")
    assert any("times their scatter. Check its unit" in remark for remark in result.remarks)


def test_one_in_metres_is_said(session):
    result = ta.fit(ARM, stating(session, 1e-3), model="kinematic")
    assert any("as if it were entered in metres" in remark for remark in result.remarks)


def test_without_a_stated_uncertainty_nothing_is_judged(session):
    model = KinematicModel(ARM).fit_readings(replace(session, point_std=None))
    assert stated_ratio(model.fit_) is None
    assert unlike_stated_uncertainty(model.fit_) == ()
