"""Laws of the JSON export: the document is the whole model, follows its schema, and is checked before it is used."""

import copy
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from planted_models import (
    angles_of,
    every_term,
    network_model,
    planted_model,
    rail_arm,
    stated_readings,
    without_some_coefficients,
)
from scipy.spatial.transform import Rotation

import truearm as ta
from refusals import refuses
from truearm.identification.terms import Column, Constant, Expression, GravityTorque, Harmonics, Term
from truearm.identification.terms.basis import Basis
from truearm.models.training_conditions import InputRange
from truearm.wings.exports.formats import json_document, json_model
from truearm.wings.exports.targets.manifest import MARKER, Manifest, read_manifest

EXAMPLES = Path(__file__).resolve().parents[4] / "examples"
DOCUMENTS = Path(__file__).parent / "documents"  # written before terms could be formulas
RELATIVE = 1e-12  # of the reach: the target of an export


def written(model, folder):
    path = folder / "arm.json"
    json_model.write(model, Manifest.of(model, "json"), path)
    return path


def assert_same_points(got, expected, arm):
    np.testing.assert_allclose(got, expected, rtol=0, atol=RELATIVE * max(arm.chain.reach, np.abs(expected).max()))


@pytest.fixture(scope="module", params=["ur10", "rail", "network"])
def model(request):
    if request.param == "network":
        return network_model()
    return planted_model(rail_arm() if request.param == "rail" else ta.load_arm("ur10"))


@pytest.fixture(scope="module")
def path(model, tmp_path_factory):
    return written(model, tmp_path_factory.mktemp("json"))


@pytest.fixture(scope="module")
def reader():
    """The independent reader of the examples, which imports NumPy only."""
    if not EXAMPLES.is_dir():
        pytest.skip("the examples are not beside the tests")
    sys.path.insert(0, str(EXAMPLES))
    try:
        import json_reader
    finally:
        sys.path.remove(str(EXAMPLES))
    return json_reader


def test_the_file_gives_the_model_s_points_to_the_last_bit(model, path):
    angles = angles_of(model.arm_, 30)
    np.testing.assert_array_equal(json_model.tips(path, angles), model.predict(angles))


def test_the_independent_reader_gives_the_model_s_points(model, path, reader):
    angles = angles_of(model.arm_, 10)
    assert_same_points(reader.tips(path, angles), model.predict(angles), model.arm_)


def test_the_independent_reader_uses_stated_inputs(model, path, reader):
    readings = stated_readings(model.arm_, 5)
    for i, q in enumerate(readings.angles):
        got = reader.tips(
            path,
            [q],
            temperature_degC=readings.temperature_degC[i],
            directions=readings.directions[i],
            columns={"load_kg": readings.columns["load_kg"][i]},
        )
        assert_same_points(got, model.predict_readings(readings.rows(np.array([i]))), model.arm_)


def test_the_independent_reader_is_short_and_needs_numpy_only():
    path = EXAMPLES / "json_reader.py"
    if not path.is_file():
        pytest.skip("the examples are not beside the tests")
    lines = path.read_text().splitlines()
    assert [line for line in lines if line.startswith(("import ", "from "))] == ["import json", "import numpy as np"]
    assert len(lines) <= 115


def test_uncertainties_come_back(path):
    fitted = planted_model(ta.load_arm("ur10"))
    document = json_model.document_of(fitted, Manifest.of(fitted, "json")).identified
    np.testing.assert_array_equal(document.covariance.matrix(), fitted.fit_.covariance)
    stated = [one for term in document.terms for one in term.standard_uncertainties]
    np.testing.assert_array_equal(stated, np.sqrt(fitted.fit_.covariance.diagonal()))


def test_terms_of_zero_coefficients_are_in_the_covariance_alone(tmp_path, reader):
    fitted = without_some_coefficients(planted_model(ta.load_arm("ur10")))
    path, angles = written(fitted, tmp_path), angles_of(fitted.arm_, 5)
    for got in (json_model.tips(path, angles), reader.tips(path, angles)):
        assert_same_points(got, fitted.predict(angles), fitted.arm_)
    identified = json_model.read(path).identified
    assert all(any(term.coefficients) for term in identified.terms)
    own = dict(
        zip((t.name for t in fitted.fit_.perturbed_chain.terms), fitted.fit_.perturbed_chain.columns, strict=True)
    )
    order = np.concatenate([own.pop(term.name) for term in (*identified.terms, *identified.uncertain_terms)])
    assert not own
    np.testing.assert_array_equal(identified.covariance.matrix(), fitted.fit_.covariance[np.ix_(order, order)])


def test_the_rounding_of_angles_is_in_the_document():
    fitted = planted_model(ta.load_arm("gao2017"))
    assert json_model.document_of(fitted, Manifest.of(fitted, "json")).training.angle_std is None
    std = np.full(fitted.arm_.n_joints, 1e-3)
    fitted.training_ = replace(fitted.training_, angle_std=std)
    assert json_model.document_of(fitted, Manifest.of(fitted, "json")).training.angle_std == std.tolist()


@pytest.mark.parametrize("size", [0, 1, json_document.MAX_LISTED, json_document.MAX_LISTED + 1])
def test_a_covariance_of_any_size_comes_back_to_the_last_bit(size):
    root = np.random.default_rng(size).normal(size=(size, size))
    matrix = root.T @ root
    form = json_document.symmetric_matrix(matrix)
    assert form.encoding == ("rows" if size <= json_document.MAX_LISTED else "base64-float64")
    again = type(form).model_validate_json(form.model_dump_json())
    np.testing.assert_array_equal(again.matrix(), matrix)


def test_a_model_of_many_coefficients_is_packed_and_keeps_its_points(tmp_path):
    arm = ta.load_arm("ur10")
    many = [Term(f"t{j}", j, (0.0, 0, 1, 0, 0, 0), Harmonics(j, tuple(range(1, 31))), "g", 1e-5) for j in range(1, 7)]
    fitted = planted_model(arm, many)
    path, angles = written(fitted, tmp_path), angles_of(arm, 5)
    assert json.loads(path.read_text())["identified"]["covariance"]["encoding"] == "base64-float64"
    np.testing.assert_array_equal(json_model.tips(path, angles), fitted.predict(angles))


def test_every_fitted_kind_is_written(tmp_path):
    session = ta.simulate("ur10", poses=60, preset="shop", seed=3).session
    arm = ta.load_arm("ur10")
    for fitted in (ta.NominalModel(arm), ta.PhysicalModel(arm, highest=2)):
        path = written(fitted.fit_readings(session), tmp_path)
        np.testing.assert_array_equal(json_model.tips(path, session.angles), fitted.predict(session.angles))


def test_a_long_formula_has_a_name_that_is_cut(tmp_path):
    arm, q = ta.load_arm("ur10"), Expression.angle(2)
    function = sum(((q - i / 7) ** 2 * Expression.angle(3) for i in range(1, 80)), start=q)
    fitted = planted_model(arm, [Term("long", 2, (0, 0, 1, 0, 0, 0), function, "g", 1e-6)])
    path, angles = written(fitted, tmp_path), angles_of(arm, 5)
    (label,) = json.loads(path.read_text())["identified"]["terms"][0]["functions"]
    assert len(str(function)) > len(label) == json_document.LONGEST_TEXT
    assert label.removesuffix("...") == str(function)[: json_document.LONGEST_TEXT - 3]
    assert_same_points(json_model.tips(path, angles), fitted.predict(angles), arm)


@pytest.mark.parametrize("with_masses", [False, True])
@pytest.mark.parametrize("basis", [Column("payload_kg"), Expression.column("payload_kg") * Expression.angle(2)])
def test_a_column_of_the_payload_is_that_of_the_training(tmp_path, reader, basis, with_masses):
    arm = rail_arm() if with_masses else ta.load_arm("ur10")
    by_weight = Term("weight", 2, (0, 0, 1, 0, 0, 0), GravityTorque(2, 2), "g", 1e-5)
    fitted = planted_model(arm, [by_weight, Term("load", 3, (0, 0, 1, 0, 0, 0), basis, "g", 1e-3)])
    columns = fitted.training_.columns | {"payload_kg": InputRange(2.0, 0.0, 2.0, 2.0)}
    fitted.training_ = replace(fitted.training_, columns=columns)
    path, angles = written(fitted, tmp_path), angles_of(arm, 5)
    for got in (json_model.tips(path, angles), reader.tips(path, angles)):
        assert_same_points(got, fitted.predict(angles), arm)


def test_formulas_of_a_document_have_a_limit_together(document, tmp_path, monkeypatch):
    """Here 10,000 parts, where it is quick; `tests/identification/terms/test_expression.py` has the limit itself."""
    monkeypatch.setattr("truearm.identification.terms.basis.MOST_PARTS_TOGETHER", 10_000)
    changed = copy.deepcopy(document)
    term = changed["identified"]["terms"][0]
    function = ["sum", *[["angle", 1]] * 999]
    n = 10
    numbers = ("coefficients", "standard_uncertainties", "prior_standard_deviations")
    term |= {name: [1.0] * n for name in numbers} | {"functions": [""] * n}
    term["basis"] = {"kind": "Formula", "functions": [function] * n}
    changed["identified"]["terms"] = [term, term]
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(changed))
    refuses("at most 10000 parts together", json_model.tips, path, np.zeros((1, len(changed["arm"]["joints"]))))


@pytest.mark.parametrize(
    "field",
    [
        *({"angles": []}, {"angles": [float("inf")]}, {"angles": [0.0] * 100_001}),
        *({"length_scales": []}, {"length_scales": [-1.0]}, {"length_scales": [0.0]}, {"length_scales": [1.0] * 101}),
        *({"sliding": [0]}, {"sliding": [1_000_000]}, {"sliding": [1] * 101}),
    ],
)
def test_a_process_with_numbers_beyond_their_bounds_is_refused(field, tmp_path):
    document = json.loads((DOCUMENTS / "residual-process.json").read_text())
    next(t for t in document["identified"]["terms"] if t["basis"]["kind"] == "InducedProcess")["basis"] |= field
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(document))
    refuses(f"InducedProcess.{next(iter(field))}", json_model.read, path)


def test_the_schema_says_what_a_process_adds_to_the_variance():
    said = " ".join(shipped_schema()["$defs"]["InducedProcess"]["description"].split())
    assert "add the prior variance times 1 less the sum of the squares of the functions" in said


def test_frames_of_sessions_are_in_the_document(tmp_path):
    one, other = (ta.simulate("ur10", poses=30, seed=seed).session for seed in (1, 2))
    frame = one.to_frame().assign(session="A")
    both = ta.Session.from_frame(pd.concat([frame, other.to_frame().assign(session="B")]))
    fitted = ta.KinematicModel(ta.load_arm("ur10")).fit_readings(both)
    path = written(fitted, tmp_path)
    frames = json.loads(path.read_text())["session_frames"]
    assert list(frames) == ["A", "B"]
    np.testing.assert_array_equal(frames["B"], fitted.session_frames_["B"])
    np.testing.assert_array_equal(json_model.tips(path, one.angles), fitted.predict(one.angles))


def test_the_same_model_gives_the_same_file(model, path, tmp_path):
    assert written(model, tmp_path).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("path", sorted(DOCUMENTS.glob("*.json")), ids=lambda path: path.stem)
def test_documents_of_earlier_versions_give_the_points_that_they_state(path, reader):
    manifest, arm = read_manifest(path), json.loads(path.read_text())["arm"]
    reach = max(np.abs(manifest.tips).max(), 1000.0)
    np.testing.assert_allclose(json_model.tips(path, manifest.joints), manifest.tips, rtol=0, atol=RELATIVE * reach)
    if path.stem != "residual-process":
        np.testing.assert_allclose(reader.tips(path, manifest.joints), manifest.tips, rtol=0, atol=RELATIVE * reach)
    assert len(arm["joints"]) == manifest.joints.shape[1]


# The schema ----------------------------------------------------------------------------------------------------------


def shipped_schema():
    path = Path(json_document.__file__).with_name("model.schema.json")
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_shipped_schema_is_that_of_the_document():
    shipped = shipped_schema()
    remedy = "write json_document.schema() to model.schema.json with indent 1"
    assert shipped == json.loads(json.dumps(json_document.schema())), remedy


def test_the_file_follows_the_schema_of_the_standard(path):
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    shipped = shipped_schema()
    jsonschema.Draft202012Validator.check_schema(shipped)
    validator = jsonschema.Draft202012Validator(shipped)
    document = json.loads(path.read_text())
    validator.validate(document)
    assert set(shipped["required"]) == set(document)
    assert shipped["additionalProperties"] is False


def test_numbers_are_finite_json(path):
    def refuse(name):
        raise AssertionError(name)

    json.loads(path.read_text(), parse_constant=refuse)


# Check poses ---------------------------------------------------------------------------------------------------------


def content_of(path):
    """Outcome and detail of evaluating a file of the small model at its check poses."""
    model = planted_model(ta.load_arm("ur10"), every_term(ta.load_arm("ur10"))[:60])
    finding = next(one for one in ta.check_export(model, path).findings if one.what == "content")
    return finding.outcome, finding.detail


def test_the_check_poses_are_met(model, path):
    assert read_manifest(path) == Manifest.of(model, "json")
    assert ta.check_export(model, path).agrees


@pytest.fixture(scope="module")
def small_text(tmp_path_factory):
    """The document of a small model."""
    arm = ta.load_arm("ur10")
    return written(planted_model(arm, every_term(arm)[:60]), tmp_path_factory.mktemp("small")).read_text()


@pytest.fixture
def document(small_text):
    """The same as plain data, for one test to change."""
    return json.loads(small_text)


def saved(document, tmp_path):
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(document))
    return path


def test_check_poses_in_another_unit_are_found(document, tmp_path):
    for pose in document[MARKER]["check_poses"]:
        pose["joints"] = np.rad2deg(pose["joints"]).tolist()
    path = saved(document, tmp_path)
    off = np.linalg.norm(json_model.tips(path, read_manifest(path).joints) - read_manifest(path).tips, axis=1)
    assert off.max() > 1.0  # mm


def test_lengths_in_another_unit_miss_the_check_poses(document, tmp_path):
    chain = document["identified"]["chain"]
    for F in chain["fixed"]:
        for row in F[:3]:
            row[3] /= 1000
    chain["tip_in_flange_mm"] = [one / 1000 for one in chain["tip_in_flange_mm"]]
    for term in document["identified"]["terms"]:
        if any(term["direction"][3:]):
            term["coefficients"] = [one / 1000 for one in term["coefficients"]]
    outcome, detail = content_of(saved(document, tmp_path))
    assert outcome == "differs"
    assert "metres for millimetres" in detail


def test_a_correction_applied_twice_misses_the_check_poses(document, tmp_path):
    """Somebody composes a constant term into the chain, and keeps the term."""
    terms, covariance = document["identified"]["terms"], document["identified"]["covariance"]
    terms.append(next(term for term in terms if term["place"] == 1 and term["direction"][2]))
    covariance["size"] += 1
    covariance["lower_triangle"].append([0.0] * covariance["size"])
    assert content_of(saved(document, tmp_path))[0] == "differs"


def test_the_numbers_of_another_robot_miss_the_check_poses(document, tmp_path):
    arm = ta.load_arm("ur10")
    other = json.loads(written(planted_model(arm, every_term(arm)[:60], seed=2), tmp_path).read_text())
    assert content_of(saved(document | {"identified": other["identified"]}, tmp_path))[0] == "differs"


# What is refused -----------------------------------------------------------------------------------------------------


def change(document, keys, value):
    """Set the value at a path of keys; a callable gets the value before."""
    *way, last = keys
    for key in way:
        document = document[key]
    document[last] = value(document[last]) if callable(value) else value


def doubled(term):
    """Twice as many numbers for every list of one for each function."""
    names = ("functions", "coefficients", "standard_uncertainties", "prior_standard_deviations")
    return {name: term[name] * 2 for name in names}


DAMAGES = {
    "a key is missing": (["arm"], {}, r"arm\.name"),
    "NaN": (["identified", "chain", "tip_in_flange_mm", 0], float("nan"), "finite"),
    "infinite": (["identified", "terms", 0, "coefficients", 0], float("inf"), "finite"),
    "text for a number": (["arm", "mass_kg", 0], "1 kg", "number"),
    "a joint more": (["arm", "joints"], lambda joints: [*joints, joints[0]], "chains of 7 joints"),
    "a link more": (["identified", "chain", "fixed"], lambda fixed: [*fixed, fixed[0]], "chains of 6 joints"),
    "not rigid": (["identified", "chain", "fixed", 1, 0, 0], 2.0, "not a rigid motion"),
    "a place beyond the tip": (["identified", "terms", 0, "place"], 9, "place from 0"),
    "a joint beyond the last": (["identified", "terms", -1, "basis"], {"kind": "Direction", "joint": 7}, "joint from"),
    "an unknown basis": (["identified", "terms", 0, "basis"], {"kind": "Spline"}, "basis"),
    "falling orders": (
        ["identified", "terms", 0, "basis"],
        {"kind": "Harmonics", "joint": 1, "orders": [2, 1]},
        "rising",
    ),
    "other functions": (
        ["identified", "terms", 0, "basis"],
        {"kind": "Harmonics", "joint": 1, "orders": [1]},
        "expected 2 prior|expected 2 coefficients",
    ),
    "a coefficient more": (["identified", "terms", 0, "coefficients"], [1.0, 2.0], "one coefficient"),
    "functions more": (["identified", "terms", 0], lambda term: term | doubled(term), "expected 1 prior"),
    "a covariance of others": (
        ["identified", "covariance"],
        {"encoding": "rows", "size": 0, "lower_triangle": []},
        "covariance of all",
    ),
    "a triangle that is none": (["identified", "covariance", "lower_triangle", 1], [1.0], "lower triangle"),
    "a longer direction": (["identified", "terms", 0, "direction"], [1.0] * 7, "at most 6"),
    "a direction of zeros": (["identified", "terms", 0, "direction"], [0.0] * 6, "not all zero"),
    "a newer version": (["version"], 3, "version"),
    "another unit": (["units", "length"], "m", "mm"),
    "a network too": (["network"], {}, "network"),
    "no model": (["identified"], None, "expected a network"),
    "a mass below zero": (["arm", "mass_kg", 0], -1.0, "not negative"),
    "numbers that overflow": (["identified", "terms", 0, "coefficients", 0], 1e300, "finite points"),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_a_document_with_a_fault_is_refused(document, tmp_path, what):
    keys, value, match = DAMAGES[what]
    change(document, keys, value)
    path = saved(document, tmp_path)
    assert refuses(match, json_model.tips, path, np.zeros((1, 6))).file == path


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[1]", b"\xff\xfe", b"[" * 100_000, b'{"truearm-export": {}}', b"1e999"]
)
def test_what_is_no_document_is_refused(content, tmp_path):
    path = tmp_path / "arm.json"
    path.write_bytes(content)
    refuses(None, json_model.tips, path, np.zeros((1, 6)))


@pytest.mark.parametrize("packed", ["", "AAAA", "?", "AAAAAAAA8H8=", "A" * 1000])
def test_a_packed_matrix_with_a_fault_is_refused(packed):
    data = {"encoding": "base64-float64", "size": 1, "lower_triangle": packed}
    with pytest.raises(ValueError, match="triangle|doubles"):
        json_document.PackedMatrix.model_validate(data)
    with pytest.raises(ValueError, match="triangle"):
        json_document.PackedMatrix.model_validate(data | {"size": 10**9})


def test_a_network_with_a_fault_is_refused(tmp_path):
    path = written(network_model(members=1), tmp_path)
    whole = json.loads(path.read_text())
    for keys, value, match in (
        (["network", "members", 0, "layers", 0, 0], [1.0], "layers of weights"),
        (["network", "members", 0, "layers", 0], [], "layers of weights|hidden layers"),
        (["network", "joint_range", "upper"], whole["network"]["joint_range"]["lower"], "rising ranges"),
        (["network", "point_range_mm", "upper"], [1.0], "rising ranges"),
        (["network", "activations"], ["tansig"], "activations|layers"),
        (["network", "activations", 2], "tansig", "layers of weights"),
    ):
        document = copy.deepcopy(whole)
        change(document, keys, value)
        refuses(match, json_model.tips, saved(document, tmp_path), np.zeros((1, 6)))


@pytest.mark.parametrize("joints", [np.zeros(6), np.zeros((1, 5)), np.full((1, 6), np.nan)])
def test_joints_of_another_shape_are_refused(document, tmp_path, joints):
    refuses("finite joints of shape", json_model.tips, saved(document, tmp_path), joints)


class Own(Basis):
    """A basis of a user's own."""

    def labels(self):
        return ("own",)

    def values(self, state):
        return np.ones((1, len(state)))

    def as_data(self):
        return {"kind": "Own"}


def test_a_user_s_own_basis_is_refused_and_nothing_is_written(tmp_path):
    arm = ta.load_arm("ur10")
    fitted = planted_model(arm, [Term("a", 1, (1.0, 0, 0, 0, 0, 0), Constant(), "g", 1e-3)])
    manifest = Manifest.of(fitted, "json")
    fitted = planted_model(arm, [Term("own", 1, (1.0, 0, 0, 0, 0, 0), Own(), "g", 1e-3)])
    refuses("basis Own", json_model.write, fitted, manifest, tmp_path / "arm.json")
    assert not list(tmp_path.iterdir())


def test_a_document_that_no_reader_would_take_is_not_written(tmp_path, monkeypatch, model):
    monkeypatch.setattr(json_model, "MAX_BYTES", 1000)
    refuses("is the limit", written, model, tmp_path)
    assert not list(tmp_path.iterdir())


# The arm -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ta.list_arms())
def test_the_table_of_the_document_is_the_nominal_arm(name):
    arm = ta.load_arm(name)
    table = json_model._table_of(arm.chain)
    if table is None:
        return
    ends = [np.array(table.base)]
    for i in range(arm.n_joints):
        own = np.eye(4)
        own[:3, :3] = Rotation.from_rotvec([0, 0, table.theta_rad[i]]).as_matrix()
        own[2, 3] = table.d_mm[i]
        across = np.eye(4)
        across[:3, :3] = Rotation.from_euler("XY", [table.alpha_rad[i], table.beta_rad[i]]).as_matrix()
        across[:2, 3] = table.a_mm[i], table.b_mm[i]
        ends.append(ends[-1] @ (own @ across if table.convention == "dh" else across @ own))
    tip = (ends[-1] @ np.array(table.flange) @ [*table.tip_mm, 1.0])[:3]
    zero = arm.chain.tip_in_base(np.zeros((1, arm.n_joints)))[0]
    np.testing.assert_allclose(tip, zero, rtol=0, atol=1e-9)  # mm, rounding at a reach of some metres
