"""The sizes of the lengths of a test, in shares of the measuring range, as the plan asks for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from truearm.wings.laboratory.standards.verification_plan import LengthTest, Volumetric

# Sizes and shares are compared with the rounding of their arithmetic.
_ROUNDING = 1e-9


def length_fault(
    name: str, test: LengthTest | Volumetric, lengths_mm: Sequence[float], measuring_range_mm: float
) -> tuple[str, str] | None:
    """Return what is wrong with the sizes of a test's lengths, and what to do; None if they are as planned.

    Parameters
    ----------
    name : str
        Of the test.
    test : LengthTest or Volumetric
    lengths_mm : sequence of float
        The calibrated lengths [mm].
    measuring_range_mm : float
        Diameter of the spherical reach [mm].

    Returns
    -------
    (str, str) or None
        Problem and hint.
    """
    sizes = sorted(map(float, lengths_mm))
    for which, length_mm, key, share, is_least in _bounds(test, sizes):
        needed = share * measuring_range_mm
        if length_mm < needed * (1 - _ROUNDING) if is_least else length_mm > needed * (1 + _ROUNDING):
            side, bar = ("more", "longer") if is_least else ("less", "shorter")
            problem = (
                f"test {name!r}: the {which} length is {length_mm:.5g} mm, the plan asks for {needed:.5g} mm or "
                f"{side}, {100 * share:.3g}% of the measuring range"
            )
            return problem, f"use a {bar} bar, or correct {key} in the plan by your copy of the standard"
    if isinstance(test, LengthTest) and sizes[-1] > sizes[0]:
        widest, mean = max(b - a for a, b in pairwise(sizes)), (sizes[-1] - sizes[0]) / (len(sizes) - 1)
        if widest > test.gap_ratio.value * mean * (1 + _ROUNDING):
            problem = (
                f"test {name!r}: the widest gap between two of its {len(sizes)} lengths is {widest:.4g} mm, "
                f"{widest / mean:.2g} times the mean one; the plan asks for {test.gap_ratio.value:g} times or less"
            )
            return problem, "use lengths that lie evenly, or correct gap_ratio in the plan by your copy of the standard"
    return None


def _bounds(test: LengthTest | Volumetric, sizes: Sequence[float]) -> Iterator[tuple[str, float, str, float, bool]]:
    """Which length, its size [mm], the key of the share and its value, and whether that is the least size."""
    shortest, longest = sizes[0], sizes[-1]
    yield "longest", longest, "longest_share", test.longest_share.value, True
    if isinstance(test, Volumetric):
        yield "longest", longest, "longest_most_share", test.longest_most_share.value, False
    if len(sizes) > 1:  # a single length is the longest
        yield "shortest", shortest, "shortest_most_share", test.shortest_most_share.value, False
        if isinstance(test, Volumetric):
            yield "shortest", shortest, "shortest_share", test.shortest_share.value, True
