"""An identified model as plain tables, from which the formats that contain the whole model are written.

The tip is ``F0 E0 J1(q1) E1 F1 ... Jn(qn) En Fn (tip + E(n+1))`` (see `truearm.arm.chain`). The motion E at a place is
the sum of its functions' values times their rows of `motion_by_function`; it turns first and shifts then.

An identified model as tables for plain loops: what C and JavaScript evaluate.

All basis functions of an arm's state are values of one vector, each computed once whatever the places that it acts at:
first the one of the constants, then temperature, directions, columns, gravity torques, and by joint the harmonics
``cos k q, sin k q`` of orders 1 to K (by addition theorems) and some higher ones; last all other functions, written out
as their expressions. A component of a place's motion is then a sum over runs of neighbouring values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearm.arm import Chain
from truearm.errors import InputError
from truearm.identification.terms import Basis, Expression, LinkMasses, Temperature, Term, link_vectors, uniform_links
from truearm.models import Compensator, IdentifiedModel
from truearm.models.identified_model import require_identified
from truearm.readings import Session
from truearm.readings.readings import PAYLOAD
from truearm.solve.linear_algebra import covariance_factor
from truearm.typing import FloatArray, IntArray
from truearm.wings.exports.targets.manifest import check_not_coupled

# Inputs that are zero in the first session, of the model's one tip, and at the payload of the training.
ZERO: Mapping[str | Expression, float] = {"session": 0.0, "tip": 0.0, "payload torque": 0.0}
ONE = Expression.number(1)


@dataclass(frozen=True, eq=False)
class PlainModel:
    """An identified model as plain tables.

    Attributes
    ----------
    model : IdentifiedModel
        The model of which these are the tables.
    chain : Chain
        The chain on which the motions act, in the frame of the reference.
    nominal_chain : Chain
        The nominal arm in its own base frame: gravity torques are those of its links.
    mass_kg, centre_in_joint_mm : (n_joints,) and (n_joints, 3) array
        Masses of the links and their centres along the axes of their places.
    gravity_in_base : (3,) array
        Acceleration of free fall along the axes of the nominal arm's base frame [m/s^2].
    functions : tuple of Expression
        Place by place; the same function may act at several places. Those of constants are `ONE`.
    place : (n_functions,) int array
        Where each acts, rising: 0 the base, i joint i, n_joints + 1 the tip.
    motion_by_function : (n_functions, 6) array
        Rotation vector [rad] and translation [mm] along the place's axes, by unit of the function.
    coefficients : (p,) int array
        The uncertain coefficients among those of the fit.
    coefficient_function : (p,) int array
        The function of each.
    coefficient_direction : (p, 6) array
        Its direction: how the motion at the function's place changes by the coefficient and the function's value.
    covariance_root : (p, p) array
        F with ``F^T F`` the covariance of the coefficients.
    grows : bool
        Whether terms describe the growth of the links by temperature.
    """

    model: IdentifiedModel
    chain: Chain
    nominal_chain: Chain
    mass_kg: FloatArray
    centre_in_joint_mm: FloatArray
    gravity_in_base: FloatArray
    functions: tuple[Expression, ...]
    place: IntArray
    motion_by_function: FloatArray
    coefficients: IntArray
    coefficient_function: IntArray
    coefficient_direction: FloatArray
    covariance_root: FloatArray
    grows: bool

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.chain.n_joints

    def columns(self) -> list[str]:
        """Columns of a session that functions depend on."""
        return sorted(one.arguments[0] for one in self.inputs if one.operation == "column")

    def uses(self, kind: str) -> bool:
        """Whether a function depends on an input of this kind."""
        return any(one.operation == kind for one in self.inputs)

    @property
    def inputs(self) -> frozenset[Expression]:
        """The inputs of all functions."""
        return frozenset().union(*(function.inputs for function in self.functions))


def plain_model(model: Compensator) -> PlainModel:
    """The tables of a nominal, kinematic or physical model. Functions of one session are those of the first (zero).

    Raises
    ------
    InputError
        If the model is a network, depends on a payload that varied in its training, or has terms of a basis without
        expressions.
    """
    identified = require_identified(
        model,
        f"expected a nominal, kinematic or physical model, got a {type(model).__name__}",
        hint="export a network as ONNX or JSON, or the kinematic or physical model of the same readings",
    )
    check_not_coupled(model.arm_, "c, js or onnx")
    fit, state = identified.fit_, model.state(Session(np.zeros((1, model.arm_.n_joints))))
    links = loaded_links(identified)
    rows: dict[tuple[int, Expression], int] = {}
    entries = list(_entries(fit.perturbed_chain.terms))
    for place, function, _, _ in sorted(entries, key=lambda entry: entry[0]):
        rows.setdefault((place, function), len(rows))
    motions = np.zeros((len(rows), 6))
    function_of, directions = [], []
    for place, function, direction, column in entries:
        row = rows[place, function]
        motions[row] += fit.coefficients[column] * np.array(direction)
        function_of.append(row)
        directions.append(direction)
    columns = np.array([column for *_, column in entries], dtype=np.intp)
    uncertain = fit.covariance.diagonal()[columns] > 0
    kept = columns[uncertain]
    plain = PlainModel(
        model=identified,
        chain=fit.perturbed_chain.chain,
        nominal_chain=state.chain,
        mass_kg=links.mass_kg,
        centre_in_joint_mm=links.centre_in_joint_mm,
        gravity_in_base=state.gravity_in_base,
        functions=tuple(function for _, function in rows),
        place=np.array([place for place, _ in rows], dtype=np.intp),
        motion_by_function=motions,
        coefficients=kept,
        coefficient_function=np.array(function_of, dtype=np.intp)[uncertain],
        coefficient_direction=np.array(directions, dtype=float).reshape(-1, 6)[uncertain],
        covariance_root=covariance_factor(fit.covariance[np.ix_(kept, kept)]),
        grows=any(isinstance(term.basis, Temperature) for term in fit.perturbed_chain.terms),
    )
    if unknown := sorted(set(plain.columns()) - set(model.training_.columns)):
        raise InputError(f"the model has terms of a column that its training does not state: {unknown[0][:40]!r}")
    return plain


def loaded_links(model: IdentifiedModel) -> LinkMasses:
    """Masses of the nominal links; the last one carries the payload of the training, at the tip.

    Raises
    ------
    InputError
        If the model depends on a payload that was not the same at all readings.
    """
    state = model.state(Session(np.zeros((1, model.arm_.n_joints))))
    links = uniform_links(state.chain, kg_per_m=1.0) if state.links is None else state.links
    known, (by_gravity, differences_from) = model.training_.columns.get(PAYLOAD), _payload_inputs(model)
    if known is None or not (by_gravity or differences_from):
        return links
    kg = known.mean
    if not np.isclose(known.lower, known.upper) or not all(np.isclose(of, kg) for of in differences_from):
        raise InputError(
            "the model depends on the payload, which no export format contains",
            hint=f"fit readings of one {PAYLOAD} to export the model for it",
        )
    mass, centre = links.mass_kg.copy(), links.centre_in_joint_mm.copy()
    if not by_gravity or mass[-1] + kg == 0:
        return links
    centre[-1] = (mass[-1] * centre[-1] + kg * link_vectors(state.chain)[-1]) / (mass[-1] + kg)
    mass[-1] += kg
    return LinkMasses(mass, centre)


def depends_on_payload(model: IdentifiedModel) -> bool:
    """Whether tips, or their uncertainty, depend on the payload by more than a column of it."""
    return any(_payload_inputs(model))


def _payload_inputs(model: IdentifiedModel) -> tuple[bool, set[float]]:
    """Whether the payload counts in gravity torques, and the payloads from which terms count its difference."""
    terms = model.fit_.perturbed_chain.terms
    inputs = {one for term in terms for function in term.basis.expressions() or () for one in function.inputs}
    by_gravity = model.arm_.masses is not None and any(one.operation == "gravity torque" for one in inputs)
    return by_gravity, {one.arguments[2] for one in inputs if one.operation == "payload torque"}


def expressions_of(basis: Basis) -> tuple[Expression, ...]:
    """What the functions of a basis are.

    Raises
    ------
    InputError
        If the basis does not say it.
    """
    expressions = basis.expressions()
    if expressions is None and basis.is_approximate:
        raise InputError(
            "the model has a residual process, which of the formats of a whole model only JSON contains",
            hint="export it as JSON, or fit the model without: --no-residual-process",
        )
    if expressions is None:
        raise InputError(
            f"the model has terms of the basis {type(basis).__name__}, which does not say what its functions are",
            hint="give the basis a method expressions (see docs/terms.md), or export a model without these terms",
        )
    return expressions


def _entries(terms: tuple[Term, ...]) -> list[tuple[int, Expression, tuple[float, ...], int]]:
    """Place, function, direction and coefficient, one for each function of each term that is not zero throughout."""
    entries, start = [], 0
    for term in terms:
        for k, expression in enumerate(expressions_of(term.basis)):
            function, direction = expression.with_inputs(ZERO), term.direction
            if function.value is not None:
                direction = tuple(function.value * share for share in direction)
                function = ONE
            if any(direction):
                entries.append((term.place, function, direction, start + k))
        start += term.n_coefficients
    return entries


class Run(NamedTuple):
    """Neighbouring values that move one component.

    Attributes
    ----------
    component : int
        6 times the place, plus 0 to 5 for the rotations and translations along its axes.
    first : int
        The first value.
    n_values : int
    """

    component: int
    first: int
    n_values: int


@dataclass(frozen=True)
class ValueLayout:
    """Where each basis function stands in the vector of values.

    Attributes
    ----------
    columns : tuple of str
        Columns of a session that functions depend on.
    first : dict of str to int
        First value of each kind of input: one temperature, a direction for each joint, columns, three gravity torques
        for the base and each joint. -1 where no function depends on it.
    harmonics : tuple of (int, int)
        First value of each joint's consecutive orders, and the highest of them; 0 where there are none.
    further : tuple of (int, int, int, int)
        Joint (counted from 0), order, first value and first value of half the order (-1: none) of the orders above.
    formulas : dict of Expression to int
        All other functions and their values.
    values : dict of Expression to int
        All functions and their values.
    """

    columns: tuple[str, ...]
    first: dict[str, int]
    harmonics: tuple[tuple[int, int], ...]
    further: tuple[tuple[int, int, int, int], ...]
    formulas: dict[Expression, int]
    values: dict[Expression, int]

    @classmethod
    def of(cls, functions: Iterable[Expression], n_joints: int) -> ValueLayout:
        """Layout of distinct functions."""
        distinct = list(dict.fromkeys(functions))
        inputs = {one for function in distinct for one in function.inputs}
        kinds = {one.operation for one in inputs}
        columns = tuple(sorted(one.arguments[0] for one in inputs if one.operation == "column"))
        values, first, joints = {ONE: 0}, {}, range(1, n_joints + 1)
        for kind, members in {
            "temperature": [Expression.temperature()],
            "direction": [*map(Expression.direction, joints)],
            "column": [*map(Expression.column, columns)],
            "gravity torque": [Expression.gravity_torque(i, axis) for i in (0, *joints) for axis in range(3)],
        }.items():
            first[kind] = len(values) if kind in kinds else -1
            for one in members if kind in kinds else ():
                values[one] = len(values)
        harmonics, further = [], []
        pairs = {function.harmonic for function in distinct}
        for joint in joints:
            orders = sorted(pair[1] for pair in pairs if pair and pair[0] == joint)
            # Orders are computed in a row as long as nine in ten of them are used.
            highest = max((k for n, k in enumerate(orders, 1) if 10 * n >= 9 * k), default=0)
            harmonics.append((len(values), highest))
            for k in (*range(1, highest + 1), *(k for k in orders if k > highest)):
                turn = Expression.angle(joint)
                if k > highest:
                    further.append((joint - 1, k, len(values), values.get((k / 2 * turn).cos(), -1)))
                for one in ((k * turn).cos(), (k * turn).sin()):
                    values[one] = len(values)
        others = [one for one in distinct if one not in values and one.operation != "temperature"]
        formulas = {one: len(values) + i for i, one in enumerate(others)}
        values |= formulas
        return cls(columns, first, tuple(harmonics), tuple(further), formulas, values)

    def index(self, function: Expression) -> int:
        """The value of a function: one temperature counts for all links."""
        return self.first["temperature"] if function.operation == "temperature" else self.values[function]


@dataclass(frozen=True, eq=False)
class ValueTables:
    """The mean of an identified model as tables; see `reduced_covariance` for its covariance.

    Attributes
    ----------
    layout : ValueLayout
    constant_motions : (n_places, 6) array
        Motions by the constants [rad, mm].
    runs : tuple of Run
        Of the other values.
    weights : (n,) array
        Motion by a unit of each value, run by run.
    load : (n_joints, 3) array
        First moment of a link and of the masses beyond its far end, along the axes of its place [kg mm].
    mass_outward : (n_joints,) array
        Mass of a link and of all beyond it [kg].
    gravity_in_place : (3,) array
        Acceleration of free fall along the axes of place 0 [m/s^2].
    """

    layout: ValueLayout
    constant_motions: FloatArray
    runs: tuple[Run, ...]
    weights: FloatArray
    load: FloatArray
    mass_outward: FloatArray
    gravity_in_place: FloatArray

    @classmethod
    def of(cls, plain: PlainModel) -> ValueTables:
        """Tables of a model."""
        layout = ValueLayout.of(plain.functions, plain.n_joints)
        constant, motions = np.zeros((plain.n_joints + 2, 6)), plain.motion_by_function.copy()
        is_constant = np.array([function == ONE for function in plain.functions], dtype=bool)
        np.add.at(constant, plain.place[is_constant], motions[is_constant])
        motions[is_constant] = 0.0
        row, axis = np.nonzero(motions)
        keys, which = _keys(plain, layout, row, axis)
        vectors, mass = link_vectors(plain.nominal_chain), plain.mass_kg
        outward = np.cumsum(mass[::-1])[::-1]
        beyond = np.append(outward[1:], 0.0)
        return cls(
            layout=layout,
            constant_motions=constant,
            runs=runs_of(keys),
            weights=np.bincount(which, motions[row, axis], minlength=len(keys)).astype(float),
            load=beyond[:, None] * vectors[1:] + mass[:, None] * plain.centre_in_joint_mm,
            mass_outward=outward,
            gravity_in_place=plain.gravity_in_base @ plain.nominal_chain.fixed[0, :3, :3],
        )


@dataclass(frozen=True, eq=False)
class CovarianceRows:
    """The coefficients' covariance root by component and value: how motions deviate, direction by direction.

    Attributes
    ----------
    keys : tuple of (int, int)
        Component and value of each row, rising.
    of_coefficient : (k, p) array
        Rows by coefficients: a row's deviation is this times the deviations of the coefficients.
    """

    keys: tuple[tuple[int, int], ...]
    of_coefficient: FloatArray

    @classmethod
    def of(cls, plain: PlainModel, layout: ValueLayout) -> CovarianceRows:
        """Rows of a model."""
        coefficient, axis = np.nonzero(plain.coefficient_direction)
        keys, which = _keys(plain, layout, plain.coefficient_function[coefficient], axis)
        of_coefficient = np.zeros((len(keys), len(plain.coefficient_function)))
        of_coefficient[which, coefficient] = plain.coefficient_direction[coefficient, axis]
        return cls(keys, of_coefficient)


def _keys(
    plain: PlainModel, layout: ValueLayout, row: IntArray, axis: IntArray
) -> tuple[tuple[tuple[int, int], ...], IntArray]:
    """Rising pairs of component and value of motions by the functions `row` along `axis`, and the pair of each."""
    values = np.array([layout.index(function) for function in plain.functions], dtype=np.intp)
    pairs = np.stack([6 * plain.place[row] + axis, values[row]], axis=1)
    keys, which = np.unique(pairs, axis=0, return_inverse=True)
    return tuple((component, value) for component, value in keys.tolist()), which.ravel()


def runs_of(keys: Iterable[tuple[int, int]]) -> tuple[Run, ...]:
    """Runs of rising pairs of component and value."""
    runs: list[Run] = []
    for component, value in keys:
        if runs and runs[-1].component == component and runs[-1].first + runs[-1].n_values == value:
            runs[-1] = runs[-1]._replace(n_values=runs[-1].n_values + 1)
        else:
            runs.append(Run(component, value, 1))
    return tuple(runs)
