"""Laws of expressions: their algebra is that of their values, they come back from data, what is none is refused."""

import json
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refuses
from truearm.identification.terms import Expression, Formula, Term, basis_from_data
from truearm.identification.terms.expression import DEEPEST, HIGHEST_ORDER, MOST_PARTS, MOST_PARTS_TOGETHER

Q = Expression.angle(2)
leaves = st.one_of(
    st.builds(Expression.angle, st.integers(1, 5)),
    st.builds(Expression.gravity_torque, st.integers(0, 5), st.integers(0, 2)),
    st.builds(Expression.temperature, st.integers(0, 5)),
    st.builds(Expression.direction, st.integers(1, 5)),
    st.just(Expression.column("load_2_Nm")),
    st.builds(Expression.number, st.sampled_from([0, 1, 2, -1.5, 0.25])),
)
expressions = st.recursive(
    leaves,
    lambda of: st.one_of(
        st.builds(lambda a, b: a + b, of, of),
        st.builds(lambda a, b: a * b, of, of),
        st.builds(lambda a, n: a.cos() ** n, of, st.integers(1, 4)),
        st.builds(Expression.sin, of),
    ),
    max_leaves=8,
)


@settings(max_examples=30, deadline=None)
@given(expressions, expressions)
def test_operations_are_those_of_the_values(make_state, a, b):
    state = make_state(3, 6)
    x, y = a.values(state), b.values(state)
    scale = 1e-12 * (1 + np.abs(x).max()) * (1 + np.abs(y).max())  # rounding, in another order
    for expression, values in (
        (a + b, x + y),
        (a - b, x - y),
        (a * b, x * y),
        (3 * a, 3 * x),
        (2 - a, 2 - x),
        (a / 4, x / 4),
        (-a, -x),
    ):
        np.testing.assert_allclose(expression.values(state), values, rtol=1e-12, atol=scale)


@given(expressions)
def test_an_expression_comes_back_from_data_and_has_a_name(expression):
    assert Expression.from_data(json.loads(json.dumps(expression.as_data()))) == expression
    assert str(expression)
    data = Formula((expression,)).as_data()
    assert basis_from_data(json.loads(json.dumps(data))) == Formula((expression,))


@settings(max_examples=30, deadline=None)
@given(expressions)
def test_numbers_for_inputs_are_the_values_there(make_state, expression):
    state = make_state(3, 1, directions=np.ones((1, 5)), columns={"load_2_Nm": np.array([2.0])})
    fixed = expression.with_inputs({"direction": 1.0, "column": 2.0})
    assert not {one.operation for one in fixed.inputs} & {"direction", "column"}
    np.testing.assert_allclose(fixed.values(state), expression.values(state), rtol=1e-12, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(expressions)
def test_an_expression_goes_to_another_process(expression):
    assert len(expression.inputs) >= len({one.operation for one in expression.inputs})  # an input is one of its own
    sent = ForkingPickler.loads(ForkingPickler.dumps(expression))
    assert sent == expression
    assert sent.inputs == expression.inputs


def test_numbers_are_folded():
    assert Expression.number(0) == 0 * Q
    assert 1 * Q == Q + 0 == Q**1 == Q
    assert Expression.number(0).cos() == Expression.number(1.0)
    assert (2 * Q) * 3 == 6 * Q
    assert str(2 * (Q + 1) - Q**2 + (Q * 3).sin()) == "2 * (q2 + 1) + -1 * q2^2 + sin(3 * q2)"


@pytest.mark.parametrize(
    ("expression", "harmonic"),
    [
        (Q.cos(), (2, 1)),
        ((3 * Q).sin(), (2, 3)),
        ((0.5 * Q).sin(), None),
        ((HIGHEST_ORDER * Q).cos(), (2, HIGHEST_ORDER)),
        (((HIGHEST_ORDER + 1) * Q).cos(), None),
        ((3e9 * Q).sin(), None),
        ((-1 * Q).cos(), None),
        ((Q + 1).cos(), None),
        ((Q * Q).cos(), None),
        (Q, None),
    ],
)
def test_a_harmonic_is_a_cosine_or_sine_of_a_whole_multiple(expression, harmonic):
    assert expression.harmonic == harmonic


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.float32, np.float64])
def test_numbers_of_any_kind_are_made_plain(kind):
    two = kind(2)
    for got, expected in ((two * Q, 2 * Q), (Q * two, 2 * Q), (Q + two, Q + 2), (two - Q, 2 - Q)):
        assert got == expected
        assert json.dumps(got.as_data())
    if np.issubdtype(kind, np.integer):
        assert Expression.angle(two) == Q
        assert Q**two == Q**2
        assert type((Q**two).arguments[1]) is int


def test_arguments_do_not_change():
    arguments = [2]
    one = Expression("angle", arguments)
    arguments[0] = 3
    assert one == Q
    assert hash(one) == hash(Q)
    for bad in (None, 2, {2}, "2"):
        refuses("expected an expression", Expression, "angle", bad)


@pytest.mark.parametrize(
    "made",
    [
        lambda: Expression.number(0) ** -1,
        lambda: Expression.number(1e200) ** 2,
        lambda: Expression.number(1e200) * 1e200,
        lambda: Expression.number(10**299) * 10**299 * 1.5,
        lambda: Expression.number(9e299) + 9e299,
        lambda: Expression.number(-1) ** 0.5,
        lambda: Expression.from_data(["power", 1e200, 2]).with_inputs({}),
        lambda: Formula((["cos", ["power", 1e200, 2]],)),
        lambda: Formula((["power", 1e200, 2],)),
    ],
)
def test_numbers_without_a_finite_result_are_refused(made):
    refuses("expected (numbers with a finite result|an expression)", made)


@pytest.mark.parametrize("operation", ["sum", "product"])
def test_numbers_for_inputs_of_a_long_expression_make_each_part_once(operation, monkeypatch):
    several = Expression(operation, tuple(Expression.column(f"c{i}") + Q for i in range(200)))
    made, check = [], Expression.__post_init__
    monkeypatch.setattr(Expression, "__post_init__", lambda self: made.append(check(self)))
    fixed = several.with_inputs({"column": 2.0})
    assert fixed.n_parts == (202 if operation == "sum" else 601)
    assert len(made) <= 4 * several.n_parts


def test_functions_of_a_formula_have_a_limit_together():
    function = Expression("sum", (Q,) * (MOST_PARTS - 1))
    most = MOST_PARTS_TOGETHER // MOST_PARTS
    assert Formula((function,) * most).n_parts == MOST_PARTS_TOGETHER
    refuses(f"at most {MOST_PARTS_TOGETHER} parts together", Formula, (function,) * most + (Q,))


def test_a_term_by_an_expression_has_a_formula():
    term = Term("own", 1, (0, 0, 1, 0, 0, 0), Q**2, "g", 1.0)
    assert term.basis == Formula((Q**2,))
    assert Term.from_data(json.loads(json.dumps(term.as_data()))) == term


def deep(n):
    data = ["angle", 1]
    for _ in range(n):
        data = ["cos", data]
    return data


@pytest.mark.parametrize(
    "data",
    [
        *([], ["angle"], ["angle", 0], ["angle", 1.0], ["angle", True], ["angle", 101], ["angle", 1, 2]),
        *(["column", ""], ["angle", deep(5000)], ["sum", 1, deep(5000)]),
        *(["tan", ["angle", 1]], ["sum", 1], ["sum", 1, "x"]),
        *(["power", ["angle", 1], 0.5], ["power", ["angle", 1], 99]),
        *(["cos"], ["cos", 1, 2], "angle", None, {"angle": 1}, float("nan"), float("inf"), True, [["angle"], 1]),
        *(["number", 1, 2], ["gravity torque", 1, 3], ["power", 2], deep(DEEPEST + 1), ["sum", *[1] * MOST_PARTS]),
        *(deep(5000), ["payload torque", 1, 0, float("nan")]),
    ],
)  # fmt: skip
def test_what_is_no_expression_is_refused(data):
    refuses("expected an expression", Expression.from_data, data)
    refuses(None, basis_from_data, {"kind": "Formula", "functions": [data]})


def test_joints_and_links_that_the_arm_has_not_are_refused(make_state):
    for expression in (Expression.angle(6), Expression.gravity_torque(6, 0), Expression.temperature(6)):
        refuses("expected a (joint|link) from", expression.values, make_state())
