"""Results of a standard's tests relative to their limits, to first order in the errors of the points.

Errors of an arm are small: a least-squares sphere and a length are then linear in them, and many arms are judged by a
few matrix products.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truearm.typing import FloatArray, IntArray
from truearm.verification.shapes.circumscribed_sphere import circumscribed_sphere
from truearm.verification.standards.layout import Placement
from truearm.verification.standards.specification import Specification

# From errors (n, 3) [mm] in the poses of the tests to results over their limits, by symbol.
Judge = Callable[[FloatArray], dict[str, float]]


@dataclass(frozen=True, eq=False)
class FirstOrderResults:
    """Test results relative to the limits of a specification.

    Parameters
    ----------
    specification : Specification
    placements : tuple of Placement
        Of all tests.
    """

    specification: Specification
    placements: tuple[Placement, ...]

    def __call__(self, errors: FloatArray) -> dict[str, float]:
        """Results over their limits by symbol, of errors (n, 3) [mm] in the poses of the tests."""
        results: dict[str, float] = {}
        for judge in self._judges:
            results |= judge(errors)
        return {symbol: results[symbol] for symbol in self.specification.limits}

    @cached_property
    def _judges(self) -> list[Judge]:
        """One per test."""
        starts = np.concatenate([[0], np.cumsum([len(one.points) for one in self.placements])])
        by_test: dict[str, list[tuple[Placement, slice]]] = defaultdict(list)
        for i, one in enumerate(self.placements):
            by_test[one.test].append((one, slice(int(starts[i]), int(starts[i + 1]))))
        makers: dict[str, Callable[[list[tuple[Placement, slice]]], Judge]] = {
            "probing": self._probing,
            "effective_diameter": self._effective_diameter,
            "articulation": self._articulation,
            "uni": self._lengths,
            "single_point": self._single_point,
            "volumetric": self._volumetric,
        }
        return [makers[test](placed) for test, placed in by_test.items()]

    def _over(self, symbol: str, value: float) -> float:
        limit = self.specification.limit(symbol)
        return np.inf if limit is None else value / limit

    def _over_limits(self, values: dict[str, float]) -> dict[str, float]:
        """Values that have a limit, over their limit."""
        return {s: self._over(s, value) for s, value in values.items() if s in self.specification.limits}

    def _probing(self, placed: list[tuple[Placement, slice]]) -> Judge:
        spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]

        def judge(errors: FloatArray) -> dict[str, float]:
            size = max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres)
            form = max(sphere.form(errors[rows]) for sphere, rows in spheres)
            return self._over_limits({"P_Size.Sph.1x25": size, "P_Form.Sph.1x25": form})

        return judge

    def _effective_diameter(self, placed: list[tuple[Placement, slice]]) -> Judge:
        spheres = [(_SphereErrors.of(one), rows) for one, rows in placed]
        return lambda errors: self._over_limits(
            {"EffectiveDiameter": max(2 * abs(sphere.radius(errors[rows])) for sphere, rows in spheres)}
        )

    def _articulation(self, placed: list[tuple[Placement, slice]]) -> Judge:
        at: dict[str, list[tuple[_SphereErrors, slice]]] = defaultdict(list)
        for one, rows in placed:
            at[one.keys["position"]].append((_SphereErrors.of(one), rows))

        def judge(errors: FloatArray) -> dict[str, float]:
            centres = [np.stack([sphere.centre(errors[rows]) for sphere, rows in groups]) for groups in at.values()]
            return {"L_Dia.5x5": self._over("L_Dia.5x5", max(2 * circumscribed_sphere(c).radius_mm for c in centres))}

        return judge

    def _lengths(self, placed: list[tuple[Placement, slice]]) -> Judge:
        bars = _Bars.of(placed)
        limits = {
            symbol: np.array([self.specification.limit(symbol, length) for length in bars.lengths_mm], dtype=float)
            for symbol in ("E_Uni", "E_Bi")
            if symbol in self.specification.limits
        }

        def judge(errors: FloatArray) -> dict[str, float]:
            sizes = np.abs(bars.deviations(errors))
            return {symbol: float((sizes / limit).max()) for symbol, limit in limits.items()}

        return judge

    def _single_point(self, placed: list[tuple[Placement, slice]]) -> Judge:
        def judge(errors: FloatArray) -> dict[str, float]:
            away = [errors[rows] - errors[rows].mean(axis=0) for _, rows in placed]
            squares = [(off**2).sum(axis=1) for off in away]
            return self._over_limits(
                {
                    "SPAT.Max": max(float(np.sqrt(s.max())) for s in squares),
                    "SPAT.2s": max(2 * float(np.sqrt(s.sum() / (len(s) - 1))) for s in squares),
                }
            )

        return judge

    def _volumetric(self, placed: list[tuple[Placement, slice]]) -> Judge:
        bars = _Bars.of(placed)

        def judge(errors: FloatArray) -> dict[str, float]:
            off = bars.deviations(errors)
            return self._over_limits(
                {
                    "Volumetric.Max": float(np.abs(off).max()),
                    "Volumetric.2s": 2 * float(off.std(ddof=1)),
                    "Volumetric.2RMS": 2 * float(np.sqrt((off**2).mean())),
                }
            )

        return judge


@dataclass(frozen=True, eq=False)
class _SphereErrors:
    """A least-squares sphere to first order: errors along the normals are ``n . dc + dr`` and residuals.

    Attributes
    ----------
    normals : (k, 3) array
    to_parameters : (4, k) array
        From errors along the normals to those of the centre and the radius.
    """

    normals: FloatArray
    to_parameters: FloatArray

    @classmethod
    def of(cls, placement: Placement) -> _SphereErrors:
        normals = placement.normals
        return cls(normals, np.linalg.pinv(np.column_stack([normals, np.ones(len(normals))])))

    def _along(self, errors: FloatArray) -> FloatArray:
        along: FloatArray = np.einsum("kc,kc->k", self.normals, errors)
        return along

    def centre(self, errors: FloatArray) -> FloatArray:
        return self.to_parameters[:3] @ self._along(errors)

    def radius(self, errors: FloatArray) -> float:
        return float(self.to_parameters[3] @ self._along(errors))

    def form(self, errors: FloatArray) -> float:
        along = self._along(errors)
        parameters = self.to_parameters @ along
        return float(np.ptp(along - self.normals @ parameters[:3]))


@dataclass(frozen=True, eq=False)
class _Bars:
    """Lengths between two ends, to first order: the difference of the errors of the ends along the length.

    Attributes
    ----------
    ends : (m, 2) array of int
        Rows of the two ends; one point each.
    along : (m, 3) array
        Unit vectors from the first end to the second.
    lengths_mm : (m,) array
    """

    ends: IntArray
    along: FloatArray
    lengths_mm: FloatArray

    @classmethod
    def of(cls, placed: Iterable[tuple[Placement, slice]]) -> _Bars:
        ends: dict[tuple[str, ...], dict[str, tuple[Placement, slice]]] = defaultdict(dict)
        for one, rows in placed:
            run = tuple(value for key, value in one.keys.items() if key != "end")
            ends[run][one.keys["end"]] = one, rows
        pairs = [(both["A"], both["B"]) for both in ends.values()]
        away = np.array([b.at - a.at for (a, _), (b, _) in pairs])
        lengths = np.linalg.norm(away, axis=1)
        first = np.array([[a.start, b.start] for (_, a), (_, b) in pairs], dtype=np.intp)
        return cls(first, away / lengths[:, None], lengths)

    def deviations(self, errors: FloatArray) -> FloatArray:
        """Measured minus true lengths (m,) [mm]."""
        deviations: FloatArray = np.einsum("mc,mc->m", self.along, errors[self.ends[:, 1]] - errors[self.ends[:, 0]])
        return deviations
