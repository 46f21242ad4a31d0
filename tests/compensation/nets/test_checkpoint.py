"""A training that was stopped ends as if it had not been; a file that is not its own is refused."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import zipfile
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.compensation.nets import normal_equations
from truearm.compensation.nets.checkpoint import Checkpoint, TrainingSnapshot
from truearm.compensation.nets.nguyen_widrow import nguyen_widrow
from truearm.compensation.nets.normal_equations import FitProblem
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.train_varpro import train_varpro
from truearm.compensation.nets.trainbr import trainbr
from truearm.compensation.nets.traingd import traingd
from truearm.compensation.nets.traingdx import traingdx
from truearm.compensation.nets.trainlm import trainlm
from truearm.errors import InputError, TruearmError

TRAINERS = [train_varpro, trainlm, trainbr, traingd, traingdx]
EPOCHS = 25


def problems():
    """A noisy sine: training and validation data taken in turn, two hidden layers, and a start."""
    rng = np.random.default_rng(4)
    x = np.linspace(-1, 1, 60)[None]
    network = Perceptron.with_layers(1, (4, 3), 1)
    y = np.sin(4 * x) + 0.1 * rng.normal(size=x.shape)
    parts = [FitProblem(network, x[:, k::2].copy(), y[:, k::2].copy()) for k in range(2)]
    return *parts, nguyen_widrow(network, seed=1)


TRAINING, VALIDATION, START = problems()


class Interrupted(FitProblem):
    """The training data of one whose user presses Ctrl-C in the midst of the k-th pass over them."""

    left = 0

    def _count(self):
        object.__setattr__(self, "left", self.left - 1)
        if self.left == 0:
            raise KeyboardInterrupt

    def summed(self, work, chunk=None):
        self._count()
        return super().summed(work, chunk)

    def normal_equations(self, x):
        self._count()
        return super().normal_equations(x)


def trained(trainer, checkpoint=None, *, validation=VALIDATION, training=TRAINING, **options):
    return trainer(
        training, START, validation=validation, test=VALIDATION, **{"epochs": EPOCHS, **options}, checkpoint=checkpoint
    )


def interrupting_at(k):
    def callback(epoch):
        if epoch.epoch == k:
            raise KeyboardInterrupt

    return callback


def assert_told(told, first, result):
    assert [epoch.epoch for epoch in told] == list(range(first, result[1].num_epochs + 1))


def assert_same(one, other, *, time=False):
    (weights, record), (weights_2, record_2) = one, other
    assert weights.tobytes() == weights_2.tobytes()
    assert type(record) is type(record_2)
    for f in fields(record):
        if f.name != "time" or time:
            np.testing.assert_array_equal(getattr(record, f.name), getattr(record_2, f.name), err_msg=f.name)
    assert (np.diff(record_2.time) >= 0).all()


@pytest.fixture(scope="module")
def whole():
    """Every training without a stop, with and without validation data."""
    return {(t, v is None): trained(t, validation=v) for t in TRAINERS for v in (VALIDATION, None)}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "training.npz"


# Going on ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trainer", TRAINERS)
@settings(max_examples=8, deadline=None)
@given(stops=st.lists(st.integers(0, EPOCHS), min_size=1, max_size=3), with_validation=st.booleans())
def test_interrupted_at_any_epochs_it_ends_as_without_to_the_last_bit(
    whole, tmp_path_factory, trainer, stops, with_validation
):
    file = tmp_path_factory.mktemp("checkpoint") / "training.npz"
    validation = VALIDATION if with_validation else None
    expected = whole[trainer, not with_validation]
    first = 0
    for stop in sorted(stops):
        try:
            trained(trainer, Checkpoint(file, "mine", 1e9), validation=validation, callback=interrupting_at(stop))
            first = expected[1].num_epochs + 1
        except KeyboardInterrupt:
            assert file.exists() == (stop > 0)
            first = stop
    told = []
    result = trained(trainer, Checkpoint(file, "mine", 1e9), validation=validation, callback=told.append)
    assert_same(expected, result)
    # The epoch whose telling was interrupted is told again, and none before it.
    assert_told(told, first, expected)


@pytest.mark.parametrize("trainer", TRAINERS)
@pytest.mark.parametrize("k", [2, 3, 8, 15])
def test_interrupted_in_the_midst_of_an_epoch_it_goes_on_from_the_last_whole_one(whole, file, trainer, k):
    training = Interrupted(TRAINING.network, TRAINING.inputs, TRAINING.targets)
    object.__setattr__(training, "left", k)
    before, after = [], []
    with pytest.raises(KeyboardInterrupt):
        trained(trainer, Checkpoint(file, "mine", 1e9), training=training, callback=before.append)
    assert file.exists() == bool(before)  # not where the start itself was interrupted
    result = trained(trainer, Checkpoint(file, "mine", 1e9), callback=after.append)
    assert_same(whole[trainer, False], result)
    assert_told(before + after, 0, result)


@pytest.mark.parametrize("trainer", [train_varpro, traingdx])
def test_sums_that_threads_share_come_out_the_same_again(file, trainer, monkeypatch):
    """Enough samples for several chunks, which threads work off in any order."""
    asked, pool = [], normal_equations._threads
    monkeypatch.setattr(normal_equations, "FLOPS_WORTH_THREADS", 0)
    monkeypatch.setattr(normal_equations, "cores", lambda: 3)
    monkeypatch.setattr(normal_equations, "_threads", lambda n: asked.append(n) or pool(n))
    inputs = np.random.default_rng(0).uniform(-1, 1, (3, 10_000))
    many = FitProblem(Perceptron.with_layers(3, (5,), 1), inputs, np.sin(inputs.sum(axis=0))[None])
    start = nguyen_widrow(many.network, seed=0)
    expected = trainer(many, start, epochs=4)
    with pytest.raises(KeyboardInterrupt):
        trainer(many, start, epochs=4, callback=interrupting_at(2), checkpoint=Checkpoint(file, "mine"))
    told = []
    result = trainer(many, start, epochs=4, checkpoint=Checkpoint(file, "mine"), callback=told.append)
    assert_same(expected, result)
    assert_told(told, 2, expected)
    assert set(asked) == {3}


@pytest.mark.parametrize(
    ("error", "written"), [(KeyboardInterrupt, True), (SystemExit(143), True), (ZeroDivisionError, False)]
)
def test_what_stops_a_training_goes_on_its_way_after_the_file_is_written(file, error, written):
    def callback(epoch):
        if epoch.epoch == 3:
            raise error

    with pytest.raises(error if isinstance(error, type) else type(error)):
        trained(trainlm, Checkpoint(file, "mine", 1e9), callback=callback)
    assert file.exists() == written


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_finished_trainings_file_gives_its_end_at_once(whole, file, trainer):
    first = trained(trainer, Checkpoint(file, "mine"))
    assert_same(whole[trainer, False], first)
    before = file.read_bytes()

    def never(epoch):
        raise AssertionError

    again = trained(trainer, Checkpoint(file, "mine"), callback=never)
    assert_same(first, again, time=True)
    assert file.read_bytes() == before


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_killed_it_goes_on_from_its_last_file(whole, file):
    """SIGKILL cannot be caught: what was written at the end of an epoch is all there is."""
    script = f"""
import os, signal, sys
sys.path.insert(0, {str(__file__.rpartition("/")[0])!r})
from test_checkpoint import Checkpoint, trainbr, trained
def die(epoch):
    if epoch.epoch == 9:
        os.kill(os.getpid(), signal.SIGKILL)
trained(trainbr, Checkpoint({str(file)!r}, "mine", 0.0), callback=die)
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ran.returncode == -signal.SIGKILL, ran.stderr
    told = []
    result = trained(trainbr, Checkpoint(file, "mine"), callback=told.append)
    assert_same(whole[trainbr, False], result)
    assert_told(told, 9, result)


def test_the_file_is_written_no_more_often_than_asked(file, monkeypatch):
    written = []
    write = Checkpoint.write
    monkeypatch.setattr(Checkpoint, "write", lambda self, *a: written.append(0) or write(self, *a))
    trained(trainlm, Checkpoint(file, "mine", 1e9))
    assert len(written) == 1  # at the end
    file.unlink()
    _, record = trained(trainlm, Checkpoint(file, "mine", 0.0))
    assert len(written) == 1 + record.num_epochs + 1
    assert [p.name for p in file.parent.iterdir()] == [file.name]  # nothing is left beside it


def test_a_further_stop_of_the_time_counts_what_went_before(file):
    with pytest.raises(KeyboardInterrupt):
        trained(trainlm, Checkpoint(file, "mine"), callback=interrupting_at(4))
    # A second is asked for, a thousand have gone by.
    _edit(file, rows=lambda rows: np.where(np.arange(rows.shape[1]) == 6, rows + 1000, rows))
    _, record = trained(trainlm, Checkpoint(file, "mine"), time=1000.0, min_grad=0.0)
    assert record.stop == "Maximum time elapsed."
    assert record.num_epochs == 4
    assert record.time[-1] >= 1000


# Files that are not its own ------------------------------------------------------------------------------------------


@pytest.fixture
def interrupted(file):
    with pytest.raises(KeyboardInterrupt):
        trained(traingdx, Checkpoint(file, "mine"), callback=interrupting_at(6))
    return file


def _edit(file, *, about=None, **changes):
    """The archive again, with arrays changed by functions, or put in their place."""
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, change in changes.items():
        arrays[name] = change(arrays[name]) if callable(change) else change
    if about is not None:
        found = json.loads(arrays["about"].tobytes()) | about
        arrays["about"] = np.frombuffer(json.dumps(found).encode(), dtype=np.uint8)
    np.savez(file, **{name: array for name, array in arrays.items() if array is not None})


def test_the_file_is_a_plain_npz(interrupted):
    with np.load(interrupted) as archive:  # pickles are not allowed by default
        assert archive["rows"].shape == (6, 8)
        assert archive["x"].shape == (START.size,)
        assert json.loads(archive["about"].tobytes())["trainer"] == "traingdx"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"about": {"fingerprint": "other"}}, "of another training"),
        ({"about": {"trainer": "trainlm"}}, "of another training"),
        ({"about": {"format": 2}}, "expected a checkpoint of format 1, got 2"),
        ({"about": {"more": 1}}, "'about' is not that of a checkpoint"),
        ({"about": {"best_epoch": -1}}, "'about' is not that of a checkpoint"),
        ({"about": {"best_epoch": 6}}, "up to the best epoch"),
        ({"about": {"stop": "x" * 70000}}, "about is compressed or larger"),
        ({"x": lambda x: x[:-1]}, "expected the array x"),
        ({"x": lambda x: np.full_like(x, np.nan)}, "not finite"),
        ({"x": lambda x: x.astype(np.float32)}, "expected the array x as <f8"),
        ({"x": lambda x: x.astype(">f8")}, "expected the array x as <f8"),
        ({"memory": lambda m: -m}, "learning rate that is not above zero"),
        ({"memory": lambda m: m[:1]}, "expected the array memory"),
        ({"rows": lambda r: r[:0]}, "up to the best epoch"),
        ({"rows": lambda r: r[:, :-1]}, "expected rows of 8 numbers"),
        ({"rows": lambda r: np.concatenate([r] * 9)}, "rows is compressed or larger|expected the array rows"),
        ({"rows": lambda r: np.asfortranarray(r)}, "expected the array rows"),
        ({"rows": lambda r: np.full_like(r, np.nan)}, "not finite"),
        ({"best_x": None}, "another archive"),
        ({"more": np.zeros(3)}, "another archive"),
    ],
)
def test_a_foreign_file_is_refused(interrupted, edit, message):
    _edit(interrupted, **edit)
    before = interrupted.read_bytes()
    with pytest.raises(InputError, match=message) as caught:
        trained(traingdx, Checkpoint(interrupted, "mine"))
    assert caught.value.file == interrupted
    assert "delete it to start the training from the beginning" in str(caught.value)
    assert interrupted.read_bytes() == before


@pytest.mark.parametrize("trainer", [train_varpro, trainlm, trainbr])
def test_damping_that_no_training_has_is_refused(file, trainer):
    with pytest.raises(KeyboardInterrupt):
        trained(trainer, Checkpoint(file, "mine"), callback=interrupting_at(5))
    _edit(file, memory=lambda m: -m)
    with pytest.raises(InputError, match=r"expected .* above zero|expected mu > 0"):
        trained(trainer, Checkpoint(file, "mine"))


@pytest.mark.parametrize("column", [9, 10])
def test_evidence_that_no_training_has_is_refused(file, column):
    with pytest.raises(KeyboardInterrupt):
        trained(trainbr, Checkpoint(file, "mine"), callback=interrupting_at(5))
    _edit(file, rows=lambda r: np.where(np.arange(r.shape[1]) == column, -r, r))
    with pytest.raises(InputError, match="alpha or beta that is not above zero"):
        trained(trainbr, Checkpoint(file, "mine"))


def _npy(header: str, data: bytes = b"") -> bytes:
    padded = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(padded).to_bytes(2, "little") + padded + data


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("x.npy", _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }")),
        ("x.npy", _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }")),
        ("x.npy", _npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", b"cos\nsystem\n(S'true'\ntR.")),
        ("x.npy", _npy("__import__('os')")),
        ("x.npy", b"\x93NUMPY\x03\x00"),
        ("x.npy", b""),
        ("about.npy", b"no array"),
        ("about.npy", _npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2,), }", b"\xff\xfe")),
        ("about.npy", _npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2,), }", b"[]")),
    ],
)
def test_hostile_arrays_are_refused_before_memory_is_taken(interrupted, name, content):
    with zipfile.ZipFile(interrupted) as archive:
        members = {n: archive.read(n) for n in archive.namelist()} | {name: content}
    with zipfile.ZipFile(interrupted, "w") as archive:
        for n, data in members.items():
            archive.writestr(n, data)
    with pytest.raises(InputError, match="delete it"):
        trained(traingdx, Checkpoint(interrupted, "mine"))


def test_a_compressed_archive_is_refused(interrupted):
    with np.load(interrupted) as archive:
        np.savez_compressed(interrupted, **archive)
    with pytest.raises(InputError, match="is compressed or larger"):
        trained(traingdx, Checkpoint(interrupted, "mine"))


def test_damage_at_any_byte_is_seen_or_harmless(interrupted):
    """Cut short anywhere, or with any byte changed: refused, or read as it was (bytes that say nothing, as dates)."""
    checkpoint = Checkpoint(interrupted, "mine")
    sizes = {"most_rows": EPOCHS + 1, "n_columns": 8, "n": START.size, "n_memory": START.size + 1}
    whole, intact = interrupted.read_bytes(), checkpoint.read("traingdx", **sizes)
    cut = [whole[:k] for k in range(0, len(whole), 5)]
    changed = [whole[:k] + bytes([whole[k] ^ 0x55]) + whole[k + 1 :] for k in range(0, len(whole), 2)]
    refused = 0
    for damaged in [*cut, *changed]:
        interrupted.write_bytes(damaged)
        try:
            found = checkpoint.read("traingdx", **sizes)
        except InputError:
            refused += 1
        else:
            for f in fields(TrainingSnapshot):
                np.testing.assert_array_equal(getattr(found, f.name), getattr(intact, f.name))
    assert refused >= len(cut)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"text", b"\x00" * 4096])
def test_something_else_is_refused(file, content):
    file.write_bytes(content)
    with pytest.raises(InputError, match="expected the checkpoint of a training"):
        trained(trainlm, Checkpoint(file, "mine"))


def test_where_no_file_can_be_written_is_said_before_the_training(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        Checkpoint(tmp_path / "nowhere" / "training.npz", "mine")
    with pytest.raises(InputError, match="got a folder"):
        Checkpoint(tmp_path, "mine")
    with pytest.raises(InputError, match="expected 0 s or more between checkpoints, got -1"):
        Checkpoint(tmp_path / "training.npz", "mine", -1)
    with pytest.raises(InputError, match="got nan"):
        Checkpoint(tmp_path / "training.npz", "mine", float("nan"))


def test_a_file_that_cannot_be_written_in_the_end_leaves_the_old_one(interrupted, monkeypatch):
    before = interrupted.read_bytes()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zipfile.ZipFile, "writestr", full)
    with pytest.raises(TruearmError, match="No space left on device"):
        trained(traingdx, Checkpoint(interrupted, "mine", 0.0))
    assert interrupted.read_bytes() == before
    assert io.BytesIO(before).read(2) == b"PK"
