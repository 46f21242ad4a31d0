"""Noise, repeats and orientations; an arm that sags."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import truearm as ta
from benchmarks.mistakes import mistake, right
from truearm.arm.chain import Chain
from truearm.identification.terms.links import gravity_torques, uniform_links
from truearm.readings import Session
from truearm.typing import FloatArray

ARM = ta.load_arm("ur10")
N = 60
SECOND = np.arange(N) >= N // 2


def real_chain(rng: np.random.Generator, arm: ta.Arm = ARM) -> Chain:
    """An arm whose constants err by a milliradian and 0.3 mm."""
    motions = np.zeros((arm.chain.n_places, 6))
    motions[1:-1] = rng.normal(size=(arm.chain.n_places - 2, 6)) * [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3]
    return arm.chain.with_motions(motions)


def repeated(n: int, times: int, *, seed: int, noise_mm: float = 1.0) -> Session:
    """Poses read several times by an instrument with noise; the arm is the same whatever the seed."""
    rng, chain = np.random.default_rng(seed), real_chain(np.random.default_rng(0))
    angles = np.repeat(rng.uniform(-1.5, 1.5, (n, 6)), times, axis=0)
    return Session(angles, chain.tip_in_base(angles) + noise_mm * rng.normal(size=(n * times, 3)))


def is_covered(trained: int, tested: int) -> bool:
    """Whether 95 % ellipsoids hold what they say, after poses were read `trained` times, of means of `tested`."""
    model = ta.fit(ARM, repeated(200, trained, seed=1), model="kinematic").model
    coverage = ta.evaluate(model, repeated(400, tested, seed=2)).coverage
    return coverage is not None and 0.93 <= coverage <= 0.985


@mistake("poses read 4 times, single readings tested")
def single_readings_after_means() -> bool:
    return is_covered(4, 1)


@mistake("poses read 10 times, single readings tested")
def single_readings_after_many() -> bool:
    return is_covered(10, 1)


@mistake("poses read 4 times, so the test")
def means_after_means() -> bool:
    return is_covered(4, 4)


@mistake("poses read once, the test 4 times")
def means_after_single_readings() -> bool:
    return is_covered(1, 4)


def turned(
    *, turn_deg: float = 0.02, remount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0), **names: FloatArray
) -> Session:
    """Poses of a marker, which was mounted again for the second half."""
    rng = np.random.default_rng(1)
    chain, angles = real_chain(rng), rng.uniform(-1.5, 1.5, (N, 6))
    marker = Rotation.from_matrix(chain.pose(angles).R_base_tip) * Rotation.from_rotvec([0.2, 0.3, 0.5])
    marker = marker * Rotation.from_rotvec(SECOND[:, None] * np.radians(remount_deg))
    marker = marker * Rotation.from_rotvec(np.radians(turn_deg) * rng.normal(size=(N, 3)))
    points = chain.tip_in_base(angles) + 0.05 * rng.normal(size=(N, 3))
    return Session(angles, points, quaternion=marker.as_quat(scalar_first=True), **names)


def fitted(session: Session) -> str:
    return str(ta.fit(ARM, session, model="kinematic"))


@mistake("a marker mounted again without a word", said="the orientations differ .* deg .* if the marker was mounted")
def marker_mounted_again() -> str:
    return fitted(turned(remount_deg=(90.0, 0.0, 30.0)))


@mistake("orientations of other poses", said=r"the orientations differ from those of the nominal arm .* by 1\d\d deg")
def orientations_of_other_poses() -> str:
    session = turned()
    assert session.quaternion is not None
    return fitted(replace(session, quaternion=np.roll(session.quaternion, 7, axis=0)))


@mistake("orientations with the scalar part last", said="order of their numbers")
def scalar_part_last() -> str:
    session = turned()
    assert session.quaternion is not None
    return fitted(replace(session, quaternion=np.roll(session.quaternion, -1, axis=1)))


@mistake("orientations far noisier than points", said="The orientations scatter by [23].* deg about each axis")
def noisy_orientations() -> str:
    return fitted(turned(turn_deg=2.6))


@right("a marker mounted again in another session", unsaid="orientations")
def marker_mounted_in_another_session() -> str:
    return fitted(turned(remount_deg=(90.0, 0.0, 30.0), session=np.where(SECOND, "B", "A")))


@right("a marker on another tip", unsaid="orientations")
def marker_on_another_tip() -> str:
    return fitted(turned(remount_deg=(170.0, 0.0, 30.0), tip=np.where(SECOND, "B", "A")))


def sagging(name: str, *, few: bool, sign: float = 1.0, rad_per_Nm: float = 2e-4) -> str:
    """What the doctor says of an arm that sags by some mm; with `few` only two joints move, with a sign J2 is wrong."""
    arm, rng = ta.load_arm(name), np.random.default_rng(3)
    angles = rng.uniform(-1.3, 1.3, (N, arm.n_joints))
    if few:
        angles[:, 2:] = 0.0
    torque = gravity_torques(arm.chain, angles, uniform_links(arm.chain, kg_per_m=20.0))[:, :, 2]
    points = real_chain(rng, arm).tip_in_base(angles + rad_per_Nm * torque) + 0.05 * rng.normal(size=(N, 3))
    angles[:, 1] *= sign
    return str(ta.diagnose(arm, Session(angles, points)))


@mistake("an arm that sags, two joints moved", said="^No mistake in the arm file: joints yield under the weight")
def sagging_in_two_joints() -> str:
    return sagging("iiwa7", few=True)


@mistake("an arm that sags, all joints moved", said="^No mistake in the arm file: joints yield under the weight")
def sagging_in_all_joints() -> str:
    return sagging("ur10", few=False)


@mistake("a wrong sign in an arm that sags", said="^sign of J2 reversed")
def wrong_sign_and_sagging() -> str:
    return sagging("gao2017", few=False, sign=-1.0, rad_per_Nm=1e-4)
