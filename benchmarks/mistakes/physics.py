"""What moves beside the arm: a reference that drifts while the room warms; arms whose axes are parallel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import truearm as ta
from benchmarks.mistakes import mistake, right
from benchmarks.uncertainty import SHARE_OF_PRIOR, drawn, topology
from truearm.identification.terms import directions
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.laboratory.tasks.feature_postures import feature_postures, middle_of
from truearm.wings.laboratory.tasks.features import UP, circle
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual.presets import ARCSEC

STEEL_PER_K = 11.5e-6
POSES, NOISE_MM = 80, 0.01


def warming(moved_mm: FloatArray, degC: FloatArray) -> tuple[ta.Arm, Session]:
    """Points of a UR10 of steel in a box of poses, while the reference moves by (n,) mm."""
    arm, rng = ta.load_arm("ur10"), np.random.default_rng(0)
    angles = arm.working + 0.35 * rng.uniform(-1, 1, (POSES, arm.n_joints))
    grown = arm.chain.tip_in_base(angles) * (1 + STEEL_PER_K * (degC - 20))[:, None]
    points = grown + np.outer(moved_mm - moved_mm.mean(), [0.6, 0.8, 0.0])
    return arm, Session(angles, points + NOISE_MM * rng.standard_normal(points.shape), temperature_degC=degC)


def holds_at_24_degC(moved_mm: FloatArray) -> bool:
    """Whether points of a warm day are within twice their uncertainty, root mean square."""
    arm, session = warming(moved_mm, np.linspace(19.0, 19.8, POSES))
    warm = Session(session.angles, temperature_degC=np.full(POSES, 24.0))
    points, covariance = ta.PhysicalModel(arm).fit_readings(session).predict_readings(warm, return_cov=True)
    off = points - arm.chain.tip_in_base(session.angles) * (1 + STEEL_PER_K * 4)
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0])
    return bool(np.sqrt(squares.mean() / 3) < 2)


def u_over_error(name: str, share: float, model: str = "auto") -> float:
    """Uncertainty of points of an arm by their error, root mean squares."""
    nominal = topology(name)
    learned, tested = drawn(nominal, POSES, 0, share)
    points, covariance = ta.fit(nominal, learned, model=model).model.predict_readings(tested, return_cov=True)
    return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).sum() / ((points - tested.points) ** 2).sum()))


TIME = np.linspace(0, 1, POSES)


@mistake("a reference that drifts by 0.1 mm while the room warms by 0.8 K, used at 24 degC")
def drift() -> bool:
    return holds_at_24_degC(0.1 * TIME)


@mistake("a tracker that moves twice by 0.05 mm while the room warms by 0.8 K, used at 24 degC")
def two_moves() -> bool:
    return holds_at_24_degC(0.05 * ((TIME > 0.33) + 1.0 * (TIME > 0.66)))


@mistake("a reference that drifted by 0.1 mm in a warming room, used where it stood at first")
def where_it_stood() -> bool:
    arm, session = warming(0.1 * TIME, np.linspace(19.0, 19.8, POSES))
    then = Session(session.angles, temperature_degC=np.full(POSES, 19.4))
    points, covariance = ta.PhysicalModel(arm).fit_readings(session).predict_readings(then, return_cov=True)
    off = points - arm.chain.tip_in_base(session.angles) * (1 - STEEL_PER_K * 0.6) + [0.03, 0.04, 0.0]
    return bool((np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off) < 7.815).mean() >= 0.9)


@mistake("a reference that drifts by 0.1 mm in a warming room: said", said="The base or the reference drifts")
def drift_is_said() -> str:
    arm, session = warming(0.1 * TIME, np.linspace(19.0, 19.8, POSES))
    return str(ta.fit(arm, session, model="physical"))


@mistake("u of a SCARA by its error")
def scara() -> bool:
    return 0.75 < u_over_error("SCARA", 0.0) < 1.33


@mistake("u of a planar arm of two joints by its error")
def planar() -> bool:
    return 0.75 < u_over_error("planar, 2 joints", SHARE_OF_PRIOR, "kinematic") < 1.33


@mistake("u of a cylindrical arm by its error")
def cylindrical() -> bool:
    return 0.75 < u_over_error("cylindrical", 0.0, "kinematic") < 1.33


@right("an arm of steel that warms by 0.8 K, the reference at rest", unsaid="drifts|reference moved|contradict")
def warms_alone() -> str:
    arm, session = warming(0 * TIME, np.linspace(19.0, 19.8, POSES))
    return str(ta.fit(arm, session, model="physical"))


@right("the growth of steel, from temperatures that swing by 8 K")
def swinging_room() -> bool:
    arm, session = warming(0.1 * TIME, 20 + 8 * np.sin(np.arange(POSES)))
    there = [replace(session, points=None, temperature_degC=np.full(POSES, degC)) for degC in (20.0, 30.0)]
    model = ta.PhysicalModel(arm).fit_readings(session)
    grown = np.subtract(*(model.predict_readings(one) for one in there[::-1]))
    true = arm.chain.tip_in_base(session.angles) * STEEL_PER_K * 10
    return bool(np.linalg.norm(grown - true, axis=1).mean() < 0.3 * np.linalg.norm(true, axis=1).mean())


@right("a SCARA with the errors of its makers", unsaid="drifts|contradict|outlier")
def scara_alone() -> str:
    nominal = topology("SCARA")
    return str(ta.fit(nominal, drawn(nominal, POSES, 1, SHARE_OF_PRIOR)[0], model="kinematic"))


@mistake("a bore touched from its middle by an arm that lags by 6 arcsec, without directions")
def lagging_bore() -> bool:
    arm = ta.load_arm("gao2017")
    rng, lag = np.random.default_rng(0), 6 * ARCSEC * np.array([1.0, 1, -1, 1, -1, 1])
    poses = measuring_poses(arm, POSES, seed=0).angles
    points = arm.chain.tip_in_base(poses) + NOISE_MM * rng.standard_normal((POSES, 3))
    model = ta.KinematicModel(arm).fit_readings(Session(poses - lag * directions(poses), points))
    middle, _ = middle_of(arm)
    touched = feature_postures(arm, circle(middle, UP, 40.0), 1, seed=1)[0]
    own_axes = arm.chain.tip_derivatives(touched).motion_jacobian[:, 1:-1, 2].transpose(0, 2, 1)
    from_middle = np.linalg.pinv(own_axes) @ (arm.chain.tip_in_base(touched) - middle)[:, :, None]
    bore = Session(touched - lag * np.sign(from_middle[:, :, 0]))
    diameter = ta.measure(model, bore, "circle", n_arms=100).features[0].quantities[0]
    return abs(diameter.value - 40.0) <= diameter.expanded
