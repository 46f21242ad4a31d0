"""Fixtures for all tests."""

import datetime
import gc
import os
import sys

# One thread of the linear algebra library for each worker of the suite; set before NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from command_line import CHECKOUT, made, refused, snapshot, truearm

__all__ = ["made", "refused", "snapshot", "truearm"]  # fixtures for all

# The benchmarks beside the tests make inputs of some of them; last, so that no folder here hides a package.
sys.path.append(str(CHECKOUT))

# Each process that a test starts, and the next run of the suite, would read every source anew: 0.4 s of 0.9.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# To search what collection makes for garbage would be a third of its time, and hardly any of it is.
gc.disable()

# A suite that passed passes again: what hypothesis tries hangs on the test alone, and a busy machine fails none.
settings.register_profile(
    "fixed", derandomize=True, max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is run weekly is slow, too: `-m "not slow"` leaves it out."""
    for item in items:
        if item.get_closest_marker("weekly"):
            item.add_marker("slow")


def pytest_collection_finish() -> None:
    """Ten thousand tests live until the end: a search for garbage, a twentieth of the time, leaves them out."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session")
def files():
    """The source of the package by module, parsed once for all laws of it; it lives until the end, as the tests do."""
    if not (CHECKOUT / "benchmarks").is_dir():
        pytest.skip("benchmarks are not beside the tests")
    from benchmarks.house import HOUSE, sources

    found = sources(HOUSE)
    gc.freeze()
    return found


@pytest.fixture(scope="session")
def ur10_session():
    """Sixty readings of a virtual UR10."""
    import truearm as ta

    return ta.simulate("ur10", poses=60, seed=1).session


@pytest.fixture(scope="session")
def ur10_model(ur10_session):
    """The kinematic model of it."""
    import truearm as ta

    return ta.fit("ur10", ur10_session, model="kinematic").model


@pytest.fixture(scope="session")
def chromium():
    """One browser for all tests of a worker."""
    from browser import browser

    with browser() as opened:
        yield opened


@pytest.fixture(scope="session")
def two_processes():
    """Two processes for all tests of a worker that compute in some: to start them takes longer than what they do."""
    from truearm.solve.executors import Processes

    started = Processes(2)
    yield started
    started.close()


@pytest.fixture(scope="module")
def undrawn():
    """Pages without the drawings in their figures, half their time: for tests that read the text around them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truearm.pages.html.svg_element", lambda drawing, prefix: "<svg></svg>")
        yield


@pytest.fixture(scope="module")
def quick_plans():
    """Plans whose path is shortened in two rounds, not sixty, three quarters of their time: for tests around them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truearm.wings.planning.designs.coordinate_exchange._ROUNDS", 2)
        yield


@pytest.fixture
def without_extras(monkeypatch: pytest.MonkeyPatch) -> None:
    """No package of an extra can be imported."""

    def missing(name: str, *_: object) -> None:
        raise ImportError(name)

    monkeypatch.setattr("truearm.errors.import_module", missing)


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20170101)


@pytest.fixture(scope="session", autouse=True)
def _no_test_waits_for_the_disk():
    """Nothing here outlives a power cut; that files are synchronised before their names is asked of the calls."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _dates_of_tests_have_come():
    """A day on which the made-up points have been measured, whatever the clock of this machine shows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truearm.files.dates.now", lambda: datetime.datetime(2026, 12, 1, 12, 0))
        yield
