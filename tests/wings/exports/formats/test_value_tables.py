"""Laws of the tables behind exported source code: values, runs, and the reduced covariance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_models import planted_model, rail_arm

import truearm as ta
from truearm.identification.terms import Expression, Harmonics
from truearm.models.training_conditions import TOGETHER
from truearm.wings.exports.formats import reduced_covariance as reduced
from truearm.wings.exports.formats.plain_model import CovarianceRows, ValueLayout, ValueTables, plain_model, runs_of


def harmonics(joint, orders):
    return list(Harmonics(joint, tuple(orders)).expressions()) if orders else []


@given(st.lists(st.sets(st.integers(1, 60), max_size=30), min_size=1, max_size=3))
def test_every_function_has_a_value_of_its_own(orders):
    functions = [Expression.number(1), Expression.direction(1), Expression.gravity_torque(0, 2)]
    functions += [Expression.angle(1), Expression.angle(1) * Expression.direction(1)]
    functions += [f for joint, ks in enumerate(orders, 1) for f in harmonics(joint, sorted(ks))]
    layout = ValueLayout.of(functions, len(orders))
    indices = [layout.index(function) for function in functions]
    assert len(set(indices)) == len(functions)
    assert max(indices) < len(layout.values)
    assert indices[0] == 0


def test_orders_are_computed_in_a_row_as_long_as_nearly_all_are_used():
    layout = ValueLayout.of(harmonics(1, [*range(1, 111), 128, 256]) + harmonics(2, [2, 4]), 2)
    assert [highest for _, highest in layout.harmonics] == [110, 0]
    assert [entry[:2] for entry in layout.further] == [(0, 128), (0, 256), (1, 2), (1, 4)]
    assert layout.index((7 * Expression.angle(1)).sin()) == layout.index((7 * Expression.angle(1)).cos()) + 1


@given(st.sets(st.tuples(st.integers(0, 3), st.integers(0, 12))))
def test_runs_list_every_pair_once_in_order(pairs):
    runs = runs_of(sorted(pairs))
    listed = [(run.component, run.first + k) for run in runs for k in range(run.n_values)]
    assert listed == sorted(pairs)


def test_rows_have_the_covariance_of_motions():
    plain = plain_model(planted_model(rail_arm()))
    rows = CovarianceRows.of(plain, ValueTables.of(plain).layout)
    spread = rows.of_coefficient @ plain.covariance_root.T
    # The variance of a component by a value is that of its coefficient: the planted terms have unit directions.
    own = np.sort((plain.covariance_root**2).sum(axis=0))
    np.testing.assert_allclose(np.sort((spread**2).sum(axis=1)), own, rtol=1e-12)


def test_variances_of_joints_are_piecewise_linear_in_the_angle(rng):
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 500.0])
    nodes = reduced.JointVariances.nodes(low, high, np.array([False, True]), (40, 0))
    assert nodes.count.tolist() == [int(np.ceil(6.5 * 40 / np.pi)), 16]
    nodes = nodes.with_values(rng.uniform(0, 1, len(nodes.variance) + 3))
    angles, levers = rng.uniform(low - 0.1, high + 0.1, (50, 2)), rng.normal(size=(50, 2, 3))
    grids = [np.linspace(a, b, n) for a, b, n in zip(low, high, nodes.count, strict=True)]
    values = np.split(nodes.variance, nodes.first[1:])
    by_joint = np.stack([np.interp(angles[:, j], grids[j], values[j]) for j in range(2)], axis=1)
    plain = np.einsum("nj,njx->nx", by_joint, levers**2) + nodes.of_axes
    np.testing.assert_allclose((nodes.design(angles, levers) @ nodes.values).reshape(-1, 3), plain, rtol=1e-12)


def test_few_coefficients_keep_all_directions_exactly():
    session = ta.simulate("ur10", poses=40, preset="shop", seed=3).session
    model = ta.fit("ur10", session, model="nominal").model
    plain = plain_model(model)
    layout = ValueTables.of(plain).layout
    found = reduced.reduced_covariance(plain, layout)
    assert found.remainder is None
    assert found.largest_error == 0
    table = found.entries * found.quantum[:, None]
    exact = CovarianceRows.of(plain, layout).of_coefficient @ plain.covariance_root.T
    np.testing.assert_allclose(table, exact, rtol=0, atol=found.quantum.max())


def test_the_region_is_inside_the_trained_range_and_beyond_it_is_wider(rng):
    model = planted_model(ta.load_arm("ur10"))
    inside = reduced.sample_trained_region(model, 500, rng)
    readings = ta.Session(inside.angles, temperature_degC=inside.temperature_degC, columns=inside.columns)
    assert set(model.inputs_outside_training(readings)) <= {TOGETHER}  # each joint by itself is inside
    both = reduced.sample_trained_region(model, 100, rng, beyond=200)
    assert len(both) == 300
    lower, upper = model.arm_.limits.T
    assert ((both.angles >= lower) & (both.angles <= upper)).all()
    assert model.outside_training(ta.Session(both.angles[100:])).mean() > 0.5


@pytest.mark.parametrize("number", [0.1, -1e-300, 1e300, 3, -0.0, np.float64(2.5)])
def test_numbers_are_written_with_all_digits(number):
    from truearm.wings.exports.formats.source_code import number as written

    assert float(written(number)) == number
