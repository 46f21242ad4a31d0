"""Model files: the same numbers back, and nothing from a file that is not sound."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.compensation.models import MODELS, KinematicModel, NetworkModel, PhysicalModel
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.compensation.models.model_file import load_model, save_model
from truearm.compensation.models.network import TRAINERS
from truearm.errors import InputError, TruearmError
from truearm.readings import Session

# Files that older versions wrote of an arm `gao2017`, and what those versions predicted at its working pose: tip and
# standard uncertainties [mm], the nominal arm's tip [mm].
KEPT = {
    "kinematic-format-1": (
        [758.9268461603382, 14.755674969324792, 237.3313078392036],
        [0.006642343415025093, 0.006958388902324782, 0.006697782188492866],
        [758.9320554947479, 14.75167507690874, 237.32485296964506],
    ),
    "network-format-1": (
        [751.9926603202762, 19.614840525274392, 239.43378856583607],
        [10.600896814791358, 15.736852900430062, 13.861002821926572],
        [758.203664119733, 14.999999999999998, 236.88741653746303],
    ),
    "nominal-format-2": (
        [858.598266119596, 217.6331274329102, 536.9964806506231],
        [0.4438664923385836, 0.4438915397890568, 0.44387077402135555],
        [858.598266119596, 217.6331274329102, 536.9964806506231],
    ),
    "kinematic-format-2": (
        [858.5640979232481, 217.53273834808957, 536.9197549760889],
        [0.019439022541773, 0.02004265281846445, 0.01948495085421197],
        [858.598266119596, 217.6331274329102, 536.9964806506231],
    ),
    "network-format-2": (
        [808.0907586569094, 177.77968926410523, 584.8906978393541],
        [45.00120316930112, 55.31576258082871, 56.30488807014532],
        [858.598266119596, 217.6331274329102, 536.9964806506231],
    ),
    "physical-format-3": (
        [61.0017410199302, -47.99909471758715, 2.99888540178867],
        [0.010109280990877956, 0.01012790564349316, 0.010078452366230693],
        [61.00171169754166, -47.99894777884096, 2.9989775415453046],
    ),
}


@pytest.fixture(scope="module")
def arm():
    fixed = np.tile(np.eye(4), (4, 1, 1))
    fixed[1:, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    fixed[1:, :3, 3] = [20, 0, 100]
    chain = Chain(fixed, np.array([0, 0, 50.0]), np.array([False, True, False]))
    return Arm("mixed", chain, title="Two turn, one slides", upper=np.array([np.inf, 50, 2]), source="made for a test")


@pytest.fixture
def fitted(arm, rng):
    def fit(name):
        angles = rng.uniform(-1, 1, (40, 3)) * [1, 40, 1]
        points = arm.chain.tip_in_base(angles) + [1.0, 2.0, 3.0] + rng.normal(0, 0.01, (40, 3))
        model = MODELS[name](arm)
        if name == "network":
            model.set_params(hidden=(4, 3), epochs=5)
        if name == "physical":
            model.set_params(highest=4)
        return model.fit(angles, points), angles

    return fit


@pytest.mark.parametrize("name", MODELS)
def test_a_model_comes_back_to_the_last_bit(name, fitted, tmp_path):
    model, angles = fitted(name)
    save_model(model, tmp_path / "m.truearm")
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
    save_model(model, tmp_path / "m")
    again = load_model(tmp_path / "m")
    for one, other in zip(
        model.predict_readings(readings, return_cov=True),
        again.predict_readings(readings, return_cov=True),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)
    assert again.excluded_terms_ == model.excluded_terms_ != ()
    assert again.columns_ == model.columns_
    assert again.column_variances_ == model.column_variances_ != {}
    assert again.temperature_degC_ == model.temperature_degC_
    assert again.temperature_variance_K2_ == model.temperature_variance_K2_ > 0
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
            for part in ("rows", "residuals", "std", "trust", "artefact"):
                np.testing.assert_array_equal(getattr(s, part), getattr(r, part))
    for part in ("rows", "group", "deviations", "covariance", "freedom"):
        np.testing.assert_array_equal(getattr(again.held_out_, part), getattr(model.held_out_, part))
    assert len(model.held_out_.rows) >= 50
    assert "load_1_Nm" in [term.group for term in again.fit_.perturbed_chain.terms]


def test_the_same_model_gives_the_same_file(fitted, tmp_path):
    model, _ = fitted("physical")
    save_model(model, tmp_path / "a")
    save_model(model, tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_options_as_numpy_leaves_them_are_saved(arm, fitted, tmp_path):
    model, angles = fitted("physical")
    model.set_params(highest=np.int64(2), robust=np.bool_(True)).fit(angles, model.predict(angles))
    save_model(model, tmp_path / "m")
    assert load_model(tmp_path / "m").get_params()["highest"] == 2


def test_a_scale_without_a_range_is_refused(fitted, tmp_path):
    model, _ = fitted("network")
    save_model(model, tmp_path / "m")
    rewritten(tmp_path / "m", edit_array("angle_scale_range", lambda a: a[[0, 0]]))
    with pytest.raises(InputError, match="must rise"):
        load_model(tmp_path / "m")


@pytest.mark.parametrize("kept", KEPT)
def test_a_file_of_an_older_format_predicts_what_it_did(kept):
    """To the last bit on the machine that wrote it; sums in another order leave 1e-12."""
    model = load_model(Path(__file__).parent / f"{kept}.truearm")
    tip, std, nominal = KEPT[kept]
    points, covariance = model.predict(model.arm.working[None], return_cov=True)
    np.testing.assert_allclose(points, [tip], rtol=1e-12)
    # Of a covariance that is singular to rounding, what was below zero is left out since.
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), std, rtol=1e-5)
    np.testing.assert_allclose(model.predict_nominal(model.arm.working[None]), [nominal], rtol=1e-12)
    assert model.free_ == model.free


@pytest.mark.parametrize("kept", KEPT)
def test_a_model_of_an_older_format_is_written_in_the_present_one(kept, tmp_path):
    """A network's training of format 1 is not known any more, nor the residuals of a fit; all else comes back."""
    old = load_model(Path(__file__).parent / f"{kept}.truearm")
    save_model(old, tmp_path / "m")
    again = load_model(tmp_path / "m")
    q = old.arm.working + np.linspace(-0.5, 0.5, 5)[:, None]
    for one, other in zip(old.predict(q, return_cov=True), again.predict(q, return_cov=True), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(old.predict_nominal(q), again.predict_nominal(q))
    if kept == "network-format-1":
        assert old.record_ is None is again.record_
    if isinstance(old, IdentifiedModel):
        assert again.residual_std_ == old.residual_std_ > 0
        assert len(old.held_out_.rows) == len(again.held_out_.rows) == (24 if kept == "physical-format-3" else 0)
    assert again.arm.masses is None
    np.testing.assert_array_equal(again.arm.gravity_direction, [0, 0, -1])


@pytest.fixture
def ensemble(arm, rng):
    def fit(trainer="varpro", **options):
        angles = rng.uniform(-1, 1, (40, 3)) * [1, 40, 1]
        points = arm.chain.tip_in_base(angles) + rng.normal(0, 0.01, (40, 3))
        options = {"hidden": (3,), "epochs": 4, "n_members": 3, "n_restarts": 2} | options
        return NetworkModel(arm, trainer=trainer, **options).fit(angles, points), angles

    return fit


@pytest.mark.parametrize("trainer", TRAINERS)
def test_an_ensemble_comes_back_with_the_records_of_its_trainings(trainer, ensemble, tmp_path):
    model, angles = ensemble(trainer)
    save_model(model, tmp_path / "m")
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


def test_a_model_larger_than_its_file_may_be_is_not_written(ensemble, tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.compensation.models.model_file.MAX_BYTES", 2**20 + 1000)
    with pytest.raises(TruearmError, match="does not fit a model file"):
        save_model(ensemble()[0], tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def test_an_unfitted_model_is_not_saved(arm, tmp_path):
    with pytest.raises(TruearmError, match="fitted"):
        save_model(KinematicModel(arm), tmp_path / "m")
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


def flip_a_bit(files):
    data = bytearray(files["fit_coefficients.npy"])
    data[-1] ^= 1
    files["fit_coefficients.npy"] = bytes(data)


def promise_a_terabyte(files):
    data = files["arm_fixed.npy"].replace(b"(4, 4, 4)", b"(99999999999, 4, 4)")
    end = data.index(b"\n")
    data = data[: end - 10] + data[end:]
    files["arm_fixed.npy"] = data
    header = json.loads(files["model.json"])
    header["arrays"]["arm_fixed"] = {"shape": [99999999999, 4, 4], "sha256": hashlib.sha256(data).hexdigest()}
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


def add_an_array(files):
    files["../../x.npy"] = files["fit_coefficients.npy"]
    header = json.loads(files["model.json"])
    header["arrays"]["../../x"] = header["arrays"]["fit_coefficients"]
    files["model.json"] = json.dumps(header).encode()


def lose(name):
    """Take an array out, from the header too."""

    def change(files):
        del files[f"{name}.npy"]
        header = json.loads(files["model.json"])
        del header["arrays"][name]
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_fact(name, value):
    def change(files):
        header = json.loads(files["model.json"])
        header["facts"][name] = value
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_fit(edit, name="fit_"):
    """Change what the header says of an identification."""

    def change(files):
        header = json.loads(files["model.json"])
        edit(header["identified"][name])
        files["model.json"] = json.dumps(header).encode()

    return change


def edit_term(number=0, **changes):
    return edit_fit(lambda fit: fit["terms"][number].update(changes))


def edit_reference(**changes):
    return edit_fit(lambda fit: fit["references"][0].update(changes))


def edit_group(**changes):
    return edit_fit(lambda fit: fit["groups"][0].update(changes))


def hide_a_pickle(files):
    files["evil.npy"] = np.lib.format.magic(1, 0) + b"..."


def first_row_networks(value):
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
        (edit_header(options={"free": 3}), "does not hold what its kind of model needs"),
        (edit_header(options={"free": ["elbow"]}), "expected free parts"),
        (edit_header(options={"prior_length": 3.0}), "does not hold what its kind of model needs"),
        (edit_header(free=["elbow"]), "model.json, free"),
        (edit_fact("unexplained_std_mm", -5.0), "model.json, facts"),
        (edit_fact("unexplained_std_mm", float("nan")), "model.json, facts"),
        (edit_array("fit_covariance", np.negative), "not a covariance"),
        (edit_array("arm_limits", np.ravel), "arm_limits of shape"),
        (edit_array("arm_tip", lambda a: a * np.nan), "not finite"),
        (edit_array("arm_fixed", lambda a: a * 2), "not a rigid motion"),
        (add_an_array, "has no array '../../x'"),
        (edit_header(format="one"), "model.json, format"),
        (edit_header(model="oracle"), "model.json, model"),
        (edit_header(options={"colour": "red"}), "does not hold what its kind of model needs"),
        (edit_header(surprise=1), "surprise"),
        (edit_header(facts={}), "does not hold what its kind"),
        (edit_header(arrays={}), "only what model.json lists"),
        (flip_a_bit, "SHA-256 differs"),
        (promise_a_terabyte, "expected the array arm_fixed"),
        (hide_a_pickle, "only what model.json lists, got also .'evil.npy'"),
        (lambda files: {"model.json": b"{"}, "not JSON"),
        (lambda files: {"model.json": b"[]"}, "as a whole"),
        (lambda files: {"model.json": b"[" * 10**5}, "not JSON"),
        (lambda files: {"model.json": b" " * (17 << 20)}, "larger than a model needs"),
        (lambda files: {"other": b""}, "without model.json"),
        (lambda files: files.pop("fit_coefficients.npy") and None, "does not hold what its kind"),
    ],
)
def test_an_unsound_file_is_refused_with_the_reason(change, message, fitted, tmp_path):
    model, _ = fitted("kinematic")
    path = tmp_path / "m.truearm"
    save_model(model, path)
    rewritten(path, change)
    with pytest.raises(InputError, match=message) as caught:
        load_model(path)
    assert str(path) in str(caught.value)


HARMONICS = {"kind": "Harmonics", "joint": 1, "orders": [1, 2]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        # Terms that do not fit the arm, or are none.
        (edit_header(identified={}), "does not say what nominal_ is"),
        (edit_header(identified={"else_": {}}), "model.json, identified"),
        (edit_fit(lambda fit: fit["terms"].pop()), "of shape"),
        (edit_fit(lambda fit: fit["terms"].append(fit["terms"][0])), "of shape"),
        (edit_fit(lambda fit: fit.update(terms=[])), "of shape"),
        (edit_fit(lambda fit: fit.update(terms=[3])), "model.json, identified"),
        (edit_fit(lambda fit: fit.update(terms=[{}])), "expected a term with"),
        (edit_fit(lambda fit: fit["terms"][0].pop("group")), "expected a term with"),
        (edit_term(place=8), "expected a place from 0 .base. to 7"),
        (edit_term(place=-1), "expected a place of 0 or more"),
        (edit_term(place=10**30), "expected a place from 0"),
        (edit_term(direction=[0, 0, 0, 0, 0, 0]), "not all zero"),
        (edit_term(direction=[1, 0]), "expected a direction of 6 numbers"),
        (edit_term(direction=["1", 0, 0, 0, 0, 0]), "expected finite numbers as direction"),
        (edit_term(prior_std=-1.0), "above zero"),
        (edit_term(prior_std=0), "above zero"),
        (edit_term(prior_std=[1.0, 2.0]), "expected 1 prior standard deviations"),
        (edit_term(learn="yes"), "expected learn as true or false"),
        (edit_term(name=""), "term's name"),
        (edit_term(basis={"kind": "os.system"}), "expected a basis among"),
        (edit_term(basis=["Constant"]), "expected a basis as a table"),
        (edit_term(basis={"kind": "Constant", "surprise": 1}), "expected the fields of a basis 'Constant'"),
        (edit_term(basis=HARMONICS | {"orders": [10**9]}), "expected orders as whole numbers, 1 to 1000"),
        (edit_term(basis=HARMONICS | {"joint": 0}), "expected joint as whole numbers, 1 or more"),
        (edit_term(basis=HARMONICS), "of shape"),
        (edit_term(basis={"kind": "GravityTorque", "joint": 9, "axis": 0}), "expected a joint from 1 to 6, got 9"),
        (edit_term(basis={"kind": "Temperature", "link": 9}), "expected a link from 0 to 6, got 9"),
        (edit_term(basis={"kind": "Column", "name": "load_7_Nm"}), "expected readings with a column 'load_7_Nm'"),
        (edit_term(basis={"kind": "Direction", "joint": 7}), "expected a joint from 1 to 6, got 7"),
        (
            edit_fit(lambda fit: fit["terms"][0].update(basis={"kind": "Temperature", "link": 0}), "nominal_"),
            "with a te",
        ),
        (edit_header(column_means={}, column_variances={}), "expected readings with a column 'load_1_Nm'"),
        (edit_header(temperature_degC=float("inf")), "model.json, temperature_degC"),
        (edit_header(column_means={"load_1_Nm": float("nan")}), "model.json, column_means"),
        # Numbers of terms and groups.
        (edit_array("fit_prior_std", np.negative), "fit_prior_std must be above zero"),
        (edit_array("fit_coefficients", lambda a: a[1:]), "fit_coefficients of shape"),
        (edit_array("fit_coefficients", lambda a: a * np.nan), "not finite"),
        (edit_array("fit_coefficients", lambda a: 0 * a + 1e308), "finite numbers at the arm's working pose"),
        (edit_array("fit_covariance", lambda a: a[1:, 1:]), "fit_covariance of shape"),
        (edit_array("fit_covariance", lambda a: np.eye(len(a)) * 1e308), "finite numbers at the arm's working pose"),
        (edit_array("fit_chain_fixed", lambda a: a[1:]), "expected|does not hold"),
        (lose("fit_prior_std"), "does not hold what its kind"),
        (edit_group(effective=-1.0), "model.json, identified.fit_.groups"),
        (edit_group(scale=float("nan")), "model.json, identified.fit_.groups"),
        (edit_group(n_coefficients=-1), "model.json, identified.fit_.groups"),
        (edit_group(n_coefficients=10**30), "model.json, identified.fit_.groups"),
        (edit_fit(lambda fit: fit.update(rounds=-1)), "model.json, identified.fit_.rounds"),
        # References and readings.
        (edit_fit(lambda fit: fit.update(references=[])), "model.json, identified.fit_.references"),
        (edit_fit(lambda fit: fit["references"].pop()), "has no array"),
        (edit_fit(lambda fit: fit["references"].append(fit["references"][0])), "does not hold what its kind"),
        (edit_fit(lambda fit: fit.update(references=fit["references"] * 10)), "model.json, identified.fit_.references"),
        (edit_reference(noise_std_mm=-1.0), "model.json, identified.fit_.references"),
        (edit_reference(unknowns={"x": float("inf")}), "model.json, identified.fit_.references"),
        (edit_array("fit_rows_0", first_row_networks(1e9)), "fit_rows_0 as whole numbers below 120"),
        (edit_array("fit_rows_0", first_row_networks(-1)), "fit_rows_0 as whole numbers below 120"),
        (edit_array("fit_rows_0", first_row_networks(0.5)), "fit_rows_0 as whole numbers below 120"),
        (edit_array("fit_rows_0", lambda a: a[1:]), "fit_trust_0 of shape"),
        (edit_array("fit_rows_0", lambda a: a.reshape(2, -1)), "fit_rows_0 as whole numbers"),
        (edit_array("fit_residuals_0", np.sum), "fit_(std|residuals)_0 of shape"),
        (edit_array("fit_residuals_0", np.ravel), "fit_(std|residuals)_0 of shape"),
        (edit_array("fit_std_0", np.negative), "fit_std_0 must be 0 or more"),
        (edit_array("fit_std_0", lambda a: a[:1]), "fit_std_0 of shape"),
        (edit_array("fit_trust_0", first_row_networks(-0.1)), "fit_trust_0 must be from 0 to 1"),
        (edit_array("fit_trust_0", lambda a: a[1:]), "fit_trust_0 of shape"),
        (edit_array("fit_artefact_1", first_row_networks(1e9)), "fit_artefact_1 as whole numbers below 120"),
        (edit_array("held_out_rows", first_row_networks(120)), "held_out_rows as whole numbers below 120"),
        (edit_array("held_out_rows", lambda a: a[1:]), "held_out_freedom of shape"),
        (edit_array("held_out_group", first_row_networks(-1)), "held_out_group as whole numbers below 120"),
        (edit_array("held_out_freedom", first_row_networks(0)), "held_out_freedom must be above 0"),
        (edit_array("held_out_freedom", first_row_networks(2)), "held_out_freedom must be above 0"),
        (edit_array("held_out_deviations", lambda a: a[:, :2]), "held_out_deviations of shape"),
        (edit_array("held_out_covariance", np.negative), "held_out_covariance does not hold covariances"),
        (lose("held_out_rows"), "does not hold what its kind"),
        (edit_header(n_train=3), "whole numbers below 3"),
        (edit_header(n_train=10**30), "model.json, n_train"),
        (edit_header(left_out=[["J1"]]), "model.json, left_out"),
        (edit_header(format=2), "does not hold|has no array|of shape"),
        (edit_header(format=1), "does not hold|has no array|of shape"),
        (edit_header(model="nominal"), "does not hold what its kind"),
        (edit_header(model="network"), "does not hold what its kind"),
        (edit_header(options={"highest": 0}), "expected a highest order"),
        (lose("arm_gravity"), "does not hold what its kind"),
        (edit_array("arm_gravity", lambda a: 0 * a), "gravity as a direction"),
        (edit_array("arm_gravity", lambda a: a[:2]), "arm_gravity of shape"),
        # How what it depends on varied.
        (edit_header(column_variances={}), "a mean and a variance of every column"),
        (edit_header(column_variances={"load_1_Nm": -1.0}), "model.json, column_variances"),
        (edit_header(temperature_variance_K2=None), "a mean and a variance of the temperature"),
        (edit_header(temperature_variance_K2=float("nan")), "model.json, temperature_variance_K2"),
        (edit_fact("widening", 0.5), "expected a widening of 1 or more"),
    ],
)
def test_a_physical_model_that_is_not_sound_is_refused(change, message, mixed, tmp_path):
    save_model(mixed[0], tmp_path / "m")
    rewritten(tmp_path / "m", change)
    with pytest.raises(InputError, match=message) as caught:
        load_model(tmp_path / "m")
    assert str(tmp_path / "m") in str(caught.value)


def test_many_unknowns_are_not_written_beyond_what_is_read(mixed, tmp_path, monkeypatch):
    monkeypatch.setattr("truearm.compensation.models.model_file.MAX_HEADER_BYTES", 10_000)
    with pytest.raises(TruearmError, match="does not fit a model file"):
        save_model(mixed[0], tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_model_file_is_refused(tmp_path):
    path = tmp_path / "m.truearm"
    with pytest.raises(InputError, match="no such file"):
        load_model(path)
    path.write_text("q1_deg,q2_deg\n")
    with pytest.raises(InputError, match="expected a model file"):
        load_model(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="expected a model file"):
        load_model(path)
    with pytest.raises(InputError, match="expected a model file"):
        load_model(tmp_path)


def test_a_compressed_bomb_is_refused(fitted, tmp_path):
    path = tmp_path / "m.truearm"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("model.json", b" " * (80 << 20))
    with pytest.raises(InputError, match="compressed or larger"):
        load_model(path)


def edit_member(**changes):
    def change(files):
        header = json.loads(files["model.json"])
        header["members"][1].update(changes)
        files["model.json"] = json.dumps(header).encode()

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit_member(epochs=3), "network_record of shape"),
        (edit_member(epochs=2**62), "members.1.epochs"),
        (edit_member(best_epoch=5), "does not hold what its members say"),
        (edit_member(start=-1), "members.1.start"),
        (edit_member(stop="x" * 300), "members.1.stop"),
        (edit_header(members=[]), "has no array 'network_record'"),
        (edit_header(record=["perf", "magic"]), "unknown columns"),
        (edit_array("network_record", lambda a: np.where(a == 0, np.nan, a)), "members say"),
        (edit_array("network_record", lambda a: a[:-1]), "network_record of shape"),
        (edit_array("network_weights", lambda a: a[:2]), "as many rows"),
        (edit_array("network_weights", lambda a: a[:0]), "as many rows"),
        (edit_array("network_weights", lambda a: a[:, 1:]), "network_weights of shape"),
        (edit_array("network_weights", lambda a: a.sum()), "does not hold what"),
        (edit_array("network_basis_covariance", np.negative), "not a covariance"),
        (edit_array("network_weights", lambda a: a * np.inf), "not finite"),
        (edit_header(format=1), "of shape"),
    ],
)
def test_an_ensemble_that_is_not_sound_is_refused(change, message, ensemble, tmp_path):
    save_model(ensemble()[0], tmp_path / "m")
    rewritten(tmp_path / "m", change)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path / "m")
