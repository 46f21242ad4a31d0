"""Laws of the worn virtual arm: each kind of wear does what its formula says, and leaves the draws of the others."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.wings.planning.virtual import PRESETS, Preset, VirtualArm
from truearm.wings.planning.virtual.error_model import (
    BASE,
    CABLES,
    GEARS,
    GROUPS,
    SLACK,
    SPOTS,
    WEAR_GROUPS,
    Spots,
    error_model,
)
from truearm.wings.planning.virtual.presets import ARCSEC

ARM = load_arm("gao2017")
TURN = 2 * np.pi


def hinge() -> Arm:
    """A single upright joint with its tip 1 m away: a rotation r moves the tip by 1000 r."""
    return Arm("hinge", Chain(np.tile(np.eye(4), (2, 1, 1)), [1000.0, 0, 0]))


def lying() -> Arm:
    """A joint along the base's y with 1 m of links along x: their weight turns it about its own axis."""
    upright_to_y = np.eye(4)
    upright_to_y[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    return Arm("lying", Chain(np.stack([upright_to_y, np.eye(4)]), [1000.0, 0, 0]))


def own_turns(virtual: VirtualArm, angles: np.ndarray, joint: int = 1) -> np.ndarray:
    """Rotations about a joint's own axis [arcsec]."""
    return virtual.motions(angles)[:, joint, 2] / ARCSEC


def test_a_worn_arm_is_one_of_the_shop_with_wear():
    shop, worn = (error_model(ARM, PRESETS[name]) for name in ("shop", "worn"))
    assert set(worn.groups) == {*GROUPS, *WEAR_GROUPS}
    sound = ~np.isin(worn.groups, WEAR_GROUPS)
    np.testing.assert_array_equal(worn.draw(3)[sound], shop.draw(3))


def test_a_spot_is_a_gaussian_of_its_width_and_repeats_after_a_turn():
    virtual = VirtualArm.draw(hinge(), Preset(gear_spot_std_arcsec=5.0, spot_width_deg=2.0), seed=1)
    basis = Spots(1, np.radians(2.0))
    assert basis.n_spots == len(basis.labels()) == 60
    heights = virtual.systematic.of_group(SPOTS) / ARCSEC
    q = np.linspace(0, TURN, 50)[:, None]
    away = np.degrees(q) - 6.0 * np.arange(60)
    away -= 360 * np.round(away / 360)
    expected = np.exp(-0.5 * (away / 2) ** 2) @ heights
    np.testing.assert_allclose(own_turns(virtual, q), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(own_turns(virtual, q + TURN), expected, rtol=0, atol=1e-9)


def test_damage_is_rare_and_as_large_as_stated():
    model = error_model(load_arm("measuring7"), Preset(bearing_spot_std_arcsec=2.0, gear_spot_std_arcsec=2.0))
    heights = np.concatenate([model.draw(seed) for seed in range(40)]) / ARCSEC
    # 34,000 cubes of normal numbers, whose kurtosis is 46: their variance is known to 4 %; 4 sigma.
    assert heights.std() == pytest.approx(2.0, rel=0.08)
    assert np.median(np.abs(heights)) < 0.2 < 10 < np.abs(heights).max()


def test_bearing_spots_tilt_and_gears_turn():
    tilted = VirtualArm.draw(hinge(), Preset(bearing_spot_std_arcsec=5.0), seed=1).motions([[0.3], [1.0]])[:, 1]
    assert (tilted[:, 2:] == 0).all()
    assert (tilted[:, :2] != 0).all()
    turned = VirtualArm.draw(hinge(), Preset(gear_spot_std_arcsec=5.0, gear_std_arcsec=5.0), seed=1)
    assert (np.delete(turned.motions([[0.3], [1.0]])[:, 1], 2, axis=1) == 0).all()


def test_a_hunting_tooth_repeats_after_two_turns_and_not_after_one():
    virtual = VirtualArm.draw(hinge(), Preset(gear_std_arcsec=5.0), seed=0)
    q = np.linspace(0.1, 1, 7)[:, None]
    once, twice = (own_turns(virtual, q + turns * TURN) for turns in (1, 2))
    # Phases of 700 rad: rounding of 1e-13 of a period.
    np.testing.assert_allclose(twice, own_turns(virtual, q), rtol=0, atol=1e-9)
    assert np.abs(once - own_turns(virtual, q)).max() > 1


def test_the_teeth_of_a_gear_rise_evenly_and_fall_at_once():
    virtual = VirtualArm.draw(hinge(), Preset(gear_std_arcsec=1.0, gear_ratio=10.0), seed=0)
    cos, sin, saw, shifted = virtual.systematic.of_group(GEARS) / ARCSEC
    # Phase 0.25 turns: cosine 0, sine 1, the sawtooth half way to 0 and its quarter further at 0.
    assert own_turns(virtual, np.array([[0.025 * TURN]]))[0] == pytest.approx(sin - saw / 2, abs=1e-9)
    below, above = own_turns(virtual, np.array([[0.1 * TURN - 1e-9], [0.1 * TURN + 1e-9]]))
    assert below - above == pytest.approx(2 * saw, abs=1e-5)
    assert cos != shifted


def test_slack_follows_the_side_of_the_load():
    preset = Preset(slack_std_arcsec=10.0, slack_zone_Nm=0.5, link_kg_per_m=2.0)
    virtual = VirtualArm.draw(lying(), preset, seed=0)
    (gap,) = virtual.systematic.of_group(SLACK) / ARCSEC
    right, left, up = own_turns(virtual, np.array([[0.0], [np.pi], [np.pi / 2]]))
    # 2 kg at 0.5 m: 9.8 N m on either side close the gap; hanging straight the torque is zero.
    assert abs(right) == pytest.approx(abs(gap), rel=1e-9)
    assert right == pytest.approx(-left, rel=1e-9)
    assert up == pytest.approx(0.0, abs=1e-9)
    standing = VirtualArm.draw(hinge(), preset, seed=0)
    assert own_turns(standing, np.array([[0.4]])) == pytest.approx([0.0], abs=1e-12)


def test_a_cable_pulls_as_its_energy_falls():
    """Torque by a difference quotient of the energy, with the slip of the guides after it."""
    virtual = VirtualArm.draw(ARM, Preset(cable_std_arcsec=10.0), seed=0)
    coefficients = virtual.systematic.of_group(CABLES) / ARCSEC
    assert len(coefficients) == 5

    def energy(a, b):
        return 0.5 * (np.sqrt(1 + a * a + b * b + a * b) - 1) ** 2

    angles = np.random.default_rng(2).uniform(-2, 2, (6, 6))
    step = 1e-5
    for joint in (1, 5):
        a, b = angles[:, joint - 1], angles[:, joint]
        torque = (energy(a + step, b) - energy(a - step, b)) / (2 * step)  # truncation of step^2
        expected = coefficients[joint - 1] * np.tanh(torque)
        np.testing.assert_allclose(own_turns(virtual, angles, joint), expected, rtol=0, atol=1e-7)


def test_the_base_settles_anew_in_every_session_and_creeps_as_the_root_of_time():
    preset = Preset(
        base_settling_um=20.0, base_creep_um_per_sqrt_h=6.0, base_creep_arcsec_per_sqrt_h=3.0, reading_interval_s=36.0
    )
    virtual = VirtualArm.draw(ARM, preset, seed=0)
    angles = np.tile(ARM.working, (101, 1))
    base = np.stack([virtual.motions(angles, virtual.state(angles, seed=seed))[:, 0] for seed in range(300)])
    assert (base[:, 0, :3] == 0).all()
    # 900 numbers each: their standard deviation is known to 2.4 %; 4 sigma. The last reading is one hour later.
    walked = base[:, -1] - base[:, 0]
    assert base[:, 0, 3:].std() == pytest.approx(20e-3, rel=0.1)
    assert walked[:, 3:].std() == pytest.approx(6e-3, rel=0.1)
    assert walked[:, :3].std() / ARCSEC == pytest.approx(3.0, rel=0.1)
    halfway = (base[:, 50] - base[:, 0])[:, 3:].std()
    assert halfway == pytest.approx(6e-3 * np.sqrt(0.5), rel=0.1)
    assert virtual.motions(angles[:1])[0, 0] == pytest.approx(np.zeros(6), abs=0)


def test_a_base_that_stands_has_no_terms():
    firm = replace(
        PRESETS["worn"], base_settling_um=0.0, base_creep_um_per_sqrt_h=0.0, base_creep_arcsec_per_sqrt_h=0.0
    )
    assert BASE not in error_model(ARM, firm).groups


def test_the_floor_knows_the_wear():
    """Wear is in the true function: it does not raise the floor, of some um."""
    angles = ARM.working + np.random.default_rng(0).uniform(-1, 1, (500, 6)) * np.radians(20)
    floors = []
    for name in ("shop", "worn"):
        virtual = VirtualArm.draw(ARM, PRESETS[name], seed=0)
        floors.append(virtual.noise_floor(virtual.measure(angles, seed=0))["rms_mm"])
    # A reading of noisy angles falls on another side of a tooth now and then.
    assert floors[1] == pytest.approx(floors[0], rel=0.03)


@pytest.mark.parametrize("name", ["spot_width_deg", "gear_ratio", "slack_zone_Nm"])
def test_widths_and_ratios_are_positive(name):
    refuses(name, Preset, **{name: 0.0})
