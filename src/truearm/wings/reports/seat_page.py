"""The page of a session without reference points: how well models' points agree in their seats and keep lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truearm.number_format import format_count, show_mm
from truearm.pages.drawings.error_figures import before_after, error_distribution
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, Table
from truearm.readings import LengthSummary
from truearm.typing import FloatArray, NameArray
from truearm.wings.reports.comparison_page import ComparedReadings, improvement_sentence


@dataclass(frozen=True, eq=False, kw_only=True)
class SeatComparison(ComparedReadings):
    """Points of readings in seats by several models.

    Attributes
    ----------
    seat : (n,) array of str
        The seat of each reading; in every seat there are two readings or more.
    lengths : sequence of (str, str, float, float)
        Known lengths: seat, seat, length and its standard uncertainty [mm].
    length_errors : mapping of str to (m,) array
        Of each model: its length less the known one [mm].
    """

    seat: NameArray
    lengths: Sequence[tuple[str, str, float, float]]
    length_errors: Mapping[str, FloatArray]

    def length_summary(self, name: str) -> LengthSummary | None:
        """How well a model measures the known lengths, beside the first; None without any."""
        if not self.lengths:
            return None
        first = next(iter(self.length_errors))
        return LengthSummary.of(self.length_errors[name], self.length_errors[first], [u for *_, u in self.lengths])


def seats_sentence(what: str, mean_mm: Mapping[str, float], seated: SeatComparison) -> str:
    """The mean distance in the seats by the best model, and its lengths where they are worse than before."""
    first, best = next(iter(mean_mm)), min(mean_mm, key=lambda name: mean_mm[name])
    lengths = seated.length_summary(best)
    if lengths is None or not lengths.is_worse:
        return improvement_sentence(what, mean_mm[first], mean_mm[best])
    return (
        f"Lengths are off by up to {show_mm(lengths.largest_mm)}, before compensation by "
        f"{show_mm(lengths.nominal_mm)}. {improvement_sentence(what, None, mean_mm[best])}"
    )


def seats_page(
    seated: SeatComparison,
    *,
    title: str,
    subtitle: str,
    facts: Sequence[tuple[str, str]],
    remarks: Sequence[str] = (),
    more: Sequence[Section] = (),
) -> Page:
    """The page: agreement in the seats before and after compensation, lengths, the session, where the errors come from.

    Parameters
    ----------
    seated : SeatComparison
    title, subtitle, facts, remarks, more
        As in `truearm.wings.reports.comparison_page.comparison_page`.
    """
    distances = {name: _from_mean(points, seated.seat) for name, points in seated.predicted.items()}
    best = min(distances, key=lambda name: float(distances[name].mean()))
    return Page(
        title=title,
        subtitle=subtitle,
        verdict=_verdict(seated, distances, best),
        summary=_summary(seated, distances, best),
        sections=(
            seated.in_space(
                "Where the points disagree",
                seated.predicted[best],
                distances,
                shown=best,
                what="distance from the seat's mean",
                names=[f"seat {name}" for name in seated.seat],
            ),
            _agreement(seated, distances, remarks),
            *_lengths(seated),
            *more,
            seated.measured_range(seated.predicted[best]),
            seated.by_joint(distances, "Distances have no sign, so a periodic error shows twice its frequency."),
        ),
        facts=tuple(facts),
    )


def _verdict(seated: SeatComparison, distances: Mapping[str, FloatArray], best: str) -> PageVerdict:
    """How well the points of a seat agree; without a reference nobody can say how true they are."""
    mean, lengths = {name: float(one.mean()) for name, one in distances.items()}, seated.length_summary(best)
    is_better = mean[best] < next(iter(mean.values())) and not (lengths is not None and lengths.is_worse)
    return PageVerdict(
        seats_sentence("Mean distance from the seat's mean point", mean, seated),
        "none" if is_better else "bad",
        "This shows how well points of one seat agree. An error that shifts all of them alike does not show.",
    )


def _from_mean(points: FloatArray, seat: NameArray) -> FloatArray:
    """(n,) distances of points from the mean of their seat [mm]."""
    index = np.unique(seat, return_inverse=True)[1]
    means = np.stack([np.bincount(index, column) for column in points.T], axis=1) / np.bincount(index)[:, None]
    return np.asarray(np.linalg.norm(points - means[index], axis=1))


def _summary(seated: SeatComparison, distances: Mapping[str, FloatArray], best: str) -> tuple[LabelledValue, ...]:
    before = next(iter(distances))
    rows = [LabelledValue(f"mean distance from the seat's mean point, {before}", float(distances[before].mean()), "mm")]
    if best != before:
        rows += [
            LabelledValue(f"mean distance, {best}", float(distances[best].mean()), "mm"),
            LabelledValue(f"largest distance, {best}", float(distances[best].max()), "mm"),
        ]
    if seated.lengths:
        rows.append(
            LabelledValue(f"largest error of a length, {best}", float(np.abs(seated.length_errors[best]).max()), "mm")
        )
    return tuple(rows)


def _agreement(seated: SeatComparison, distances: Mapping[str, FloatArray], remarks: Sequence[str]) -> Section:
    names, index, counts = np.unique(seated.seat, return_inverse=True, return_counts=True)
    of_models = Table(
        Column.of(
            "model",
            "mean distance [mm]",
            "rms distance [mm]",
            "95 % of distances below [mm]",
            "largest distance [mm]",
            "readings",
        ),
        tuple(
            (name, *map(float, (d.mean(), np.sqrt((d**2).mean()), np.quantile(d, 0.95), d.max())), len(d))
            for name, d in distances.items()
        ),
        "Distances from the mean point of the seat",
    )
    of_seats = Table(
        Column.of("seat", "readings", *(Column(name, "mm", group="mean distance") for name in distances)),
        tuple(
            (str(name), int(counts[i]), *(float(d[index == i].mean()) for d in distances.values()))
            for i, name in enumerate(names)
        ),
        "Each seat",
    )
    clouds, spread = before_after(distances), error_distribution(distances)
    text = (
        f"The tip was in {format_count(len(names), 'seat')}, each in several poses. An arm without errors gives the "
        "same point in all poses of a seat, so distances from the mean point show its errors and noise. An error that "
        "shifts all points of a seat alike does not show, nor does an error of scale: that needs known lengths."
    )
    return Section(
        "Agreement in the seats",
        "\n\n".join([*remarks, text]),
        tables=(of_models, of_seats),
        figures=(clouds, replace(spread, caption=spread.caption.replace("the reference's", "the mean of its seat"))),
    )


def _lengths(seated: SeatComparison) -> tuple[Section, ...]:
    if not seated.lengths:
        return ()
    rows: list[tuple[Cell, ...]] = [
        (a, b, length, u, *(float(errors[i]) for errors in seated.length_errors.values()))
        for i, (a, b, length, u) in enumerate(seated.lengths)
    ]
    worst = {name: float(np.abs(errors).max()) for name, errors in seated.length_errors.items()}
    largest = ", ".join(f"{name} {show_mm(error)}" for name, error in worst.items())
    table = Table(
        Column.of(
            "seat",
            "seat",
            Column("length", "mm", 7),
            Column("its u", "mm", 2),
            *(Column(name, "mm", 2, group="error") for name in seated.length_errors),
        ),
        tuple(rows),
        "Known lengths, and the error of each model: its length minus the known one",
    )
    return (
        Section(
            "Lengths",
            f"Largest errors: {largest}. An error is the distance between the mean points of two seats minus the known "
            "length. Lengths from which the arm was identified are no independent test.",
            tables=(table,),
        ),
    )
