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
from truearm.errors import InputError, TruearmError
from truearm.models import MODELS, KinematicModel, NetworkModel
from truearm.models.file import load_model, save_model
from truearm.models.network import TRAINERS

KEPT_TIP_MM = [758.9268461603382, 14.755674969324792, 237.3313078392036]
KEPT_STD_MM = [0.006642343415025093, 0.006958388902324782, 0.006697782188492866]
KEPT_NETWORK_TIP_MM = [751.9926603202762, 19.614840525274392, 239.43378856583607]
KEPT_NETWORK_STD_MM = [10.600896814791358, 15.736852900430062, 13.861002821926572]


@pytest.fixture
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
    assert {k: v for k, v in again.get_params().items() if k != "arm"} == {
        k: v for k, v in model.get_params().items() if k != "arm"
    }
    np.testing.assert_array_equal(again.arm.limits, model.arm.limits)


def test_the_same_model_gives_the_same_file(fitted, tmp_path):
    model, _ = fitted("kinematic")
    save_model(model, tmp_path / "a")
    save_model(model, tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_options_as_numpy_leaves_them_are_saved(arm, fitted, tmp_path):
    model, angles = fitted("kinematic")
    model.set_params(prior_length=np.float32(3), robust=np.bool_(True)).fit(angles, model.predict(angles))
    save_model(model, tmp_path / "m")
    assert load_model(tmp_path / "m").get_params()["prior_length"] == 3.0


def test_a_scale_without_a_range_is_refused(fitted, tmp_path):
    model, _ = fitted("network")
    save_model(model, tmp_path / "m")
    rewritten(tmp_path / "m", edit_array("angle_scale_range", lambda a: a[[0, 0]]))
    with pytest.raises(InputError, match="must rise"):
        load_model(tmp_path / "m")


def test_a_file_of_the_first_format_still_loads():
    """Kept from truearm 0.1: a kinematic model of `gao2017`, and what it predicted at its working pose."""
    model = load_model(Path(__file__).parent / "kinematic-format-1.truearm")
    tip, covariance = model.predict(model.arm.working[None], return_cov=True)
    np.testing.assert_allclose(tip, [KEPT_TIP_MM], atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), KEPT_STD_MM, rtol=1e-6)


def test_a_network_of_the_first_format_still_loads():
    """Kept from truearm 0.1: 6-5-4-3 on 60 readings of a virtual `gao2017`."""
    model = load_model(Path(__file__).parent / "network-format-1.truearm")
    tip, covariance = model.predict(model.arm.working[None], return_cov=True)
    np.testing.assert_allclose(tip, [KEPT_NETWORK_TIP_MM], atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance[0])), KEPT_NETWORK_STD_MM, rtol=1e-9)


def test_a_model_of_the_first_format_is_written_in_the_second(tmp_path):
    """Its training is not known any more; all else comes back."""
    old = load_model(Path(__file__).parent / "network-format-1.truearm")
    save_model(old, tmp_path / "m")
    again = load_model(tmp_path / "m")
    assert old.record_ is None is again.record_
    q = old.arm.working[None]
    for one, other in zip(old.predict(q, return_cov=True), again.predict(q, return_cov=True), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture
def ensemble(arm, rng):
    def fit(trainer="lm", **options):
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
    monkeypatch.setattr("truearm.models.file.MAX_BYTES", 2**20 + 1000)
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
    data = bytearray(files["fit_motions.npy"])
    data[-1] ^= 1
    files["fit_motions.npy"] = bytes(data)


def promise_a_terabyte(files):
    data = files["fit_motions.npy"].replace(b"(5, 6)", b"(99999999999, 6)")
    end = data.index(b"\n")
    data = data[: end - 10] + data[end:]
    files["fit_motions.npy"] = data
    header = json.loads(files["model.json"])
    header["arrays"]["fit_motions"] = {"shape": [99999999999, 6], "sha256": hashlib.sha256(data).hexdigest()}
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
    files["../../x.npy"] = files["fit_motions.npy"]
    header = json.loads(files["model.json"])
    header["arrays"]["../../x"] = header["arrays"]["fit_motions"]
    files["model.json"] = json.dumps(header).encode()


def edit_fact(name, value):
    def change(files):
        header = json.loads(files["model.json"])
        header["facts"][name] = value
        files["model.json"] = json.dumps(header).encode()

    return change


def hide_a_pickle(files):
    files["evil.npy"] = np.lib.format.magic(1, 0) + b"..."


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edit_header(format=3), "format 3.*update truearm"),
        (edit_header(format=True), "model.json, format"),
        (edit_header(format=0), "model.json, format"),
        (edit_header(options={"free": 3}), "does not hold what its kind of model needs"),
        (edit_header(options={"prior_length": -1.0}), "prior_length"),
        (edit_fact("fit_noise_std_mm", -5.0), "model.json, facts"),
        (edit_fact("fit_noise_std_mm", float("nan")), "model.json, facts"),
        (edit_array("fit_covariance", np.negative), "not a covariance"),
        (edit_array("arm_limits", np.ravel), "arm_limits of shape"),
        (edit_array("fit_weights", lambda a: a[:4].reshape(2, 2)), "fit_weights of shape"),
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
        (promise_a_terabyte, "expected the array fit_motions"),
        (hide_a_pickle, "only what model.json lists, got also .'evil.npy'"),
        (lambda files: {"model.json": b"{"}, "not JSON"),
        (lambda files: {"model.json": b"[]"}, "as a whole"),
        (lambda files: {"other": b""}, "without model.json"),
        (lambda files: files.pop("fit_motions.npy") and None, "does not hold what its kind"),
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
        (edit_header(format=1), "as many rows"),
    ],
)
def test_an_ensemble_that_is_not_sound_is_refused(change, message, ensemble, tmp_path):
    save_model(ensemble()[0], tmp_path / "m")
    rewritten(tmp_path / "m", change)
    with pytest.raises(InputError, match=message):
        load_model(tmp_path / "m")
