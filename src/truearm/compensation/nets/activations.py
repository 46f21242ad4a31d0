"""Activation functions under MATLAB's names; derivatives come from the value, as a network has it at hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from array_api_compat import array_namespace

from truearm.solve.arrays import Array


@dataclass(frozen=True)
class Activation:
    """An activation function.

    Attributes
    ----------
    value : callable
        Of the net input.
    derivative : callable
        By the net input, computed from the value.
    net_range : (float, float) or None
        Net inputs where the function is not saturated (Nguyen-Widrow); None for a linear function.
    output_range : (float, float) or None
        Values it can take; None for all.
    """

    value: Callable[[Array], Array]
    derivative: Callable[[Array], Array]
    net_range: tuple[float, float] | None
    output_range: tuple[float, float] | None


def _tanh(net: Array) -> Array:
    return array_namespace(net).tanh(net)


def _logistic(net: Array) -> Array:
    # Through tanh: no overflow for large negative net inputs.
    return 0.5 + 0.5 * _tanh(0.5 * net)


ACTIVATIONS: dict[str, Activation] = {
    "tansig": Activation(_tanh, lambda a: 1 - a * a, (-2.0, 2.0), (-1.0, 1.0)),
    "logsig": Activation(_logistic, lambda a: a * (1 - a), (-4.0, 4.0), (0.0, 1.0)),
    "purelin": Activation(lambda net: net, lambda a: array_namespace(a).ones_like(a), None, None),
}
