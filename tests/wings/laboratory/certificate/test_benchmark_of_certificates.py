"""A sample of the ways to a false certificate and of right campaigns; all: `python -m benchmarks certificates`."""

import importlib
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[4]


@pytest.fixture
def cases(monkeypatch, tmp_path):
    """All cases of the benchmark."""
    if not (CHECKOUT / "benchmarks").is_dir():
        pytest.skip("benchmarks are not beside the tests")
    pytest.importorskip("signxml", reason="pip install truearm[sign] signs and verifies")
    monkeypatch.syspath_prepend(CHECKOUT)
    monkeypatch.setenv(importlib.import_module("benchmarks.rows").SCRATCH, str(tmp_path))
    return importlib.import_module("benchmarks.certificates").CASES.load("certificates")


@pytest.mark.parametrize("every", [60, pytest.param(20, marks=pytest.mark.weekly)])
def test_a_sample_of_the_ways_is_found_and_of_the_right_campaigns_none_is_questioned(cases, every):
    answers = {case.what: case.outcome() for case in cases[::every]}
    assert {what: said for what, (is_held, said) in answers.items() if not is_held} == {}


def test_there_are_more_ways_and_campaigns_than_asked_for(cases):
    """188 and 60."""
    assert sum(case.is_mistake for case in cases) >= 188
    assert sum(not case.is_mistake for case in cases) >= 60
