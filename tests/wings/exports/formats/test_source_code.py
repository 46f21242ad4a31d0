"""Laws of the exported source code: C and JavaScript compute what Python does."""

import ctypes
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from planted_models import angles_of, empty_models, every_term, network_model, planted_model, rail_arm, stated_readings

import truearm as ta
from refusals import refuses
from truearm.arm import Arm, Chain
from truearm.errors import MissingTool
from truearm.identification.terms import Column, Constant, Harmonics, PayloadTorque, Term
from truearm.identification.terms.basis import Basis
from truearm.models.identified_model import ROUNDED
from truearm.models.training_conditions import TOGETHER, InputRange
from truearm.readings import Session
from truearm.wings.exports.formats import c_source, es_module, reduced_covariance, source_code
from truearm.wings.exports.formats.reduced_covariance import sample_trained_region
from truearm.wings.exports.formats.source_code import macros_of
from truearm.wings.exports.targets.correction import correct_targets
from truearm.wings.exports.targets.manifest import Manifest, read_manifest
from truearm.wings.exports.targets.targets import Targets

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")

STRICT = ("-pedantic", "-Wall", "-Wextra", "-Werror")
RELATIVE = 1e-12  # of the reach; rounding is 1e-15
EXACT_SHARE = 1e-3  # of a standard uncertainty: the table has whole numbers
REDUCED_SHARE = 0.01  # of a standard uncertainty: leading directions and a variance by joint


CONSTANT = Term("base", 0, (1, 0, 0, 0, 0, 0), Constant(), "base", 1e-3)


def make_model(name):
    """A model by its name; motions of the one called large are up to 0.5 rad: more than a correction may be."""
    if name in ("large", "ur10", "measuring7", "rail"):
        arm = rail_arm() if name == "rail" else ta.load_arm("ur10" if name == "large" else name)
        model = planted_model(arm)
        share = 1.0 if name == "large" else 0.01
        model.fit_ = replace(model.fit_, coefficients=share * model.fit_.coefficients)
        return model
    session = ta.simulate("ur10", poses=40, preset="shop", seed=3).session
    return ta.fit("ur10", session, model=name).model


@dataclass
class Written:
    """A model, its two files, and the compiled library."""

    model: ta.KinematicModel
    c: object
    js: object
    library: ctypes.CDLL

    def state(self, readings=None, row=0):
        n, names = self.model.arm_.n_joints, sorted(self.model.training_.columns)

        class State(ctypes.Structure):
            _fields_ = (
                ("temperature_degC", ctypes.c_double),
                ("direction", ctypes.c_double * n),
                ("column", ctypes.c_double * (len(names) + 1)),
            )

        nan = float("nan")
        state = State(
            nan, (ctypes.c_double * n)(*[nan] * n), (ctypes.c_double * (len(names) + 1))(*[nan] * (len(names) + 1))
        )
        if readings is not None:
            if readings.temperature_degC is not None:
                state.temperature_degC = readings.temperature_degC[row]
            if readings.directions is not None:
                state.direction = (ctypes.c_double * n)(*readings.directions[row])
            for i, name in enumerate(names):
                if name in readings.columns:
                    state.column[i] = readings.columns[name][row]
        return state

    def predict(self, readings, *, stated=True):
        """Points, covariances and codes."""
        q = np.ascontiguousarray(readings.angles)
        xyz, cov = np.full((len(q), 3), np.nan), np.full((len(q), 3, 3), np.nan)
        codes = []
        for i in range(len(q)):
            state = ctypes.byref(self.state(readings, i)) if stated else None
            codes.append(self.library.truearm_predict(pointer(q[i]), state, pointer(xyz[i]), pointer(cov[i])))
        return xyz, cov, np.array(codes)

    def joints(self, function, q):
        """Joints and codes of one of the functions that turn joints into joints."""
        q = np.ascontiguousarray(q)
        out = np.full_like(q, np.nan)
        call = getattr(self.library, function)
        return out, np.array([call(pointer(a), None, pointer(b)) for a, b in zip(q, out, strict=True)])


def readings_of(model, n, seed=5):
    """Readings that state what the model knows."""
    readings = stated_readings(model.arm_, n, seed)
    return replace(readings, columns={name: readings.columns[name] for name in model.training_.columns})


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


def uncertainty(covariances):
    return np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))


def both_files(model, folder):
    """The files in C and JavaScript; their table of uncertainties is of fewer poses than users have."""
    c, js = folder / "arm.c", folder / "arm.mjs"
    with pytest.MonkeyPatch.context() as patch:  # enough for some 150 coefficients
        for name, n in (("N_POSES", 3000), ("N_BEYOND", 1000), ("N_JUDGES", 500)):
            patch.setattr(reduced_covariance, name, n)
        c_source.write(model, Manifest.of(model, "c"), c)
        es_module.write(model, Manifest.of(model, "js"), js)
    return c, js


@pytest.fixture(
    scope="module",
    params=[
        "large",
        "rail",
        *(pytest.param(name, marks=pytest.mark.weekly) for name in ("ur10", "measuring7", "kinematic")),
    ],
)
def written(request, tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is installed")
    folder, model = tmp_path_factory.mktemp(request.param), make_model(request.param)
    c, js = both_files(model, folder)
    # Without optimisation a compiler is fast, with it it sees more to warn of.
    level = "-O2" if request.param in ("large", "kinematic") else "-O0"
    library = ctypes.CDLL(str(c_source.compile_library(c, folder, *STRICT, level)))
    library.truearm_check.restype = ctypes.c_double
    return Written(model, c, js, library)


def test_c_gives_the_points_uncertainties_and_codes_of_the_model(written):
    model = written.model
    readings = readings_of(model, 40)
    expected, covariances = model.predict_readings(readings, return_cov=True)
    points, cov, codes = written.predict(readings)
    np.testing.assert_allclose(points, expected, rtol=0, atol=RELATIVE * model.arm_.chain.reach)
    # A written file looks at each joint by itself.
    inputs = {name: rows for name, rows in model.inputs_outside_training(readings).items() if name != TOGETHER}
    outside = np.logical_or.reduce([np.zeros(40, dtype=bool), *inputs.values()])
    np.testing.assert_array_equal(codes == 1, outside)
    # These readings are outside the trained range, where the table is only roughly right.
    np.testing.assert_allclose(uncertainty(cov), uncertainty(covariances), rtol=0.2)


def test_a_joint_counted_on_by_full_turns_is_where_it_was(written):
    model, rng = written.model, np.random.default_rng(7)
    slides = model.arm_.chain.is_prismatic
    inside = sample_trained_region(model, 8, rng).angles
    inside[0] -= np.where(np.arange(len(slides)) == np.flatnonzero(~slides)[-1], 2 * np.pi, 0.0)
    turns = np.where(slides, 0, rng.integers(-3, 4, (2, *inside.shape)))
    far = np.where(rng.random(inside.shape) < 0.3, 1.5 * inside, inside)
    angles = np.concatenate([inside, inside + 2 * np.pi * turns[0], far + 2 * np.pi * turns[1]])
    found = model.training_.outside(Session(angles), slides)
    outside = np.zeros(len(angles), dtype=bool)
    for name, rows in found.items():
        outside |= rows & (name != TOGETHER)
    assert not outside[:16].any()
    assert outside.any()
    codes = written.predict(Session(angles))[2]
    np.testing.assert_array_equal(codes == 1, outside)
    if shutil.which("node"):
        rows = es_module.run_module(written.js, "predict", [[q.tolist()] for q in angles])
        assert [row["outside"] for row in rows] == outside.tolist()


def test_c_gives_the_uncertainties_in_the_trained_region(written):
    model, rng = written.model, np.random.default_rng(11)
    state = sample_trained_region(model, 300, rng)
    stated = Session(
        state.angles, temperature_degC=state.temperature_degC, directions=state.directions, columns=state.columns
    )
    few = len(model.fit_.coefficients) <= 96
    for readings in (stated, Session(state.angles)):
        covariances = model.predict_readings(readings, return_cov=True)[1]
        cov = written.predict(readings, stated=readings is stated)[1]
        limit = EXACT_SHARE if few else REDUCED_SHARE
        np.testing.assert_allclose(uncertainty(cov), uncertainty(covariances), rtol=limit)
        trace = np.trace(covariances, axis1=1, axis2=2)[:, None, None]
        np.testing.assert_allclose(cov / trace, covariances / trace, rtol=0, atol=3 * limit)
        np.testing.assert_array_equal(cov, cov.transpose(0, 2, 1))


def test_unstated_inputs_count_with_the_training_mean_and_its_variance(written):
    model = written.model
    readings = Session(angles_of(model.arm_, 30, 2))
    expected, covariances = model.predict_readings(readings, return_cov=True)
    unknown, null = written.predict(readings), written.predict(readings, stated=False)
    for one, other in zip(unknown, null, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(unknown[0], expected, rtol=0, atol=RELATIVE * model.arm_.chain.reach)
    np.testing.assert_allclose(uncertainty(unknown[1]), uncertainty(covariances), rtol=0.1)


def test_the_check_poses_pass_and_the_covariance_is_optional(written):
    assert written.library.truearm_check() < RELATIVE * written.model.arm_.chain.reach
    manifest = read_manifest(written.c)
    assert manifest == read_manifest(written.js).model_copy(update={"format": "c"})
    for q, tip in zip(manifest.joints, manifest.tips, strict=True):
        xyz = np.zeros(3)
        assert written.library.truearm_predict(pointer(q), None, pointer(xyz), None) in (0, 1)
        np.testing.assert_allclose(xyz, tip, rtol=0, atol=1e-9)
    np.testing.assert_allclose(c_source.tips(written.c, manifest.joints), manifest.tips, rtol=0, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e7])
def test_c_refuses_bad_joints_and_writes_nothing(written, bad):
    q = written.model.arm_.working.copy()
    q[-1] = bad
    xyz, cov, out = np.full(3, 7.0), np.full(9, 7.0), np.full(len(q), 7.0)
    assert written.library.truearm_predict(pointer(q), None, pointer(xyz), pointer(cov)) == -1
    assert written.library.truearm_correct(pointer(q), None, pointer(out)) == -1
    assert written.library.truearm_feedback(pointer(q), None, pointer(out)) == -1
    assert (xyz == 7).all()
    assert (cov == 7).all()
    assert (out == 7).all()


@pytest.mark.parametrize("field", ["temperature", "direction", "column"])
def test_c_refuses_bad_states(written, field):
    if field == "column" and not written.model.training_.columns:
        pytest.skip("the model has no columns")
    state = written.state()
    if field == "temperature":
        state.temperature_degC = 300.0  # kelvin
    elif field == "direction":
        state.direction[0] = 2.0
    else:
        state.column[0] = float("inf")
    xyz = np.full(3, 7.0)
    q = written.model.arm_.working.copy()
    assert written.library.truearm_predict(pointer(q), ctypes.byref(state), pointer(xyz), None) == -1
    assert (xyz == 7).all()


def test_corrected_joints_bring_the_true_tip_to_the_nominal_one(written):
    model = written.model
    nominal = sample_trained_region(model, 40, np.random.default_rng(3)).angles
    command, codes = written.joints("truearm_correct", nominal)
    good = codes >= 0
    motions_are_large = len(model.fit_.coefficients) > 50 and np.abs(model.fit_.coefficients).max() > 1
    assert good.mean() > (0.1 if motions_are_large else 0.8)  # the others are near singularities or limits
    assert np.isnan(command[~good]).all()
    tips = model.predict(command[good])
    np.testing.assert_allclose(tips, model.nominal_.chain.tip_in_base(nominal[good]), rtol=0, atol=1e-8)
    if motions_are_large:
        return  # back, some changes are beyond the usual ones
    back, codes = written.joints("truearm_feedback", command[good])
    assert (codes >= 0).all()
    np.testing.assert_allclose(back, nominal[good], rtol=0, atol=1e-7)  # rad, or mm


def test_corrected_joints_are_those_of_python(written):
    model = written.model
    nominal = sample_trained_region(model, 40, np.random.default_rng(4)).angles
    for direction, function in (("command", "truearm_correct"), ("feedback", "truearm_feedback")):
        expected = correct_targets(model, Targets(nominal), direction=direction, untrained="accept", uncertainty=False)
        joints, codes = written.joints(function, nominal)
        both = ~expected.refused
        np.testing.assert_array_equal(codes >= 0, both)
        # Joints that the pose leaves free hang on the Jacobian, in which Python neglects the slopes of gravity.
        atol = 1e-9 if model.arm_.n_joints == 6 else 1e-4
        np.testing.assert_allclose(joints[both], expected.joints[both], rtol=0, atol=atol)
        np.testing.assert_array_equal(codes[both] == 1, expected.outside[both])


@pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")
def test_the_module_gives_what_c_gives(written):
    model, readings = written.model, readings_of(written.model, 12)
    points, cov, codes = written.predict(readings)
    names = sorted(model.training_.columns)
    rows = [
        [
            readings.angles[i].tolist(),
            {
                "temperature_degC": readings.temperature_degC[i],
                "direction": readings.directions[i].tolist(),
                "column": {name: readings.columns[name][i] for name in names},
            },
        ]
        for i in range(len(readings))
    ]
    found = es_module.run_module(written.js, "predict", rows)
    atol = RELATIVE * model.arm_.chain.reach
    np.testing.assert_allclose([row["xyz"] for row in found], points, rtol=0, atol=atol)
    np.testing.assert_allclose([row["xyz"] for row in found], model.predict_readings(readings), rtol=0, atol=atol)
    assert [row["outside"] for row in found] == (codes == 1).tolist()
    trace = np.trace(cov, axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose(np.array([row["cov"] for row in found]) / trace, cov / trace, rtol=0, atol=1e-4)
    np.testing.assert_allclose(es_module.tips(written.js, readings.angles), model.predict(readings.angles), atol=atol)
    assert es_module.run_module(written.js, "check", [[]])[0] < atol
    for call, function in (("correct", "truearm_correct"), ("feedback", "truearm_feedback")):
        joints, codes = written.joints(function, readings.angles)
        for code, q, row in zip(
            codes, joints, es_module.run_module(written.js, call, [[q.tolist()] for q in readings.angles]), strict=True
        ):
            assert ("error" in row) == (code < 0)
            if code >= 0:
                np.testing.assert_allclose(row["q"], q, rtol=0, atol=1e-7)
                assert row["outside"] == (code == 1)


def rail_robot():
    """Six joints on a rail of two metres; its stand is half a millimetre further along the rail than drawn."""
    chain = ta.load_arm("ur10").chain
    onto_rail = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    fixed = np.concatenate([onto_rail[None], (np.linalg.inv(onto_rail) @ chain.fixed[0])[None], chain.fixed[1:]])
    limits = {"lower": np.array([0.0] + [-6.0] * 6), "upper": np.array([2000.0] + [6.0] * 6)}
    working = np.array([1000.0, 0.3, -1.2, 1.4, -1.0, 1.2, 0.2])
    arm = Arm("robot", Chain(fixed, [0.0, 0.0, 90.0], [True] + [False] * 6), working_pose=working, **limits)
    model = planted_model(arm, [Term("stand", 1, (0, 0, 0, 0, 0, 1), Constant(), "stand", 1.0)])
    model.fit_ = replace(model.fit_, coefficients=np.array([-0.5]))
    return model


def at_rail_ends(model):
    """Targets at both ends of the rail, and in its middle."""
    joints = angles_of(model.arm_, 12, 3)
    joints[:, 0] = [1999.95] * 5 + [0.05] * 4 + [1000.0] * 3
    return joints


def at_trained_edges(model):
    """Targets of which one joint is at an end of its trained range, with the rounding of a unit."""
    (low, high), rng = model.training_.angle_ranges.T, np.random.default_rng(5)
    joints = rng.uniform(low, high, (2 * len(low), len(low)))
    for row, q in enumerate(joints):
        q[row % len(low)] = (low - 1e-12, high + 1e-12)[row // len(low)][row % len(low)]
    return joints


def near_a_singularity(model):
    """Targets with a wrist nearer and nearer to being straight, on both sides of the largest condition."""
    joints = np.tile(model.arm_.working, (12, 1))
    joints[:, 4] = np.logspace(-6, -2, 12)
    return joints


def all_joints(model, folder, q):
    """By direction: joints and codes from C, and the answers of JavaScript."""
    c, js = both_files(model, folder)
    written = Written(model, c, js, ctypes.CDLL(str(c_source.compile_library(c, folder, *STRICT, "-O0"))))
    for direction, call in (("command", "correct"), ("feedback", "feedback")):
        rows = es_module.run_module(js, call, [[row.tolist()] for row in q])
        yield direction, *written.joints(f"truearm_{call}", q), rows


@needs_cc
@needs_node
@pytest.mark.parametrize(
    ("make", "targets", "feature"),
    [
        (rail_robot, at_rail_ends, lambda found: (found.margins[:5, 0] == 0).all()),
        (lambda: make_model("ur10"), at_trained_edges, lambda found: not found.outside.all()),
        (
            lambda: empty_models()[0],
            near_a_singularity,
            lambda found: 0 < sum("singular" in reason for reason in found.reasons) < 12,
        ),
    ],
)
def test_the_rules_of_corrected_targets_are_those_of_python(make, targets, feature, tmp_path):
    model = make()
    q = targets(model)
    for direction, joints, codes, rows in all_joints(model, tmp_path, q):
        expected = correct_targets(model, Targets(q), direction=direction, untrained="accept", uncertainty=False)
        assert direction == "feedback" or feature(expected)
        np.testing.assert_array_equal(codes >= 0, ~expected.refused)
        np.testing.assert_array_equal(["q" in row for row in rows], ~expected.refused)
        good = ~expected.refused
        in_js = np.array([row["q"] for row in rows if "q" in row])
        for got in (joints[good], in_js):
            np.testing.assert_allclose(got, expected.joints[good], rtol=0, atol=1e-6)  # rad, or mm
        np.testing.assert_array_equal(codes[good] == 1, expected.outside[good])
        assert [row["outside"] for row in rows if "q" in row] == expected.outside[good].tolist()


@needs_cc
@needs_node
def test_rounding_of_the_angles_is_in_the_covariance(tmp_path):
    arm = rail_arm()
    model = planted_model(arm, [CONSTANT])
    std = np.array([0.3, 1e-3, 0, 0.1, 5e-4])  # mm and rad
    steps = np.sqrt(12) * std
    first = model.training_.angle_sample[0]
    raw = angles_of(arm, 6, 3)
    angles = np.where(std > 0, first + steps * np.round((raw - first) / np.where(std > 0, steps, 1)), raw)
    model.training_ = replace(model.training_, angle_std=std)
    c, js = tmp_path / "arm.c", tmp_path / "arm.mjs"
    c_source.write(model, Manifest.of(model, "c"), c)
    es_module.write(model, Manifest.of(model, "js"), js)
    written = Written(model, c, js, ctypes.CDLL(str(c_source.compile_library(c, tmp_path, *STRICT, "-O0"))))
    assert all("training angles were rounded" in file.read_text() for file in (c, js))
    expected = model.predict_readings(Session(angles), return_cov=True)[1]
    without = expected - model.unstated_input_covariances(Session(angles))[ROUNDED]
    cov = written.predict(Session(angles), stated=False)[1]
    assert (uncertainty(without) < 0.9 * uncertainty(expected)).any()
    np.testing.assert_allclose(uncertainty(cov), uncertainty(expected), rtol=REDUCED_SHARE)
    rows = es_module.run_module(js, "predict", [[q.tolist()] for q in angles])
    np.testing.assert_allclose([row["cov"] for row in rows], cov, rtol=1e-4, atol=1e-6)
    exact = angles + 0.2 * steps  # not rounded, as each of them shows
    expected = model.predict(exact, return_cov=True)[1]
    cov = written.predict(Session(exact), stated=False)[1]
    np.testing.assert_allclose(uncertainty(cov), uncertainty(expected), rtol=REDUCED_SHARE)
    rows = es_module.run_module(js, "predict", [[q.tolist()] for q in exact])
    np.testing.assert_allclose([row["cov"] for row in rows], cov, rtol=1e-4, atol=1e-6)


@needs_cc
@needs_node
def test_a_joint_counted_on_by_full_turns_has_the_uncertainty_that_it_had(tmp_path):
    arm = ta.load_arm("ur10")
    terms = [
        Term(f"gear {i}", i, (0, 0, 1, 0, 0, 0), Harmonics(i, tuple(range(1, 41))), "gear", 1e-4) for i in (1, 2, 3)
    ]
    model = planted_model(arm, terms)
    decay = np.tile(np.repeat(1 / np.arange(1, 41), 2), 3)  # without correlations the joints have most by themselves
    model.fit_ = replace(model.fit_, covariance=np.diag((1e-4 * decay) ** 2))
    slope, beyond = 0.3 * np.ones(6), replace(model.variance_function_.beyond, ranges=model.training_.angle_ranges)
    model.variance_function_ = replace(model.variance_function_, slope=slope, beyond=beyond)
    c, js = both_files(model, tmp_path)
    written = Written(model, c, js, ctypes.CDLL(str(c_source.compile_library(c, tmp_path, *STRICT, "-O0"))))
    rng = np.random.default_rng(3)
    inside = sample_trained_region(model, 60, rng).angles
    angles = inside + 2 * np.pi * rng.integers(-2, 3, (60, 6))
    expected = model.predict_readings(model.at(Session(angles)), return_cov=True)[1]
    np.testing.assert_allclose(expected, model.predict(inside, return_cov=True)[1], rtol=1e-6, atol=1e-12)
    cov = written.predict(Session(angles), stated=False)[1]
    np.testing.assert_allclose(uncertainty(cov), uncertainty(expected), rtol=REDUCED_SHARE)
    rows = es_module.run_module(js, "predict", [[q.tolist()] for q in angles])
    np.testing.assert_allclose([row["cov"] for row in rows], cov, rtol=1e-4, atol=1e-7)


def test_the_poses_of_the_table_reach_the_mean_temperature_of_a_new_set_up():
    model = planted_model(ta.load_arm("ur10"), [CONSTANT])
    model.training_ = replace(model.training_, temperature_degC=InputRange(43.0, 0.01, 21.0, 25.0))
    degC = sample_trained_region(model, 200, np.random.default_rng(3)).temperature_degC
    assert degC.min() < 25 < 42 < degC.max() < 43


@needs_cc
@needs_node
def test_a_direction_that_the_training_has_not_is_outside_and_another_payload_is_refused(tmp_path):
    arm = ta.load_arm("ur10")
    sag = Term("payload sag", 2, (1, 0, 0, 0, 0, 0), PayloadTorque(2, 0, 3.0), "sag", 1e-6)
    model = planted_model(arm, [CONSTANT, sag])
    forwards = np.array([[1.0, 1], [-1, 1], [-1, 1], [-1, -1], [-1, 1], [-1, 1]])
    columns = {"load_kg": InputRange(2.5, 1.0, 0.0, 5.0), "payload_kg": InputRange(3.0, 0.0, 3.0, 3.0)}
    model.training_ = replace(model.training_, direction_ranges=forwards, columns=columns)
    c, js = both_files(model, tmp_path)
    written = Written(model, c, js, ctypes.CDLL(str(c_source.compile_library(c, tmp_path, *STRICT, "-O0"))))
    angles = np.tile(sample_trained_region(model, 1, np.random.default_rng(2)).angles, (5, 1))
    directions = np.zeros((5, 6))
    directions[[0, 1, 2, 3], [0, 0, 3, 1]] = [1, -1, 1, -1]
    readings = Session(angles, directions=directions, columns={"payload_kg": np.array([3.0, 3, 3, 3, 4])})
    inputs = model.inputs_outside_training(readings)
    outside = inputs["direction_1"] | inputs["direction_4"]
    assert outside.tolist() == [False, True, True, False, False]
    codes = written.predict(readings)[2]
    assert codes.tolist() == [0, 1, 1, 0, -1]
    stated = [
        [q.tolist(), {"direction": one.tolist(), "column": {"payload_kg": kg}}]
        for q, one, kg in zip(angles, directions, readings.columns["payload_kg"], strict=True)
    ]
    rows = es_module.run_module(js, "predict", stated)
    assert [row.get("outside") for row in rows] == [False, True, True, False, None]
    assert "payload of the training" in rows[4]["error"]


@needs_node
@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([[0.0] * 5], "expected 6 joints, got 5"),
        ([None], "expected 6 joints"),
        ([[0.0, 0, 0, 0, 0, None]], "in rad or mm"),
        ([[0.0, 0, 0, 0, 0, 1e7]], "in rad or mm"),
        ([[0.0] * 6, {"temperature_degC": 300}], "temperature"),
        ([[0.0] * 6, {"direction": [2]}], "directions"),
        ([[0.0] * 6, {"column": {"load": 1}}], "unknown column"),
    ],
)
def test_the_module_refuses_bad_input(tmp_path, nominal, arguments, problem):
    path = tmp_path / "arm.mjs"
    es_module.write(nominal, Manifest.of(nominal, "js"), path)
    found = es_module.run_module(path, "predict", [arguments])[0]
    assert problem in found["error"]


@pytest.fixture(scope="module")
def nominal():
    return make_model("nominal")


@needs_cc
def test_the_sanitizers_find_nothing_over_random_and_hostile_inputs(tmp_path):
    model = make_model("rail")
    c_source.write(model, Manifest.of(model, "c"), tmp_path / "arm.c")
    (tmp_path / "main.c").write_text(HOSTILE_MAIN)
    flags = ["-std=c99", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = ["cc", *flags, "-o", str(tmp_path / "program"), str(tmp_path / "main.c"), "-lm"]
    built = subprocess.run(command, capture_output=True, text=True)
    if "cannot find" in built.stderr:
        pytest.skip("the sanitizers' libraries are not installed")
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(tmp_path / "program")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "600\n"


HOSTILE_MAIN = """
#include "arm.c"
#include <stdio.h>
#include <float.h>
static unsigned long seed = 1;
static double draw(void)
{
    seed = seed * 6364136223846793005UL + 1442695040888963407UL;
    return (double)(seed >> 11) / 9007199254740992.0;
}
static double hostile(double usual)
{
    static const double worst[] = {NAN,  INFINITY, -INFINITY, 1e300, -1e300, 1e6,
                                   -1e6, DBL_MIN,  4e-324,    0.0,   -0.0,   999999.0};
    return draw() < 0.1 ? worst[(int)(draw() * 12)] : usual * (2 * draw() - 1);
}
int main(void)
{
    int i, j, done = 0;
    for (i = 0; i < 600; i++) {
        double q[TRUEARM_JOINTS], out[TRUEARM_JOINTS], xyz[3], cov[9];
        truearm_state s = truearm_unknown();
        for (j = 0; j < TRUEARM_JOINTS; j++) q[j] = hostile(i % 2 ? 3.0 : 300.0);
        if (i % 3) s.temperature_degC = hostile(60.0);
        if (i % 5) s.direction[0] = hostile(1.0);
        if (TRUEARM_COLUMNS) s.column[0] = hostile(5.0);
        if (truearm_predict(q, i % 7 ? &s : NULL, xyz, i % 2 ? cov : NULL) >= 0)
            for (j = 0; j < 3; j++) if (xyz[j] - xyz[j] != 0.0) return 3;
        if (i % 40 == 0) {
            truearm_correct(q, &s, out);
            truearm_feedback(q, &s, out);
        }
        done++;
    }
    printf("%d\\n", done);
    return truearm_check() < 1e-6 ? 0 : 4;
}
"""


@needs_cc
def test_declarations_alone_and_a_hostile_name_compile(tmp_path, nominal):
    model = planted_model(
        replace(nominal.arm_, name='*/ /* ??/ -- " \\ \n#error', serial_number="*/int x;/*"), [CONSTANT]
    )
    c_source.write(model, Manifest.of(model, "c"), tmp_path / "arm.c")
    main = tmp_path / "main.c"
    main.write_text(
        '#define TRUEARM_DECLARATIONS_ONLY\n#include "arm.c"\n#include "arm.c"\nint main(void)'
        "{ return truearm_check() < 1e-6 ? 0 : 1; }\n"
    )
    program = tmp_path / "program"
    command = ["cc", "-std=c99", *STRICT, "-o", str(program), str(main), str(tmp_path / "arm.c"), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert subprocess.run([str(program)]).returncode == 0
    assert read_manifest(tmp_path / "arm.c").provenance.serial_number == "*/int x;/*"
    if shutil.which("g++"):
        command = ["g++", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c++", str(tmp_path / "arm.c")]
        assert subprocess.run(command).returncode == 0


SYSTEM = 'extern int system(const char *);\n__attribute__((constructor)) static void p(void) { system("touch {ran}"); }'
WRITE = '(await import("node:fs")).writeFileSync("{ran}", "");'
ATTACKS = (
    f"*/ {SYSTEM} /*",
    f"*/ {WRITE} /*",
    f"\n{SYSTEM}\n//",
    f"\u2028{WRITE}\n//",
    f'"]; {WRITE} ["',
    "??/",
    "\\",
    "ü -->",
)


@needs_cc
@needs_node
def test_texts_of_a_model_file_never_run(tmp_path, nominal):
    """Names of all that has one, past the checks of a model file: the last of two walls."""
    ran = tmp_path / "ran"
    texts = [attack.replace("{ran}", str(ran)) for attack in ATTACKS]
    arm = replace(
        nominal.arm_, name=texts[0], title=texts[1], serial_number=texts[0] + texts[5], joint_names=tuple(texts[:6])
    )
    model = planted_model(arm, [Term("load", 2, (0, 0, 0, 0, 0, 1), Column("load_kg"), "load", 0.1)])
    model.training_.columns.update(dict.fromkeys(texts, model.training_.columns["load_kg"]))
    terms = tuple(Term(text, 2, (0, 0, 0, 0, 0, 1), Column(text), text, 0.1) for text in texts[:1])
    model.fit_ = replace(model.fit_, perturbed_chain=replace(model.fit_.perturbed_chain, terms=terms))
    c, js = tmp_path / "arm.c", tmp_path / "arm.mjs"
    c_source.write(model, Manifest.of(model, "c"), c)
    es_module.write(model, Manifest.of(model, "js"), js)
    q = nominal.arm_.working[None]
    c_source.compile_library(c, tmp_path, *STRICT, "-O0")
    for module, path in ((c_source, c), (es_module, js)):
        np.testing.assert_allclose(module.tips(path, q), model.predict(q), rtol=0, atol=1e-8)
        assert read_manifest(path).provenance.serial_number == arm.serial_number
    found = es_module.run_module(js, "predict", [[q[0].tolist(), {"column": {text: 1.0}}] for text in texts])
    assert all("xyz" in one for one in found)
    assert not ran.exists()


LOADS = ("load_größe", "load_a-b", "load_a.b", "load_a_b")


@needs_cc
@needs_node
def test_columns_of_any_name_have_their_own_place(tmp_path):
    arm = ta.load_arm("ur10")
    terms = [Term(name, 2, (0, 0, 0, 0, 0, 1), Column(name), name, 0.1) for name in LOADS]
    model = planted_model(arm, terms)
    model.training_ = replace(model.training_, columns=dict.fromkeys(LOADS, InputRange(0.0, 1.0, -5.0, 5.0)))
    c, js = tmp_path / "arm.c", tmp_path / "arm.mjs"
    c_source.write(model, Manifest.of(model, "c"), c)
    es_module.write(model, Manifest.of(model, "js"), js)
    library = ctypes.CDLL(str(c_source.compile_library(c, tmp_path, *STRICT, "-O0")))
    written, q, xyz = Written(model, c, js, library), arm.working.copy(), np.zeros(3)
    for name in LOADS:
        readings = Session(q[None], columns={name: np.array([3.0])})
        expected = model.predict_readings(readings)[0]
        assert library.truearm_predict(pointer(q), ctypes.byref(written.state(readings)), pointer(xyz), None) >= 0
        np.testing.assert_allclose(xyz, expected, rtol=0, atol=1e-9)
        found = es_module.run_module(js, "predict", [[q.tolist(), {"column": {name: 3.0}}]])[0]
        np.testing.assert_allclose(found["xyz"], expected, rtol=0, atol=1e-9)


def test_a_name_that_is_one_in_c_stays_as_it_is():
    names = macros_of(sorted(LOADS))
    assert names == {
        "load_a_b": "load_a_b",
        "load_a-b": "load_a_b_2",
        "load_a.b": "load_a_b_3",
        "load_größe": "load_gr__e",
    }


def test_a_column_without_training_is_refused(tmp_path, nominal):
    model = planted_model(nominal.arm_, [Term("load", 2, (0, 0, 0, 0, 0, 1), Column("load_x"), "load", 0.1)])
    for module in (c_source, es_module):
        with pytest.raises(ta.InputError, match="a column that its training does not state: 'load_x'"):
            module.write(model, Manifest.of(nominal, module.FORMAT), tmp_path / "arm")


@needs_cc
@needs_node
def test_an_arm_without_coefficients_is_written(tmp_path):
    for model in empty_models():
        folder = tmp_path / type(model).__name__  # a library of the same path would be the one loaded before
        folder.mkdir()
        c, js = folder / "arm.c", folder / "arm.mjs"
        c_source.write(model, Manifest.of(model, "c"), c)
        es_module.write(model, Manifest.of(model, "js"), js)
        library = ctypes.CDLL(str(c_source.compile_library(c, folder, *STRICT, "-O0")))
        written, readings = Written(model, c, js, library), Session(angles_of(model.arm_, 5, 1))
        expected, covariances = model.predict_readings(readings, return_cov=True)
        points, cov, _ = written.predict(readings)
        np.testing.assert_allclose(points, expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(uncertainty(cov), uncertainty(covariances), rtol=EXACT_SHARE)
        np.testing.assert_allclose(es_module.tips(js, readings.angles), expected, rtol=0, atol=1e-9)


def test_networks_and_bases_of_one_s_own_are_refused(tmp_path):
    @dataclass(frozen=True)
    class Wobble(Basis):
        def labels(self):
            return ("wobble",)

        def values(self, state):
            return np.ones((1, len(state)))

    arm = ta.load_arm("ur10")
    own = [Term("own", 1, (0, 0, 1, 0, 0, 0), Wobble(), "own", 1e-3), CONSTANT]
    for model, problem in ((network_model(), "NetworkModel"), (planted_model(arm, own), "Wobble")):
        for module in (c_source, es_module):
            refuses(problem, module.write, model, Manifest.of(model, module.FORMAT), tmp_path / "arm")
    assert not list(tmp_path.iterdir())


def test_missing_tools_and_damaged_files_are_named(tmp_path, nominal, monkeypatch):
    c, js = tmp_path / "arm.c", tmp_path / "arm.mjs"
    c_source.write(nominal, Manifest.of(nominal, "c"), c)
    es_module.write(nominal, Manifest.of(nominal, "js"), js)
    q = np.zeros((2, 6))
    for module, path in ((c_source, c), (es_module, js)):
        refuses(r"expected joints of shape \(n, 6\), got \(2, 5\)", module.tips, path, np.zeros((2, 5)))
    if shutil.which("cc"):
        with pytest.raises(ta.InputError, match=r"arm.c, pose 2: the file refuses the joints with code -1"):
            c_source.tips(c, [[0.0] * 6, [np.nan] + [0.0] * 5])
        c.write_text(c.read_text().replace("static int is_number", "static int is_number("))
        refuses("the C compiler refuses the file", c_source.tips, c, q)
    if shutil.which("node"):
        refuses(r"arm.mjs, pose 1: the module refuses the joints", es_module.tips, js, [[1e7] + [0.0] * 5])
        js.write_text(js.read_text().replace("export function predictPoint", "export function predict Point"))
        refuses("Node.js refuses the file", es_module.tips, js, q)
    line = read_manifest(c).line()
    if shutil.which("cc"):
        c.write_text(f"/* {line} */ int other(void) {{ return 0; }}\n")
        refuses("no function truearm_predict", c_source.tips, c, q)
    if shutil.which("node"):
        js.write_text(f"/* {line} */ console.log(1); export const predictPoint = () => [0, 0, 0];\n")
        refuses("prints something of its own", es_module.tips, js, q)
        js.write_text(f"/* {line} */ export const other = 1;\n")
        refuses("not a function", es_module.tips, js, q)
        js.write_text(f"/* {line} */ for (;;);\n")
        monkeypatch.setattr(source_code, "MAX_SECONDS", 0.2)
        refuses(r"did not finish the file in 0.2 s", es_module.tips, js, q)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(MissingTool, match="C compiler"):
        c_source.tips(c, q)
    with pytest.raises(MissingTool, match="Node"):
        es_module.tips(js, q)


def test_numbers_read_back_exactly(nominal, tmp_path):
    c_source.write(nominal, Manifest.of(nominal, "c"), tmp_path / "arm.c")
    text = (tmp_path / "arm.c").read_text()
    table = re.search(r"NOMINAL_FIXED\[N \+ 1\]\[12\] = ([^;]*);", text).group(1)
    numbers = np.array([float(x) for x in re.findall(r"-?\d[^,}\n]*", table)])
    np.testing.assert_array_equal(numbers, nominal.nominal_.chain.fixed[:, :3].ravel())


def test_terms_at_every_place_are_among_the_models():
    """The planted models above have every basis; a basis that is added must come to them."""
    kinds = {type(term.basis).__name__ for term in every_term(rail_arm())}
    assert kinds == {"Constant", "Harmonics", "GravityTorque", "Direction", "Temperature", "Column", "InSession"}


def snippet(language):
    """The code of the guide in a language."""
    guide = (Path(__file__).parents[4] / "docs" / "export.md").read_text(encoding="utf-8")
    return re.search(rf"```{language}\n(.*?)```", guide, re.DOTALL).group(1)


@needs_cc
def test_the_guide_s_c_program_compiles_and_runs(tmp_path, nominal):
    c_source.write(nominal, Manifest.of(nominal, "c"), tmp_path / "arm.c")
    (tmp_path / "main.c").write_text(snippet("c"))
    command = ["cc", "-std=c99", *STRICT, "-o", "program", "main.c", "arm.c", "-lm"]
    subprocess.run(command, check=True, cwd=tmp_path)
    done = subprocess.run([str(tmp_path / "program")], capture_output=True, text=True, check=True)
    expected = nominal.predict([[0.17, -1.66, 1.40, -1.22, 1.48, 0.09]])[0]
    np.testing.assert_allclose([float(x) for x in done.stdout.split()[:3]], expected, rtol=0, atol=1e-4)


@needs_node
def test_the_guide_s_module_runs(tmp_path, nominal):
    es_module.write(nominal, Manifest.of(nominal, "js"), tmp_path / "arm.mjs")
    (tmp_path / "main.mjs").write_text(snippet("js"))
    done = subprocess.run(["node", "main.mjs"], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert re.search(r"\] \d\S* (true|false) \[", done.stdout), done.stdout
