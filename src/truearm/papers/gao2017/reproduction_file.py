"""What a reproduction of a paper found, as ``reproduction.json`` holds it: typed, or a message that names the key.

Lengths in mm, times in s. A part that was not run is null.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm.errors import InputError

_LARGEST = 1e12  # no length, time or ratio of these experiments comes near, and no axis could show it
Real = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
Size = Annotated[Real, Field(ge=0)]
Positive = Annotated[Real, Field(gt=1e-12)]  # drawn on logarithmic scales, where zero has no place
Text = Annotated[str, Field(max_length=4000)]
Some = Field(min_length=1)


class _Record(BaseModel):
    # Keys that the page does not show do no harm; a missing one is told.
    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)


class PaperResult(_Record):
    """A row as the paper prints it."""

    trainer: Text
    epochs: int
    seconds: Size
    mean_mm: Positive
    max_mm: Positive


class Run(_Record):
    """One start of one network."""

    stop: Text
    mean_many_mm: Positive
    seconds_to_paper: Size | None


class Medians(_Record):
    """Medians over the starts."""

    epochs: Size
    seconds: Size
    mean_many_mm: Positive
    max_mm: Positive


class TrainerSummary(_Record):
    """A row's network, trained from several starts by one trainer."""

    time_limit_s: Size | None
    runs: Annotated[list[Run], Some]
    median: Medians
    range_mm: Annotated[list[Positive], Field(min_length=2, max_length=2)]


class TableRow(_Record):
    """One row of a table of the paper: its settings, its result, and what was found."""

    row: int
    n_train: int
    hidden: list[int]
    activation: Text
    learning_rate: Size
    goal: Size
    same_training_as: int | None
    paper: PaperResult
    faithful: TrainerSummary | None
    ours: TrainerSummary | None
    ratio: dict[str, Size | None]
    verdict: Text | None
    verdict_ours: Text | None
    note: Text | None

    def by_trainer(self) -> dict[str, TrainerSummary]:
        """What was run: ``faithful``, ``lm``, or both."""
        return {way: one for way, one in (("faithful", self.faithful), ("lm", self.ours)) if one is not None}

    def verdicts(self) -> dict[str, str]:
        """The verdicts of what was run, but of no training that another row has already."""
        given = {"faithful": self.verdict, "lm": self.verdict_ours}
        return {way: verdict for way in self.by_trainer() if (verdict := given[way]) is not None}


class Errors(_Record):
    """Absolute errors of coordinates on the poses of the final test."""

    mean_mm: Positive
    max_mm: Positive
    over_0_05: Annotated[int, Field(alias="over_0.05")]
    over_0_08: Annotated[int, Field(alias="over_0.08")]
    removed_percent: Real
    seconds: Size | None = None


class Nominal(_Record):
    """Those of the uncompensated arm."""

    mean_mm: Positive
    max_mm: Positive


class FinalRun(_Record):
    """The final test on one virtual arm."""

    nominal: Nominal
    faithful: Errors | None
    ours: Errors | None
    kinematic: Errors | None
    noise_floor_mm: Positive


class PaperFinal(_Record):
    """The paper's final test."""

    nominal: Nominal
    network: Errors


class FinalTest(_Record):
    """The paper's final test, and ours on several virtual arms."""

    poses: int
    paper: PaperFinal
    runs: Annotated[list[FinalRun], Some]

    def fits(self) -> dict[str, list[Errors]]:
        """What each model made of the virtual arms that it was fitted to."""
        by_model = {
            "faithful": [run.faithful for run in self.runs],
            "lm": [run.ours for run in self.runs],
            "kinematic": [run.kinematic for run in self.runs],
        }
        found = {name: [fit for fit in fits if fit is not None] for name, fits in by_model.items()}
        return {name: fits for name, fits in found.items() if fits}

    def removed_percent(self) -> dict[str, float]:
        """Median share that each model removed."""
        return {name: median(fit.removed_percent for fit in fits) for name, fits in self.fits().items()}


class LearningRate(_Record):
    """The paper's rows that differ in the learning rate, and the one training that they are."""

    rates: Annotated[list[Positive], Some]
    rows: list[int]
    mean_mm: Positive
    paper_mean_mm: Annotated[list[Positive], Some]


class Scatter(_Record):
    """One training from many starts."""

    what: Text
    mean_mm: Annotated[list[Positive], Some]
    mean_many_mm: Annotated[list[Positive], Some]
    relative_spread: Size
    paper_rows: list[int]
    paper_rows_mean_mm: Annotated[list[Positive], Some]
    paper_relative_spread: Size


class BoxWidths(_Record):
    """Rows 1 and 15 of Table 2 in boxes of several widths."""

    half_width_deg: Annotated[list[Positive], Some]
    row1_mean_mm: list[Positive]
    row15_mean_mm: list[Positive]
    paper_row1: Positive
    paper_row15: Positive


class Outside(_Record):
    """The models outside the box they were fitted in."""

    distance_deg: Annotated[list[Size], Some]
    lm_median_mm: list[Positive]
    lm_p95_mm: list[Positive]
    nominal_median_mm: list[Positive]
    kinematic_median_mm: list[Positive]


class Claims(_Record):
    """What the paper's claims are worth, each by an experiment of its own."""

    learning_rate: LearningRate | None
    scatter: Scatter | None
    boxes: BoxWidths | None
    outside: Outside | None


class ArmFrames(_Record):
    """The arm at a pose: its frames by Denavit and Hartenberg, the base first."""

    angles_deg: list[Real]
    frames: list[list[list[Real]]]
    tip_mm: list[Real]


class Layers(_Record):
    """Units of a network, input to output."""

    sizes: list[int]


class Deviations(_Record):
    """Predicted minus true coordinates."""

    deviation_mm: list[list[Real]]


class Predicted(_Record):
    """True coordinates, and where each network puts them."""

    points_mm: list[list[Real]]
    predicted_mm: dict[str, list[list[Real]] | None]


class PaperFigures(_Record):
    """Arrays of the paper's figures; null for one that was not made."""

    arm: ArmFrames | None
    network: Layers | None
    figure_4: Annotated[Predicted | None, Field(alias="4")]
    figure_6: Annotated[Deviations | None, Field(alias="6")]
    figure_7: Annotated[Predicted | None, Field(alias="7")]
    figure_8: Annotated[Deviations | None, Field(alias="8")]


class Machine(_Record):
    """Where it was run."""

    cpu: Text
    cores: int
    python: Text
    numpy: Text


class Boxes(_Record):
    """Half-widths of the boxes of joint angles, and how they were fixed."""

    simulation_deg: Positive
    experiment_deg: Positive
    how: Text


class ReproductionResult(_Record):
    """All that a reproduction found."""

    truearm: Text
    machines: Annotated[list[Machine], Some]
    trained: list[Text] | None
    quick: bool
    left_out: list[Text]
    training_seconds: Size
    rule: Text
    boxes: Boxes
    tables: dict[str, list[TableRow] | None]
    final_test: FinalTest | None
    claims: Claims
    figures: PaperFigures

    def rows_by_table(self) -> dict[int, list[TableRow]]:
        """The tables that were run."""
        return {int(number): rows for number, rows in self.tables.items() if rows}

    def rows(self) -> list[TableRow]:
        """The rows of all tables."""
        return [row for rows in self.rows_by_table().values() for row in rows]


def read_reproduction(found: Mapping[str, Any]) -> ReproductionResult:
    """Read the findings of a reproduction.

    Raises
    ------
    InputError
        If a key is missing or its value is not what it must be; the key is named with its place, such as
        ``tables.2.0.paper.mean_mm``.
    """
    try:
        return ReproductionResult.model_validate(found)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"])) or "findings"
        raise InputError(
            f"findings of a reproduction: {place}: {first['msg']}", hint="truearm reproduce gao2017 writes them anew"
        ) from None
