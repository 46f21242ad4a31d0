"""Laws of `one_blas_thread`: one thread inside, the caller's setting after, and every public verb runs in it."""

from collections.abc import Iterator
from threading import Event, Thread

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import truearm as ta
from truearm.models import Compensator
from truearm.models.identified_model import IdentifiedModel
from truearm.models.model_file import load_model
from truearm.solve.threads import one_blas_thread
from truearm.wings.bench.recording import learning
from truearm.wings.bench.recording.record_readings import record

# One downloads, the others read devices: what corrects their samples is a door of its own, what learns from them too.
NOT_CALCULATING = {"fetch", "list_sources", "record", "try_source"}
VERBS = [
    name
    for module, names in ta._HOMES.items()
    for name in names
    if module.startswith("truearm.verbs") and name.islower() and name not in NOT_CALCULATING
]


def blas_threads() -> set[int]:
    """Of the BLAS that NumPy and SciPy have; OpenCV, where a test has loaded it, brings one of its own."""
    of_ours = (one for one in threadpool_info() if one["user_api"] == "blas" and "opencv" not in one["filepath"])
    return {library["num_threads"] for library in of_ours}


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    with threadpool_limits(2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("this BLAS has one thread anyway")
        yield


def test_one_thread_inside_and_the_setting_of_the_caller_after_nested_blocks():
    with one_blas_thread():
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == {1}
    assert blas_threads() == {2}


def test_the_setting_returns_after_an_error():
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        1 / 0  # noqa: B018
    assert blas_threads() == {2}


def test_blocks_of_two_threads_that_overlap_have_one_thread_until_the_last_ends():
    first_is_in, second_is_in, first_is_out = Event(), Event(), Event()
    seen = []

    def first() -> None:
        with one_blas_thread():
            first_is_in.set()
            second_is_in.wait(10)
        first_is_out.set()

    def second() -> None:
        first_is_in.wait(10)
        with one_blas_thread():
            second_is_in.set()
            first_is_out.wait(10)
            seen.append(blas_threads())

    threads = [Thread(target=first), Thread(target=second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == [{1}]
    assert blas_threads() == {2}


@pytest.mark.parametrize(
    "door",
    [
        *(pytest.param(getattr(ta, name), id=name) for name in VERBS),
        load_model,
        Compensator.fit,
        Compensator.fit_readings,
        Compensator.predict_readings,
        Compensator.covariance_parts,
        Compensator.predict_nominal_readings,
        IdentifiedModel.unstated_input_covariances,
    ],
)
def test_every_public_door_runs_in_one_thread(door):
    """`ContextDecorator` keeps the function it decorates."""
    assert door.__code__ is one_blas_thread()(lambda: None).__code__
    assert door.__wrapped__.__name__ == door.__name__


def test_a_model_fits_and_predicts_with_one_thread_and_leaves_the_setting(monkeypatch):
    seen = []
    tips = IdentifiedModel._tips

    def watched(self: IdentifiedModel, readings: ta.Session) -> np.ndarray:
        seen.append(blas_threads())
        return tips(self, readings)

    monkeypatch.setattr(IdentifiedModel, "_tips", watched)
    session = ta.simulate("ur10", poses=20).session
    model = ta.NominalModel(ta.load_arm("ur10")).fit_readings(session)
    model.predict(session.angles)
    assert seen == [{1}]
    assert blas_threads() == {2}


def test_a_recording_learns_and_chooses_poses_with_one_thread_and_leaves_the_setting(monkeypatch, tmp_path):
    seen = []

    def watched(function):
        def call(*given, **options):
            seen.append((function.__name__, *blas_threads()))
            return function(*given, **options)

        return call

    for name in ("updated_estimate", "moment_matrix", "decreases"):
        monkeypatch.setattr(f"truearm.wings.bench.recording.learning.{name}", watched(getattr(learning, name)))
    ta.simulate("ur10", poses=3).save(tmp_path / "session.csv")
    source = f"replay:{tmp_path / 'session.csv'}@max"
    events = [event.kind for event in record(source, tmp_path / "out.csv", arm="ur10", rank=True)]
    assert events.count("learned") == 2
    assert set(seen) == {("updated_estimate", 1), ("moment_matrix", 1), ("decreases", 1)}
    assert blas_threads() == {2}
