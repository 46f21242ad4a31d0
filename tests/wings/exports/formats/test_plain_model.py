"""Laws of the plain tables: an independent composition of them gives the model's points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.arm.arm import LinkMasses
from truearm.identification.terms import Expression
from truearm.identification.terms.links import gravity_torques
from truearm.wings.exports.formats.plain_model import PlainModel, plain_model


def tip(plain: PlainModel, q: np.ndarray, degC: float) -> np.ndarray:
    """The tip at one reading, composed place by place with SciPy's rotations."""
    links = LinkMasses(plain.mass_kg, plain.centre_in_joint_mm)
    torques = gravity_torques(plain.nominal_chain, q[None], links, gravity_in_base=plain.gravity_in_base)[0]

    def value(function: Expression) -> float:
        of = function.arguments
        match function.operation:
            case "number":
                return of[0]
            case "angle":
                return q[of[0] - 1]
            case "product":
                return float(np.prod([value(one) for one in of]))
            case "cos" | "sin":
                return float(getattr(np, function.operation)(value(of[0])))
            case "gravity torque" if of[0]:
                return float(torques[of[0] - 1, of[1]])
            case "gravity torque":
                return float((Rotation.from_rotvec([0, 0, q[0]]).as_matrix() @ torques[0])[of[1]])
            case "temperature":
                return degC - 20.0
        return 0.0

    motions = np.zeros((plain.n_joints + 2, 6))
    for function, place, row in zip(plain.functions, plain.place, plain.motion_by_function, strict=True):
        motions[place] += value(function) * row
    v = plain.chain.tip_in_flange + motions[-1, 3:]
    for i in range(plain.n_joints, -1, -1):
        v = plain.chain.fixed[i, :3, :3] @ v + plain.chain.fixed[i, :3, 3] if i else v
        v = Rotation.from_rotvec(motions[i, :3]).apply(v) + motions[i, 3:]
        if i:
            v = Rotation.from_rotvec([0, 0, q[i - 1]]).apply(v)
    return plain.chain.fixed[0, :3, :3] @ v + plain.chain.fixed[0, :3, 3]


@pytest.fixture(scope="module")
def session() -> ta.Session:
    return ta.simulate("ur10", poses=150, preset="shop", seed=3).session


@pytest.mark.parametrize("kind", ["nominal", pytest.param("kinematic", marks=pytest.mark.weekly), "physical"])
def test_the_tables_compose_to_the_model_s_points(session, kind):
    model = ta.fit("ur10", session, model=kind, **({"highest": 8} if kind == "physical" else {})).model
    plain = plain_model(model)
    degC = 20.0 if model.training_.temperature_degC is None else model.training_.temperature_degC.mean
    q = session.angles[:20]
    got = np.array([tip(plain, row, degC) for row in q])
    np.testing.assert_allclose(got, model.predict(q), rtol=0, atol=1e-9)  # mm, rounding at a reach of 1.5 m


def test_the_root_gives_the_covariance_of_the_coefficients(session):
    model = ta.fit("ur10", session, model="kinematic").model
    plain = plain_model(model)
    own = model.fit_.covariance.diagonal()
    np.testing.assert_allclose((plain.covariance_root**2).sum(axis=0), own[own > 0], rtol=1e-9)
    assert plain.coefficient_direction.shape == (plain.covariance_root.shape[1], 6)


def test_a_network_has_no_such_tables():
    session = ta.simulate("gao2017", poses=40, seed=1).session
    model = ta.NetworkModel(ta.load_arm("gao2017"), hidden=(3,), epochs=3).fit(session.angles, session.points)
    refuses("expected a nominal, kinematic or physical model", plain_model, model)
