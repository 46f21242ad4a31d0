"""An identified model as tables for plain loops: what C and JavaScript evaluate.

All basis functions of an arm's state are values of one vector, each computed once whatever the places that it acts at:
first the one of the constants, then temperature, directions, columns, gravity torques, and by joint the harmonics
``cos k q, sin k q`` of orders 1 to K (by addition theorems) and some higher ones; last all other functions, written out
as their expressions. A component of a place's motion is then a sum over runs of neighbouring values.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearm.identification.terms import Expression, link_vectors
from truearm.typing import FloatArray, IntArray
from truearm.wings.exports.formats.plain_model import ONE, PlainModel


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
