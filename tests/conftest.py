"""Fixtures for all tests."""

from __future__ import annotations

import datetime

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20170101)


@pytest.fixture(autouse=True)
def _dates_of_tests_have_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """A day on which the made-up points have been measured, whatever the clock of this machine shows."""
    monkeypatch.setattr("truearm.verify.days.now", lambda: datetime.datetime(2026, 12, 1, 12, 0))
