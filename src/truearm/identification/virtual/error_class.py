"""Classes of errors: terms, and the random numbers that their coefficients take."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import factorial2

from truearm.identification.terms import Term
from truearm.identification.virtual.state import random_stream
from truearm.typing import FloatArray, IntArray


class DrawnTerm(NamedTuple):
    """A term, which numbers of a stream its coefficients take, and their mean and standard deviation."""

    term: Term
    numbers: tuple[int, ...]
    mean: float = 0.0
    std: float | None = None  # by default the term's


@dataclass(frozen=True, eq=False)
class ErrorClass:
    """Terms whose coefficients take the normal random numbers z of one stream: ``(mean + std t) exp(log_std z)``.

    Here ``t = z^power`` over its standard deviation, power odd: with 1 the coefficients are normal; with 3 most are
    small and a few are large, as damage is.
    """

    stream: str
    rows: tuple[DrawnTerm, ...]
    n_numbers: int
    log_std: float = 0.0
    power: int = 1

    def draw(self, seed: int) -> FloatArray:
        """Draw the coefficients of all terms."""
        if not self.rows:
            return np.zeros(0)
        z = random_stream("arm", seed, self.stream).standard_normal(self.n_numbers)[self._index]
        t = z**self.power / np.sqrt(factorial2(2 * self.power - 1))
        coefficients: FloatArray = (self._mean + self._std * t) * np.exp(self.log_std * z)
        return coefficients

    @cached_property
    def _index(self) -> IntArray:
        return np.concatenate([row.numbers for row in self.rows]).astype(np.intp)

    @cached_property
    def _mean(self) -> FloatArray:
        return np.concatenate([np.full(len(row.numbers), row.mean) for row in self.rows])

    @cached_property
    def _std(self) -> FloatArray:
        stds = [row.term.prior_std if row.std is None else row.std for row in self.rows]
        return np.concatenate([np.full(len(row.numbers), std) for row, std in zip(self.rows, stds, strict=True)])
