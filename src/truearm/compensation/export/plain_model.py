"""An identified model as plain tables, from which the formats that contain the whole model are written.

The tip is ``F0 E0 J1(q1) E1 F1 ... Jn(qn) En Fn (tip + E(n+1))`` (see `truearm.arm.chain`). The motion E at a place is
the sum of its functions' values times their rows of `motion_by_function`; it turns first and shifts then.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from truearm.arm.chain import Chain
from truearm.arm.masses import LinkMasses
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.compensation.models.training_conditions import TrainingConditions
from truearm.errors import InputError
from truearm.identification.estimation.residual_variance import VarianceFunction
from truearm.identification.terms import Term
from truearm.identification.terms.basis import Basis, Column, Constant, Direction, Harmonics, InSession, Temperature
from truearm.identification.terms.gravity import uniform_links
from truearm.identification.terms.kernel import InducedProcess
from truearm.identification.terms.thermal import link_vectors
from truearm.identification.terms.torque import GravityTorque, PayloadTorque
from truearm.readings.readings import PAYLOAD
from truearm.readings.session import Session
from truearm.solve.square_roots import covariance_factor
from truearm.typing import FloatArray, IntArray

# Functions that are zero in the first session and at the payload of the training.
NOT_EXPORTED = (InSession, PayloadTorque)

FunctionKind = Literal["constant", "cos", "sin", "gravity", "temperature", "direction", "column"]


@dataclass(frozen=True)
class BasisFunction:
    """One scalar function of the arm's state.

    Attributes
    ----------
    kind : FunctionKind
        ``cos`` and ``sin`` of ``order * q[joint]``; ``gravity`` torque [N m] at `joint` about `axis` of its place
        (joint 0: torque of joint 1 on the base, about the axes of place 0); ``temperature`` of a link above 20 degC
        [K]; ``direction`` of a joint's last movement, -1 to 1; a ``column`` of the session in its own unit.
    joint : int
        Counted from 1; of a temperature the link (0 is the stand); 0 where there is none.
    order : int
        Of a harmonic.
    axis : int
        0, 1, 2 for x, y, z, of a gravity torque.
    column : str
        Name of the session's column.
    """

    kind: FunctionKind
    joint: int = 0
    order: int = 0
    axis: int = 0
    column: str = ""


@dataclass(frozen=True, eq=False)
class PlainModel:
    """An identified model as plain tables.

    Attributes
    ----------
    chain : Chain
        The chain on which the motions act, in the frame of the reference.
    nominal_chain : Chain
        The nominal arm in its own base frame: gravity torques are those of its links.
    mass_kg, centre_in_joint_mm : (n_joints,) and (n_joints, 3) array
        Masses of the links and their centres along the axes of their places.
    gravity_in_base : (3,) array
        Acceleration of free fall along the axes of the nominal arm's base frame [m/s^2].
    functions : tuple of BasisFunction
        Place by place; the same function may act at several places.
    place : (n_functions,) int array
        Where each acts, rising: 0 the base, i joint i, n_joints + 1 the tip.
    motion_by_function : (n_functions, 6) array
        Rotation vector [rad] and translation [mm] along the place's axes, by unit of the function.
    coefficient_function : (p,) int array
        The function of each uncertain coefficient.
    coefficient_direction : (p, 6) array
        Its direction: how the motion at the function's place changes by the coefficient and the function's value.
    covariance_root : (p, p) array
        F with ``F^T F`` the covariance of the coefficients.
    residual_std_mm : float
        Standard deviation of a coordinate that the model does not explain.
    variance_function : VarianceFunction
        Share of its square at given angles.
    training : TrainingConditions
    reference_chain : Chain
        The nominal arm with base and tip identified from the same readings: the controller's view.
    lower, upper : (n_joints,) array
        Limits of the joints [rad, or mm], infinite without.
    """

    chain: Chain
    nominal_chain: Chain
    mass_kg: FloatArray
    centre_in_joint_mm: FloatArray
    gravity_in_base: FloatArray
    functions: tuple[BasisFunction, ...]
    place: IntArray
    motion_by_function: FloatArray
    coefficient_function: IntArray
    coefficient_direction: FloatArray
    covariance_root: FloatArray
    residual_std_mm: float
    variance_function: VarianceFunction
    training: TrainingConditions
    reference_chain: Chain
    lower: FloatArray
    upper: FloatArray

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.chain.n_joints

    @cached_property
    def highest_orders(self) -> IntArray:
        """(n_joints,) highest order of the harmonics of each joint; 0 without."""
        out = np.zeros(self.n_joints, dtype=np.intp)
        for function in self.functions:
            if function.order:
                out[function.joint - 1] = max(out[function.joint - 1], function.order)
        return out

    def uses(self, kind: FunctionKind) -> bool:
        """Whether a function of this kind is among the model's."""
        return any(function.kind == kind for function in self.functions)


def plain_model(model: Compensator) -> PlainModel:
    """The tables of a nominal, kinematic or physical model. Functions of one session are those of the first (zero).

    Raises
    ------
    InputError
        If the model is a network, depends on a payload that varied in its training, or has terms of a basis of its
        user's own.
    """
    if not isinstance(model, IdentifiedModel):
        raise InputError(
            f"expected a nominal, kinematic or physical model, got a {type(model).__name__}",
            hint="export the kinematic or physical model of the same readings",
        )
    fit, arm = model.fit_, model.arm_
    state = model.state(Session(np.zeros((1, arm.n_joints))))
    links = loaded_links(model)
    rows: dict[tuple[int, BasisFunction], int] = {}
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
    if unknown := sorted({function.column for _, function in rows} - {"", *model.training_.columns}):
        raise InputError(f"the model has terms of a column that its training does not state: {unknown[0][:40]!r}")
    columns = np.array([column for *_, column in entries], dtype=np.intp)
    uncertain = fit.covariance.diagonal()[columns] > 0
    kept = columns[uncertain]
    return PlainModel(
        chain=fit.perturbed_chain.chain,
        nominal_chain=state.chain,
        mass_kg=links.mass_kg,
        centre_in_joint_mm=links.centre_in_joint_mm,
        gravity_in_base=state.gravity_in_base,
        functions=tuple(function for _, function in rows),
        place=np.array([place for place, _ in rows], dtype=np.intp),
        motion_by_function=motions,
        coefficient_function=np.array(function_of, dtype=np.intp)[uncertain],
        coefficient_direction=np.array(directions, dtype=float).reshape(-1, 6)[uncertain],
        covariance_root=covariance_factor(fit.covariance[np.ix_(kept, kept)]),
        residual_std_mm=model.residual_std_,
        variance_function=model.variance_function_,
        training=model.training_,
        reference_chain=model.nominal_.chain,
        lower=arm.limits[:, 0],
        upper=arm.limits[:, 1],
    )


def loaded_links(model: IdentifiedModel) -> LinkMasses:
    """Masses of the nominal links; the last one carries the payload of the training, at the tip.

    Raises
    ------
    InputError
        If the model depends on a payload that was not the same at all readings.
    """
    state, terms = model.state(Session(np.zeros((1, model.arm_.n_joints)))), model.fit_.perturbed_chain.terms
    links = uniform_links(state.chain, kg_per_m=1.0) if state.links is None else state.links
    known = model.training_.columns.get(PAYLOAD)
    differences_from = {term.basis.from_kg for term in terms if isinstance(term.basis, PayloadTorque)}
    by_gravity = state.links is not None and any(isinstance(term.basis, GravityTorque) for term in terms)
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


def unknown_basis(basis: Basis) -> InputError:
    """That no format has the functions of a basis."""
    return InputError(
        f"the model has terms of the basis {type(basis).__name__}, which no export format contains",
        hint="export the kinematic model of the same readings",
    )


def _entries(terms: tuple[Term, ...]) -> list[tuple[int, BasisFunction, tuple[float, ...], int]]:
    """Place, function, direction and coefficient, one for each function of each exported term."""
    entries, start = [], 0
    for term in terms:
        if not isinstance(term.basis, NOT_EXPORTED):
            for k, function in enumerate(_functions(term.basis)):
                entries.append((term.place, function, term.direction, start + k))
        start += term.n_coefficients
    return entries


def _functions(basis: Basis) -> list[BasisFunction]:
    match basis:
        case Constant():
            return [BasisFunction("constant")]
        case Harmonics():
            return [BasisFunction(kind, basis.joint, order=k) for k in basis.orders for kind in ("cos", "sin")]
        case GravityTorque():
            return [BasisFunction("gravity", basis.joint, axis=basis.axis)]
        case Temperature():
            return [BasisFunction("temperature", basis.link)]
        case Direction():
            return [BasisFunction("direction", basis.joint)]
        case Column():
            return [BasisFunction("column", column=basis.name)]
        case InducedProcess():
            raise InputError(
                "the model has a residual process, which of the formats of a whole model only JSON contains",
                hint="export it as JSON, or fit the model without: --no-residual-process",
            )
    raise unknown_basis(basis)
