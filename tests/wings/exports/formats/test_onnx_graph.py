"""Laws of the ONNX export: the graph is the model, and a graph of another kind is refused before it runs."""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest
from planted_models import (
    angles_of,
    empty_models,
    every_term,
    network_model,
    planted_model,
    rail_arm,
    stated_readings,
    without_some_coefficients,
)

import truearm as ta
from refusals import refuses
from truearm import errors
from truearm.errors import MissingTool
from truearm.identification.terms import Constant, Term
from truearm.identification.terms.basis import Basis
from truearm.readings import Session
from truearm.wings.exports.formats import onnx_graph
from truearm.wings.exports.targets.manifest import MARKER, Manifest, read_manifest

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


@pytest.mark.parametrize("kind", ["nominal", pytest.param("kinematic", marks=pytest.mark.weekly), "physical"])
def test_the_graph_of_a_fitted_model_gives_its_points(kind, tmp_path):
    session = ta.simulate("ur10", poses=60, preset="shop", seed=3).session
    models = {"nominal": ta.NominalModel, "kinematic": ta.KinematicModel, "physical": ta.PhysicalModel}
    options = {"highest": 4} if kind == "physical" else {}
    model = models[kind](ta.load_arm("ur10"), **options).fit_readings(session)
    path = written(model, tmp_path)
    assert_same_points(onnx_graph.tips(path, session.angles), model.predict(session.angles), model.arm_)


def test_terms_of_zero_coefficients_are_not_in_the_graph(tmp_path):
    model, angles = without_some_coefficients(planted_model(ta.load_arm("ur10"))), angles_of(ta.load_arm("ur10"), 10)
    path = written(model, tmp_path)
    assert_same_points(onnx_graph.tips(path, angles), model.predict(angles), model.arm_)
    whole, terms = onnx.load(path).graph, model.fit_.perturbed_chain.terms
    model.fit_ = model.fit_.select(lambda term: terms.index(term) % 3)
    graph = onnx.load(written(model, tmp_path)).graph
    assert (whole.node, whole.initializer) == (graph.node, graph.initializer)


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


def content_of(model, path):
    """Outcome and detail of evaluating the file at its check poses."""
    finding = next(one for one in ta.check_export(model, path).findings if one.what == "content")
    return finding.outcome, finding.detail


def offset_model(seed=1):
    """A model of which joint 1 has an offset and nothing else differs."""
    offset = Term("offset", 1, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), Constant(), "g", 1e-3)
    return planted_model(ta.load_arm("ur10"), [offset], seed=seed)


def with_manifest_of(path, other, to):
    """The file with the manifest of another one."""
    model = onnx.load(path)
    onnx.helper.set_model_props(model, {MARKER: onnx.load(other).metadata_props[0].value})
    onnx.save(model, to)
    return to


def test_the_check_poses_are_met(planted):
    model, path = planted
    assert read_manifest(path) == Manifest.of(model, "onnx")
    assert ta.check_export(model, path).agrees


def test_a_graph_in_another_unit_misses_the_check_poses(planted, tmp_path):
    """Somebody divides the output by a thousand."""
    model, path = planted
    graph = onnx.load(path)
    graph.graph.node[-1].output[0] = "tip_in_mm"
    graph.graph.initializer.append(onnx.numpy_helper.from_array(np.array(1e-3), "metres"))
    graph.graph.node.append(onnx.helper.make_node("Mul", ["tip_in_mm", "metres"], ["tip_mm"]))
    onnx.save(graph, tmp_path / "x.onnx")
    outcome, detail = content_of(model, tmp_path / "x.onnx")
    assert outcome == "differs"
    assert "metres for millimetres" in detail


def test_a_graph_fed_with_degrees_misses_the_check_poses(planted):
    _, path = planted
    manifest = read_manifest(path)
    got = onnx_graph.tips(path, np.rad2deg(manifest.joints))
    assert np.linalg.norm(got - manifest.tips, axis=1).max() > 1e6 * manifest.tolerance_mm


def test_a_correction_applied_twice_misses_the_check_poses(tmp_path):
    """Angles that a controller has corrected already, and then the graph: here by the offset of a joint."""
    model = offset_model()
    path = written(model, tmp_path)
    manifest = read_manifest(path)
    corrected = manifest.joints.copy()
    corrected[:, 0] += model.fit_.coefficients[0]
    off = np.linalg.norm(onnx_graph.tips(path, corrected) - manifest.tips, axis=1).max()
    assert off > 1e4 * manifest.tolerance_mm


def test_the_graph_of_another_robot_misses_the_check_poses(tmp_path):
    mine, other = offset_model(seed=1), offset_model(seed=2)
    for name, model in (("mine", mine), ("other", other)):
        (tmp_path / name).mkdir()
        written(model, tmp_path / name)
    other_path = tmp_path / "other" / "arm.onnx"
    assert not ta.check_export(mine, other_path).agrees
    renamed = with_manifest_of(other_path, tmp_path / "mine" / "arm.onnx", tmp_path / "x.onnx")
    assert content_of(mine, renamed)[0] == "differs"


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
    refuses("basis Own", onnx_graph.write, model, manifest, tmp_path / "arm.onnx")
    assert not list(tmp_path.iterdir())


def test_the_graph_of_an_arm_without_coefficients_gives_its_points(tmp_path):
    for model in empty_models():
        angles = angles_of(model.arm_, 5, 1)
        assert_same_points(onnx_graph.tips(written(model, tmp_path), angles), model.predict(angles), model.arm_)


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_missing_package_is_named(planted, package, monkeypatch, tmp_path):
    model, path = planted

    def without(name):
        if name == package:
            raise ImportError(name)
        return __import__(name)

    monkeypatch.setattr(errors, "import_module", without)
    with pytest.raises(MissingTool, match=rf"need the package {package}.*pip install {package}"):
        onnx_graph.tips(path, angles_of(model.arm_, 1))
    assert content_of(model, path)[0] == "not run"
    if package == "onnx":
        refuses("package onnx", onnx_graph.write, model, read_manifest(path), tmp_path / "arm.onnx")


@pytest.mark.parametrize("content", [b"", b"not a graph", b"\x08\x08", bytes(1000)])
def test_what_is_no_graph_is_refused(content, tmp_path):
    path = tmp_path / "arm.onnx"
    path.write_bytes(content)
    refuses(r"not an ONNX graph|from joints", onnx_graph.tips, path, np.zeros((1, 6)))


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
    refuses(match, onnx_graph.tips, tmp_path / "x.onnx", np.zeros(joints))


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


def test_inputs_that_do_not_fit_are_refused(planted):
    model, path = planted
    n = model.arm_.n_joints + 1
    refuses(rf"\(n, {n - 1}\), got \(1, {n}\)", onnx_graph.tips, path, np.zeros((1, n)))
    refuses("finite tips", onnx_graph.tips, path, np.full((1, n - 1), np.nan))
    refuses("does not run", onnx_graph.tips, path, angles_of(model.arm_, 1), wind=np.zeros(1))


# The guide -----------------------------------------------------------------------------------------------------------


def test_the_lines_of_the_guide_run(tmp_path, monkeypatch):
    page = Path(__file__).resolve().parents[4] / "docs" / "export.md"
    if not page.is_file():
        pytest.skip("the guide is not beside the tests")
    model = planted_model(ta.load_arm("ur10"))
    written(model, tmp_path)
    monkeypatch.chdir(tmp_path)
    (lines,) = re.findall(r"```python\n(.*?)```", page.read_text().partition("## ONNX")[2].partition("\n## ")[0], re.S)
    found: dict[str, np.ndarray] = {}
    exec(lines, found)
    assert_same_points(found["tip_mm"], model.predict(found["joints"]), model.arm_)
