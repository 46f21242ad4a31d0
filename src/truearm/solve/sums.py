"""Figures that are sums over parts of a session: records that are added field by field, in the order of the parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

import numpy as np

from truearm.typing import FloatArray

T = TypeVar("T")

_JOINED = "joined"
# What parts say that is kept.
MAX_KEPT = 6


def joined(by: Callable[[Any, Any], Any]) -> dict[str, Any]:
    """Metadata of a field of `Sums` that is no sum: a function of both values joins them, such as the larger one."""
    return {_JOINED: by}


def one_below_the_other(a: FloatArray, b: FloatArray) -> FloatArray:
    """The rows of both arrays."""
    return np.concatenate([a, b])


def different(a: tuple[T, ...], b: tuple[T, ...]) -> tuple[T, ...]:
    """What parts say, once each."""
    return tuple(dict.fromkeys((*a, *b)))


def first_different(a: tuple[T, ...], b: tuple[T, ...]) -> tuple[T, ...]:
    """The first different of what parts say, `MAX_KEPT` of them."""
    return different(a, b)[:MAX_KEPT]


@dataclass(frozen=True, eq=False)
class Sums:
    """Base of dataclasses whose fields are sums: numbers, arrays, such records, or all of these by name."""

    def __add__(self, other: Self) -> Self:
        """Figures of both."""
        return type(self)(
            **{
                one.name: one.metadata.get(_JOINED, _added)(getattr(self, one.name), getattr(other, one.name))
                for one in fields(self)
            }
        )


def _added(a: Any, b: Any) -> Any:
    if not isinstance(a, Mapping):
        return a + b
    return {**a, **{name: a[name] + value if name in a else value for name, value in b.items()}}
