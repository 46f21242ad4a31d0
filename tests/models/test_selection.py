"""Which model is kept: the simplest that is as good as the best on readings held out."""

from dataclasses import replace

import numpy as np
import pytest

from refusals import refuses
from truearm.models import IdentifiedModel, KinematicModel, NominalModel, PhysicalModel
from truearm.models.selection import CANDIDATES, select_model, trimmed_mean
from truearm.readings import Session
from truearm.verbs.fit import fit

NOISE = 0.02  # mm
KINDS = {"nominal": NominalModel, "kinematic": KinematicModel, "physical": PhysicalModel}


def select(arm, readings, *, free=("base", "tip"), lengths=None, progress=None):
    nominal = NominalModel(arm, free=free)
    prepared = nominal.prepare(readings, lengths)
    return select_model(nominal.learn(prepared), prepared, progress=progress)[:3]


def session(real, planted, rng, n=200):
    """Readings of an arm as drawn; with constants; with constants and an error of J2's gear of 1e-3 rad."""
    angles = real.arm.working + rng.uniform(-1.2, 1.2, (n, 6))
    turned = angles.copy()
    if planted == "physical":
        turned[:, 1] += 1e-3 * np.cos(3 * angles[:, 1])
    chain = real.arm.chain if planted == "nominal" else real.chain
    position = np.array([f"p{i // 4}" for i in range(n)])
    return Session(angles, chain.tip_in_base(turned) + rng.normal(0, NOISE, (n, 3)), position=position)


@pytest.mark.parametrize("planted", KINDS)
def test_the_simplest_model_that_explains_the_readings_is_kept(planted, real, rng, monkeypatch):
    monkeypatch.setattr(
        PhysicalModel.__init__, "__kwdefaults__", PhysicalModel.__init__.__kwdefaults__ | {"highest": 8}
    )
    readings = session(real, planted, rng)
    told = []
    model, table, _ = select(real.arm, readings, progress=lambda done, note: told.append((done, note)))
    assert type(model) is KINDS[planted]
    assert [row.name for row in table if row.name != "hybrid"] == list(KINDS)
    assert [row.name for row in table if row.kept] == [planted]
    assert {done for done, _ in told} >= {1, 2}
    assert told[0][1].startswith("kinematic: ")
    kept = next(row for row in table if row.kept)
    assert kept.excess_mm <= kept.excess_standard_error_mm
    assert any(row.excess_mm == row.excess_standard_error_mm == 0 for row in table)
    for row in table[: list(KINDS).index(planted)]:
        assert row.excess_mm > row.excess_standard_error_mm
    for row in table:
        assert 0 < row.standard_error_mm < row.mean_mm <= row.p95_mm <= row.max_mm
        assert row.n_effective > 0
    assert kept.mean_mm == pytest.approx(NOISE * np.sqrt(8 / np.pi), rel=0.2)  # mean length of three Gaussian ones
    assert model.held_out_.mean_mm == pytest.approx(kept.mean_mm, rel=1e-12)  # sorted rows are summed in another order


@pytest.mark.parametrize("size", [1.0, pytest.param(100.0, marks=pytest.mark.weekly)])
def test_gross_errors_do_not_change_the_choice(size, real, rng, monkeypatch):
    """One in twenty: the constants are kept, and their errors on the other readings are stated."""
    monkeypatch.delitem(CANDIDATES, "physical")  # quicker
    clean = real.points(100, rng)
    points = clean.points.copy()
    bad = [4, 31, 50, 77, 99]
    points[bad] += size * np.array([[2, -1, 2], [1, 2, 2], [-2, -1, 2], [2, 1, 2], [-2, 2, 1]]) / 3
    _, table, _ = select(real.arm, clean)
    model, spoilt, _ = select(real.arm, replace(clean, points=points))
    assert isinstance(model, KinematicModel)
    assert spoilt[0].n_excluded == spoilt[1].n_excluded == len(bad)
    assert table[0].n_excluded == 0
    assert set(bad).isdisjoint(model.held_out_.rows)
    for row, other in zip(spoilt[:2], table[:2], strict=True):  # a hybrid is compared only where it may win
        assert row.kept == other.kept
        assert row.max_mm < 1.1 * other.max_mm
        assert row.excess_mm == pytest.approx(other.excess_mm, rel=0.1)


def test_a_fit_without_weights_of_outliers_is_that_of_the_model(real, rng):
    """It places its own nominal arm; that of the verb has weights."""
    readings = session(real, "kinematic", rng, n=60)
    fitted = fit(real.arm, readings, model="kinematic", robust=False).model
    alone = KinematicModel(real.arm, robust=False).fit_readings(readings)
    # Sums in another order of memory, at most.
    np.testing.assert_allclose(fitted.predict(readings.angles), alone.predict(readings.angles), rtol=0, atol=1e-9)


def test_a_trimmed_mean_and_its_standard_error():
    """By hand: 0 .. 8, 1000 without the ends are 1 .. 8; clipped 1, 1, 2 .. 7, 8, 8, with a sum of squares of 66.5."""
    mean, error = trimmed_mean(np.array([1000.0, *range(9)]))
    assert mean == pytest.approx(4.5)
    assert error == pytest.approx(np.sqrt(66.5 / (8 * 7)))
    plain = np.array([1.0, 2.0, 6.0])  # too few to trim
    assert trimmed_mean(plain) == pytest.approx((3.0, plain.std(ddof=1) / np.sqrt(3)))
    assert trimmed_mean(np.array([2.0])) == (2.0, np.inf)


def test_free_parts_and_lengths_are_passed_on(real, rng):
    model, _, _ = select(real.arm, real.held(rng), free=("base",), lengths=real.lengths())
    assert model.free == ("base",)
    assert model.free_ == ()
    centres = [model.predict(real.in_seats[real.names == name]).mean(axis=0) for name in ("S1", "S2", "S3")]
    apart = np.linalg.norm(np.array(centres[1:]) - centres[0], axis=1)
    np.testing.assert_allclose(apart, real.lengths().length_mm, atol=0.05)


def test_models_are_compared_on_parts_of_a_single_seat(real, rng):
    _, table, _ = select(real.arm, real.held(rng).rows(np.arange(20)))
    assert all(np.isfinite(row.standard_error_mm) for row in table)


def test_a_reading_alone_in_a_seat_makes_no_group_of_the_others(real, rng):
    """It shows nothing, so the others are held out one by one, as those of a single seat are."""
    held = real.held(rng).rows(np.arange(21))
    seat = np.array(["S1"] * 20 + ["stray"])
    model, table, _ = select(real.arm, replace(held, seat=seat))
    assert len(np.unique(model.held_out_.group)) > 5
    assert [row.name for row in table if row.kept] == [model.kind]


def test_the_nominal_arm_is_fitted_once_for_all(real, rng, monkeypatch):
    readings = real.points(40, rng)
    nominal = NominalModel(real.arm).fit_readings(readings)
    np.testing.assert_array_equal(nominal.fit_.coefficients, nominal.nominal_.coefficients)
    plain = KinematicModel(real.arm).fit_readings(readings)

    def again(*_):
        raise AssertionError("fitted again")

    monkeypatch.setattr(IdentifiedModel, "_place", staticmethod(again))
    monkeypatch.delitem(CANDIDATES, "physical")  # quicker
    model = select_model(nominal, nominal.prepare(readings)).model
    assert model.nominal_ is nominal.nominal_
    kinematic = KinematicModel(real.arm).fit_readings(readings, nominal=nominal)
    np.testing.assert_array_equal(kinematic.predict(readings.angles), plain.predict(readings.angles))
    np.testing.assert_array_equal(kinematic.predict_nominal(readings.angles), plain.predict_nominal(readings.angles))


@pytest.mark.parametrize("other", ["readings", "free", "robust", "arm", "lengths"])
def test_the_nominal_arm_of_something_else_is_refused(other, real, rng):
    readings = real.held(rng)
    nominal = NominalModel(real.arm, free=("tip",)).fit_readings(readings)
    arm = replace(real.arm, name="other") if other == "arm" else real.arm
    model = KinematicModel(arm, free=() if other == "free" else ("tip",), robust=other != "robust")
    lengths = real.lengths() if other == "lengths" else None
    told = {"readings": "data_fingerprint", "lengths": "lengths_fingerprint"}.get(other, other)
    given = readings.rows(np.arange(50)) if other == "readings" else readings
    refuses(f"got one with another {told}$", model.fit_readings, given, nominal=nominal, lengths=lengths)
