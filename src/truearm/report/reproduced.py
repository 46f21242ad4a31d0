"""What a reproduction of a paper found, checked before a number of it is shown.

The findings come as one nested mapping, as ``reproduction.json`` holds it: lengths in mm, times in s. A part that was
not run is null. Here it becomes typed records, or a message that names the key at fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from truearm.errors import InputError

_Checked = TypeVar("_Checked", bound=BaseModel)
# No length, time or ratio of these experiments comes near; what is larger was not measured, and no axis could show it.
_LARGEST = 1e12
_MOST = 100_000  # points of a figure; the paper has 200

Real = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False, strict=True)]
Size = Annotated[float, Field(ge=0, le=_LARGEST, allow_inf_nan=False, strict=True)]
# Drawn on logarithmic scales, where zero has no place.
Positive = Annotated[float, Field(gt=1e-12, le=_LARGEST, allow_inf_nan=False, strict=True)]
Count = Annotated[int, Field(ge=0, le=10**12, strict=True)]
Seed = Annotated[int, Field(ge=0, strict=True)]
Span = tuple[Size, Size]
Text = Annotated[str, Field(max_length=4000)]
Point = tuple[Real, Real, Real]
Points = Annotated[list[Point], Field(min_length=1, max_length=_MOST)]
Matrix = tuple[tuple[Real, Real, Real, Real], ...]
Sizes = Annotated[list[Annotated[int, Field(ge=1, le=100_000)]], Field(min_length=1, max_length=20)]


class _Record(BaseModel):
    # Keys that a later program adds do no harm; a missing one is told.
    model_config = ConfigDict(extra="ignore", frozen=True)


class Machine(_Record):
    """Where it was run."""

    cpu: Text
    cores: Count
    python: Text
    numpy: Text


class Boxes(_Record):
    """Half-widths of the boxes of joint angles, and how they were fixed."""

    simulation_deg: Positive
    experiment_deg: Positive
    how: Text


class PaperResult(_Record):
    """A row as the paper prints it."""

    trainer: Text
    epochs: Count
    seconds: Size
    mean_mm: Positive
    max_mm: Positive


class Run(_Record):
    """One start of one network."""

    seed: Seed
    epochs: Count
    seconds: Size
    stop: Text
    mean_mm: Positive
    max_mm: Positive
    mean_many_mm: Positive
    max_many_mm: Positive
    seconds_to_paper: Size | None
    epochs_to_paper: Count | None


class Medians(_Record):
    """Medians over the starts."""

    epochs: Size
    seconds: Size
    mean_mm: Positive
    max_mm: Positive
    mean_many_mm: Positive
    max_many_mm: Positive


class Spans(_Record):
    """Least and largest over the starts."""

    epochs: Span
    seconds: Span
    mean_mm: Span
    max_mm: Span
    mean_many_mm: Span
    max_many_mm: Span


class Trained(_Record):
    """A row's network, trained from several starts by one trainer."""

    trainer: Text
    seeds: Annotated[list[Seed], Field(min_length=1)]
    time_limit_s: Size | None
    runs: Annotated[list[Run], Field(min_length=1)]
    median: Medians
    range: Spans


class BothWays(_Record):
    """A number for the paper's trainer and for ours."""

    faithful: Size | None
    ours: Size | None


class Ratio(_Record):
    """Ours by the paper's."""

    mean: BothWays


class TableRow(_Record):
    """One row of a table of the paper: its settings, its result, and what was found."""

    row: Annotated[int, Field(ge=1, le=1000)]
    n_train: Count
    hidden: Sizes
    activation: Text
    learning_rate: Size | None
    goal: Size | None
    max_epochs: Count
    same_training_as: int | None
    paper: PaperResult
    faithful: Trained | None
    ours: Trained | None
    ratio: Ratio
    verdict: Text
    verdict_ours: Text | None = None
    rule: Text
    note: Text | None = None

    def by_trainer(self) -> dict[str, Trained]:
        """What was run: ``faithful``, ``lm``, or both."""
        found = {"faithful": self.faithful, "lm": self.ours}
        return {way: trained for way, trained in found.items() if trained is not None}


class Tables(_Record):
    """The rows of the paper's three tables of results, null for a table that was not run."""

    table_2: list[TableRow] | None = Field(alias="2")
    table_3: list[TableRow] | None = Field(alias="3")
    table_4: list[TableRow] | None = Field(alias="4")

    def by_number(self) -> dict[int, list[TableRow]]:
        """The tables that were run."""
        found = {2: self.table_2, 3: self.table_3, 4: self.table_4}
        return {number: rows for number, rows in found.items() if rows}

    def rows(self) -> list[TableRow]:
        """The rows of all tables."""
        return [row for rows in self.by_number().values() for row in rows]


class Compensated(_Record):
    """Errors of a model on the poses of the final test."""

    mean_mm: Positive
    max_mm: Positive
    over_0_05: Count = Field(alias="over_0.05")
    over_0_08: Count = Field(alias="over_0.08")
    removed_percent: Real
    seconds: Size


class FinalRun(_Record):
    """The final test on one virtual arm."""

    seed: Seed
    nominal_mean_mm: Positive
    nominal_max_mm: Positive
    faithful: Compensated | None
    ours: Compensated | None
    kinematic: Compensated | None
    noise_floor_mm: Positive

    def by_model(self) -> dict[str, Compensated]:
        """What was fitted."""
        found = {"faithful": self.faithful, "lm": self.ours, "kinematic": self.kinematic}
        return {name: model for name, model in found.items() if model is not None}


class MeanMax(_Record):
    """Mean and largest absolute error of a coordinate."""

    mean_mm: Positive
    max_mm: Positive


class PaperNetwork(MeanMax):
    """The paper's network on its 200 poses."""

    over_0_05: Count = Field(alias="over_0.05")
    over_0_08: Count = Field(alias="over_0.08")


class PaperFinal(_Record):
    """The paper's final test."""

    nominal: MeanMax
    network: PaperNetwork
    removed_percent: Real


class FinalTest(_Record):
    """The paper's final test, and ours on several virtual arms."""

    poses: Annotated[int, Field(ge=1, le=10**9)]
    paper: PaperFinal
    runs: Annotated[list[FinalRun], Field(min_length=1)]

    def fits(self) -> dict[str, list[Compensated]]:
        """What each model made of the virtual arms that it was fitted to."""
        by_model: dict[str, list[Compensated]] = {}
        for run in self.runs:
            for name, fit in run.by_model().items():
                by_model.setdefault(name, []).append(fit)
        return by_model

    def removed_percent_by_model(self) -> dict[str, float]:
        """Median share that each model removed."""
        return {name: median(fit.removed_percent for fit in fits) for name, fits in self.fits().items()}


class LearningRate(_Record):
    """The same training at several learning rates."""

    rates: Annotated[list[Positive], Field(min_length=1)]
    mean_mm: Annotated[list[Positive], Field(min_length=1)]
    identical: bool
    paper_mean_mm: list[Positive] | None = None

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        return _same_length(self, "rates", "mean_mm", *([] if self.paper_mean_mm is None else ["paper_mean_mm"]))


class Scatter(_Record):
    """One training from many starts."""

    what: Text
    mean_mm: Annotated[list[Positive], Field(min_length=1, max_length=_MOST)]
    max_mm: Annotated[list[Positive], Field(min_length=1, max_length=_MOST)]
    paper_rows_mean_mm: Annotated[list[Positive], Field(min_length=1, max_length=1000)]
    paper_rows: list[Count] | None = None

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        _same_length(self, "mean_mm", "max_mm")
        return _same_length(self, "paper_rows_mean_mm", *([] if self.paper_rows is None else ["paper_rows"]))


class BoxWidths(_Record):
    """Rows 1 and 15 of Table 2 in boxes of several widths."""

    half_width_deg: Annotated[list[Positive], Field(min_length=1, max_length=1000)]
    row1_mean_mm: list[Positive]
    row15_mean_mm: list[Positive]
    paper_row1: Positive
    paper_row15: Positive

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        return _same_length(self, "half_width_deg", "row1_mean_mm", "row15_mean_mm")


class Outside(_Record):
    """The direct network outside the box it was trained in."""

    distance_deg: Annotated[list[Size], Field(min_length=1, max_length=1000)]
    median_mm: list[Positive]
    p95_mm: list[Positive]
    nominal_mm: Positive
    kinematic_mm: list[Positive]

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        return _same_length(self, "distance_deg", "median_mm", "p95_mm", "kinematic_mm")


class Percent(_Record):
    """What a share removed means."""

    nominal_mean_mm: Positive
    network_mean_mm: Positive
    floor_mm: Positive
    removed_percent: Real
    text: Text


class Claims(_Record):
    """What the paper's claims are worth, each by an experiment of its own."""

    learning_rate: LearningRate | None
    scatter: Scatter | None
    boxes: BoxWidths | None
    outside: Outside | None
    percent: Percent | None


class ArmFrames(_Record):
    """The arm at a pose: its frames by Denavit and Hartenberg, the base first."""

    angles_deg: Annotated[list[Real], Field(min_length=1, max_length=100)]
    frames: list[Matrix]
    tip_mm: Point


class Layers(_Record):
    """Units of a network, input to output."""

    sizes: Annotated[Sizes, Field(min_length=2)]


class TenPoses(_Record):
    """Some poses, and where each network puts them."""

    points_mm: Points
    predicted_mm: dict[str, Points | None]


class Deviations(_Record):
    """Predicted minus true coordinates."""

    deviation_mm: Points


class Predicted(_Record):
    """True and predicted coordinates."""

    points_mm: Points
    predicted_mm: Points

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        return _same_length(self, "points_mm", "predicted_mm")


class PaperFigures(_Record):
    """Arrays of the paper's figures; null for one that was not made."""

    arm: ArmFrames | None
    network: Layers | None
    figure_4: TenPoses | None = Field(alias="4")
    figure_6: Deviations | None = Field(alias="6")
    figure_7: Predicted | None = Field(alias="7")
    figure_8: Deviations | None = Field(alias="8")


class Reproduced(_Record):
    """All that a reproduction found."""

    truearm: Text
    machine: Machine
    quick: bool
    left_out: list[Text]
    seconds: Size
    boxes: Boxes
    tables: Tables
    final_test: FinalTest | None
    claims: Claims
    figures: PaperFigures


def reproduced(found: Mapping[str, Any]) -> Reproduced:
    """Check the findings of a reproduction.

    Parameters
    ----------
    found : mapping
        As ``reproduction.json`` holds it.

    Raises
    ------
    InputError
        If a key is missing or its value is not what it must be; the key is named with its place, such as
        ``tables.2[0].paper.mean_mm``.
    """
    if not isinstance(found, Mapping):
        raise InputError(f"expected the findings of a reproduction as a mapping, got {type(found).__name__}")
    try:
        return Reproduced.model_validate(found)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        place = _place(first["loc"])
        if first["type"] == "missing":
            problem = f"expected the key {place} in the findings of a reproduction, got none"
        else:
            got = repr(first["input"])
            problem = (
                f"{place or 'findings'}: {first['msg'].removeprefix('Value error, ')}, "
                f"got {got if len(got) <= 60 else got[:59] + '…'}"
            )
        raise InputError(problem, hint="truearm reproduce gao2017, which writes them anew") from None


def _place(keys: tuple[int | str, ...]) -> str:
    place = ""
    for key in keys:
        place += f"[{key}]" if isinstance(key, int) else f".{key}" if place else key
    return place


def _same_length(record: _Checked, *names: str) -> _Checked:
    lengths = {name: len(getattr(record, name)) for name in names}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ValueError(f"expected lists of one length, got {told}")
    return record
