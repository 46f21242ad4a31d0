"""The solver against problems with known answers, and each part against its formula."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from refusals import refuses
from truearm.errors import TruearmError
from truearm.solve.least_squares import (
    SETTLED,
    STUCK,
    UNSOLVED,
    Trial,
    damped_step,
    gauss_newton,
    levenberg_marquardt,
    levenberg_marquardt_by_row,
    step_in_valley,
)
from truearm.solve.least_squares_problem import (
    DenseProblem,
    KnownStep,
    MarquardtDamping,
    NielsenDamping,
    NormalEquations,
    StepHalving,
)
from truearm.solve.stop_criteria import (
    BestPoint,
    CostConverged,
    CostGoal,
    DampingLimit,
    MaxEpochs,
    MaxSeconds,
    MinGradient,
    OptimizerState,
    StopReason,
    ValidationStop,
)


class Residuals:
    """A problem from a residual function and its Jacobian."""

    def __init__(self, residuals, jacobian):
        self.residuals, self.jacobian = residuals, jacobian
        self.built = self.tried = 0

    def cost(self, x):
        self.tried += 1
        r = self.residuals(x)
        return 0.5 * float(r @ r)

    def normal_equations(self, x):
        self.built += 1
        r, J = self.residuals(x), self.jacobian(x)
        return NormalEquations(0.5 * float(r @ r), J.T @ r, J.T @ J)


def rosenbrock():
    return Residuals(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
    )


# NIST Statistical Reference Datasets, Misra1a (Misra, D., 1978: dental research monomolecular adsorption), lower
# difficulty; certified values as printed, to 11 digits.
MISRA1A_Y = [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78]
MISRA1A_X = [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0]
MISRA1A_B = [2.3894212918e02, 5.5015643181e-04]
MISRA1A_STD = [2.7070075241e00, 7.2668688436e-06]
MISRA1A_SQUARES = 1.2455138894e-01


def misra1a():
    x, y = np.array(MISRA1A_X), np.array(MISRA1A_Y)
    # The second parameter in units of 1e-3: damping by the unit matrix needs parameters of like size.
    return Residuals(
        lambda b: b[0] * (1 - np.exp(-b[1] * 1e-3 * x)) - y,
        lambda b: np.stack([1 - np.exp(-b[1] * 1e-3 * x), b[0] * x * 1e-3 * np.exp(-b[1] * 1e-3 * x)], axis=1),
    )


@pytest.mark.parametrize("damping", [NielsenDamping(), MarquardtDamping()])
@pytest.mark.parametrize("start", [[500.0, 0.1], [250.0, 0.5]])
def test_certified_values_of_misra1a(damping, start):
    result = levenberg_marquardt(misra1a(), start, damping=damping, stops=[CostConverged(1e-14), MaxEpochs(500)])
    assert result.reason.converged
    np.testing.assert_allclose(result.x * [1, 1e-3], MISRA1A_B, rtol=1e-7)
    assert 2 * result.cost == pytest.approx(MISRA1A_SQUARES, rel=1e-9)
    std = np.sqrt(np.diag(np.linalg.inv(result.equations.gram)) * 2 * result.cost / (14 - 2))
    np.testing.assert_allclose(std * [1, 1e-3], MISRA1A_STD, rtol=1e-6)


@pytest.mark.parametrize("damping", [NielsenDamping(), MarquardtDamping()])
def test_rosenbrock_converges_from_the_usual_start(damping):
    result = levenberg_marquardt(rosenbrock(), [-1.2, 1.0], damping=damping, stops=[CostGoal(1e-20), MaxEpochs(300)])
    np.testing.assert_allclose(result.x, [1, 1], atol=1e-9)
    assert result.reason.text == "Performance goal met."


def test_the_cost_never_rises_and_every_epoch_is_reported():
    told = []
    result = levenberg_marquardt(
        rosenbrock(), [-1.2, 1.0], stops=[CostGoal(1e-20), MaxEpochs(300)], callback=told.append
    )
    assert all(after.cost < before.cost for before, after in itertools.pairwise(told))
    assert all(after.previous_cost == before.cost for before, after in itertools.pairwise(told))
    assert [state.epoch for state in told] == list(range(result.epochs + 1))
    assert [state.reason for state in told] == [None] * result.epochs + [result.reason]


def test_a_rejected_step_uses_the_same_equations_again():
    problem = rosenbrock()
    result = levenberg_marquardt(problem, [-1.2, 1.0], stops=[CostGoal(1e-20), MaxEpochs(300)])
    assert problem.tried > result.epochs  # some steps were rejected
    assert problem.built == result.epochs + 1


def test_a_linear_problem_takes_two_epochs_without_damping():
    A = np.array([[2.0, 1], [1, 3], [0, 1]])
    b = np.array([1.0, 2, 3])
    problem = Residuals(lambda x: A @ x - b, lambda x: A)
    result = levenberg_marquardt(
        problem, [0, 0], damping=MarquardtDamping(mu=1e-12), stops=[MinGradient(1e-9), MaxEpochs(50)]
    )
    np.testing.assert_allclose(result.x, np.linalg.lstsq(A, b)[0], rtol=1e-9)
    assert result.epochs <= 2


def test_it_ends_where_no_step_helps():
    problem = Residuals(lambda x: np.array([1.0 + 0 * x[0]]), lambda x: np.array([[1.0]]))  # a wrong derivative
    result = levenberg_marquardt(problem, [0.0], damping=MarquardtDamping(), stops=[DampingLimit()])
    assert result.reason.text == "Maximum MU reached."
    without_that_rule = levenberg_marquardt(problem, [0.0], stops=[])
    assert "derivatives predict it" in without_that_rule.reason.text
    assert not without_that_rule.reason.converged
    at_the_minimum = levenberg_marquardt(rosenbrock(), [1.0, 1.0], stops=[])
    assert at_the_minimum.reason.converged


def test_derivatives_of_the_wrong_sign_are_no_convergence():
    plain = rosenbrock()
    result = levenberg_marquardt(Residuals(plain.residuals, lambda x: -plain.jacobian(x)), [-1.2, 1.0])
    assert "derivatives predict it" in result.reason.text
    assert not result.reason.converged


@pytest.mark.parametrize("damping", [NielsenDamping(), MarquardtDamping()])
def test_a_matrix_of_no_numbers_is_no_convergence(damping):
    problem = rosenbrock()
    problem.normal_equations = lambda x: NormalEquations(1.0, np.ones(2), np.full((2, 2), np.nan))
    result = levenberg_marquardt(problem, [-1.2, 1.0], damping=damping)
    assert "No step can be computed" in result.reason.text
    assert not result.reason.converged


@pytest.mark.parametrize("seed", range(5))
def test_an_exact_fit_converges_though_rounding_is_left(seed):
    """Distances near 1e3 to points in space, planted without noise: costs of 1e-25 that no step makes less."""
    rng = np.random.default_rng(seed)
    beacons, place = rng.uniform(-1e3, 1e3, (40, 3)), rng.uniform(-100, 100, 3)
    distances = np.linalg.norm(place - beacons, axis=1)
    problem = Residuals(
        lambda x: np.linalg.norm(x - beacons, axis=1) - distances,
        lambda x: (x - beacons) / np.linalg.norm(x - beacons, axis=1)[:, None],
    )
    result = levenberg_marquardt(problem, np.zeros(3))
    assert result.reason.converged
    np.testing.assert_allclose(result.x, place, atol=1e-9)


def test_a_step_is_tried_with_the_largest_damping_too():
    """Damping of 1 and 10 fails, 100 = mu_max succeeds: the slope is ten times too large."""
    problem = Residuals(lambda x: np.array([x[0]]), lambda x: np.array([[1.0]]))
    problem.normal_equations = lambda x: NormalEquations(0.5 * float(x @ x), 40 * x, np.eye(1))
    told = []
    stops = [MaxEpochs(1)]
    levenberg_marquardt(problem, [1.0], damping=MarquardtDamping(1.0, maximum=100.0), stops=stops, callback=told.append)
    assert told[1].step_accepted
    assert told[1].x[0] == pytest.approx(1 - 40 / 101)


def test_a_largest_damping_without_bound_ends_too():
    flat = Residuals(lambda x: np.array([1.0]), lambda x: np.array([[1.0]]))
    assert not levenberg_marquardt(flat, [0.0], damping=MarquardtDamping(maximum=np.inf), stops=[]).reason.converged


def test_a_start_that_is_no_number_is_an_error():
    problem = Residuals(lambda x: np.array([np.nan]), lambda x: np.array([[1.0]]))
    with pytest.raises(TruearmError, match="not a finite number"):
        levenberg_marquardt(problem, [0.0])


@pytest.mark.parametrize(
    "make",
    [
        lambda: MarquardtDamping(mu=0.0),
        lambda: MarquardtDamping(mu=np.nan),
        lambda: MarquardtDamping(decrease=1.0),
        lambda: MarquardtDamping(increase=1.0),
        lambda: MarquardtDamping(maximum=0.0),
        lambda: NielsenDamping(relative_start=0.0),
        lambda: NielsenDamping(mu=-1.0),
        lambda: NielsenDamping(growth=1.0),
    ],
)
def test_damping_that_could_never_end_is_refused(make):
    refuses("expected", make)


@pytest.mark.parametrize("rule", [MarquardtDamping(mu=1e-19), NielsenDamping(mu=1e-19)])
def test_damping_never_falls_to_nothing(rule):
    for _ in range(1000):
        rule = rule.after_success(1.0)
    assert rule.after_failure().mu > rule.mu > 0


def test_an_interrupt_passes_through():
    def interrupt(state):
        if state.epoch == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        levenberg_marquardt(rosenbrock(), [-1.2, 1.0], callback=interrupt)


def test_nielsens_rule_by_hand():
    start = NielsenDamping(relative_start=1e-3).at_start(NormalEquations(1.0, np.zeros(2), np.diag([4.0, 50.0])))
    assert start.mu == pytest.approx(0.05)
    assert start.after_success(0.5).mu == pytest.approx(0.05)  # 1 - 0
    assert start.after_success(1.0).mu == pytest.approx(0.05 / 3)  # 1 - 1 = 0, held at 1/3
    assert start.after_success(0.25).mu == pytest.approx(0.05 * 1.125)  # 1 + 1/8
    assert start.after_failure().mu == pytest.approx(0.1)
    assert start.after_failure().after_failure().after_failure().mu == pytest.approx(0.05 * 2 * 4 * 8)
    assert start.after_failure().after_success(1.0).growth == 2


def test_nielsens_rule_starts_above_zero_without_derivatives():
    start = NielsenDamping().at_start(NormalEquations(1.0, np.zeros(2), np.zeros((2, 2))))
    assert 0 < start.mu < start.maximum
    flat = Residuals(lambda x: np.array([1.0]), lambda x: np.array([[0.0]]))
    assert levenberg_marquardt(flat, [3.0], stops=[]).x.tolist() == [3.0]


def test_the_clock_counts_the_evaluation_at_the_start():
    now = [0.0]
    problem, told = rosenbrock(), []
    plain = problem.normal_equations

    def slow(x):
        now[0] += 7.0
        return plain(x)

    problem.normal_equations = slow
    levenberg_marquardt(problem, [-1.2, 1.0], stops=[MaxEpochs(2)], callback=told.append, clock=lambda: now[0])
    assert [state.seconds for state in told] == [7.0, 14.0, 21.0]


def test_marquardts_rule_by_hand():
    rule = MarquardtDamping()
    assert (rule.mu, rule.maximum) == (1e-3, 1e10)
    assert rule.after_success(0.9).mu == pytest.approx(1e-4)
    assert rule.after_failure().after_failure().mu == pytest.approx(0.1)


def state(**changes):
    given = {
        "epoch": 3, "x": np.zeros(1), "cost": 1.0, "previous_cost": 2.0, "gradient_norm": 1.0, "seconds": 5.0,
    }  # fmt: skip
    return OptimizerState(**{**given, **changes})


@pytest.mark.parametrize(
    ("stop", "ends", "goes_on"),
    [
        (CostGoal(1.0), {"cost": 1.0}, {"cost": 1.1}),
        (MaxEpochs(3), {"epoch": 3}, {"epoch": 2}),
        (MaxSeconds(5.0), {"seconds": 5.0}, {"seconds": 4.9}),
        (MinGradient(0.1), {"gradient_norm": 0.1}, {"gradient_norm": 0.2}),
        (DampingLimit(), {"damping": MarquardtDamping(mu=1e10)}, {"damping": MarquardtDamping(mu=1e9)}),
        (DampingLimit(), {"damping": MarquardtDamping(mu=2.0, maximum=1.0)}, {"damping": None}),
        (CostConverged(0.1), {"cost": 1.85}, {"cost": 1.75}),
        (CostConverged(0.1), {"cost": 2.0}, {"epoch": 0, "previous_cost": np.inf}),
        (CostConverged(0.1), {"cost": 2.0}, {"cost": 2.0, "step_accepted": False}),
    ],
)
def test_each_stop_at_its_threshold(stop, ends, goes_on):
    assert stop(state(**ends)) is not None
    assert stop(state(**goes_on)) is None


def test_validation_stops_after_max_fail_failures_and_keeps_the_best():
    errors = iter([5.0, 4.0, 3.0, 3.5, 3.0, 3.6, 3.7, 2.9])
    watch = ValidationStop(lambda x: next(errors), max_fail=3)
    reasons, failures = [], []
    for i in range(7):
        reasons.append(watch(state(epoch=i, x=np.array([float(i)]))))
        failures.append(watch.best.failures)
    # 3.5, 3.6 and 3.7 are worse than 3.0; the equal 3.0 neither counts nor clears, as in MATLAB.
    assert failures == [0, 0, 0, 1, 1, 2, 3]
    assert [reason is not None for reason in reasons] == [False] * 6 + [True]
    assert reasons[-1] == StopReason("Validation stop.", converged=True)
    assert (watch.best.epoch, watch.best.error, watch.best.x.tolist()) == (2, 3.0, [2.0])


def test_an_error_that_is_no_number_is_no_best():
    best = BestPoint(0, np.zeros(1), np.nan).updated_with(state(epoch=1), 7.0)
    assert (best.epoch, best.error) == (1, 7.0)
    assert best.updated_with(state(epoch=2), np.nan).failures == 1


def test_a_step_is_bent_by_its_second_derivative():
    """r = exp(x) at 0 with mu 1: step -1/2, r'' along it 1/4, bend -1/16; 0.1623 lies below 0.1839."""
    told = []

    def bending(x, step):
        told.append((float(x[0]), float(step[0])))
        return np.exp(x) * np.exp(x) * step**2

    problem = Residuals(np.exp, lambda x: np.exp(x)[:, None])
    result = levenberg_marquardt(
        problem, [0.0], damping=MarquardtDamping(1.0), stops=[MaxEpochs(1)], acceleration=bending
    )
    assert told == [(0.0, pytest.approx(-0.5, rel=1e-15))]
    assert result.x[0] == pytest.approx(-0.5625, rel=1e-15)
    assert result.cost == pytest.approx(0.5 * np.exp(-1.125), rel=1e-15)


@pytest.mark.parametrize("factor", [100.0, -1.0, np.nan])
def test_a_bend_that_is_long_or_raises_the_cost_or_is_nan_is_rejected(factor):
    problem = Residuals(np.exp, lambda x: np.exp(x)[:, None])
    result = levenberg_marquardt(
        problem,
        [0.0],
        damping=MarquardtDamping(1.0),
        stops=[MaxEpochs(1)],
        acceleration=lambda x, step: factor * np.exp(2 * x) * step**2,
    )
    assert result.x[0] == pytest.approx(-0.5, rel=1e-15)


def test_bending_saves_epochs_in_a_narrow_valley():
    def bending(x, step):
        return rosenbrock().jacobian(x).T @ np.array([-20 * step[0] ** 2, 0.0])

    plain, bent = (levenberg_marquardt(rosenbrock(), [-1.2, 1.0], acceleration=way) for way in (None, bending))
    np.testing.assert_allclose(bent.x, [1, 1], atol=1e-6)
    assert bent.epochs < plain.epochs


def test_the_best_step_of_a_plane_ends_at_the_minimum_of_a_valley_of_second_order():
    """Of Rosenbrock's valley; the Gauss-Newton step leads out of it, from a cost of 12 to one of 1,171."""
    valley, x = rosenbrock(), np.array([-1.2, 1.0])
    J = valley.jacobian(x)
    step = -np.linalg.solve(J, valley.residuals(x))
    assert 0.5 * (valley.residuals(x + step) ** 2).sum() == pytest.approx(1171.28)
    bent = step_in_valley(
        valley.residuals,
        lambda right: np.linalg.solve(J, right),
        x,
        step,
        valley.residuals(x),
        valley.residuals(x + step),
    )
    np.testing.assert_allclose(x + bent, [1, 1], atol=1e-4)  # the tolerance of the gradient, 1e-5 of 200 a unit


def test_the_best_step_of_a_straight_plane_is_the_step(rng):
    J, r, x = rng.normal(size=(9, 4)), rng.normal(size=9), rng.normal(size=4)
    solve = np.linalg.pinv(J).dot
    step = -solve(r + J @ x)
    bent = step_in_valley(lambda at: r + J @ at, solve, x, step, r + J @ x, r + J @ (x + step))
    np.testing.assert_allclose(bent, step, atol=1e-6)


def dense(problem, **options):
    return DenseProblem(lambda x: (problem.residuals(x), problem.jacobian(x)), **options)


def test_gauss_newton_on_a_dense_problem_reaches_the_certified_values():
    result = gauss_newton(dense(misra1a()), np.array([250.0, 0.5]), stops=[CostConverged(1e-14), MaxEpochs(100)])
    np.testing.assert_allclose(result.x * [1, 1e-3], MISRA1A_B, rtol=1e-8)  # of 11 printed digits
    assert 2 * result.cost == pytest.approx(MISRA1A_SQUARES, rel=1e-9)


@pytest.mark.parametrize("mu", [0.0, 1e-3, 10.0])
def test_dense_and_normal_equations_have_the_same_damped_step(rng, mu):
    J, r = rng.normal(size=(9, 4)), rng.normal(size=9)
    one, other = DenseProblem(lambda _: (r, J)).normal_equations(0), NormalEquations(0.5 * r @ r, J.T @ r, J.T @ J)
    step = one.damped_step(mu)
    np.testing.assert_allclose(step, other.damped_step(mu), rtol=1e-10)
    assert one.predicted_decrease(step) == pytest.approx(other.predicted_decrease(step))
    assert one.cost == other.cost


def test_parameters_that_the_data_do_not_tell_apart_have_no_step(rng):
    column = rng.normal(size=(9, 1))
    singular = DenseProblem(lambda x: (np.ones(9), np.hstack([column, 2 * column])))
    assert gauss_newton(singular, np.zeros(2)).reason is UNSOLVED


def test_a_step_is_halved_until_the_cost_does_not_rise():
    """Of cost x^2 / 2 from 1, a step of -9 leads to -8, -3.5, -1.25 and, after three halvings, to -0.125."""
    halves = Residuals(lambda x: x, lambda x: np.eye(1))
    epoch = damped_step(halves, np.ones(1), KnownStep(0.5, np.array([-9.0])), StepHalving())
    assert epoch.trial.x == -0.125
    assert (epoch.damping.share, epoch.damping.halvings) == (1.0, 0)
    refused = damped_step(halves, np.ones(1), KnownStep(0.5, np.array([-9.0])), StepHalving(max_halvings=2))
    assert refused.trial is None


@pytest.mark.parametrize(("costs", "reason"), [((2.0, 1.0), SETTLED), ((1.0, 1.0), STUCK), ((2.0, 2.0), STUCK)])
def test_a_cost_that_steps_only_raise_or_leave_is_settled(costs, reason):
    """Steps of which one should have lowered the cost: it is at its rounding if one leaves it and another raises it."""
    trials = (Trial(np.ones(1), cost, 0.5, False) for cost in costs)
    equations = SimpleNamespace(cost=1.0, tolerance=0.0)
    tried = damped_step(None, np.ones(1), equations, StepHalving(max_halvings=1), step=lambda *_: next(trials))
    assert (tried.trial, tried.reason) == (None, reason)


class Circles:
    """Points at distances from an origin: n problems of one residual each."""

    def __init__(self, radius):
        self.radius = radius

    def rows(self, which):
        return Circles(self.radius[which])

    def linearise(self, x):
        return (x**2).sum(axis=1, keepdims=True) - self.radius[:, None] ** 2, 2 * x[:, None, :]

    def move(self, x, residuals, jacobian, mu):
        gram = jacobian @ jacobian.transpose(0, 2, 1) + mu[:, None, None]
        return x - (jacobian.transpose(0, 2, 1) @ np.linalg.solve(gram, residuals[:, :, None]))[:, :, 0]

    def has_converged(self, residuals):
        return np.abs(residuals[:, 0]) < 1e-10


def test_rows_are_minimised_independently(rng):
    start, radius = rng.normal(size=(20, 2)), rng.uniform(0.1, 10, 20)
    start[0] *= radius[0] / np.linalg.norm(start[0])  # at the solution
    found = levenberg_marquardt_by_row(Circles(radius), start, damping=MarquardtDamping(), max_epochs=100)
    assert np.abs(found.residuals).max() < 1e-10
    assert found.steps[0] == 0 < found.steps[1:].min()
    np.testing.assert_array_equal(found.jacobian, 2 * found.x[:, None, :])
    for i in range(20):
        one = levenberg_marquardt_by_row(Circles(radius[[i]]), start[[i]], damping=MarquardtDamping(), max_epochs=100)
        np.testing.assert_allclose(one.x[0], found.x[i], rtol=1e-12)
        assert one.steps[0] == found.steps[i]
