"""Zeros that are off by degrees hide nothing: scales and signs are judged about the arm with its zeros in place."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import truearm as ta
from refusals import refuses


@cache
def kit() -> ta.Session:
    """Of a printed arm by a camera of 1 mm: zeros are off by degrees, lengths by a hundredth."""
    return ta.simulate("so101", poses=60, preset="printed", strategy="uniform", seed=1, arm_seed=1).session


@cache
def shop(degrees: float) -> ta.Session:
    """Of an arm with lengths off by 0.01 mm, and zeros by degrees."""
    made = ta.simulate("wx250", poses=60, preset="shop", strategy="uniform", seed=2, arm_seed=2).session
    return replace(made, angles=made.angles + np.radians(degrees) * np.array([1, -1, 1, 1, -1]))


def said(arm: str, session: ta.Session, what: str) -> list[str]:
    found = ta.fit(arm, session, model="kinematic", limits="ignore").findings
    return [str(one) for one in found if one.what == what]


@pytest.mark.parametrize("degrees", [0.0, 8.0])
def test_a_right_session_has_no_scale_and_no_sign_that_is_wrong(degrees):
    """Cosines of 8 degrees shorten the lengths of the arm as drawn by 1 %."""
    for what in ("length scale", "axis scale", "joint sign"):
        assert not said("so101", kit(), what)
        assert not said("wx250", shop(degrees), what)


def test_a_scale_of_the_reference_is_refused_beside_zeros():
    caught = refuses(
        r"all lengths of the arm are 0\.\d+ % longer",
        ta.fit,
        "wx250",
        replace(shop(8.0), points=1.005 * shop(8.0).points),
        model="kinematic",
        limits="ignore",
    )
    factor = float(caught.hint.split("divided by ")[1].split()[0].rstrip(")"))
    assert factor == pytest.approx(1.005, abs=2e-4)  # lengths of 250 mm are off by 0.03 mm


def test_a_scale_that_lengths_of_a_kit_may_have_is_said():
    """Lengths of plastic scatter by 1 %: squares printed 5 % too large are a remark, and 20 % are refused."""
    [remark] = said("so101", replace(kit(), points=1.05 * kit().points), "length scale")
    assert "longer than drawn" in remark
    assert "warm" not in remark  # by 5 % no arm grows


def test_the_depth_of_a_camera_is_refused_beside_zeros():
    deep = replace(kit(), points=kit().points * [1, 1, 1.02])
    caught = refuses("longer along z than", ta.fit, "so101", deep, model="nominal")
    assert float(caught.hint.split("divided by ")[1].split()[0]) == pytest.approx(1.02, abs=3e-3)  # three u


def test_a_reversed_sign_is_named_beside_zeros():
    """It explains half of what the arm as drawn misses, where zeros are the other half."""
    wrong = replace(kit(), angles=kit().angles * [1, 1, 1, 1, -1])
    assert "sign of J5 reversed" in refuses("misses its references", ta.fit, "so101", wrong, model="nominal").hint
    assert ta.diagnose("so101", wrong).check.findings[0].mistakes == ("sign of J5 reversed",)
