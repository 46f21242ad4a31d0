"""Laws of the ONNX export: the graph is the model, and a graph of another kind is refused before it runs."""

from __future__ import annotations

import contextlib
import json

import numpy as np
import pytest
from planted_models import angles_of, every_term, network_model, planted_model, rail_arm, stated_readings

import truearm as ta
from truearm.compensation.export import onnx_graph
from truearm.compensation.targets.manifest import MARKER, Manifest, read_manifest
from truearm.identification.terms import Constant, Term
from truearm.identification.terms.basis import Basis
from truearm.readings import Session

onnx = pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

# Of the reach: some thousand roundings of doubles. The target of an export is 1e-12.
RELATIVE = 1e-13


def written(model, folder):
    path = folder / "arm.onnx"
    onnx_graph.write(model, Manifest.of(model, "onnx"), path)
    return path


def assert_same_points(got, expected, arm):
    np.testing.assert_allclose(got, expected, rtol=0, atol=RELATIVE * max(arm.chain.reach, np.abs(expected).max()))


@pytest.fixture(scope="module", params=["ur10", "rail"])
def planted(request, tmp_path_factory):
    arm = rail_arm() if request.param == "rail" else ta.load_arm(request.param)
    model = planted_model(arm)
    return model, written(model, tmp_path_factory.mktemp(request.param))


def test_the_graph_gives_the_model_s_points_with_stated_inputs(planted):
    model, path = planted
    readings = stated_readings(model.arm_)
    states = {
        "temperature_degC": readings.temperature_degC,
        "directions": readings.directions,
        "load_kg": readings.columns["load_kg"],
    }
    got = onnx_graph.tips(path, readings.angles, **states)
    assert_same_points(got, model.predict_readings(readings), model.arm_)
    for name in states:  # each alone, the others as on average in training
        alone = Session(
            readings.angles,
            temperature_degC=readings.temperature_degC if name == "temperature_degC" else None,
            directions=readings.directions if name == "directions" else None,
            columns=readings.columns if name == "load_kg" else {},
        )
        got = onnx_graph.tips(path, readings.angles, **{name: states[name]})
        assert_same_points(got, model.predict_readings(alone), model.arm_)


@pytest.mark.parametrize("n", [1, 2, 40])
def test_the_graph_gives_the_model_s_points_for_any_number_of_readings(planted, n):
    model, path = planted
    angles = angles_of(model.arm_, n, 7)
    assert_same_points(onnx_graph.tips(path, angles), model.predict(angles), model.arm_)


@pytest.mark.parametrize("kind", ["nominal", "kinematic", "physical"])
def test_the_graph_of_a_fitted_model_gives_its_points(kind, tmp_path):
    session = ta.simulate("ur10", poses=60, preset="shop", seed=3).session
    models = {"nominal": ta.NominalModel, "kinematic": ta.KinematicModel, "physical": ta.PhysicalModel}
    options = {"highest": 4} if kind == "physical" else {}
    model = models[kind](ta.load_arm("ur10"), **options).fit_readings(session)
    path = written(model, tmp_path)
    assert_same_points(onnx_graph.tips(path, session.angles), model.predict(session.angles), model.arm_)


@pytest.mark.parametrize("activation", ["tansig", "logsig", "purelin"])
def test_the_graph_of_a_network_gives_its_points(activation, tmp_path):
    model = network_model(activation)
    path = written(model, tmp_path)
    angles = angles_of(model.arm_, 20)
    assert_same_points(onnx_graph.tips(path, angles), model.predict(angles), model.arm_)


@pytest.mark.parametrize("turn", [0.0, 1e-170, 1e-9, 1e-4, 3.0])
def test_a_rotation_of_any_size_is_exact(turn, tmp_path):
    """A rotation vector that depends on the reading, in addition to one that does not."""
    arm = ta.load_arm("ur10")
    state = Term("by load", 2, (turn, 0.0, turn, 0.0, 0.0, 1e-3), every_term(arm)[-3].basis, "g", 1.0)
    model = planted_model(arm, [state])
    model.fit_.coefficients[:] = 1.0
    path = written(model, tmp_path)
    angles = angles_of(arm, 10)
    assert_same_points(onnx_graph.tips(path, angles, load_kg=np.ones(10)), model.predict_readings(
        Session(angles, columns={"load_kg": np.ones(10)})
    ), arm)  # fmt: skip


def test_inputs_say_their_units_and_defaults(planted):
    model, path = planted
    graph = onnx.load(path).graph
    inputs = {value.name: value.doc_string for value in graph.input}
    assert list(inputs) == ["joints", "temperature_degC", "directions", "load_kg"]
    assert "rad" in inputs["joints"]
    assert "degC" in inputs["temperature_degC"]
    defaults = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    assert defaults["temperature_degC"] == model.training_.temperature_degC.mean
    assert "mm" in graph.output[0].doc_string


def test_a_model_without_states_has_one_input(tmp_path):
    arm = ta.load_arm("ur10")
    model = planted_model(arm, [term for term in every_term(arm) if isinstance(term.basis, Constant)])
    assert [value.name for value in onnx.load(written(model, tmp_path)).graph.input] == ["joints"]


def test_the_file_is_double_precision_of_a_stated_version(planted):
    _, path = planted
    model = onnx.load(path)
    assert (model.ir_version, model.opset_import[0].version, model.producer_name) == (8, 17, "truearm")
    kinds = {tensor.data_type for tensor in model.graph.initializer}
    assert kinds == {onnx.TensorProto.DOUBLE, onnx.TensorProto.INT64}
    assert {node.op_type for node in model.graph.node} <= onnx_graph.OPERATORS


def test_the_same_model_gives_the_same_file(planted, tmp_path):
    model, path = planted
    assert written(model, tmp_path).read_bytes() == path.read_bytes()


# Check poses ---------------------------------------------------------------------------------------------------------


def worst_mm(path):
    """Largest deviation of the file from its own check poses [mm]."""
    manifest = read_manifest(path)
    return float(np.linalg.norm(onnx_graph.tips(path, manifest.joints) - manifest.tips, axis=1).max())


def test_the_check_poses_are_met(planted):
    model, path = planted
    assert read_manifest(path) == Manifest.of(model, "onnx")
    assert worst_mm(path) < read_manifest(path).tolerance_mm


def with_manifest(path, change, to):
    """The file with its manifest changed by a function of the plain data."""
    model = onnx.load(path)
    data = json.loads(model.metadata_props[0].value)
    change(data)
    onnx.helper.set_model_props(model, {MARKER: json.dumps(data)})
    onnx.save(model, to)
    return to


def in_degrees(data):
    for pose in data["check_poses"]:
        pose["joints"] = np.rad2deg(pose["joints"]).tolist()


def in_metres(data):
    for pose in data["check_poses"]:
        pose["tip_mm"] = (np.array(pose["tip_mm"]) / 1000).tolist()


@pytest.mark.parametrize("wrong_unit", [in_degrees, in_metres])
def test_a_wrong_unit_misses_the_check_poses(planted, tmp_path, wrong_unit):
    _, path = planted
    changed = with_manifest(path, wrong_unit, tmp_path / "changed.onnx")
    assert worst_mm(changed) > 1e6 * read_manifest(changed).tolerance_mm


def test_a_correction_applied_twice_misses_the_check_poses(tmp_path):
    """Angles that a controller has corrected already, and then the graph: here by the offset of a joint."""
    arm = ta.load_arm("ur10")
    offset = Term("offset", 1, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), Constant(), "g", 1e-3)
    model = planted_model(arm, [offset])
    path = written(model, tmp_path)
    manifest = read_manifest(path)
    corrected = manifest.joints.copy()
    corrected[:, 0] += model.fit_.coefficients[0]
    off = np.linalg.norm(onnx_graph.tips(path, corrected) - manifest.tips, axis=1).max()
    assert off > 1e4 * manifest.tolerance_mm


def test_the_graph_of_another_robot_misses_the_check_poses(tmp_path):
    arm = ta.load_arm("ur10")
    mine = onnx.load(written(planted_model(arm, seed=1), tmp_path))
    other = written(planted_model(arm, seed=2), tmp_path)
    path = with_manifest(other, lambda data: data.update(json.loads(mine.metadata_props[0].value)), tmp_path / "x")
    assert worst_mm(path) > 1e4 * read_manifest(path).tolerance_mm


# What is refused -----------------------------------------------------------------------------------------------------


class Own(Basis):
    """A basis of a user's own."""

    def labels(self):
        return ("own",)

    def values(self, state):
        return np.ones((1, len(state)))


def test_a_user_s_own_basis_is_refused_and_nothing_is_written(tmp_path):
    arm = ta.load_arm("ur10")
    model = planted_model(arm)
    manifest = Manifest.of(model, "onnx")
    model = planted_model(arm, [Term("own", 1, (1.0, 0, 0, 0, 0, 0), Own(), "g", 1e-3)])
    with pytest.raises(ta.InputError, match="basis Own"):
        onnx_graph.write(model, manifest, tmp_path / "arm.onnx")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_named(planted, package, monkeypatch, tmp_path):
    model, path = planted

    def without(name):
        if name == package:
            raise ImportError(name)
        return __import__(name)

    monkeypatch.setattr(onnx_graph, "import_module", without)
    with pytest.raises(ta.InputError, match=rf"need the package {package}.*pip install {package}"):
        onnx_graph.tips(path, angles_of(model.arm_, 1))
    if package == "onnx":
        with pytest.raises(ta.InputError, match="package onnx"):
            onnx_graph.write(model, read_manifest(path), tmp_path / "arm.onnx")


@pytest.mark.parametrize("content", [b"", b"not a graph", b"\x08\x08", bytes(1000)])
def test_what_is_no_graph_is_refused(content, tmp_path):
    path = tmp_path / "arm.onnx"
    path.write_bytes(content)
    with pytest.raises(ta.InputError, match=r"not an ONNX graph|from joints"):
        onnx_graph.tips(path, np.zeros((1, 6)))


def test_a_damaged_file_is_refused_or_gives_finite_points(planted, tmp_path):
    model, path = planted
    content, rng = path.read_bytes(), np.random.default_rng(3)
    angles = angles_of(model.arm_, 2)
    for _ in range(15):
        at = int(rng.integers(len(content)))
        damaged = bytearray(content)
        damaged[at] ^= 0xFF
        (tmp_path / "x.onnx").write_bytes(damaged)
        with contextlib.suppress(ta.InputError):
            assert np.isfinite(onnx_graph.tips(tmp_path / "x.onnx", angles)).all()


def hostile(nodes, inputs=None, constants=()):
    make = onnx.helper
    inputs = inputs or [make.make_tensor_value_info("joints", 11, ("n", 6))]
    outputs = [make.make_tensor_value_info("tip_mm", 11, ("n", 3))]
    graph = make.make_graph(nodes, "g", inputs, outputs, list(constants))
    return make.make_model(graph, opset_imports=[make.make_opsetid("", 17)], ir_version=8)


def large(name, shape):
    return onnx.numpy_helper.from_array(np.ones(shape), name)


def refused(model, tmp_path, match, joints=(1, 6)):
    onnx.save(model, tmp_path / "x.onnx")
    with pytest.raises(ta.InputError, match=match):
        onnx_graph.tips(tmp_path / "x.onnx", np.zeros(joints))


def test_other_operators_are_refused(tmp_path):
    node = onnx.helper.make_node("Slice", ["joints", "a", "b", "c"], ["tip_mm"])
    ends = [onnx.numpy_helper.from_array(np.array([i]), name) for name, i in (("a", 0), ("b", 3), ("c", 1))]
    refused(hostile([node], constants=ends), tmp_path, "does not write: .*Slice")


def test_data_in_other_files_is_refused(tmp_path):
    node = onnx.helper.make_node("MatMul", ["joints", "w"], ["tip_mm"])
    weights = large("w", (6, 3))
    onnx.external_data_helper.set_external_data(weights, "weights.bin")
    weights.ClearField("raw_data")
    (tmp_path / "weights.bin").write_bytes(np.ones((6, 3)).tobytes())
    refused(hostile([node], constants=[weights]), tmp_path, "does not write|not an ONNX graph")


def test_large_intermediate_values_are_refused(tmp_path):
    make = onnx.helper
    nodes = [
        make.make_node("MatMul", ["tall", "wide"], ["square"]),
        make.make_node("MatMul", ["joints", "w"], ["tip_mm"]),
    ]
    constants = [large("tall", (400, 1)), large("wide", (1, 400)), large("w", (6, 3))]
    refused(hostile(nodes, constants=constants), tmp_path, "intermediate values")


def test_another_number_of_joints_is_refused(planted):
    model, path = planted
    n = model.arm_.n_joints + 1
    with pytest.raises(ta.InputError, match=rf"\(n, {n - 1}\), got \(1, {n}\)"):
        onnx_graph.tips(path, np.zeros((1, n)))


def test_points_that_are_not_finite_are_refused(planted):
    model, path = planted
    with pytest.raises(ta.InputError, match="finite tips"):
        onnx_graph.tips(path, np.full((1, model.arm_.n_joints), np.nan))


def test_an_unknown_input_is_refused(planted):
    model, path = planted
    with pytest.raises(ta.InputError, match="does not run"):
        onnx_graph.tips(path, angles_of(model.arm_, 1), wind=np.zeros(1))
