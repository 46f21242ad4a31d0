"""How far the constants of an arm are from those that it had, and from those of other arms of its type.

Both in combined standard uncertainties. Where an arm stands and which tip it has are no constants of the arm: base and
tip do not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist, median

from truearm.fleet.fit_task import FitRow

# Columns of the base and the tip; joints have those of Denavit and Hartenberg.
_SET_UP = frozenset({"x", "y", "z", "rx", "ry", "rz"})
# Arms of a type from which the scatter of a constant is stated.
LEAST_OF_TYPE = 5
# A normal distribution's standard deviation in median absolute deviations.
_MAD = 1.4826
# Share of the arms whose constants did not change that get a remark.
_FALSE_REMARKS = 0.001
# Constants that a remark names.
_NAMED = 3


@dataclass(frozen=True)
class TypeConstant:
    """A constant over the arms of a type: median, and a standard deviation that single arms do not move."""

    median: float
    std: float


@dataclass(frozen=True)
class ConstantDrift:
    """A constant of an arm, beside its own history and its type.

    Attributes
    ----------
    name, unit : str
    nominal, value : float or None
    u : float or None
        Standard uncertainty of the value.
    own : float or None
        Difference from that earlier model in force from which it is largest, in combined standard uncertainties.
    of_type : float or None
        Difference from the median of its type, in units of ``sqrt(std^2 + u^2)``.
    """

    name: str
    unit: str
    nominal: float | None
    value: float | None
    u: float | None
    own: float | None
    of_type: float | None


def type_constants(models: Iterable[FitRow]) -> dict[str, dict[str, TypeConstant]]:
    """The constants of every type with enough arms, by type and name.

    Parameters
    ----------
    models : iterable of FitRow
        In force, one of each arm.
    """
    values: dict[tuple[str, str], list[float]] = {}
    for row in models:
        for name, (value, _) in _joints(row).items():
            values.setdefault((row.arm, name), []).append(value)
    found: dict[str, dict[str, TypeConstant]] = {}
    for (arm, name), of_arms in values.items():
        if len(of_arms) >= LEAST_OF_TYPE:
            middle = median(of_arms)
            std = _MAD * median(abs(value - middle) for value in of_arms)
            found.setdefault(arm, {})[name] = TypeConstant(middle, std)
    return found


def constant_drifts(models: Sequence[FitRow], of_type: Mapping[str, TypeConstant]) -> list[ConstantDrift]:
    """The constants of the last of an arm's models in force.

    Parameters
    ----------
    models : sequence of FitRow
        One or more, the last one last.
    of_type : mapping of str to TypeConstant
        Of its type, see `type_constants`.
    """
    joints, earlier = _joints(models[-1]), [_joints(row) for row in models[:-1]]
    found = []
    for one in models[-1].constants:
        own = type_wise = None
        if (name := one["name"]) in joints:
            value, u = joints[name]
            before = [(value - was, (u**2 + u_was**2) ** 0.5) for was, u_was in (e[name] for e in earlier if name in e)]
            own = max((shift / scale for shift, scale in before), key=abs, default=None)
            if (typical := of_type.get(name)) is not None:
                type_wise = (value - typical.median) / (typical.std**2 + u**2) ** 0.5
        found.append(ConstantDrift(name, one["unit"], one["nominal"], one["value"], one["u"], own, type_wise))
    return found


def drift_remark(models: Sequence[FitRow]) -> str:
    """Which constants changed since the last model of other readings by more than chance explains, worst first.

    The limit is that which one of a thousand unchanged arms exceeds, by the normal distribution and the number of its
    constants (Bonferroni): 4.0 u of 18 constants.

    Parameters
    ----------
    models : sequence of FitRow
        That were in force, one or more, the last one last.

    Returns
    -------
    str
        Empty if there are none.
    """
    before = [row for row in models[:-1] if row.session_sha256 != models[-1].session_sha256][-1:]
    drifts = {one.name: one.own for one in constant_drifts([*before, models[-1]], {}) if one.own is not None}
    limit = NormalDist().inv_cdf(1 - _FALSE_REMARKS / (2 * max(len(drifts), 1)))
    worst = sorted((-abs(own), name) for name, own in drifts.items() if abs(own) > limit)
    if not worst:
        return ""
    named = ", ".join(f"{name} by {-minus:.1f} u" for minus, name in worst[:_NAMED])
    more = f" and {len(worst) - _NAMED} more" if len(worst) > _NAMED else ""
    return f"changed since the model before: {named}{more} (limit {limit:.1f} u)"


def _joints(row: FitRow) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty of the constants of the joints that a model identified."""
    return {
        one["name"]: (one["value"], one["u"])
        for one in row.constants
        if one["name"].rpartition(" ")[2] not in _SET_UP and one["value"] is not None and one["u"]
    }
