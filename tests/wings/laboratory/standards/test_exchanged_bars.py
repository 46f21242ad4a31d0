"""Two bars of the same nominal length exchanged: noticed by their serial numbers, or by what their lengths fit."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.files.toml_documents import parse_toml
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.evaluation import ODDS, exchanged_bars
from truearm.wings.laboratory.standards.measurands import LengthMeasurement
from truearm.wings.laboratory.standards.specification import Specification

BAR = """\
[[bars]]
name = "{name}"
certificate = "K-{name}"
date = 2026-01-15
expires = 2028-01-15
form_mm = 0.0005
expansion_per_K = 1e-6
u_expansion_per_K = 0.3e-6
u_temperature_K = 0.5
u_fixture_mm = 0.002
lengths = [{{ name = "1000", length_mm = {length}, u_mm = 0.001 }}]
"""
LIMITS = Specification(name="arm", source="sheet", measuring_range_mm=2500, limits={"E_Uni": {"B_um": 60}})


def bars(*lengths):
    text = "".join(BAR.format(name=name, length=length) for name, length in zip("AB", lengths, strict=False))
    return parse_toml(text.encode(), Artefacts)


def measured(bar, true_mm, *, scatter_mm, scale=0.0, positions=7, seed=0):
    """Lengths of a bar of true size at positions, of an arm with an error of scale and one of each position."""
    rng = np.random.default_rng(seed)
    sizes = true_mm * (1 + scale) + scatter_mm * rng.normal(size=positions)
    return [
        LengthMeasurement(bar, bar.lengths[0], np.zeros((1, 3)), np.array([[size, 0.0, 0.0]]), position=str(i))
        for i, size in enumerate(sizes)
    ]


def found(lengths, artefacts, limits=LIMITS):
    return exchanged_bars(lengths, artefacts, limits)


@pytest.mark.parametrize("scale", [0.0, 100e-6])
@pytest.mark.parametrize(("first", "second"), [(1000.003, 1000.203), (1000.203, 1000.003)])
def test_two_measured_bars_that_were_exchanged_are_named_whatever_the_scale_of_the_arm(first, second, scale):
    artefacts = bars(first, second)
    a, b = artefacts.bars
    exchanged = measured(a, second, scatter_mm=0.02, scale=scale) + measured(
        b, first, scatter_mm=0.02, scale=scale, seed=1
    )
    name, fits, odds = found(exchanged, artefacts)
    assert {name, fits} == {"A", "B"}
    assert odds > ODDS
    right = measured(a, first, scatter_mm=0.02, scale=scale) + measured(b, second, scatter_mm=0.02, scale=scale, seed=1)
    assert found(right, artefacts) is None


def test_an_arm_is_not_taken_for_exchanged_bars():
    """Of 1000 verifications of right bars that are 10 um to 0.5 mm apart, with a scatter of 3 um to 0.3 mm, none."""
    rng = np.random.default_rng(5)
    for _ in range(1000):
        apart = 10 ** rng.uniform(-2, -0.3)
        artefacts = bars(1000.0, 1000.0 + apart)
        scatter, scale = 10 ** rng.uniform(-2.5, -0.5), rng.normal(0, 1e-4)
        lengths = [
            one
            for bar in artefacts.bars
            for one in measured(bar, bar.lengths[0].length_mm, scatter_mm=scatter, scale=scale, positions=5, seed=rng)
        ]
        assert found(lengths, artefacts) is None


def test_the_odds_are_those_of_students_t():
    """By hand: deviations of 0.1 as named and none exchanged, positions 0.01 apart: t = 0.2 / u, 4 degrees."""
    artefacts = bars(1000.0, 1000.1)
    a, b = artefacts.bars
    steps = [-0.01, 0.0, 0.01]
    lengths = [
        LengthMeasurement(bar, bar.lengths[0], np.zeros((1, 3)), np.array([[size + step, 0, 0]]), position=str(i))
        for bar, size in ((a, 1000.1), (b, 1000.0))
        for i, step in enumerate(steps)
    ]
    u = np.sqrt(4e-4 / 4 * 2 / 3 + 2 * (0.001**2 + 0.002**2))
    expected = (1 + (0.2 / u) ** 2 / 4) ** 2.5
    assert expected > ODDS
    assert found(lengths, artefacts)[2] == pytest.approx(expected, rel=1e-6)


def test_a_bar_that_another_one_of_the_file_fits_is_named_only_far_beyond_the_limit():
    artefacts = bars(1000.0, 1000.45)
    a, _ = artefacts.bars
    assert found(measured(a, 1000.45, scatter_mm=0.02), artefacts)[:2] == ("A", "B")
    assert found(measured(a, 1000.0, scatter_mm=0.02), artefacts) is None
    # 0.1 mm is not beyond an arm that is out of adjustment.
    near = bars(1000.0, 1000.1)
    assert found(measured(near.bars[0], 1000.1, scatter_mm=0.02), near) is None
    # Without a limit, and of bars of other nominal lengths, there is nothing to compare.
    bare = LIMITS.model_copy(update={"limits": {}})
    assert found(measured(a, 1000.45, scatter_mm=0.02), artefacts, bare) is None
    other = bars(1000.0, 1500.0)
    assert found(measured(other.bars[0], 1000.4, scatter_mm=0.02), other) is None
    opposite = [replace(one) for one in measured(a, 1000.0, scatter_mm=0.02)]
    assert found(opposite, bars(1000.0)) is None
