"""Expressions: functions of the state of an arm by a closed set of operations, which every export can write.

What a basis function is, is said once as an expression. The exports of a whole model follow from it; evaluation may be
a faster form of the same, and a test holds the two equal.
"""

from __future__ import annotations

import math
import operator
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any, NamedTuple, Self

import numpy as np

from truearm.errors import InputError
from truearm.identification.terms.state import ArmState
from truearm.readings.readings import PAYLOAD
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray, NameArray

AXES = "xyz"
MOST_JOINTS = 100
MOST_PARTS, DEEPEST = 1000, 30
MOST_PARTS_TOGETHER = 100_000
"""Parts of all expressions of a model: they are evaluated at a thousand readings within seconds."""
HIGHEST_POWER = 12
HIGHEST_ORDER = 1000
"""Harmonics of higher order have periods of less than 0.36 deg, which no session samples."""


class Input(NamedTuple):
    """An input of expressions: checks of its arguments, its name, its values, and whether readings may lack it."""

    arguments: tuple[Callable[[object], bool], ...]
    name: str
    values: Callable[..., FloatArray]
    is_stated: bool


class Operation(NamedTuple):
    """An operation of expressions: whether arguments are its own, and its result of arrays or of expressions."""

    fits: Callable[..., bool]
    apply: Callable[..., Any]


def of_joint(by_joint: FloatArray, joint: int) -> FloatArray:
    """Column of a joint counted from 1, contiguous."""
    if joint > by_joint.shape[1]:
        raise InputError(f"expected a joint from 1 to {by_joint.shape[1]}, got {joint}")
    return np.ascontiguousarray(by_joint[:, joint - 1])


def torque_about(state: ArmState, torques: FloatArray, joint: int, axis: int) -> FloatArray:
    """(n,) torque about an axis of a joint's place; joint 0: of joint 1 on the base, about the axes of place 0."""
    if joint > 0:
        of_joint(state.angles, joint)  # which refuses a joint beyond the last
        return np.ascontiguousarray(torques[:, joint - 1, axis])
    return np.ascontiguousarray(torques_on_base(state, torques)[:, axis])


def torques_on_base(state: ArmState, torques: FloatArray) -> FloatArray:
    """(n, 3) torques of joint 1 on the base, about the axes of place 0."""
    on_base = torques[:, 0].copy()
    if not state.chain.is_prismatic[0]:
        turn, x, y = state.joint_angles[:, 0], torques[:, 0, 0], torques[:, 0, 1]
        cos, sin = np.cos(turn), np.sin(turn)
        on_base[:, 0], on_base[:, 1] = cos * x - sin * y, sin * x + cos * y
    return on_base


def _payload_torque(state: ArmState, joint: int, axis: int, from_kg: float) -> FloatArray:
    if PAYLOAD not in state.columns:
        raise InputError("expected readings with a payload, got none", column=PAYLOAD)
    per_kg = torque_about(state, state.loads_per_kg.torque_in_joint, joint, axis)
    return np.asarray((state.columns[PAYLOAD] - from_kg) * per_kg)


def _temperature(state: ArmState, link: int) -> FloatArray:
    temperature = state.temperature_degC
    if temperature is None:
        raise InputError("expected readings with a temperature, got none", column="temperature_degC")
    if link > state.chain.n_joints:
        raise InputError(f"expected a link from 0 to {state.chain.n_joints}, got {link}")
    return np.asarray((temperature if temperature.ndim == 1 else temperature[:, link]) - REFERENCE_DEGC)


def _direction(state: ArmState, joint: int) -> FloatArray:
    if state.directions is None:
        raise InputError("expected readings with directions of movement, got none")
    return of_joint(state.directions, joint)


def _column(state: ArmState, name: str) -> FloatArray:
    if name not in state.columns:
        raise InputError(
            f"expected readings with a column {name!r}, got {sorted(state.columns) or 'none'}", column=name
        )
    return np.ascontiguousarray(state.columns[name])


def _is_of(names: NameArray | None, name: str, n: int) -> FloatArray:
    return np.zeros(n) if names is None else (names == name).astype(float)


def _whole(lowest: int, highest: int) -> Callable[[object], bool]:
    return lambda value: type(value) is int and lowest <= value <= highest


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 1000


def _are_several(*of: object) -> bool:
    return len(of) > 1 and all(isinstance(one, Expression) for one in of)


def _is_one(*of: object) -> bool:
    return len(of) == 1 and isinstance(of[0], Expression)


_JOINT, _PLACE, _AXIS, _POWER = _whole(1, MOST_JOINTS), _whole(0, MOST_JOINTS), _whole(0, 2), _whole(2, HIGHEST_POWER)
INPUTS: Mapping[str, Input] = {
    "angle": Input((_JOINT,), "q{0}", lambda state, joint: of_joint(state.joint_angles, joint), False),
    "gravity torque": Input(
        (_PLACE, _AXIS),
        "gravity torque about {axis} of {place}",
        lambda state, *at: torque_about(state, state.gravity_torques, *at),
        False,
    ),
    "payload torque": Input(
        (_PLACE, _AXIS, _is_number), "torque of the payload{above} about {axis} of {place}", _payload_torque, True
    ),
    "temperature": Input((_PLACE,), "temperature of {link} above 20 degC", _temperature, True),
    "direction": Input((_JOINT,), "direction of J{0}", _direction, True),
    "column": Input((_is_name,), "{0}", _column, True),
    "session": Input((_is_name,), "session {0}", lambda state, name: _is_of(state.session, name, len(state)), False),
    "tip": Input((_is_name,), "tip {0}", lambda state, name: _is_of(state.tip, name, len(state)), False),
}
OPERATIONS: Mapping[str, Operation] = {
    "sum": Operation(_are_several, lambda *of: _sum(of) if _are_several(*of) else reduce(operator.add, of)),
    "product": Operation(_are_several, lambda *of: _product(of) if _are_several(*of) else reduce(operator.mul, of)),
    "power": Operation(lambda *of: _is_one(*of[:1]) and len(of) == 2 and _POWER(of[1]), operator.pow),
    # NumPy calls the methods of the same names of what is no array.
    "cos": Operation(_is_one, np.cos),
    "sin": Operation(_is_one, np.sin),
}


@dataclass(frozen=True)
class Expression:
    """A function of the state of an arm: an input, or an operation on other expressions.

    Expressions are added, subtracted and multiplied with each other and with numbers, and raised to whole powers. As
    the basis of a `Term` an expression is a cause of error that is identified, saved and exported as any other.

    Parameters
    ----------
    operation : str
        An input of `INPUTS`, or one of `OPERATIONS`.
    arguments : tuple
        What the input is of, the number, or expressions; of a power the base and the exponent.

    Raises
    ------
    InputError
        If the operation is unknown, or the arguments are not its own.

    Examples
    --------
    >>> import truearm as ta
    >>> q3 = ta.Expression.angle(3)
    >>> print((2 * q3).cos() + q3**2)
    cos(2 * q3) + q3^2
    """

    operation: str
    arguments: tuple[Any, ...]

    def __post_init__(self) -> None:
        of: object = self.arguments
        kind = self.operation if isinstance(self.operation, str) else ""
        if isinstance(of, list | tuple):
            of = tuple(map(plain, of))
            object.__setattr__(self, "arguments", of)
        if not isinstance(of, tuple):
            fits = False
        elif kind in INPUTS:
            checks = INPUTS[kind].arguments
            fits = len(of) == len(checks) and all(check(one) for check, one in zip(checks, of, strict=True))
        elif kind in OPERATIONS:
            fits = OPERATIONS[kind].fits(*of)
        else:
            fits = kind == "number" and len(of) == 1 and _is_number(of[0])
        if not fits:
            raise InputError(
                f"expected an expression among {', '.join([*INPUTS, *OPERATIONS])} with its arguments, "
                f"got {reprlib.repr(kind):.40} of {reprlib.repr(of):.60}",
                hint=f"joints are whole from 1, axes 0, 1 or 2, powers whole from 2 to {HIGHEST_POWER}, numbers finite",
            )
        if self.n_parts > MOST_PARTS or self._depth > DEEPEST:
            raise InputError(f"expected an expression of at most {MOST_PARTS} parts, {DEEPEST} deep")

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: an input is among its own `inputs`, a set that no other process could fill before it."""
        return {"operation": self.operation, "arguments": self.arguments}

    # Inputs ----------------------------------------------------------------------------------------------------------

    @classmethod
    def number(cls, value: float) -> Self:
        """A number, the same at every reading."""
        return cls("number", (value,))

    @classmethod
    def angle(cls, joint: int) -> Self:
        """Angle of a joint counted from 1 [rad]; of a sliding one its displacement [mm]."""
        return cls("angle", (joint,))

    @classmethod
    def gravity_torque(cls, joint: int, axis: int) -> Self:
        """Gravity torque at a joint about an axis (0, 1, 2) of its place [N m]; joint 0 is the base."""
        return cls("gravity torque", (joint, axis))

    @classmethod
    def payload_torque(cls, joint: int, axis: int, from_kg: float = 0.0) -> Self:
        """Torque by the weight of a payload less a mass [kg], otherwise as `gravity_torque`."""
        return cls("payload torque", (joint, axis, from_kg))

    @classmethod
    def temperature(cls, link: int = 0) -> Self:
        """Temperature of a link above 20 degC [K]; 0 is the stand."""
        return cls("temperature", (link,))

    @classmethod
    def direction(cls, joint: int) -> Self:
        """Sign of a joint's last movement."""
        return cls("direction", (joint,))

    @classmethod
    def column(cls, name: str) -> Self:
        """A column of the session, in its own unit."""
        return cls("column", (name,))

    @classmethod
    def session(cls, name: str) -> Self:
        """One at the readings of a session, zero at all others."""
        return cls("session", (name,))

    @classmethod
    def tip(cls, name: str) -> Self:
        """One at the readings of a tip, zero at all others."""
        return cls("tip", (name,))

    # Operations ------------------------------------------------------------------------------------------------------

    def cos(self) -> Expression:
        """Cosine."""
        return Expression("cos", (self,)) if self.value is None else Expression.number(math.cos(self.value))

    def sin(self) -> Expression:
        """Sine."""
        return Expression("sin", (self,)) if self.value is None else Expression.number(math.sin(self.value))

    def __pow__(self, exponent: int) -> Expression:
        if self.value is not None:
            return _folded(operator.pow, self.value, plain(exponent))
        return self if exponent == 1 else Expression("power", (self, exponent))

    def __add__(self, other: Expression | float) -> Expression:
        return _sum((self, _expression(other)))

    def __mul__(self, other: Expression | float) -> Expression:
        return _product((self, _expression(other)))

    def __neg__(self) -> Expression:
        return self * -1

    def __sub__(self, other: Expression | float) -> Expression:
        return self + -_expression(other)

    def __rsub__(self, other: float) -> Expression:
        return -self + other

    def __truediv__(self, other: float) -> Expression:
        return self * (1 / other)

    __radd__, __rmul__ = __add__, __mul__

    # What it is ------------------------------------------------------------------------------------------------------

    @property
    def value(self) -> float | None:
        """The number that it is; None if it is none."""
        return self.arguments[0] if self.operation == "number" else None

    @cached_property
    def inputs(self) -> frozenset[Expression]:
        """The inputs in it."""
        if self.operation in INPUTS:
            return frozenset([self])
        return frozenset().union(*(one.inputs for one in self._expressions))

    @property
    def harmonic(self) -> tuple[int, int] | None:
        """Joint and order k, to `HIGHEST_ORDER`, of ``cos k q`` or ``sin k q``; None of anything else."""
        if self.operation not in ("cos", "sin"):
            return None
        factor, of = 1.0, self.arguments[0]
        if of.operation == "product" and len(of.arguments) == 2 and of.arguments[0].value is not None:
            factor, of = of.arguments[0].value, of.arguments[1]
        is_order = factor == int(factor) and 1 <= factor <= HIGHEST_ORDER
        return (of.arguments[0], int(factor)) if of.operation == "angle" and is_order else None

    def values(self, state: ArmState) -> FloatArray:
        """(n,) values at a state.

        Raises
        ------
        InputError
            If the state lacks an input.
        """

        def value(one: Expression) -> FloatArray:
            if one.value is not None:
                return np.full(len(state), float(one.value))
            return INPUTS[one.operation].values(state, *one.arguments)

        return np.asarray(self._by_parts(value))

    def with_inputs(self, values: Mapping[str | Expression, float]) -> Expression:
        """The expression with numbers for some inputs, or for all inputs of some kinds."""

        def replaced(one: Expression) -> Expression:
            value = values.get(one, values.get(one.operation))
            return one if value is None else Expression.number(value)

        found: Expression = self._by_parts(replaced)
        return found

    def _by_parts(self, of_part: Callable[[Expression], Any]) -> Any:
        """The operations on what a function gives for inputs and numbers."""
        if self.operation not in OPERATIONS:
            return of_part(self)
        parts = (one._by_parts(of_part) if isinstance(one, Expression) else one for one in self.arguments)
        return OPERATIONS[self.operation].apply(*parts)

    def as_data(self) -> Any:
        """The expression as plain data: a number, or a list of the operation and its arguments."""
        if self.operation == "number":
            return self.arguments[0]
        return [self.operation, *(one.as_data() if isinstance(one, Expression) else one for one in self.arguments)]

    @classmethod
    def from_data(cls, data: object, _depth: int = 0) -> Expression:
        """Create an expression from the data of `as_data`.

        Raises
        ------
        InputError
            If it is none.
        """
        if isinstance(data, int | float):
            return cls("number", (data,))
        if not isinstance(data, list | tuple) or not data or _depth > DEEPEST:
            raise InputError(f"expected an expression as a number or a list, got {reprlib.repr(data):.60}")
        kind, *arguments = data
        if isinstance(kind, str) and kind in OPERATIONS:
            n_expressions = 1 if kind == "power" else len(arguments)
            arguments[:n_expressions] = [cls.from_data(one, _depth + 1) for one in arguments[:n_expressions]]
        return cls(kind, tuple(arguments))

    def __str__(self) -> str:
        of = self.arguments
        if self.operation in INPUTS:
            words = {"place": f"J{of[0]}" if of[0] else "the base", "link": f"link {of[0]}" if of[0] else "the stand"}
            words |= {
                "axis": AXES[of[1]] if len(of) > 1 else "",
                "above": f" above {of[2]:g} kg" if any(of[2:]) else "",
            }
            return INPUTS[self.operation].name.format(*of, **words)
        match self.operation:
            case "number":
                return f"{of[0]:.6g}"
            case "sum":
                return " + ".join(map(str, of))
            case "product":
                return " * ".join(f"({one})" if one.operation == "sum" else str(one) for one in of)
            case "power":
                return f"{of[0]}^{of[1]}" if of[0].operation in ("angle", "cos", "sin") else f"({of[0]})^{of[1]}"
        return f"{self.operation}({of[0]})"

    @cached_property
    def n_parts(self) -> int:
        """Number of inputs, numbers and operations in it."""
        return 1 + sum(one.n_parts for one in self._expressions)

    @cached_property
    def _depth(self) -> int:
        return 1 + max((one._depth for one in self._expressions), default=0)

    @property
    def _expressions(self) -> tuple[Expression, ...]:
        return tuple(one for one in self.arguments if isinstance(one, Expression))


def _expression(value: Expression | float) -> Expression:
    return value if isinstance(value, Expression) else Expression.number(value)


def _sum(of: Sequence[Expression]) -> Expression:
    numbers, others = _parts("sum", of)
    total = _folded(lambda *values: sum(values), *numbers)
    return _joined("sum", others + [total] * (total.value != 0 or not others))


def _product(of: Sequence[Expression]) -> Expression:
    numbers, others = _parts("product", of)
    factor = _folded(lambda *values: math.prod(values), *numbers)
    if factor.value == 0:
        return Expression.number(0)
    return _joined("product", [factor] * (factor.value != 1 or not others) + others)


def _parts(operation: str, of: Sequence[Expression]) -> tuple[list[float], list[Expression]]:
    """Numbers and other expressions in sums, or in products."""
    parts = [part for one in of for part in (one.arguments if one.operation == operation else (one,))]
    return [part.value for part in parts if part.value is not None], [part for part in parts if part.value is None]


def _joined(operation: str, parts: list[Expression]) -> Expression:
    return parts[0] if len(parts) == 1 else Expression(operation, tuple(parts))


def _folded(operation: Callable[..., Any], *numbers: float) -> Expression:
    try:
        return Expression.number(operation(*numbers))
    except ArithmeticError:  # too large, or a power of zero
        raise InputError(
            f"expected numbers with a finite result in an expression, got {reprlib.repr(numbers):.60}"
        ) from None


def plain(value: object) -> Any:
    """A NumPy scalar as a Python number, which a file can store; other values unchanged."""
    return value.item() if isinstance(value, np.generic) else value
