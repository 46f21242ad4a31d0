"""Test values of both standards: how often U holds what artefact and set-up did to them."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from benchmarks.rows import RowResult, Rows
from truearm.typing import FloatArray
from truearm.wings.laboratory.standards import asme_b89_4_22, iso10360_12
from truearm.wings.laboratory.standards.artefacts import Artefacts, CalibratedBar, CalibratedSphere, example_artefacts
from truearm.wings.laboratory.standards.decision import ConformityResult
from truearm.wings.laboratory.standards.measurands import LengthMeasurement, SphereMeasurement
from truearm.wings.laboratory.standards.positions import hemisphere
from truearm.wings.laboratory.standards.specification import Specification

ROWS = Rows()

RANGE, DEGC = 2500.0, 22.0
SPECIFICATION = Specification(name="none", source="none", measuring_range_mm=RANGE, limits={})


def artefacts() -> Artefacts:
    """The example artefacts with a rougher ball and a looser one, so that every contribution counts."""
    made = example_artefacts(RANGE)
    rough = {"form_mm": 0.002, "u_form_mm": 0.0003, "u_fixture_mm": 0.001}
    return made.model_copy(
        update={
            "spheres": tuple(one.model_copy(update=rough) for one in made.spheres),
            "seats": tuple(one.model_copy(update=rough) for one in made.seats),
        }
    )


def _grown(artefact: CalibratedSphere | CalibratedBar, z: FloatArray) -> float:
    """What temperature and expansion that are not as stated leave of a size corrected to 20 degC, as a share."""
    alpha = artefact.expansion_per_K + artefact.u_expansion_per_K * z[2]
    return alpha * (DEGC - 20 + artefact.u_temperature_K * z[1])


def both(rng: np.random.Generator, arm_mm: float) -> tuple[list[ConformityResult], list[ConformityResult]]:
    """The rows of a campaign with perfect artefacts, and of the same readings with artefacts drawn within certificates.

    Sizes, temperature and expansion are drawn once for each artefact; the form, within half of it to either side, at
    each touch; the fixture at each touch of a ball or seat, and for each group of L_Dia and each measured length.

    Parameters
    ----------
    rng : Generator
    arm_mm : float
        Standard deviation of a coordinate of the arm [mm].
    """
    known = artefacts()
    ball, bar, seat = known.spheres[0], known.bars[0], known.seats[0]
    z_ball, z_bar = rng.normal(size=3), rng.normal(size=3)
    excess = {one.name: one.u_mm * rng.normal() for one in bar.lengths}
    stated = {one.name: 1 + one.expansion_per_K * (DEGC - 20) for one in (ball, bar)}
    scale = rng.uniform(0.5, 1.5)  # errors of the arm that readings have in common

    def sphere(n: int, where: str, moved: FloatArray | None = None) -> list[SphereMeasurement]:
        normals = hemisphere(n)
        errors = arm_mm * rng.normal(size=(n, 3)) + moved_arm(where)
        form = ball.form_mm + ball.u_form_mm * rng.normal()
        touch = rng.uniform(-0.5, 0.5, (n, 1)) * form * normals
        touch = touch + (ball.u_fixture_mm * rng.normal(size=(n, 3)) if moved is None else moved)
        true = (ball.diameter_mm + ball.u_diameter_mm * z_ball[0]) * (1 + _grown(ball, z_ball)) / 2
        return [
            SphereMeasurement(ball, ball.diameter_mm / 2 * stated["ball"] * normals + errors, DEGC, 0.0, where),
            SphereMeasurement(ball, true * normals + errors + touch, DEGC, 0.0, where),
        ]

    def moved_arm(where: str) -> FloatArray:
        return arm_mm * rng.normal(size=3) if where.startswith("group") else np.zeros(3)

    def length(which: int, position: int, repeat: int, place: FloatArray) -> list[LengthMeasurement]:
        one = bar.lengths[which]
        along = rng.normal(size=3)
        along /= np.linalg.norm(along)
        true = (one.length_mm + excess[one.name]) * (1 + _grown(bar, z_bar))
        form = (bar.form_mm + bar.u_form_mm * rng.normal()) * rng.uniform(-0.5, 0.5, 2).sum()
        off = bar.u_fixture_mm * rng.normal() + form
        error = place + arm_mm * 0.3 * rng.normal()
        return [
            LengthMeasurement(
                bar, one, np.zeros((1, 3)), ((size + error) * along)[None], DEGC, 0.0, str(position), str(repeat)
            )
            for size in (one.length_mm * stated["bar"], true + off)
        ]

    def points() -> list[asme_b89_4_22.SeatPoints]:
        errors = arm_mm * rng.normal(size=(10, 3))
        touch = seat.form_mm * rng.uniform(-0.5, 0.5, (10, 3)) + seat.u_fixture_mm * rng.normal(size=(10, 3))
        return [asme_b89_4_22.SeatPoints(seat, one, "seat") for one in (errors, errors + touch)]

    probed = list(zip(*(sphere(25, f"position {i}") for i in (1, 2)), strict=True))
    nine = list(zip(*(sphere(9, f"repeat {i}") for i in (1, 2, 3)), strict=True))
    turned = [
        list(zip(*(sphere(5, f"group {i}", ball.u_fixture_mm * rng.normal(size=3)) for i in range(5)), strict=True))
        for _ in (1, 2)
    ]
    places = scale * arm_mm * rng.normal(size=(5, 7))
    uni = list(
        zip(*(length(i, j, k, places[i, j]) for i in range(5) for j in range(7) for k in (1, 2, 3)), strict=True)
    )
    volumetric = list(zip(*(length(2 + i % 2, i, 1, arm_mm * rng.normal()) for i in range(20)), strict=True))
    seats = points()
    rows = []
    for which in (0, 1):
        rows.append(
            [
                iso10360_12.p_size(probed[which], SPECIFICATION),
                iso10360_12.p_form(probed[which], SPECIFICATION),
                *iso10360_12.l_dia([one[which] for one in turned], SPECIFICATION),
                *iso10360_12.length_errors(uni[which], SPECIFICATION),
                asme_b89_4_22.effective_diameter(nine[which], SPECIFICATION),
                *asme_b89_4_22.single_point([seats[which]], SPECIFICATION),
                *asme_b89_4_22.volumetric(volumetric[which], SPECIFICATION),
            ]
        )
    return rows[0], rows[1]


@ROWS.row("coverage", quick={"campaigns": 2})
def coverage(campaigns: int = 1000, arms: tuple[float, ...] = (0.003, 0.010, 0.030)) -> RowResult:
    """Test values whose U holds the difference from those of the same readings with perfect artefacts [%].

    Arms whose coordinates scatter by the stated millimetres; the set-up of a length by 0.0028 mm.
    """
    held: dict[str, dict[float, list[bool]]] = defaultdict(lambda: defaultdict(list))
    widths: dict[str, list[float]] = defaultdict(list)
    for arm in arms:
        rng = np.random.default_rng(1)
        for _ in range(campaigns):
            for perfect, row in zip(*both(rng, arm), strict=True):
                held[row.label][arm].append(abs(abs(row.value) - abs(perfect.value)) <= row.uncertainty)
                widths[row.label].append(row.uncertainty)
    return RowResult([
        {"test value": label, **{f"{arm:g} mm": 100 * float(np.mean(of[arm])) for arm in arms},
         "median U [mm]": float(np.median(widths[label]))}
        for label, of in held.items()
    ])  # fmt: skip
