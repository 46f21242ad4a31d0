"""Sums of products of cosines and sines of whole multiples of angles, at the price of a Fourier transform.

With the functions phi = (cos k a, sin k a) of an angle a and psi = (cos l b, sin l b) of another, a block of normal
equations is ``sum_n w_n phi(n) psi(n)^T``. Its entries are the real and imaginary parts of

    F(k, l) = sum_n w_n exp(i (k a_n + l b_n)),

a two-dimensional non-uniform Fourier transform of the weights (type 1). The adjoint of it, of type 2, evaluates the
trigonometric polynomial ``phi(n)^T M psi(n)`` of a matrix M at all n. Of one angle, F depends on k + l alone, and the
transforms are one-dimensional. With K and L multiples and m values they cost ``m + K L log(K L)`` times constants,
where products of matrices cost ``m K L``.

Source: A. Dutt, V. Rokhlin, "Fast Fourier transforms for nonequispaced data", SIAM J. Sci. Comput. 14 (1993) 1368;
A. H. Barnett, J. F. Magland, L. af Klinteberg, "A parallel nonuniform fast Fourier transform library based on an
'exponential of semicircle' kernel", SIAM J. Sci. Comput. 41 (2019) C479.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from importlib.util import find_spec
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from truearm.typing import FloatArray, IntArray

# Error of a transform, relative to the root of the sum of the squares of its result.
TOLERANCE = 1e-15
# A grid is twice as fine as the multiples ask for, and a value is spread to so many of its points a dimension.
FINENESS, WIDTH = 2, 16
# Operations of a product of matrices in the time of one of a transform, whose memory is not used in order (Xeon, one
# thread: 45 and 6.5 GFLOP/s).
SLOWNESS = 7


class Multiples(NamedTuple):
    """The functions ``cos k1 a, sin k1 a, cos k2 a, sin k2 a, ...`` of an angle.

    Attributes
    ----------
    angles : (m,) array
        [rad].
    orders : (K,) int array
        The multiples: no two of them are the same.
    """

    angles: FloatArray
    orders: IntArray


@cache
def has_transforms() -> bool:
    """Whether finufft is installed: it has no wheels for Linux on ARM."""
    return find_spec("finufft") is not None


def is_cheaper(m: int, one: IntArray, other: IntArray | None = None) -> bool:
    """Whether a transform of m values costs less than products of matrices, for orders of two angles, or of one.

    By counted operations; where there are no transforms, products are the only way.
    """
    if not has_transforms():
        return False
    products = (4 if other is None else 8) * m * len(one) * len(one if other is None else other)
    return products > SLOWNESS * operations(m, one, other)


def operations(m: int, one: IntArray, other: IntArray | None = None) -> float:
    """Operations of a transform of m values, for orders of two angles, or of one with itself."""
    if other is None:
        grid, spread = FINENESS * 4 * int(one.max()), WIDTH
    else:
        grid, spread = FINENESS**2 * int(np.ptp(one) + 1) * (2 * int(other.max()) + 1), WIDTH**2
    return 5 * grid * math.log2(grid) + 4 * spread * m


def weighted_products(weights: FloatArray, one: Multiples, other: Multiples | None = None) -> FloatArray:
    """(2K, 2L) sums of the products of the functions of two angles, or of one with itself.

    Parameters
    ----------
    weights : (m,) array
    one, other : Multiples
        K and L of them.
    """
    if other is None:
        n = 2 * int(one.orders.max())
        sums = _transformed(1, (2 * n + 1,), [_wrapped(one.angles)], weights.astype(complex))
        sums = 0.5 * (sums + sums[::-1].conj())  # of real weights they differ by rounding: the result is symmetric
        k, orders = one.orders[:, None], one.orders
        plus, minus = sums[n + k + orders], sums[n + k - orders]
    else:
        first, size, last = int(one.orders.min()), int(np.ptp(one.orders)) + 1, int(other.orders.max())
        a, b = _wrapped(one.angles), _wrapped(other.angles)
        # Modes are about zero: the multiples of the first angle are moved there.
        turned = weights * np.exp(1j * (first + size // 2) * a)
        sums = _transformed(1, (size, 2 * last + 1), [a, b], turned)
        rows = sums[one.orders - first]
        plus, minus = rows[:, last + other.orders], rows[:, last - other.orders]
    out = np.empty((2 * plus.shape[0], 2 * plus.shape[1]))
    out[::2, ::2], out[1::2, 1::2] = plus.real + minus.real, minus.real - plus.real
    out[1::2, ::2], out[::2, 1::2] = plus.imag + minus.imag, plus.imag - minus.imag
    out *= 0.5
    return out


def bilinear_form(matrix: FloatArray, one: Multiples, other: Multiples | None = None) -> FloatArray:
    """(m,) values ``phi(n)^T M psi(n)`` of the functions of two angles, or of one with itself.

    Parameters
    ----------
    matrix : (2K, 2L) array
    one, other : Multiples
        K and L of them.
    """
    cosines, sines = matrix[::2], matrix[1::2]
    even, odd = cosines[:, ::2] - sines[:, 1::2], sines[:, ::2] + cosines[:, 1::2]
    plus = 0.5 * (even - 1j * odd)
    even, odd = cosines[:, ::2] + sines[:, 1::2], sines[:, ::2] - cosines[:, 1::2]
    minus = 0.5 * (even - 1j * odd)
    a = _wrapped(one.angles)
    if other is None:
        n = 2 * int(one.orders.max())
        k, orders = one.orders[:, None], one.orders
        where = np.concatenate([(n + k + orders).ravel(), (n + k - orders).ravel()])
        both = np.concatenate([plus.ravel(), minus.ravel()])
        modes = np.bincount(where, both.real, 2 * n + 1) + 1j * np.bincount(where, both.imag, 2 * n + 1)
        return np.asarray(_transformed(2, modes.shape, [a], modes).real)
    first, size, last = int(one.orders.min()), int(np.ptp(one.orders)) + 1, int(other.orders.max())
    modes = np.zeros((size, 2 * last + 1), dtype=complex)
    modes[np.ix_(one.orders - first, last + other.orders)] = plus
    modes[np.ix_(one.orders - first, last - other.orders)] = minus
    values = _transformed(2, modes.shape, [a, _wrapped(other.angles)], modes)
    return np.asarray((values * np.exp(1j * (first + size // 2) * a)).real)


def _transformed(
    kind: int, modes: tuple[int, ...], angles: list[FloatArray], given: npt.NDArray[np.complex128]
) -> npt.NDArray[np.complex128]:
    """The transform of type 1 or 2 between complex values at angles and multiples about zero."""
    plan = _plan(kind, modes, get_ident())
    plan.setpts(*angles)
    return np.asarray(plan.execute(given))


@lru_cache(maxsize=8)
def _plan(kind: int, modes: tuple[int, ...], thread: int) -> Any:  # noqa: ARG001 - a plan serves one thread
    """The plan of transforms of a shape: to make it takes as long as to sum a thousand values."""
    import finufft  # an import of milliseconds, which small models never need

    return finufft.Plan(kind, modes, eps=TOLERANCE, isign=1, nthreads=1)


def _wrapped(angles: FloatArray) -> FloatArray:
    """Angles of whole multiples, within half a turn."""
    return np.ascontiguousarray(angles - 2 * np.pi * np.round(angles / (2 * np.pi)))
