"""Laws of every basis: what it says of itself as expressions is what it evaluates, and what every export writes.

A basis that is registered and not among `BASES` fails here.
"""

import json
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest
from planted_models import angles_of, planted_model, rail_arm

import truearm as ta
from refusals import refuses
from truearm.identification.terms import (
    ArmState,
    Basis,
    Column,
    Constant,
    Direction,
    Expression,
    Formula,
    GravityTorque,
    Harmonics,
    InducedProcess,
    InSession,
    OfTip,
    PayloadTorque,
    Temperature,
    Term,
    basis,
    register_basis,
)
from truearm.identification.terms.linear_axis import Travel, TravelHarmonics
from truearm.models.training_conditions import InputRange
from truearm.readings import Session
from truearm.wings.exports.formats import c_source, es_module, json_document, json_model, onnx_graph
from truearm.wings.exports.targets.manifest import Manifest

PAYLOAD_KG = 2.0
Q2, Q5 = Expression.angle(2), Expression.angle(5)
PROCESS = InducedProcess((0.1, 0.2, 0.3, 40.0, 0.5, 100.0, 0.4, -0.2, 50.0, 0.2), (200.0, 1, 1, 90.0, 1), (1, 4))
# One of every registered class. The arm slides along joints 1 and 4.
BASES = {
    type(one).__name__: one
    for one in (
        *(Constant(), Harmonics(2, (1, 2, 7)), GravityTorque(2, 1), Temperature(2), Direction(5), Column("load_kg")),
        *(InSession("second"), OfTip("ball"), Travel(1, 40.0), TravelHarmonics(1, 1234.5, (1, 3)), PROCESS),
        PayloadTorque(3, 1, PAYLOAD_KG),
        Formula((
            (2 * Q2).cos() * Expression.gravity_torque(3, 0) + 0.5,
            Expression.temperature(1) ** 2 * Expression.column("load_kg"),
            Expression.column("load_kg") ** 2,
            (Q5 - 0.3) ** 3 * Expression.direction(2) + (0.7 * Q5).sin() * Expression.gravity_torque(0, 1),
            Expression.session("second") * Q5,
            (3e9 * Q5).cos(),  # an order that no harmonic has
            Expression.payload_torque(2, 1, PAYLOAD_KG) + Q2 * Q5,
        )),
    )
}  # fmt: skip
# What no export but JSON contains, and why its refusal says so.
REFUSED = {"InducedProcess": "residual process"}


@register_basis
@dataclass(frozen=True)
class BeltStretch(Basis):
    """A user's own basis, which says what it is and does not evaluate itself."""

    joint: int

    def labels(self):
        return ("belt", "belt, twice")

    def expressions(self):
        q = Expression.angle(self.joint)
        return (q * Expression.gravity_torque(self.joint, 2), (2 * q).sin() / 3)


def full_state(arm, n=30):
    rng = np.random.default_rng(2)
    return ArmState.of(
        arm,
        angles_of(arm, n, 6),
        temperature_degC=rng.uniform(18, 26, (n, arm.n_joints + 1)),
        directions=rng.choice([-1.0, 1.0], (n, arm.n_joints)),
        columns={"load_kg": rng.uniform(0, 5, n), "payload_kg": rng.uniform(0, 5, n)},
        session=rng.choice(["", "second"], n),
        tip=rng.choice(["ball", "pen"], n),
    )


def test_every_registered_basis_is_among_these():
    ours = {name for name, kind in basis._KINDS.items() if kind.__module__.startswith("truearm.")}
    assert ours == set(BASES)
    assert {name for name, one in BASES.items() if one.expressions() is None} == set(REFUSED)


@pytest.mark.parametrize("name", sorted(set(BASES) - set(REFUSED)))
def test_what_a_basis_says_is_what_it_evaluates(name):
    one, state = BASES[name], full_state(rail_arm())
    said = np.stack([expression.values(state) for expression in one.expressions()])
    # Rounding of arguments of some 10 rad, of torques of some 100 N m and displacements of some 100 mm.
    np.testing.assert_allclose(one.values(state), said, rtol=1e-13, atol=1e-13)
    if type(one).values is Basis.values:
        np.testing.assert_array_equal(one.values(state), said)


@pytest.mark.parametrize("name", sorted(BASES))
def test_a_basis_that_readings_may_lack_says_so(name):
    """A state of joint angles alone has all that a basis without stated inputs depends on."""
    one, bare = BASES[name], ArmState.of(rail_arm(), angles_of(rail_arm(), 3))
    if one.has_stated_inputs:
        refuses("expected readings with", one.values, bare)
    else:
        assert np.isfinite(one.values(bare)).all()


@pytest.mark.parametrize("name", sorted(BASES))
def test_a_basis_comes_back_from_data_and_from_that_of_its_expressions(name):
    one = BASES[name]
    assert basis.basis_from_data(json.loads(json.dumps(one.as_data()))) == one
    if one.expressions() is not None:
        formula = Formula(one.expressions())
        assert basis.basis_from_data(json.loads(json.dumps(formula.as_data()))) == formula


def model_of(bases):
    """A model with these bases at several places, its payload that of the training."""
    arm, terms = rail_arm(), [Term("J1", 1, (0, 0, 1, 0, 0, 0), Constant(), "constants", 1e-3)]
    for i, one in enumerate(bases):
        size = float(np.abs(one.values(full_state(arm))).max() or 1.0)
        for place, axis, std in ((i % 6 + 1, i % 3, 1e-3), (i % 5 + 1, 3 + i % 3, 1.0)):
            direction = tuple(np.eye(6)[axis])
            terms.append(Term(f"{type(one).__name__} {axis}", place, direction, one, "all", std / size))
    model = planted_model(arm, terms)
    payload = InputRange(PAYLOAD_KG, 0.0, PAYLOAD_KG, PAYLOAD_KG)
    model.training_ = replace(model.training_, columns=model.training_.columns | {"payload_kg": payload})
    return model


@pytest.fixture(scope="module")
def model():
    return model_of([*(BASES[name] for name in sorted(set(BASES) - set(REFUSED))), BeltStretch(2)])


def stated(arm, n=8):
    rng = np.random.default_rng(3)
    return Session(
        angles_of(arm, n, 4),
        temperature_degC=rng.uniform(20, 26, n),
        directions=rng.choice([-1.0, 1.0], (n, arm.n_joints)),
        columns={"load_kg": rng.uniform(0, 5, n), "payload_kg": np.full(n, PAYLOAD_KG)},
    )


def close(got, model, readings):
    np.testing.assert_allclose(got, model.predict_readings(readings), rtol=0, atol=1e-11 * model.arm_.chain.reach)


def test_json_has_every_basis(model, tmp_path):
    path = tmp_path / "arm.json"
    json_model.write(model, Manifest.of(model, "json"), path)
    readings = Session(stated(model.arm_).angles)
    close(json_model.tips(path, readings.angles), model, readings)
    kinds = {term["basis"]["kind"] for term in json.loads(path.read_text())["identified"]["terms"]}
    assert kinds == {one.__name__ for one in json_document.NAMED} - set(REFUSED) | {"Formula"}


def test_onnx_has_every_basis(model, tmp_path):
    pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    path, readings = tmp_path / "arm.onnx", stated(model.arm_)
    onnx_graph.write(model, Manifest.of(model, "onnx"), path)
    states = {"temperature_degC": readings.temperature_degC, "directions": readings.directions}
    got = onnx_graph.tips(path, readings.angles, load_kg=readings.columns["load_kg"], **states)
    close(got, model, readings)
    close(onnx_graph.tips(path, readings.angles), model, Session(readings.angles))


def test_c_has_every_basis(model, tmp_path):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is installed")
    path, readings = tmp_path / "arm.c", Session(stated(model.arm_).angles)
    c_source.write(model, Manifest.of(model, "c"), path)
    c_source.compile_library(path, tmp_path, "-pedantic", "-Wall", "-Wextra", "-Werror")
    close(c_source.tips(path, readings.angles), model, readings)


def test_javascript_has_every_basis_and_its_uncertainty(model, tmp_path):
    if shutil.which("node") is None:
        pytest.skip("Node.js is not installed")
    path, readings = tmp_path / "arm.mjs", stated(model.arm_)
    es_module.write(model, Manifest.of(model, "js"), path)
    rows = [
        [
            q.tolist(),
            {
                "temperature_degC": readings.temperature_degC[i],
                "direction": readings.directions[i].tolist(),
                "column": {name: column[i] for name, column in readings.columns.items()},
            },
        ]
        for i, q in enumerate(readings.angles)
    ]
    found = es_module.run_module(path, "predict", rows)
    close([row["xyz"] for row in found], model, readings)
    covariances = model.predict_readings(readings, return_cov=True)[1]
    u, expected = (np.sqrt(np.diagonal(c, axis1=1, axis2=2)) for c in ([row["cov"] for row in found], covariances))
    np.testing.assert_allclose(u, expected, rtol=1e-3)  # the table has whole numbers


@pytest.mark.parametrize("name", REFUSED)
def test_what_an_export_does_not_contain_it_refuses_by_name(name, tmp_path):
    model = model_of([BASES[name]])
    json_model.write(model, Manifest.of(model, "json"), tmp_path / "arm.json")
    close(json_model.tips(tmp_path / "arm.json", angles_of(model.arm_, 5)), model, Session(angles_of(model.arm_, 5)))
    for module in (c_source, es_module, onnx_graph):
        refuses(REFUSED[name], module.write, model, Manifest.of(model, "c"), tmp_path / "arm")


@dataclass(frozen=True)
class Unsaid(Basis):
    """A user's own basis that evaluates itself and does not say what it is."""

    def labels(self):
        return ("unsaid",)

    def values(self, state):
        return np.exp(-(state.angles[:, :1].T ** 2))


def test_a_basis_without_expressions_is_refused_with_what_to_do(tmp_path):
    model = model_of([Unsaid()])
    for module in (c_source, es_module, onnx_graph, json_model):
        with pytest.raises(ta.InputError, match=r"basis Unsaid, .* give the basis a method expressions"):
            module.write(model, Manifest.of(model, "c"), tmp_path / "arm")
    assert not list(tmp_path.iterdir())
