"""What hangs on a virtual arm, and where its weight pulls, are the arm's own."""

from dataclasses import replace

import numpy as np
import pytest

from truearm.arm import LinkMasses, load_arm
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.identification.terms import uniform_links
from truearm.models import PhysicalModel
from truearm.wings.planning.virtual import PRESETS, Preset, VirtualArm
from truearm.wings.planning.virtual.presets import ARCSEC

SOFT = Preset(link_kg_per_m=2.0, joint_tilt_arcsec_per_Nm=2.0)
WEIGHT_PRESET = replace(
    PRESETS["perfect"],
    reference_std_mm=0.002,
    **{
        name: getattr(PRESETS["research"], name)
        for name in Preset.__dataclass_fields__
        if name.startswith(("joint_", "link_"))
    },
)


def mast(**more) -> Arm:
    """One joint about the base's z, its tip 1 m above on its axis."""
    return Arm("mast", Chain(np.tile(np.eye(4), (2, 1, 1)), [0, 0, 1000]), **more)


@pytest.mark.parametrize("along", [[0, 0, -1], [0, 0, 1], [1, 0, 0], [0, -1, 0], [3, 4, 0]])
def test_a_mast_leans_where_its_weight_pulls(along):
    shift = VirtualArm.draw(mast(gravity_in_base=along), SOFT, seed=0).true_tip([[0.0]])[0] - [0, 0, 1000]
    # 2 kg/m over 1 m, 0.5 m above the joint: 9.80665 N m when the mast lies across the weight.
    lean = 2.0 * 9.80665 * ARCSEC * 1000 * np.array([*along[:2], 0]) / np.linalg.norm(along)
    # The turn by 1e-4 rad is composed exactly: its second order is 5e-9 of 1 m.
    np.testing.assert_allclose(shift, lean, rtol=0, atol=1e-5)


def test_known_masses_hang_on_the_joints():
    masses = LinkMasses([5.0], [[0, 0, 200.0]])
    shift = VirtualArm.draw(mast(gravity_in_base=[1, 0, 0], masses=masses), SOFT, seed=0).true_tip([[0.0]])[0]
    assert shift[0] == pytest.approx(2.0 * 9.80665 * ARCSEC * 1000, rel=1e-6)  # 5 kg at 0.2 m: also 9.80665 N m


@pytest.mark.parametrize("name", ["research", "shop"])
def test_an_upright_arm_of_uniform_links_is_the_one_of_which_nothing_is_known(name):
    arm, preset = load_arm("gao2017"), PRESETS[name]
    told = replace(
        arm, masses=uniform_links(arm.chain, kg_per_m=preset.link_kg_per_m), gravity_in_base=np.array([0, 0, -1.0])
    )
    angles = arm.working + np.random.default_rng(0).uniform(-1, 1, (20, 6))
    one, other = (VirtualArm.draw(which, preset, seed=1).true_tip(angles) for which in (arm, told))
    assert (one == other).all()


def test_an_arm_on_a_wall_is_fitted_as_well_as_an_upright_one():
    errors, shown = [], []
    for along in ([0, 0, -1.0], [1.0, 0, 0]):
        arm = replace(load_arm("gao2017"), gravity_in_base=along)
        virtual = VirtualArm.draw(arm, WEIGHT_PRESET, seed=1)
        rng = np.random.default_rng(0)
        angles, fresh = (arm.working + 0.8 * rng.uniform(-1, 1, (150, 6)) for _ in range(2))
        readings = replace(virtual.measure(angles, seed=2).readings, point_std=None)
        model = PhysicalModel(arm, free=(), highest=2).fit_readings(readings)
        shown.append(virtual.true_tip(fresh))
        errors.append(np.linalg.norm(model.predict(fresh) - shown[-1], axis=1).mean())
    assert np.abs(shown[0] - shown[1]).max() > 0.05  # mm: another pull, another arm
    # Noise of 2 um: both are found to about as much. With the pull of the upright arm the error on the wall is 9 um.
    assert max(errors) < 0.003
