"""Basis functions: how a small motion depends on the state of the arm at a reading.

A basis is a frozen dataclass with a few plain fields, which a model file can store. It says once what its functions
are, as expressions, from which evaluation and the exports of a whole model follow; it may evaluate them in a faster
form. A user's own basis needs `expressions` and the decorator `register_basis`; one without expressions needs `labels`
and `values`, and no export contains it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, Self, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt
from pydantic import Field

from truearm.arm.rigid_motions import cos_sin
from truearm.errors import InputError
from truearm.identification.terms.expression import AXES as AXES
from truearm.identification.terms.expression import (
    HIGHEST_ORDER,
    INPUTS,
    MOST_JOINTS,
    MOST_PARTS_TOGETHER,
    Expression,
    of_joint,
    plain,
    torque_about,
    torques_on_base,
)
from truearm.identification.terms.state import ArmState
from truearm.typing import FloatArray

# Types of the fields of a basis: its constructor and the schema of JSON documents check them.
JointNumber = Annotated[int, Field(ge=1, le=MOST_JOINTS)]
JointOrBase = Annotated[int, Field(ge=0, le=MOST_JOINTS)]
AxisNumber = Annotated[int, Field(ge=0, le=2)]
Orders = Annotated[
    tuple[Annotated[int, Field(ge=1, le=HIGHEST_ORDER)], ...], Field(min_length=1, max_length=HIGHEST_ORDER)
]
Name = Annotated[str, Field(min_length=1, max_length=1000)]
Number = Annotated[float, Field(allow_inf_nan=False)]
_CHECKED = (JointNumber, JointOrBase, AxisNumber, Orders, Name, Number)


class Basis:
    """Abstract base class. Subclasses are frozen dataclasses whose fields are numbers, strings or tuples."""

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for field, form in _forms(kind).items():
            object.__setattr__(self, field, form.settled(field, getattr(self, field)))

    @cached_property
    def n_functions(self) -> int:
        """Number of functions."""
        return len(self.expressions() or self.labels())

    def labels(self) -> tuple[str, ...]:
        """Return the name of every function; by default its expression in words."""
        return tuple(map(str, self._functions))

    def expressions(self) -> tuple[Expression, ...] | None:
        """What the functions are, in their order; None where expressions have no word for them."""
        return None

    def values(self, state: ArmState) -> FloatArray:
        """Evaluate the functions at a state.

        Returns
        -------
        (n_functions, n) array
            C-contiguous.

        Raises
        ------
        InputError
            If the state lacks a quantity that they depend on.
        """
        return np.array([one.values(state) for one in self._functions])  # of few readings sooner than `stack`

    @cached_property
    def _functions(self) -> tuple[Expression, ...]:
        expressions = self.expressions()
        if expressions is None:
            raise NotImplementedError(f"the basis {type(self).__name__} needs expressions, or labels and values")
        return expressions

    @cached_property
    def inputs(self) -> frozenset[str] | None:
        """Kinds of the inputs of its expressions; None where it has none."""
        if (expressions := self.expressions()) is None:
            return None
        return frozenset(one.operation for function in expressions for one in function.inputs)

    @property
    def has_stated_inputs(self) -> bool:
        """Whether the functions may depend on what readings state beside angles and session: temperatures, loads."""
        return self.inputs is None or any(INPUTS[kind].is_stated for kind in self.inputs)

    @classmethod
    def together(cls, bases: Sequence[Self]) -> Callable[[ArmState], FloatArray]:
        """Prepare the functions of several bases of this kind, one below the other, for many states of few readings.

        The values are those of `values`. A kind of many functions may evaluate them in fewer array operations.
        """
        return lambda state: np.concatenate([basis.values(state) for basis in bases])

    def joint_slope(self, weights: FloatArray) -> tuple[int, FloatArray] | None:
        """Derivative by a joint's angle of a weighted sum of the functions, as a weighted sum of the same functions.

        Parameters
        ----------
        weights : (n_functions, k) array
            Weights of k sums.

        Returns
        -------
        joint : int
            Counted from 1.
        weights : (n_functions, k) array
            Weights of the derivatives [per rad].

        None for functions that depend on no joint, or so slowly that Newton's method needs no derivative of theirs:
        a gravity torque changes a motion of some 1e-4 rad by as much per rad, a step's error by 1e-4 of itself.
        """
        del weights
        return None

    @property
    def is_approximate(self) -> bool:
        """Whether the functions approximate a process, and leave a `remainder`."""
        return False

    def remainder(self, state: ArmState) -> FloatArray:
        """(n,) variance, in units of that of a coefficient, of what the functions approximate and do not span."""
        return np.zeros(len(state))

    def as_data(self) -> dict[str, Any]:
        """Return the basis as plain data: ``kind``, the name of the class, and its fields."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}  # type: ignore[arg-type]
        return {"kind": type(self).__name__} | {k: list(v) if isinstance(v, tuple) else v for k, v in fields.items()}


_KINDS: dict[str, Callable[..., Basis]] = {}

B = TypeVar("B", bound=Basis)


def register_basis(basis: type[B]) -> type[B]:
    """Class decorator: register a basis by the name of its class, for `basis_from_data` and model files.

    Raises
    ------
    InputError
        If another class has that name.
    """
    known = _KINDS.get(basis.__name__)
    # A class that is defined again, as in a notebook cell that runs twice, replaces the older one.
    if known is not None and (known.__module__, known.__qualname__) != (basis.__module__, basis.__qualname__):
        raise InputError(f"a basis of kind {basis.__name__!r} is already registered", hint="use another class name")
    _KINDS[basis.__name__] = basis
    return basis


def basis_from_data(data: Mapping[str, Any]) -> Basis:
    """Create a basis from the data of `as_data`.

    Raises
    ------
    InputError
        If the kind is not registered, or the fields do not match the kind.
    """
    kind = data.get("kind") if isinstance(data, Mapping) else None
    if not isinstance(kind, str):
        raise InputError(f"expected a basis as a table with its kind, got {_short(data)}")
    make = _KINDS.get(kind)
    if make is None:
        raise InputError(
            f"expected a basis among {sorted(_KINDS)}, got {kind[:60]!r}",
            hint="if it is your own basis, import the module that registers it",
        )
    fields = {str(key): tuple(v) if isinstance(v, list) else v for key, v in data.items() if key != "kind"}
    try:
        return make(**fields)
    except InputError:
        raise
    except (TypeError, ValueError) as problem:
        raise InputError(f"expected the fields of a basis {kind!r}, got {_short(data)}") from problem


@register_basis
@dataclass(frozen=True)
class Formula(Basis):
    """Functions by their expressions: those of a user's own, and in exported files those of a basis of any class.

    Parameters
    ----------
    functions : tuple of Expression
    """

    functions: tuple[Expression, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.functions, tuple) or not self.functions:
            raise InputError(f"expected a tuple of functions, got {_short(self.functions)}")
        made = (one if isinstance(one, Expression) else Expression.from_data(one) for one in self.functions)
        object.__setattr__(self, "functions", tuple(made))
        check_parts([self])
        for one in self.functions:
            one.with_inputs({})  # which refuses numbers without a finite result

    @cached_property
    def n_parts(self) -> int:
        """Number of inputs, numbers and operations in all functions."""
        return sum(one.n_parts for one in self.functions)

    def expressions(self) -> tuple[Expression, ...]:
        """The functions."""
        return self.functions

    def as_data(self) -> dict[str, Any]:
        """As of any basis."""
        return {"kind": "Formula", "functions": [one.as_data() for one in self.functions]}


def check_parts(bases: Iterable[Basis]) -> None:
    """Check that the formulas among the bases of a model are not too long together.

    Raises
    ------
    InputError
        If they have more than `MOST_PARTS_TOGETHER` parts.
    """
    n = sum(basis.n_parts for basis in bases if isinstance(basis, Formula))
    if n > MOST_PARTS_TOGETHER:
        raise InputError(f"expected formulas of at most {MOST_PARTS_TOGETHER} parts together, got {n}")


@register_basis
@dataclass(frozen=True)
class Constant(Basis):
    """One at every reading."""

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.number(1),)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) ones."""
        return np.ones((1, len(state)))


@register_basis
@dataclass(frozen=True)
class Harmonics(Basis):
    """Cosine and sine of whole multiples of a joint's angle: ``cos k1 q, sin k1 q, cos k2 q, ...``.

    Parameters
    ----------
    joint : int
        Counted from 1.
    orders : tuple of int
        The multiples k, rising, from 1 to 1000.
    """

    joint: JointNumber
    orders: Orders

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(a >= b for a, b in pairwise(self.orders)):
            raise InputError(f"expected rising orders, got {_short(self.orders)}")

    @property
    def n_functions(self) -> int:
        """Two for each order."""
        return 2 * len(self.orders)

    @property
    def inputs(self) -> frozenset[str]:
        """The angle alone."""
        return frozenset({"angle"})

    def labels(self) -> tuple[str, ...]:
        """Two functions for each order."""
        multiples = [f"{k} J{self.joint}" if k > 1 else f"J{self.joint}" for k in self.orders]
        return tuple(f"{function} {of}" for of in multiples for function in ("cos", "sin"))

    def expressions(self) -> tuple[Expression, ...]:
        """Two functions for each order."""
        turns = [k * Expression.angle(self.joint) for k in self.orders]
        return tuple(function for turn in turns for function in (turn.cos(), turn.sin()))

    def values(self, state: ArmState, out: FloatArray | None = None) -> FloatArray:
        """(2 n_orders, n) cosines and sines, in memory that may be given.

        By the addition theorems, straight into their rows: consecutive orders from one to two, from two to four and so
        on, by products instead of cosines and sines, to some 1e-14.
        """
        angle = of_joint(state.joint_angles, self.joint)
        out = np.empty((2 * len(self.orders), len(angle))) if out is None else out
        pairs, turns = out.reshape(len(self.orders), 2, len(angle)), _turns(angle, self.orders[-1].bit_length())
        for first, stop in self._runs:
            lowest, *others = (turn for bit, turn in enumerate(turns) if self.orders[first] >> bit & 1)
            pairs[first] = reduce(lambda pair, turn: np.einsum("am,bam->bm", pair, turn), others, lowest[:, 0])
            for bit in range((stop - first - 1).bit_length()):
                new = pairs[first + 2**bit : min(first + 2 * 2**bit, stop)]
                np.einsum("kam,bam->kbm", pairs[first : first + len(new)], turns[bit], out=new)
        return out

    @classmethod
    def together(cls, bases: Sequence[Self]) -> Callable[[ArmState], FloatArray]:
        """One cosine and sine of every joint and order; for many readings the addition theorems are faster."""
        pairs = [(basis.joint - 1, order) for basis in bases for order in basis.orders]
        row_of = {pair: row for row, pair in enumerate(dict.fromkeys(pairs))}
        rows = np.array([(row_of[pair], row_of[pair] + len(row_of)) for pair in pairs], dtype=np.intp).ravel()
        joints, orders = np.array(list(row_of), dtype=np.intp).T
        last, multiples = int(joints.max()) + 1, orders[:, None].astype(float)

        def values(state: ArmState) -> FloatArray:
            if last > state.angles.shape[1]:
                of_joint(state.angles, last)  # which refuses it
            return np.concatenate(cos_sin(multiples * state.joint_angles.T[joints]))[rows]

        return values

    @property
    def _runs(self) -> list[tuple[int, int]]:
        """First and last place (exclusive) of consecutive orders."""
        gaps = [i for i in range(1, len(self.orders)) if self.orders[i] != self.orders[i - 1] + 1]
        return list(pairwise([0, *gaps, len(self.orders)]))

    def joint_slope(self, weights: FloatArray) -> tuple[int, FloatArray]:
        """``(a cos kq + b sin kq)' = k b cos kq - k a sin kq``."""
        orders = np.array(self.orders, dtype=float)[:, None]
        out = np.empty_like(weights)
        out[::2], out[1::2] = orders * weights[1::2], -orders * weights[::2]
        return self.joint, out


@register_basis
@dataclass(frozen=True)
class Temperature(Basis):
    """Temperature of a link above 20 degC [K].

    Parameters
    ----------
    link : int
        0 is the stand, i the link that joint i moves. A single temperature of the state applies to every link.
    """

    link: JointOrBase = 0

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.temperature(self.link),)


@register_basis
@dataclass(frozen=True)
class Direction(Basis):
    """Sign of a joint's last movement: -1, 1, or 0 where it is unknown.

    Parameters
    ----------
    joint : int
        Counted from 1.
    """

    joint: JointNumber

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.direction(self.joint),)


@register_basis
@dataclass(frozen=True)
class InSession(Basis):
    """One at the readings of a session, zero at all others.

    Parameters
    ----------
    name : str
        The session's name in the session file.
    """

    name: Name

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.session(self.name),)


@register_basis
@dataclass(frozen=True)
class OfTip(Basis):
    """One at the readings of a tip, zero at all others, and where no tip is named.

    Parameters
    ----------
    name : str
        The tip's name in the session file.
    """

    name: Name

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.tip(self.name),)


@register_basis
@dataclass(frozen=True)
class Column(Basis):
    """A column of the session, in its own unit.

    Parameters
    ----------
    name : str
        The column's name in the session file.
    """

    name: Name

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.column(self.name),)


@register_basis
@dataclass(frozen=True)
class GravityTorque(Basis):
    """A component of the gravity torque at a joint by the masses outward of it, at the nominal pose [N m].

    Parameters
    ----------
    joint : int
        Counted from 1, along the axes of that joint's place; 0 is the torque of joint 1 on the base, along the axes of
        place 0, which do not rotate with joint 1.
    axis : int
        0, 1, 2 for x, y, z.
    """

    joint: JointOrBase
    axis: AxisNumber

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.gravity_torque(self.joint, self.axis),)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) torques, without the way through their expression."""
        return torque_about(state, state.gravity_torques, self.joint, self.axis)[None]

    @classmethod
    def together(cls, bases: Sequence[Self]) -> Callable[[ArmState], FloatArray]:
        """Torques of all joints from the loads at once."""
        places = np.array([3 * (basis.joint - 1) + basis.axis for basis in bases], dtype=np.intp)
        on_base = np.array([row for row, basis in enumerate(bases) if basis.joint == 0], dtype=np.intp)
        axes, last = [bases[row].axis for row in on_base], max(basis.joint for basis in bases)

        def values(state: ArmState) -> FloatArray:
            if last > state.angles.shape[1]:
                of_joint(state.angles, last)  # which refuses it
            found: FloatArray = state.gravity_torques.reshape(len(state), -1).T[places]
            if len(on_base):
                found[on_base] = torques_on_base(state, state.gravity_torques).T[axes]
            return found

        return values


@register_basis
@dataclass(frozen=True)
class PayloadTorque(Basis):
    """A component of the torque at a joint by the weight of a payload at the tip, at the nominal pose [N m].

    Parameters
    ----------
    joint : int
        As in `GravityTorque`.
    axis : int
        0, 1, 2 for x, y, z.
    from_kg : float
        The torque is that of the payload less this mass [kg].
    """

    joint: JointOrBase
    axis: AxisNumber
    from_kg: Number = 0.0

    def expressions(self) -> tuple[Expression, ...]:
        """One function."""
        return (Expression.payload_torque(self.joint, self.axis, self.from_kg),)


class _Form(NamedTuple):
    """A type of this module that a field has: a number or text between limits, or a tuple of such."""

    kind: type
    lowest: int
    highest: int
    each: _Form | None

    @classmethod
    def of(cls, annotated: Any) -> _Form:
        kind, about = get_args(annotated)
        lowest, highest = (0, 0) if kind is float else (dataclasses.astuple(limit)[0] for limit in about.metadata)
        return cls(kind, lowest, highest, cls.of(get_args(kind)[0]) if get_origin(kind) is tuple else None)

    def settled(self, field: str, value: object) -> Any:
        """The value of a field as a file can store it, checked."""
        lowest, highest = self.lowest, self.highest
        if self.each is not None:
            if not isinstance(value, tuple) or not lowest <= len(value) <= highest:
                raise InputError(f"expected a tuple of {field}, {lowest} to {highest} of them, got {_short(value)}")
            return tuple(self.each.settled(field, one) for one in value)
        value = plain(value)
        if self.kind is str:
            if not isinstance(value, str) or not lowest <= len(value) <= highest:
                raise InputError(f"expected a {field} as text of {lowest} to {highest} characters, got {_short(value)}")
            return value
        if self.kind is float:
            if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
                raise InputError(f"expected {field} as a finite number, got {_short(value)}")
            return float(value)
        if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= highest:
            raise InputError(f"expected {field} as whole numbers, {lowest} to {highest}, got {_short(value)}")
        return value


@cache
def _forms(basis: type[Basis]) -> dict[str, _Form]:
    """Types of this module that fields have, by name; a user's own class checks its other fields itself."""
    try:
        hints = get_type_hints(basis, include_extras=True)
    except NameError:  # of a user's own class, types that only its function knows
        return {}
    return {name: _Form.of(form) for name, form in hints.items() if any(form is one for one in _CHECKED)}


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _turns(angle: FloatArray, n: int) -> FloatArray:
    """Matrices (at least n, 2, 2, m) that turn pairs (cosine, sine) by 1, 2, 4, .. times angles (m,).

    By squares of complex numbers, each fifth afresh: errors double with each square.
    """
    powers = np.empty((-(-n // 5), min(n, 5), len(angle)), dtype=complex)
    powers[:, 0].real, powers[:, 0].imag = cos_sin(np.multiply.outer(32.0 ** np.arange(len(powers)), angle))
    for bit in range(1, powers.shape[1]):
        np.square(powers[:, bit - 1], out=powers[:, bit])
    turns = np.empty((powers.shape[0] * powers.shape[1], 2, 2, len(angle)))
    in_order = powers.reshape(len(turns), len(angle))
    turns[:, 0, 0] = turns[:, 1, 1] = in_order.real
    turns[:, 1, 0] = in_order.imag
    np.negative(in_order.imag, out=turns[:, 0, 1])
    return turns


def harmonics(angles: npt.ArrayLike, orders: Sequence[float]) -> FloatArray:
    """Cosine and sine of multiples of joint angles.

    Order 1 is the error of an encoder by an eccentric grating, order 2 by a tilted or oval disc, order 4 the remainder
    with four read heads; bearings cause orders 1 and 2. Orders need not be integers: a ball cage turns at about 0.4 of
    the shaft speed. Integer orders repeat after a full turn, others continue over several turns.

    Parameters
    ----------
    angles : (...) array
        [rad].
    orders : sequence of float
        The multiples k.

    Returns
    -------
    (..., n_orders, 2) array
        ``cos k q, sin k q`` for each order.
    """
    turns = np.asarray(angles, dtype=float)[..., None] * np.asarray(orders, dtype=float)
    return np.stack([np.cos(turns), np.sin(turns)], axis=-1)


def directions(angles: npt.ArrayLike) -> FloatArray:
    """Sign of each joint's last movement in a sequence of readings, (n, n_joints).

    A joint that does not move keeps its sign; before its first movement the sign is 0.
    """
    angles = np.asarray(angles, dtype=float)
    signs = np.sign(np.diff(angles, axis=0, prepend=angles[:1]))
    last_moved = np.where(signs != 0, np.arange(len(signs))[:, None], 0)
    return np.take_along_axis(signs, np.maximum.accumulate(last_moved, axis=0), axis=0)
