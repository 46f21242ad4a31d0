"""Links that lag behind the thermometer: their temperatures, and the expansion that readings of a drift show."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from truearm.arm import load_arm
from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.expansion_prior import LAG_K
from truearm.identification.judgement.thermal_lag import TIME_CONSTANTS, _products, lagging_temperatures, most_lag_K
from truearm.identification.terms import ArmState, Constant, Term
from truearm.identification.terms.basis import Temperature
from truearm.identification.terms.catalogue import own_axis, thermal
from truearm.identification.terms.links import MATERIALS
from truearm.models import KinematicModel, PhysicalModel
from truearm.readings import Session
from truearm.wings.planning.virtual import VirtualArm, load_preset

EXPANSION_PER_K = 23e-6
DRIFT = np.linspace(20.0, 26.0, 120)


def test_a_link_approaches_a_step_of_the_air_exponentially():
    """From 20 to 20.5 degC at the second reading, closed form; where the thermometer jumps the link has settled."""
    air = np.where(np.arange(50) > 0, 20.5, 20.0)
    found = lagging_temperatures(air, np.array([10.0]))[:, 0]
    np.testing.assert_allclose(found, 20.5 - 0.5 * np.exp(-np.arange(50) / 10), rtol=1e-12)
    jumped = np.where(np.arange(50) > 24, 26.0, 20.0)
    np.testing.assert_allclose(lagging_temperatures(jumped, np.array([10.0]))[:, 0], jumped, rtol=1e-12)


def test_links_settle_before_each_session():
    air, session = np.repeat([20.0, 20.9], 30), np.repeat(["A", "B"], 30)
    np.testing.assert_allclose(lagging_temperatures(air, TIME_CONSTANTS, session)[:, -1], air, rtol=1e-12)
    assert most_lag_K(air, session) == pytest.approx(0.0, abs=1e-12)


def test_links_lag_as_long_behind_the_air_in_a_sample():
    """Within the change of the air from one reading of the sample to the next."""
    air = 22 + 3 * np.sin(2 * np.pi * np.arange(20_000) / 2_000)
    links, of_sample = (lagging_temperatures(air[::k], TIME_CONSTANTS, stride=k) for k in (1, 10))
    change_K = 3 * 2 * np.pi / 2_000 * 10
    np.testing.assert_allclose(of_sample[200:], links[2000::10], rtol=0, atol=change_K)
    assert most_lag_K(air[::10], stride=10.0) == pytest.approx(most_lag_K(air), abs=change_K)
    assert most_lag_K(air[::10]) > most_lag_K(air) + 10 * change_K  # as if it were read once in ten


@pytest.mark.parametrize(
    ("degC", "lags"),
    [(DRIFT, True), (np.linspace(20, 20.6, 120), False), (np.full(120, 20.0), False), (np.repeat([20, 26], 60), False)],
)
def test_only_a_drift_of_some_kelvins_leaves_slow_links_behind(degC, lags):
    assert (most_lag_K(degC.astype(float)) > LAG_K) == lags


def test_products_of_growth_and_drift_are_those_of_the_derivatives_of_all_coefficients():
    """To rounding, of J2 with 32 functions, whose coordinates are contracted first, and of others with one."""
    rng, arm, m = np.random.default_rng(3), load_arm("gao2017"), 90
    axes = np.eye(6).tolist()
    free = [
        Term(f"{place} {i}", place, tuple(axes[i]), Constant(), "set-up", 1.0) for place in (0, 7) for i in range(6)
    ]
    growth = thermal(arm.chain)
    chain = PerturbedChain(arm.chain, (*free, *growth, *own_axis(arm.chain, 2, highest=16)))
    x, grows = 1e-4 * rng.normal(size=chain.n_coefficients), np.arange(12, 12 + len(growth))
    std, weight = rng.uniform(0.01, 0.02, (3, m)), rng.uniform(0.5, 1, m)
    part = ReferenceFit("point", np.arange(m), rng.normal(size=(3, m)), std, 0.01, weight, np.zeros(m, int), {})
    fit = IdentificationResult(chain, x, np.eye(len(x)), np.ones(len(x)), (), (part,), True, 1)
    kelvin, courses = rng.normal(size=(m, 2)), rng.normal(size=(m, 3))
    state = ArmState.of(arm, rng.uniform(-1, 1, (m, 6)), temperature_degC=rng.uniform(20, 25, m))
    ((_, _, columns),) = chain.derivatives(replace(state, temperature_degC=np.full(m, 21.0)), x)
    by_time = [columns[grows, None] * kelvin.T[:, None], columns[[*range(6), 9, 10, 11], None] * courses.T[:, None]]
    by_time[1][:3] /= fit.chain.reach
    moved = np.concatenate([one.swapaxes(0, 1).reshape(-1, 3 * m) for one in by_time]) * part.weights.ravel()
    J = columns.reshape(len(x), -1) * part.weights.ravel()
    plain = J @ moved.T, moved @ moved.T, moved @ (part.weights * part.residuals).ravel()
    for found, expected in zip(_products(fit, state, grows, kelvin, courses), plain, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.fixture(scope="module")
def virtual():
    """An arm of aluminium without errors that no term describes, whose links have one time constant."""
    preset = replace(load_preset("perfect"), expansion_per_K=EXPANSION_PER_K, lag_s=600.0, reference_std_mm=0.003)
    return VirtualArm.draw(load_arm("gao2017"), preset, seed=0)


@pytest.fixture(scope="module")
def readings(virtual):
    angles = np.random.default_rng(0).uniform(-1.2, 1.2, (len(DRIFT), 6))
    return virtual.measure(angles, seed=0, temperature_degC=DRIFT).readings


def errors(model, virtual, degC):
    """In standard uncertainties, root mean square of a coordinate, at poses of a day at one temperature."""
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 6))
    measured = virtual.measure(angles, seed=1, temperature_degC=degC)
    points, covariance = model.predict_readings(measured.readings, return_cov=True)
    off = points - measured.true_tips
    return np.sqrt((np.linalg.solve(covariance, off[:, :, None])[:, :, 0] * off).sum(axis=1).mean() / 3)


@pytest.mark.parametrize("degC", [18.0, *(pytest.param(one, marks=pytest.mark.weekly) for one in (20.0, 26.0, 30.0))])
def test_the_expansion_of_links_that_lag_is_recovered_within_its_uncertainty(virtual, readings, degC):
    model = PhysicalModel(virtual.nominal, highest=2, residual=False).fit_readings(readings)
    assert errors(model, virtual, degC) < 1.5
    chain = model.fit_.perturbed_chain
    grows = [k[0] for term, k in zip(chain.terms, chain.columns, strict=True) if isinstance(term.basis, Temperature)]
    off = model.fit_.coefficients[grows] - EXPANSION_PER_K
    assert (np.abs(off) < 3 * np.sqrt(model.fit_.covariance.diagonal()[grows])).all()


def drifting(moved_mm, *, n=80):
    """Points of an arm of steel with 0.01 mm of noise, of a room that warms by 0.8 K while the reference moves."""
    arm, rng = load_arm("ur10"), np.random.default_rng(0)
    angles, degC = arm.working + 0.35 * rng.uniform(-1, 1, (n, 6)), np.linspace(19.0, 19.8, n)
    grown = arm.chain.tip_in_base(angles) * (1 + 11.5e-6 * (degC - 20))[:, None]
    moved = np.outer(moved_mm(np.linspace(0, 1, n)), [0.6, 0.8, 0.0])
    points = grown + moved - moved.mean(axis=0) + 0.01 * rng.standard_normal((n, 3))
    return arm, Session(angles, points, temperature_degC=degC)


@pytest.mark.parametrize(
    "moved_mm",
    [lambda t: -0.1 * t, lambda t: 0.05 * ((t > 0.33) + 1.0 * (t > 0.66))],
    ids=["drift of 0.1 mm", "two moves of 0.05 mm"],
)
def test_a_reference_that_moves_while_the_room_warms_is_no_growth_of_the_links(moved_mm):
    """At 24 degC, 4.6 K away: 0.20 and 0.22 mm at u 0.03 mm before, now 0.05."""
    arm, session = drifting(moved_mm)
    model = PhysicalModel(arm, highest=1, residual=False).fit_readings(session)
    assert np.abs(growth_of(model)).max() < 3 * np.hypot(*MATERIALS[1][1:])
    warm = replace(session, points=None, temperature_degC=np.full(len(session), 24.0))
    points, covariance = model.predict_readings(warm, return_cov=True)
    off = points - arm.chain.tip_in_base(session.angles) * (1 + 11.5e-6 * 4)
    assert np.sqrt((np.linalg.solve(covariance, off[:, :, None])[:, :, 0] * off).sum(axis=1).mean() / 3) < 2.0


def test_another_day_may_find_base_and_tip_where_the_drift_began():
    """0.05 mm from its mean: of 95 % ellipsoids 90 % or more hold the point, before 70 %; no u of it at rest."""
    arm, session = drifting(lambda t: 0.1 * t)
    model = PhysicalModel(arm, highest=1, residual=False).fit_readings(session)
    then = replace(session, points=None, temperature_degC=np.full(len(session), 19.4))
    points, covariance = model.predict_readings(then, return_cov=True)
    off = points - arm.chain.tip_in_base(session.angles) * (1 - 11.5e-6 * 0.6) + [0.03, 0.04, 0.0]
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
    assert (squares < chi2.ppf(0.95, 3)).mean() >= 0.9
    still = PhysicalModel(arm, highest=1, residual=False).fit_readings(drifting(lambda t: 0 * t)[1])
    u_mm = [np.sqrt(np.trace(one.covariance_parts(then)[0], axis1=1, axis2=2).mean()) for one in (model, still)]
    assert u_mm[0] > 0.1 / np.sqrt(12) > 2.5 * u_mm[1]


def test_growth_is_learned_from_temperatures_that_do_not_follow_the_order():
    """Of the same readings in another order: the drift is seen apart, and steel within 3 standard uncertainties."""
    arm, session = drifting(lambda t: 0 * t)
    degC = 20 + 8 * np.sin(np.arange(len(session)))
    grown = arm.chain.tip_in_base(session.angles) * (1 + 11.5e-6 * (degC - 20))[:, None]
    rng = np.random.default_rng(1)
    drift = np.outer(np.linspace(-0.05, 0.05, len(session)), [0.6, 0.8, 0.0])
    points = grown + drift + 0.01 * rng.standard_normal(grown.shape)
    model = PhysicalModel(arm, highest=1, residual=False).fit_readings(
        replace(session, points=points, temperature_degC=degC)
    )
    assert np.median(growth_of(model)) == pytest.approx(11.5e-6, abs=4e-6)


def growth_of(model):
    """Thermal expansion of each link [1/K]."""
    chain = model.fit_.perturbed_chain
    return np.array(
        [
            model.fit_.coefficients[columns[0]]
            for term, columns in zip(chain.terms, chain.columns, strict=True)
            if isinstance(term.basis, Temperature)
        ]
    )


@pytest.mark.parametrize("degC", [pytest.param(20.0, marks=pytest.mark.weekly), 26.0])
def test_a_model_without_growth_is_uncertain_where_slow_links_never_were(virtual, readings, degC):
    """At 26 degC, inside the thermometer's range; at the start of the session as before."""
    model = KinematicModel(virtual.nominal).fit_readings(readings)
    day = replace(readings, temperature_degC=np.full(len(readings), degC))
    assert model.expansion_covariance(day).any() == (degC == 26.0)
    assert errors(model, virtual, degC) < 2.0
