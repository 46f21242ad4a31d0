"""The virtual arm composes its terms exactly: as a plain model does, and as the arms of the same seeds always were."""

from dataclasses import replace

import numpy as np
import pytest
from forward_model import PlainArm

from truearm.arm import load_arm
from truearm.arm.arm import LinkMasses
from truearm.wings.planning.virtual import PRESETS, VirtualArm
from truearm.wings.planning.virtual.error_model import GROUPS, error_model
from truearm.wings.planning.virtual.state import link_masses

# Tips [mm] of arms of seed 11, in the last of three poses: at rest, and in a session of seed 6. Written down before
# the arms were drawn from terms; the figures of the documentation rest on them.
GOLDEN = {
    ("gao2017", "research"): (
        [576.728546746726, 217.86433167141968, 91.82216911275698],
        [576.7284376735224, 217.8614681213457, 91.82282586991597],
    ),
    ("gao2017", "shop"): (
        [577.1406033403731, 217.23706063798315, 91.9783486190219],
        [577.1404825029605, 217.2350615258299, 91.98066215470494],
    ),
    ("measuring7", "research"): (
        [368.2318470205341, 524.0756493269681, 285.11017608743776],
        [368.234320379997, 524.072640961245, 285.1113393610446],
    ),
    ("measuring7", "shop"): (
        [367.68188282164635, 524.3754654583016, 284.2909557211969],
        [367.68387883961543, 524.3707426400765, 284.29102119266184],
    ),
    ("ur10", "research"): (
        [690.816731887856, -170.2867270041495, 976.7081220095403],
        [690.8167741242798, -170.28886605616208, 976.7141467794885],
    ),
    ("ur10", "shop"): (
        [690.1101245355319, -170.61617962078594, 977.187709880151],
        [690.1086981442791, -170.62091543513583, 977.1971658111491],
    ),
}


@pytest.fixture(scope="module", params=GOLDEN, ids="-".join)
def drawn(request):
    name, preset = request.param
    return request.param, VirtualArm.draw(load_arm(name), preset, seed=11)


def poses(arm, n=3):
    return arm.working + np.random.default_rng(4).uniform(-1, 1, (n, arm.n_joints)) * 0.5


def test_a_seed_gives_the_arm_that_it_always_gave(drawn):
    key, virtual = drawn
    angles = poses(virtual.nominal)
    measured = virtual.measure(angles, seed=6)
    # The last digits written down are rounding; a draw that differs does so by micrometres.
    np.testing.assert_allclose(virtual.true_tip(angles)[-1], GOLDEN[key][0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(measured.true_tips[-1], GOLDEN[key][1], rtol=0, atol=1e-6)


def test_the_true_tips_are_those_of_a_plain_forward_model(drawn):
    _, virtual = drawn
    arm, preset = virtual.nominal, virtual.preset
    constrained = virtual.systematic.geometry if preset.nominal_mean_mm > 0 else None
    plain = PlainArm(arm, preset, virtual.seed, link_masses(arm, preset), constrained)
    state = virtual.state(poses(arm, 5), seed=2)
    force = np.stack([state.columns[f"tip_force_{axis}_N"] for axis in "xyz"], axis=1)
    phase = [state.columns[f"cage_phase_{joint}_rad"][0] for joint in range(1, arm.n_joints + 1)]
    expected = [
        plain.tip(state.angles[i], state.directions[i], state.temperature_degC[i], force[i], phase) for i in range(5)
    ]
    # Products of a dozen matrices with lengths of 1e3 mm: rounding is 1e-12.
    np.testing.assert_allclose(virtual.true_tip(state.angles, state), expected, rtol=0, atol=1e-9)


def test_the_plain_model_agrees_on_an_arm_with_its_own_masses_that_hangs_askew():
    arm = load_arm("gao2017")
    masses = LinkMasses([4.0, 3.0, 0.0, 2.0, 1.0, 0.5], np.random.default_rng(3).uniform(-100, 100, (6, 3)))
    arm = replace(arm, masses=masses, gravity_in_base=np.array([1.0, 2.0, -2.0]))
    preset = replace(PRESETS["shop"], joint_drive_arcsec_per_Nm=0.4, link_bending_stiffness_Nm2=5e3, name="soft")
    virtual = VirtualArm.draw(arm, preset, seed=4)
    plain = PlainArm(arm, preset, 4, masses)
    angles = poses(arm)
    rest = virtual.resting(angles)
    force = np.array([rest.columns[f"tip_force_{axis}_N"][0] for axis in "xyz"])
    expected = [plain.tip(q, np.zeros(6), np.full(7, 22.0), force, np.zeros(6)) for q in angles]
    np.testing.assert_allclose(virtual.true_tip(angles), expected, rtol=0, atol=1e-9)


def test_coefficients_scatter_as_the_standard_deviations_of_their_terms():
    arm, preset = load_arm("gao2017"), replace(PRESETS["shop"], expansion_per_K=0.0, tip_compliance_um_per_N=0.0)
    model = error_model(arm, preset)
    about_zero = np.isin(
        model.groups, ["geometry", "encoders", "bearings", "hysteresis", "ball cages", "thermal expansion"]
    )
    std = np.concatenate([term.prior_stds for term in model.terms])
    drawn = np.stack([model.draw(seed) for seed in range(100)])[:, about_zero] / std[about_zero]
    # Some 200 coefficients, 100 arms: the mean square is known to 1 %.
    assert (drawn**2).mean() == pytest.approx(1.0, abs=0.04)
    assert np.abs(drawn.mean()) < 0.03


def test_every_group_has_terms_in_the_shop_and_none_in_a_perfect_arm():
    arm = load_arm("measuring7")
    assert set(error_model(arm, PRESETS["shop"]).groups) == set(GROUPS)
    assert error_model(arm, PRESETS["perfect"]).terms == ()


def test_a_group_scaled_changes_its_motions_in_proportion_and_no_other():
    virtual = VirtualArm.draw(load_arm("measuring7"), "shop", seed=0)
    angles, systematic = poses(virtual.nominal), virtual.systematic
    motions = virtual.motions(angles)
    for group in GROUPS:
        twice, without = (
            replace(virtual, systematic=systematic.scaled({group: factor})).motions(angles) for factor in (2.0, 0.0)
        )
        np.testing.assert_allclose(twice - motions, motions - without, rtol=0, atol=1e-15)


def test_geometry_comes_back_as_it_was_put_in():
    virtual = VirtualArm.draw(load_arm("ur10"), "shop", seed=0)
    motions = np.random.default_rng(0).standard_normal(virtual.systematic.geometry.shape)
    motions[-1, :3] = 0.0
    np.testing.assert_array_equal(virtual.systematic.with_geometry(motions).geometry, motions)


def test_geometry_that_a_preset_has_no_terms_for_is_refused():
    virtual = VirtualArm.draw(load_arm("ur10"), "perfect", seed=0)
    with pytest.raises(ValueError, match="no terms for some motions"):
        virtual.systematic.with_geometry(np.ones((8, 6)))
