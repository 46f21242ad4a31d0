"""Model files: the same numbers back, and nothing from a file that is not sound."""

import hashlib
import io
import json
import shutil
import zipfile
from copy import copy
from dataclasses import fields, is_dataclass, replace
from inspect import get_annotations
from pathlib import Path
from types import UnionType
from typing import Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from refusals import refuses
from truearm.arm.arm import NOT_KEPT, Arm
from truearm.arm.chain import Chain
from truearm.errors import TruearmError
from truearm.identification.judgement.outliers import outliers
from truearm.identification.terms import SkippedTerm, Term
from truearm.models import MODELS, KinematicModel, NetworkModel, PhysicalModel
from truearm.models.model_archive import DTYPES, read_archive
from truearm.models.model_file import load_model
from truearm.models.network import TRAINERS
from truearm.readings import Session

# Files of format 1, and the predictions of their models at the working pose: tip, standard uncertainties and nominal
# tip [mm].
SAMPLES = {
    "nominal": (
        [60.99777190266799, -47.99830362902277, 2.9993045717095104],
        [0.011333177817361291, 0.011333378116168333, 0.011328750496204472],
        [60.99777190266799, -47.99830362902277, 2.9993045717095104],
    ),
    "kinematic": (
        [60.99777190266798, -47.99830362902278, 2.999304571709537],
        [0.01133317791679876, 0.011333378215472572, 0.011328750596987737],
        [60.99777190266799, -47.99830362902277, 2.9993045717095104],
    ),
    "physical": (
        [60.997894363284615, -47.99666395502765, 2.999379507552891],
        [0.011146572349497787, 0.011175343461098603, 0.011110221459081719],
        [60.99777190266799, -47.99830362902277, 2.9993045717095104],
    ),
    "network": (
        [85.47393968847484, -44.82023982724284, 2.9968739702879383],
        [21.394395528391208, 11.65778211821027, 0.008271403125432876],
        [60.99777190266799, -47.99830362902277, 2.9993045717095104],
    ),
}


@pytest.fixture(scope="module")
def arm():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    chain = Chain(fixed, np.array([0, 0, 50.0]), np.array([False, True, False]))
    return Arm("mixed", chain, title="Two turn, one slides", upper=np.array([np.inf, 50, 2]), source="made for a test")


SMALL = {"network": {"hidden": (4, 3), "epochs": 5}, "physical": {"highest": 4}}
SMALL["hybrid"] = SMALL["network"] | {"n_members": 2}


def learned(model, rng):
    """A model of 40 readings, and their angles."""
    angles = rng.uniform(-1, 1, (40, 3)) * [1, 40, 1]
    points = model.arm.chain.tip_in_base(angles) + [1.0, 2.0, 3.0] + rng.normal(0, 0.01, (40, 3))
    return model.fit(angles, points), angles


@pytest.fixture
def fitted(arm, rng):
    return lambda name: learned(MODELS[name](arm, **SMALL.get(name, {})), rng)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_comes_back_to_the_last_bit(name, fitted, tmp_path):
    model, angles = fitted(name)
    model.save(tmp_path / "m.truearm")
    again = load_model(tmp_path / "m.truearm")
    for expected, got in zip(
        model.predict(angles, return_cov=True), again.predict(angles, return_cov=True), strict=True
    ):
        np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(again.predict_nominal(angles), model.predict_nominal(angles))
    np.testing.assert_array_equal(again.outside_training(2 * angles), model.outside_training(2 * angles))
    assert again.data_fingerprint_ == model.data_fingerprint_
    assert again.lengths_fingerprint_ == model.lengths_fingerprint_ == ""
    assert {k: v for k, v in again.get_params().items() if k != "arm"} == {
        k: v for k, v in model.get_params().items() if k != "arm"
    }
    np.testing.assert_array_equal(again.arm.limits, model.arm.limits)


@pytest.fixture(scope="module")
def mixed(real):
    """Readings with points and in seats, a temperature, and a load that turns J1; the physical model from them."""
    rng = np.random.default_rng(20170101)
    seen, held = real.points(60, rng), real.held(rng)
    load = rng.normal(size=120)
    angles = np.concatenate([seen.angles, held.angles])
    angles[:, 0] -= 1e-3 * load  # the true arm turns further by so much
    points = np.concatenate([seen.points, np.full((60, 3), np.nan)])
    readings = Session(
        angles,
        points,
        np.where(np.isnan(points), np.nan, 0.01),
        seat=np.concatenate([np.full(60, ""), held.seat]),
        position=np.array([f"p{i // 5}" for i in range(60)] + [""] * 60),
        temperature_degC=20 + rng.uniform(-3, 3, 120),
        columns={"load_1_Nm": load},
    )
    return PhysicalModel(real.arm, highest=2).fit_readings(readings), readings


def test_all_that_was_identified_comes_back(mixed, tmp_path):
    model, readings = mixed
    model.save(tmp_path / "m")
    again = load_model(tmp_path / "m")
    for one, other in zip(
        model.predict_readings(readings, return_cov=True),
        again.predict_readings(readings, return_cov=True),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)
    assert again.excluded_terms_ == model.excluded_terms_ != ()
    assert again.training_.columns == model.training_.columns != {}
    assert again.training_.temperature_degC == model.training_.temperature_degC
    assert again.training_.temperature_degC.variance > 0
    assert again.birge_ratio_ == model.birge_ratio_ >= 1
    for name in ("nominal_", "fit_"):
        one, other = getattr(model, name), getattr(again, name)
        assert other.perturbed_chain.terms == one.perturbed_chain.terms
        assert other.groups == one.groups
        assert (other.converged, other.rounds) == (one.converged, one.rounds)
        np.testing.assert_array_equal(other.chain.fixed, one.chain.fixed)
        assert [r.kind for r in other.references] == ["point", "seat"]
        for r, s in zip(one.references, other.references, strict=True):
            assert s.unknowns == r.unknowns
            assert s.noise_std == r.noise_std
    assert outliers(again.fit_) == outliers(model.fit_)
    assert again.held_out_errors_ == model.held_out_errors_
    assert model.held_out_errors_.n >= 50
    assert len(again.held_out_.rows) == 0
    assert "load_1_Nm" in [term.group for term in again.fit_.perturbed_chain.terms]


def test_a_covariance_is_there_once(fitted, tmp_path):
    """Its lower triangle, and under repeatability conditions its diagonal: all else is alike."""
    model, _ = fitted("kinematic")
    model.save(tmp_path / "m")
    arrays, n = read_archive(tmp_path / "m")[1], len(model.fit_.coefficients)
    assert arrays["fit_.covariance"].shape == (n * (n + 1) // 2,)
    assert arrays["fit_.repeatability_covariance"].shape == (n,)
    again = load_model(tmp_path / "m").fit_
    np.testing.assert_array_equal(again.covariance, model.fit_.covariance)
    np.testing.assert_array_equal(again.repeatability_covariance, model.fit_.repeatability_covariance)
    assert (again.covariance.diagonal() > again.repeatability_covariance.diagonal()).any()


def test_the_same_model_gives_the_same_file(fitted, tmp_path):
    model, _ = fitted("physical")
    model.save(tmp_path / "a")
    model.save(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_options_as_numpy_leaves_them_are_saved(arm, fitted, tmp_path):
    model, angles = fitted("physical")
    model.set_params(highest=np.int64(2), robust=np.bool_(True)).fit(angles, model.predict(angles))
    model.save(tmp_path / "m")
    assert load_model(tmp_path / "m").get_params()["highest"] == 2


def test_a_scale_without_a_range_is_refused(fitted, tmp_path):
    model, _ = fitted("network")
    model.save(tmp_path / "m")
    rewritten(tmp_path / "m", edit_array("angle_scale_.lower", lambda a: a + 1e6))
    refuses("that rise from lower to upper", load_model, tmp_path / "m")


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_of_format_1_predicts_what_it_did(name):
    """To the last bit on the machine that wrote it; sums in another order differ by 1e-12.

    The inverse of a matrix with little information on some constants makes 4e-7 of it in the uncertainty.
    """
    model = load_model(Path(__file__).parent / f"{name}-format-1.truearm")
    tip, std, nominal = SAMPLES[name]
    points, covariance = model.predict(model.arm.working[None], return_cov=True)
    np.testing.assert_allclose(points, [tip], rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), std, rtol=1e-5)
    np.testing.assert_allclose(model.predict_nominal(model.arm.working[None]), [nominal], rtol=1e-12)
    assert model.ellipsoid_factor(0.99) == pytest.approx(np.sqrt(11.345), abs=1e-4)  # its tails were not kept


@pytest.mark.parametrize("path", sorted(Path(__file__).parent.glob("*.truearm")), ids=lambda path: path.stem)
def test_a_file_from_another_python_comes_back_to_the_last_bit(path, tmp_path):
    """Written by Python 3.11 with NumPy 2.4 (format-1) and by Python 3.13 with NumPy 2.5."""
    load_model(path).save(tmp_path / "again.truearm")
    (header, kept), (header_again, again) = read_archive(path), read_archive(tmp_path / "again.truearm")
    for name, array in kept.items():
        is_triangle = array.ndim > again[name].ndim  # symmetric matrices are triangles since format 2
        np.testing.assert_array_equal(again[name], array[np.tril_indices(len(array))] if is_triangle else array)
    assert header.options.items() <= header_again.options.items()
    assert is_within(header.learned, header_again.learned)


def is_within(part, whole):
    """Whether `whole` says all that `part` says; what a class gained since comes in addition."""
    if isinstance(part, dict):
        if "lower triangle" in whole:
            return set(part.values()) == set(whole.values())
        return all(key in whole and is_within(one, whole[key]) for key, one in part.items())
    if isinstance(part, list):
        return len(part) == len(whole) and all(map(is_within, part, whole))
    return part == whole


def types_within(hint):
    """A type and the types of all that its values hold; a term has a form of its own."""
    yield hint
    if is_dataclass(hint) and hint is not Term:
        hints = get_type_hints(hint)
        parts = [hints[field.name] for field in fields(hint) if NOT_KEPT not in field.metadata]
    else:
        parts = () if hint in DTYPES else get_args(hint)
    for one in parts:
        yield from types_within(one)


@pytest.mark.parametrize("kind", MODELS.values(), ids=MODELS)
def test_every_type_that_a_model_learns_has_a_form_in_its_file(kind):
    """Also where no sample has a value of it: what is spelled otherwise would be saved and not read."""
    learned = {get_type_hints(cls)[n] for cls in kind.__mro__ for n in get_annotations(cls) if n.endswith("_")}
    known = {type(None), bool, int, float, str, Term, SkippedTerm, *DTYPES}
    for hint in (one for learnt in learned for one in types_within(learnt) if one not in known and one is not ...):
        is_container = get_origin(hint) in (tuple, dict, Union, UnionType)
        assert is_container or is_dataclass(hint), f"no form in a model file: {hint}"


ENSEMBLE = {"hidden": (3,), "epochs": 4, "n_members": 3, "n_restarts": 2}


@pytest.mark.parametrize("trainer", TRAINERS)
def test_an_ensemble_comes_back_with_the_records_of_its_trainings(trainer, arm, rng, tmp_path):
    model, angles = learned(NetworkModel(arm, trainer=trainer, **ENSEMBLE), rng)
    model.save(tmp_path / "m")
    again = load_model(tmp_path / "m")
    for one, other in zip(model.predict(angles, return_cov=True), again.predict(angles, return_cov=True), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(model.member_scatter(2 * angles), again.member_scatter(2 * angles))
    for one, other in zip(model.members_, again.members_, strict=True):
        assert one.start == other.start
        assert type(one.record) is type(other.record)
        for field in fields(one.record):
            expected, got = getattr(one.record, field.name), getattr(other.record, field.name)
            assert np.asarray(expected).dtype == np.asarray(got).dtype
            np.testing.assert_array_equal(got, expected)
    assert again.get_params()["n_members"] == 3


def test_a_model_larger_than_its_file_may_be_is_not_written(fitted, tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.models.model_archive.MAX_BYTES", 2**24 + 1000)
    with pytest.raises(TruearmError, match="larger than a model file may be"):
        fitted("network")[0].save(tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def test_the_file_does_not_grow_with_the_readings(arm, rng, tmp_path):
    """A file of every residual would reach the limit at a million readings, after the fit."""
    sizes = []
    for n in (500, 1000):
        angles = rng.uniform(-1, 1, (n, 3)) * [1, 40, 1]
        points = arm.chain.tip_in_base(angles) + rng.uniform(-0.01, 0.01, (n, 3))
        KinematicModel(arm).fit(angles, points).save(tmp_path / "m")
        sizes.append((tmp_path / "m").stat().st_size)
    assert sizes[1] < sizes[0] + 1000  # a byte a reading; every reading's residual would take 48


def test_an_unfitted_model_is_not_saved(arm, tmp_path):
    with pytest.raises(TruearmError, match="fitted"):
        KinematicModel(arm).save(tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def rewritten(path, change):
    """The zip at `path` with `change` made to its {name: bytes}."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files = change(files) or files
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def edit_header(**changes):
    def change(files):
        header = json.loads(files["model.json"])
        header.update(changes)
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_json(*path, value):
    """Set what stands in model.json at `path`; None at its end takes it out."""

    def change(files):
        header = json.loads(files["model.json"])
        at = header
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value
        files["model.json"] = json.dumps(header).encode()

    return change


def without(*path):
    """Take out what stands in model.json at `path`."""

    def change(files):
        header = json.loads(files["model.json"])
        at = header
        for key in path[:-1]:
            at = at[key]
        del at[path[-1]]
        files["model.json"] = json.dumps(header).encode()

    return change


def flip_a_bit(files):
    data = bytearray(files["fit_.coefficients.npy"])
    data[-1] ^= 1
    files["fit_.coefficients.npy"] = bytes(data)


def promise_a_terabyte(files):
    data = files["arm_.chain.fixed.npy"].replace(b"(4, 4, 4)", b"(99999999999, 4, 4)")
    end = data.index(b"\n")
    data = data[: end - 10] + data[end:]
    files["arm_.chain.fixed.npy"] = data
    header = json.loads(files["model.json"])
    entry = {"shape": [99999999999, 4, 4], "sha256": hashlib.sha256(data).hexdigest()}
    header["arrays"]["arm_.chain.fixed"] = entry
    files["model.json"] = json.dumps(header).encode()


def edit_array(name, edit):
    """Change an array, with everything in the header in order."""

    def change(files):
        stream = io.BytesIO()
        array = edit(np.lib.format.read_array(io.BytesIO(files[f"{name}.npy"])))
        np.lib.format.write_array(stream, array, version=(1, 0))
        files[f"{name}.npy"] = stream.getvalue()
        header = json.loads(files["model.json"])
        header["arrays"][name] = {"shape": list(array.shape), "sha256": hashlib.sha256(stream.getvalue()).hexdigest()}
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_matrix(name, edit):
    """Change a symmetric matrix, of which the file has the lower triangle."""

    def edited(triangle):
        size = int(np.sqrt(2 * len(triangle)))
        matrix = np.zeros((size, size))
        matrix[np.tril_indices(size)] = triangle
        changed = edit(matrix + np.tril(matrix, -1).T)
        return changed[np.tril_indices(len(changed))]

    return edit_array(name, edited)


def add_an_array(files):
    files["../../x.npy"] = files["fit_.coefficients.npy"]
    header = json.loads(files["model.json"])
    header["arrays"]["../../x"] = header["arrays"]["fit_.coefficients"]
    files["model.json"] = json.dumps(header).encode()


def lose(name):
    """Take an array out, from the list in the header too."""

    def change(files):
        del files[f"{name}.npy"]
        header = json.loads(files["model.json"])
        del header["arrays"][name]
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_fit(name, value, fit="fit_"):
    return edit_json("learned", fit, name, value=value)


def edit_term(name, value, fit="fit_"):
    return edit_json("learned", fit, "perturbed_chain", "terms", 0, name, value=value)


def edit_reference(name, value):
    return edit_json("learned", "fit_", "references", 0, name, value=value)


def hide_a_pickle(files):
    files["evil.npy"] = np.lib.format.magic(1, 0) + b"..."


@pytest.fixture(scope="module")
def sound(arm, mixed, tmp_path_factory):
    """A folder with sound files, one a kind of model, for a change to spoil a copy."""
    weights = np.r_[0.1, np.ones(59)]
    outlier = replace(mixed[0].fit_.references[0], robust_weight=weights, repeat_variance=1e-4 * weights)
    physical = copy(mixed[0])
    physical.fit_ = replace(physical.fit_, references=(outlier, *physical.fit_.references[1:]))
    small = {
        "kinematic": KinematicModel(arm),
        "network": NetworkModel(arm, **ENSEMBLE),
        "hybrid": MODELS["hybrid"](arm, arm_model="nominal", **SMALL["hybrid"]),
    }
    folder = tmp_path_factory.mktemp("sound")
    models = {name: learned(model, np.random.default_rng(3))[0] for name, model in small.items()}
    for name, model in (models | {"physical": physical}).items():
        model.save(folder / name)
    return folder


def refused(file, change, message, folder):
    path = folder / "m.truearm"
    shutil.copy(file, path)
    rewritten(path, change)
    assert str(path) in str(refuses(message, load_model, path))


def first_number(value):
    """Change the first number of an array."""

    def edit(array):
        array.flat[0] = value
        return array

    return edit


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit_header(format=99), "format 99.*update truearm"),
        (edit_header(format=True), "model.json, format"),
        (edit_header(format=0), "model.json, format"),
        (edit_header(format="one"), "model.json, format"),
        (edit_header(model="oracle"), "model.json, model"),
        (edit_header(model="network"), "model.json, learned: expected"),
        (edit_header(options={"free": 3}), "does not describe a model of its kind"),
        (edit_header(options={"free": ["elbow"]}), "expected free parts"),
        (edit_header(options={"colour": "red"}), "does not describe a model of its kind"),
        (edit_header(surprise=1), "surprise"),
        (edit_header(arrays={}), "only what model.json lists"),
        (edit_header(learned={}), "model.json, learned"),
        (edit_json("learned", "free_", value=["elbow"]), "expected free parts"),
        (edit_json("learned", "residual_std_", value=-5.0), "residual standard deviation of 0 or more"),
        (edit_json("learned", "residual_std_", value=float("nan")), "finite numbers, got NaN"),
        (edit_json("learned", "residual_std_", value="inf"), "residual standard deviation of 0 or more"),
        (edit_json("learned", "residual_std_", value=True), "residual_std_: expected float, got True"),
        (edit_json("learned", "birge_ratio_", value=0.5), "a Birge ratio of 1 or more"),
        (edit_json("learned", "arm_", "name", value=7), "arm_.name: expected str, got 7"),
        (edit_json("learned", "arm_", "chain", value=None), "model.json, arm_.chain: expected"),
        (edit_json("learned", "arm_", "lower", value={"array": "arm_.upper"}), "arm_.lower: expected an array of that"),
        (edit_array("fit_.covariance", np.negative), "not a covariance"),
        (edit_array("fit_.covariance", lambda a: a[1:]), "fit_.covariance as a lower triangle"),
        (edit_array("fit_.repeatability_covariance", np.negative), "not a covariance"),
        (edit_array("fit_.repeatability_covariance", lambda a: a[1:]), "repeatability_covariance of shape"),
        (edit_array("arm_.lower", lambda a: a[:2]), "lower must be 3 numbers"),
        (edit_array("arm_.chain.tip_in_flange", lambda a: a * np.nan), "not finite"),
        (edit_array("arm_.chain.fixed", lambda a: a * 2), "not a rigid motion"),
        (edit_array("arm_.chain.prismatic", lambda a: a + 0.5), "prismatic as 0 and 1"),
        (add_an_array, "has no array '../../x'"),
        (flip_a_bit, "SHA-256 differs"),
        (promise_a_terabyte, "expected the array arm_.chain.fixed"),
        (hide_a_pickle, "only what model.json lists, got also .'evil.npy'"),
        (lambda files: {"model.json": b"{"}, "not JSON"),
        (lambda files: {"model.json": b"[]"}, "as a whole"),
        (lambda files: {"model.json": b"[" * 10**5}, "not JSON"),
        (lambda files: {"model.json": b" " * (17 << 20)}, "larger than a model needs"),
        (lambda files: {"other": b""}, "without model.json"),
        (lambda files: files.pop("fit_.coefficients.npy") and None, "does not describe a model of its kind"),
    ],
)
def test_an_unsound_file_is_refused_with_the_reason(change, message, sound, tmp_path):
    refused(sound / "kinematic", change, message, tmp_path)


HARMONICS = {"kind": "Harmonics", "joint": 1, "orders": [1, 2]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        # Terms that do not fit the arm, or are none.
        (without("learned", "nominal_"), "model.json, learned: expected"),
        (without("learned", "fit_", "perturbed_chain", "terms", 0), "of shape"),
        (edit_fit("perturbed_chain", {}), "fit_.perturbed_chain: expected chain, terms"),
        (edit_json("learned", "fit_", "perturbed_chain", "terms", value=[]), "of shape"),
        (edit_json("learned", "fit_", "perturbed_chain", "terms", value=[3]), "expected a term with"),
        (edit_json("learned", "fit_", "perturbed_chain", "terms", value=[{}]), "expected a term with"),
        (edit_term("place", 8), "expected a place from 0 .base. to 7"),
        (edit_term("place", -1), "expected a place of 0 or more"),
        (edit_term("place", 10**30), "expected a place from 0"),
        (edit_term("direction", [0, 0, 0, 0, 0, 0]), "not all zero"),
        (edit_term("direction", [1, 0]), "expected a direction of 6 numbers"),
        (edit_term("direction", ["1", 0, 0, 0, 0, 0]), "expected finite numbers as direction"),
        (edit_term("prior_std", -1.0), "above zero"),
        (edit_term("prior_std", 0), "above zero"),
        (edit_term("prior_std", [1.0, 2.0]), "expected 1 prior standard deviations"),
        (edit_term("learn", "yes"), "expected learn as true or false"),
        (edit_term("name", ""), "term's name"),
        (edit_term("basis", {"kind": "os.system"}), "expected a basis among"),
        (edit_term("basis", ["Constant"]), "expected a basis as a table"),
        (edit_term("basis", {"kind": "Constant", "surprise": 1}), "expected the fields of a basis 'Constant'"),
        (edit_term("basis", HARMONICS | {"orders": [10**9]}), "expected orders as whole numbers, 1 to 1000"),
        (edit_term("basis", HARMONICS | {"joint": 0}), "expected joint as whole numbers, 1 to 100"),
        (edit_term("basis", HARMONICS), "of shape"),
        (edit_term("basis", {"kind": "GravityTorque", "joint": 9, "axis": 0}), "expected a joint from 1 to 6, got 9"),
        (edit_term("basis", {"kind": "Temperature", "link": 9}), "expected a link from 0 to 6, got 9"),
        (edit_term("basis", {"kind": "Column", "name": "load_7_Nm"}), "expected readings with a column 'load_7_Nm'"),
        (edit_term("basis", {"kind": "Direction", "joint": 7}), "expected a joint from 1 to 6, got 7"),
        (edit_term("basis", {"kind": "Temperature", "link": 0}, "nominal_"), "with a te"),
        # Training conditions.
        (edit_json("learned", "training_", "columns", value=[]), "expected readings with a column 'load_1_Nm'"),
        (edit_json("learned", "training_", "temperature_degC", "mean", value="inf"), "finite"),
        (edit_json("learned", "training_", "temperature_degC", "variance", value=-1.0), "a variance of 0 or more"),
        (edit_json("learned", "training_", "temperature_degC", "lower", value=1e9), "lower end is not above"),
        (edit_json("learned", "training_", "n_readings", value=0), "one reading or more"),
        (edit_array("training_.angle_ranges", lambda a: a[:, ::-1]), "begin before they end"),
        (edit_array("training_.angle_ranges", lambda a: a[1:]), "of shape|sample of 5 angles"),
        # Numbers of terms and groups.
        (edit_array("fit_.prior_std", np.negative), "prior standard deviations above zero"),
        (edit_array("fit_.coefficients", lambda a: a[1:]), "fit_.coefficients of shape"),
        (edit_array("fit_.coefficients", lambda a: a * np.nan), "not finite"),
        (edit_array("fit_.coefficients", lambda a: 0 * a + 1e308), "finite numbers at the arm's working pose"),
        (edit_matrix("fit_.covariance", lambda a: a[1:, 1:]), "fit_.covariance of shape"),
        (edit_array("fit_.repeatability_covariance", np.negative), "not a covariance"),
        (edit_matrix("fit_.covariance", lambda a: np.eye(len(a)) * 1e308), "finite numbers at the arm's working pose"),
        (edit_array("fit_.perturbed_chain.chain.fixed", lambda a: a[1:]), "expected 5 joint types"),
        (lose("fit_.prior_std"), "fit_.prior_std: expected an array of that name"),
        (edit_json("learned", "fit_", "groups", 0, "effective", value=-1.0), "0 or more of the groups"),
        (edit_json("learned", "fit_", "groups", 0, "scale", value="inf"), "0 or more of the groups"),
        # References and readings.
        (edit_fit("references", []), "has no array"),
        (without("learned", "fit_", "references", 0), "expected an array of that name|has no array"),
        (edit_reference("noise_std", -1.0), "a noise of 0 or more"),
        (edit_reference("unknowns", [["x", "inf"]]), "finite unknowns"),
        (edit_reference("unknowns", [["x", 1.0], ["x", 2.0]]), "a name is there twice"),
        (edit_reference("unknowns", {"x": 1.0}), "expected a list"),
        (edit_array("fit_.references.0.rows", first_number(-1)), "rows as whole numbers"),
        (edit_array("fit_.references.0.rows", first_number(0.5)), "rows as whole numbers"),
        (edit_array("fit_.references.0.rows", first_number(1e300)), "rows as whole numbers"),
        (edit_array("fit_.references.0.rows", lambda a: a[1:]), "of shape"),
        (edit_array("fit_.references.0.residuals", np.sum), "of shape"),
        (edit_array("fit_.references.0.residuals", np.ravel), "of shape"),
        (edit_array("fit_.references.0.std", np.negative), "uncertainties of 0 or more"),
        (edit_array("fit_.references.0.robust_weight", first_number(-0.1)), "robust weights from 0 to 1"),
        (edit_array("fit_.references.0.repeat_variance", first_number(-1e-9)), "variances of repeats of 0 or more"),
        (edit_array("fit_.references.0.repeat_variance", lambda a: np.ones((3, 7))), "of shape"),
        (edit_array("fit_.references.0.repeat_variance", first_number(np.nan)), "not finite"),
        (edit_array("refit_reading_ids_", lambda a: np.ones((2, 2))), "refit_reading_ids_ of shape"),
        (edit_json("learned", "excluded_terms_", value=[["J1"]]), "does not describe a model of its kind"),
        (edit_json("learned", "excluded_terms_", value=["J1"]), "expected a list"),
        (edit_header(options={"highest": 0}), "expected a highest order"),
        (edit_array("arm_.gravity_in_base", lambda a: 0 * a), "gravity as a direction"),
        (edit_array("arm_.gravity_in_base", lambda a: a[:2]), "gravity as a direction"),
        (edit_array("variance_function_.spread", lambda a: 0 * a), "positive spread"),
        (edit_array("variance_function_.slope", lambda a: a[1:]), "variance function"),
    ],
)
def test_a_physical_model_that_is_not_sound_is_refused(change, message, sound, tmp_path):
    refused(sound / "physical", change, message, tmp_path)


def test_many_unknowns_are_not_written_beyond_what_is_read(mixed, tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.models.model_archive.MAX_HEADER_BYTES", 10_000)
    with pytest.raises(TruearmError, match="larger than a model file may be"):
        mixed[0].save(tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_model_file_is_refused(tmp_path):
    path = tmp_path / "m.truearm"
    refuses("does not exist", load_model, path)
    path.write_text("q1_deg,q2_deg\n")
    refuses("expected a model file", load_model, path)
    path.write_bytes(b"")
    refuses("expected a model file", load_model, path)
    refuses("expected a file, got a folder", load_model, tmp_path)


def test_a_compressed_bomb_is_refused(fitted, tmp_path):
    path = tmp_path / "m.truearm"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("model.json", b" " * (80 << 20))
    refuses("compressed or larger", load_model, path)


def edit_member(*path, value):
    return edit_json("learned", "members_", 1, *path, value=value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit_array("members_.1.record.perf", lambda a: a[1:]), "of shape"),
        (edit_member("record", "best_epoch", value=5), "a best epoch of member 1"),
        (edit_member("record", "best_epoch", value=-1), "a best epoch of member 1"),
        (edit_member("record", "best_epoch", value=1.0), "expected int"),
        (edit_member("start", value=-1), "expected a start"),
        (edit_member("record", "stop", value=None), "expected str"),
        (edit_member("record", value={}), "model.json, members_.1.record"),
        (edit_json("learned", "members_", value=[]), "has no array"),
        (edit_array("members_.1.record.val_fail", first_number(0.5)), "whole numbers"),
        (edit_array("members_.0.weights", lambda a: a[1:]), "weights of shape"),
        (edit_array("members_.0.weights", lambda a: a.sum()), "weights of shape"),
        (edit_array("members_.0.weights", lambda a: a * np.inf), "not finite"),
        (edit_array("members_.0.basis_covariance", np.negative), "not a covariance"),
        (edit_json("learned", "network_", "sizes", value=[3, 4, 3]), "layers that the options state"),
        (edit_json("learned", "network_", "hidden", value=["relu"]), "unknown activation"),
    ],
)
def test_an_ensemble_that_is_not_sound_is_refused(change, message, sound, tmp_path):
    refused(sound / "network", change, message, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit_array("inputs_.kept", lambda a: a[::-1]), "numbered upwards"),
        (edit_array("inputs_.kept", lambda a: a + 3), "inputs that there are"),
        (edit_array("inputs_.is_prismatic", lambda a: 1 - a), "inputs of the joints"),
        (edit_array("inputs_.scale.upper", lambda a: -a), "rise from lower"),
        (edit_array("committee_.weights", lambda a: a[:1]), "two networks or more"),
        (edit_array("committee_.weights", lambda a: a[:, 1:]), "weights of shape"),
        (edit_array("committee_.effective", lambda a: a[1:]), "effective of shape"),
        (edit_array("fit_.covariance", np.negative), "not a covariance"),
        (edit_json("learned", "target_scale_mm_", value=0.0), "scale above zero"),
        (edit_json("learned", "tail_freedom_", value=1.0), "degrees of freedom"),
        (edit_json("options", "arm_model", value="drawn"), "arm_model among"),
    ],
)
def test_a_hybrid_that_is_not_sound_is_refused(change, message, sound, tmp_path):
    refused(sound / "hybrid", change, message, tmp_path)
