"""Arms that keep a specification sheet: they do, their worst result near its limit; all goes with the sheet's size."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.errors import InputError
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.laboratory.shapes.minimum_zone import circumscribed_sphere
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.tasks import features
from truearm.wings.laboratory.tasks.feature_postures import middle_of
from truearm.wings.laboratory.tasks.specification_sheet import (
    BEST_SHARE,
    SPREAD,
    SpecificationDistribution,
    share_of_limit,
)
from truearm.wings.laboratory.tasks.task import simulate_measurements
from truearm.wings.planning.virtual import VirtualArm
from truearm.wings.planning.virtual.error_model import GROUPS
from truearm.wings.planning.virtual.presets import SHOP

ARM = load_arm("measuring7")
ISO = {
    "P_Size.Sph.1x25": {"B_um": 15.0},
    "P_Form.Sph.1x25": {"B_um": 30.0},
    "L_Dia.5x5": {"B_um": 40.0},
    "E_Uni": {"A_um": 15.0, "K_mm_per_um": 80.0, "B_um": 50.0},
    "E_Bi": {"B_um": 60.0},
}
ASME = {
    "EffectiveDiameter": {"B_um": 20.0},
    "SPAT.Max": {"B_um": 30.0},
    "SPAT.2s": {"B_um": 40.0},
    "Volumetric.Max": {"B_um": 50.0},
    "Volumetric.2RMS": {"B_um": 60.0},
}


def sheet(limits, *, range_mm=2500.0):
    """A specification with these limits."""
    return Specification.model_validate(
        {"name": "arm", "source": "made up", "measuring_range_mm": range_mm, "limits": limits}
    )


@pytest.fixture(scope="module")
def both():
    """Arms by limits of both standards."""
    return SpecificationDistribution(ARM, sheet(ISO | ASME))


def test_the_worst_result_of_a_drawn_arm_is_near_its_limit(both):
    drawn = [both.draw(seed) for seed in range(12)]
    worst = np.array([max(one.results.values()) for one in drawn])
    assert (worst <= 1 + 1e-12).all()
    assert (worst >= BEST_SHARE - 1e-12).all()
    assert np.ptp(worst) > 0.1
    assert list(drawn[0].results) == list(ISO | ASME)
    assert both.draw(3).factor == drawn[3].factor


def test_an_arm_with_classes_scaled_is_the_arm_of_the_scaled_preset(both):
    drawn = both.draw(2).drawn
    scaled, shop = drawn.virtual.systematic, VirtualArm.draw(both.arm, SHOP, seed=drawn.virtual.seed).systematic
    factors = {group: float((scaled.of_group(group) / shop.of_group(group))[0]) for group in GROUPS}
    tilt_arcsec = factors["bearings"] * SHOP.bearing_tilt_std_arcsec
    preset = replace(SHOP, bearing_runout_std_um=0.0, bearing_tilt_std_arcsec=tilt_arcsec)
    other = VirtualArm.draw(both.arm, preset, seed=drawn.virtual.seed).systematic
    # Rounding of the product of a magnitude, a factor and a random number.
    rotations = scaled.of_group("bearings").reshape(2, -1, 5, 2)[:, :, :2]
    np.testing.assert_allclose(other.of_group("bearings").reshape(rotations.shape), rotations, rtol=1e-12)
    assert all(1 / SPREAD <= factor <= SPREAD for factor in factors.values())


def test_test_results_to_first_order_are_those_of_the_shapes(both):
    """The same points by the fits of the verification: 2e-5 mm, the square of an error of 0.02 mm over a radius."""
    rng = np.random.default_rng(1)
    drawn = both.draw(5)
    angles = both.posed.angles
    off = drawn.systematic(angles) + drawn.random(angles, rng)
    found = both.results(off)
    shown = both.posed.points + off
    sizes, forms, centres, ends, seats = [], [], {}, {}, []
    for i, one in enumerate(both.posed.placements):
        points = shown[both.posed.placement == i]
        if one.test == "probing":
            fitted = fit_sphere(points)
            sizes.append(abs(2 * fitted.radius_mm - 25))
            forms.append(fitted.form_mm)
        elif one.test == "articulation":
            centres.setdefault(one.keys["position"], []).append(fit_sphere(points).centre)
        elif one.test == "uni":
            run = tuple(value for key, value in one.keys.items() if key != "end")
            ends.setdefault(run, {})[one.keys["end"]] = (one.at, points[0])
        elif one.test == "single_point":
            seats.append(np.linalg.norm(points - points.mean(axis=0), axis=1))
    lengths = []
    for pair in ends.values():
        (a, shown_a), (b, shown_b) = pair["A"], pair["B"]
        nominal = np.linalg.norm(b - a)
        limit = min(15 + nominal / 80, 50) / 1000
        lengths.append(abs(np.linalg.norm(shown_b - shown_a) - nominal) / limit)
    assert found["P_Size.Sph.1x25"] * 0.015 == pytest.approx(max(sizes), abs=2e-4)
    assert found["P_Form.Sph.1x25"] * 0.030 == pytest.approx(max(forms), abs=2e-4)
    spread = max(2 * circumscribed_sphere(np.stack(c)).radius_mm for c in centres.values())
    assert found["L_Dia.5x5"] * 0.040 == pytest.approx(spread, abs=5e-4)
    assert found["E_Uni"] == pytest.approx(max(lengths), abs=1e-3)
    assert found["SPAT.Max"] * 0.030 == pytest.approx(max(s.max() for s in seats), rel=1e-9)
    assert found["SPAT.2s"] * 0.040 == pytest.approx(
        max(2 * np.sqrt((s**2).sum() / (len(s) - 1)) for s in seats), rel=1e-9
    )


def test_a_sheet_of_twice_the_limits_gives_twice_the_uncertainty():
    """Errors are small: everything is in proportion, draw by draw."""
    middle, across = middle_of(ARM)
    feature = features.length_at(middle, across, 400.0)
    one, two = (
        simulate_measurements(SpecificationDistribution(ARM, sheet({"SPAT.Max": {"B_um": limit}})), feature, n_arms=100)
        for limit in (30.0, 60.0)
    )
    assert two.estimates[0].errors == pytest.approx(2 * one.estimates[0].errors, abs=1e-5)


def test_arms_at_their_limit_err_by_as_much_more_as_their_worst_result_was_below_it():
    middle, across = middle_of(ARM)
    feature = features.length_at(middle, across, 400.0)
    known = SpecificationDistribution(ARM, sheet({"SPAT.Max": {"B_um": 30.0}}))
    found = simulate_measurements(known, feature, n_arms=100, share_of_limit=share_of_limit)
    larger = found.at_limit.errors / found.estimates[0].errors
    assert (larger >= 1 - 1e-12).all()
    assert (larger <= 1 / BEST_SHARE + 1e-12).all()
    assert found.at_limit.u_mm > found.estimates[0].u_mm
    assert simulate_measurements(known, feature, n_arms=100).at_limit is None


def test_a_sheet_without_limits_is_refused():
    refuses("states no limit", SpecificationDistribution, ARM, sheet({}))


def test_an_arm_of_another_size_is_refused():
    with pytest.raises(InputError, match="far larger than half the measuring range") as caught:
        SpecificationDistribution(ARM, sheet(ISO, range_mm=800.0))
    assert "--arm" in caught.value.hint
    refuses("does not reach", SpecificationDistribution, ARM, sheet(ISO, range_mm=4500.0))
