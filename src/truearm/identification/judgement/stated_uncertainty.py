"""Whether stated uncertainties of reference points agree with their scatter about the identified arm.

The ratio of both is one over the root of the reduced chi-square (the Birge ratio, R. T. Birge, Phys. Rev. 40 (1932)
207), computed from the median of the residuals' lengths, so that outliers do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from truearm.findings import Finding
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_variance import LEAST_FREEDOM
from truearm.identification.references.prepared_readings import PreparedReadings, tip_motion_mm
from truearm.identification.references.references import Points, Reference
from truearm.readings.readings import Measurements
from truearm.solve.distributions import chi2_quantile
from truearm.typing import FloatArray

# Stated uncertainties that are as many times the scatter are refused: micrometres entered as mm, to a factor of `NEAR`.
# Below, a careful person may have stated a bound: that is said.
MAX_RATIO = 200.0
# Ratio from which a person is asked. Scatter contains all of u: a ratio above 1 is a stated u that is too large.
SUSPECT_RATIO = 3.0
# Scatter in multiples of the stated uncertainty from which a unit is suspected: arms that move scatter by up to some
# fifty times the uncertainty of a laser tracker.
MOST_SCATTER = 200.0
# An identification without stated uncertainties is tried where the nominal arm already misses by less than this
# multiple of them: it never does where they are right, unless there is nothing to identify.
SUSPECT_NOMINAL = 2.0
# Share of their largest spread that points have along an axis at least, to show a scatter along it.
LEAST_SPREAD = 0.01
# What ratios near these mean: the scatter also contains what the arm does, so that they may be smaller by a factor;
# larger they are by the error of a scatter alone.
MISTAKES = {1e3: ", as if micrometres were entered as mm", 1e-3: ", as if it were entered in metres"}
NEAR, ABOVE = 5.0, 1.5


def stated_ratio(fit: IdentificationResult, axis: int | None = None) -> float | None:
    """Stated standard uncertainty of a coordinate over its scatter, of all or along one axis.

    None without stated uncertainties of points, and where an arm passes through nearly all of them.
    """
    which = slice(None) if axis is None else slice(axis, axis + 1)
    for part in fit.references:
        if part.kind == "point" and part.residuals.size and (part.std > 0).all():
            n_effective = sum(group.effective for group in fit.groups)
            if part.residuals.size - n_effective < LEAST_FREEDOM:
                return None
            whitened = (part.residuals / part.std)[which]
            scatter = _scatter(whitened, n_effective * whitened.size / part.residuals.size)
            return 1 / scatter if scatter > 0 else np.inf
    return None


def as_stated(fit: IdentificationResult, references: Sequence[Reference]) -> IdentificationResult:
    """An identification with what its references state, without the rounding of the angles."""
    parts = zip(fit.references, references, strict=True)
    return replace(fit, references=tuple(replace(part, std=reference.std) for part, reference in parts))


def check_stated_uncertainty(
    readings: Measurements,
    nominal: IdentificationResult,
    references: Sequence[Reference],
    identify: Callable[[Sequence[Reference]], IdentificationResult],
) -> None:
    """Refuse stated uncertainties that are far larger than the scatter of the points, be it along one axis.

    Parameters
    ----------
    readings : Session
    nominal : IdentificationResult
        The nominal arm.
    references : sequence of Reference
    identify : callable
        Returns the arm with its constants identified from references. Called only where that is in question.

    Raises
    ------
    InputError
        If they are `MAX_RATIO` times as large or more, with the likely mistake.
    """
    axes = [axis for one in references if isinstance(one, Points) for axis in _spread_axes(one.points)]
    if _largest(as_stated(nominal, references), axes)[0] * SUSPECT_NOMINAL < 1:
        return
    bare = [replace(one, point_std=None) if isinstance(one, Points) else one for one in references]
    ratio, axis = _largest(as_stated(identify(bare), references), axes)
    if ratio >= MAX_RATIO:
        readings.contradict(
            f"the stated uncertainty of the reference points is {ratio:.0f} times their scatter about the identified "
            f"arm{_mistake(ratio)}",
            column=f"s{axis}_mm",
            hint="check the unit of the stated uncertainty, or omit its columns",
        )


def unlike_stated_uncertainty(fit: IdentificationResult) -> tuple[Finding, ...]:
    """What a person must know of the stated uncertainties of the points; nothing if they may be right."""
    ratio = stated_ratio(fit)
    if ratio is None or 1 / MOST_SCATTER < ratio < SUSPECT_RATIO:
        return ()
    if ratio > 1:
        said = (
            f"The stated uncertainty of the reference points is {ratio:.0f} times their scatter{_mistake(ratio)}. "
            "Check its unit: readings with an overstated uncertainty determine fewer constants."
        )
    else:
        said = (
            f"The reference points scatter {1 / ratio:.0f} times as much as their stated uncertainty"
            f"{_mistake(ratio)}. Check its unit; if it is right, look for a change, or rows that are mixed up."
        )
    return (Finding("stated uncertainty", said, {"stated_over_scatter": ratio}),)


def counts_rounding(readings: PreparedReadings, fit: IdentificationResult) -> bool:
    """Whether the angles are rounded, and the readings scatter as if they were."""
    parts = zip(fit.references, readings.references, strict=True)
    return any(bool((part.std > reference.std).any()) for part, reference in parts)


def rounded_angles(readings: PreparedReadings, fit: IdentificationResult) -> tuple[Finding, ...]:
    """What rounding of the angles does to the tip; nothing if that is next to nothing."""
    state = readings.state
    if state.angle_std is None:
        return ()
    slides, steps = state.chain.is_prismatic, np.sqrt(12) * state.angle_std
    units = {"deg": np.degrees(steps[~slides].max(initial=0.0)), "mm": steps[slides].max(initial=0.0)}
    said = " and ".join(f"{step:.3g} {unit}" for unit, step in units.items() if step)
    moved = tip_motion_mm(state.chain, state.angles, state.angle_std)
    would = (
        f"The angles have steps of {said}. Rounding to these would move the tip by {moved:.2g} mm (root mean square), "
    )
    if not counts_rounding(readings, fit):
        would += "which the readings do not show: truearm treats them as exact."
    elif max(part.noise_std for part in fit.references) > moved:
        would += "which is less than the readings scatter: they do not show whether it did. It counts as "
        would += "uncertainty of the angles."
    else:
        would = (
            f"The angles are rounded to {said}: that alone moves the tip by {moved:.2g} mm (root mean square). It "
            "counts as uncertainty of the angles, not of the arm."
        )
    return (Finding("rounded angles", would, {"moved_mm": moved}),)


def _largest(fit: IdentificationResult, axes: Sequence[int]) -> tuple[float, str]:
    """The largest `stated_ratio` of these axes, and its axis; zero where there is none."""
    return max(((stated_ratio(fit, axis) or 0.0, "xyz"[axis]) for axis in axes), default=(0.0, ""))


def _spread_axes(points: FloatArray) -> list[int]:
    """Axes along which an arm moved its points (m, 3): along others their scatter is rounding, as of a planar arm."""
    spread = np.ptp(points, axis=0)
    return np.flatnonzero(spread > LEAST_SPREAD * spread.max()).tolist()


def _mistake(ratio: float) -> str:
    """The exchange of units that would explain a ratio, as the end of a sentence; empty if there is none."""
    return next((text for factor, text in MISTAKES.items() if 1 / NEAR < ratio / factor < ABOVE), "")


def _scatter(residuals: FloatArray, n_effective: float) -> float:
    """Standard deviation of whitened residuals (k, m) by the median of their lengths."""
    k, m = residuals.shape
    freedom = max(k * m - n_effective, 0.1 * k * m)
    return float(np.sqrt(np.median((residuals**2).sum(axis=0)) / chi2_quantile(0.5, k) * k * m / freedom))
