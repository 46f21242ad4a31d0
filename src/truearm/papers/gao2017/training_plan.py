"""Which trainings the founding paper's rows ask for, and how much of it is run.

*Faithful* trainings follow MATLAB: ``mapminmax``, Nguyen-Widrow start, the row's training function, goal and epochs,
15 % of the poses set aside to stop by and 15 % as test data. *Ours* is `train_varpro` on the same poses, without a goal.

The paper does not say that poses are set aside. That they are was settled by its early stops: of 14 rows of Table 2
that no goal ends, 6 end before epoch 1000. Trained on all poses, 4 starts of 4 of row 1 went to epoch 1000; with 15 %
and 15 % set aside 5 of 10 ended before, by validation. MATLAB's older division (60, 20, 20 %, 5 failures) ended 2 of
3: the two cannot be told apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from truearm.papers.gao2017.tables import TABLES, PaperRow
from truearm.papers.gao2017.training import GRADIENT_TRAINERS, Source, Training

Method = Literal["faithful", "ours"]
METHODS: tuple[Method, Method] = ("faithful", "ours")

SIMULATION = Source(half_width_deg=34.0, virtual=False)
EXPERIMENT = Source(half_width_deg=20.0, virtual=True)
SOURCES = {2: SIMULATION, 3: SIMULATION, 4: EXPERIMENT}

# Rows 9 and 10 of Table 3 read as row 6 but err 20 times as much. On 3000 poses, after 250 epochs, 20-20 units left
# 0.88 mm with tansig, 0.95 with logsig, 5.4 with the second layer linear, 4.9 with the first; one layer of 20 left 5.0.
# Only a linear layer explains such a factor. Which of the two rows has which is a guess.
ACTIVATIONS: Mapping[tuple[int, int], tuple[str, ...]] = {(3, 9): ("tansig", "purelin"), (3, 10): ("purelin", "tansig")}

# Rows that speak for the boxes: SIMULATION is the half-width at which the geometric mean of ours (faithful) by the
# paper's average is nearest to 1 over the distinct rows of Table 2 with 10000 poses; EXPERIMENT is the demo's box, in
# which lm comes below the paper's average of row 4 of Table 4. To find such a row reproduced would be to find it twice.
BOX_FITTING_ROWS = frozenset({(2, 1), *((2, number) for number in range(12, 18)), (4, 4)})

PARTS = ("table 2", "table 3", "table 4", "boxes", *(f"figure {number}" for number in (1, 2, 3, 4, 6, 7, 8)))
"""What can be asked for; Figure 5 of the paper is not made."""


@dataclass(frozen=True)
class Effort:
    """How much is run.

    Attributes
    ----------
    quick : bool
    epochs, box_epochs : int
        Most epochs of a faithful training, and in the study of boxes.
    lm_epochs : dict of int to int
        Most epochs of ours, by table.
    time_limit_s : float
        Of one training, faithful or ours.
    starts : tuple of (float, int)
        Seeds of a training by the time it is estimated to take: up to so many seconds, so many seeds. A training that
        takes longer than all of them is left out.
    starts_by_row : dict of (int, int) to int
        Seeds of a table's row that has more, or fewer, whatever it takes.
    half_widths_deg : tuple of float
        Of the study of boxes.
    """

    quick: bool
    epochs: int
    box_epochs: int
    lm_epochs: Mapping[int, int]
    time_limit_s: float
    starts: tuple[tuple[float, int], ...]
    starts_by_row: Mapping[tuple[int, int], int]
    half_widths_deg: tuple[float, ...]

    def seeds(self, table: int, row: PaperRow, training: Training) -> range:
        """The seeds of a row's training."""
        by_time = (n for seconds, n in self.starts if training.estimated_seconds <= seconds)
        return range(self.starts_by_row.get((table, row.row), next(by_time, 0)))


FULL_EFFORT = Effort(
    quick=False,
    epochs=1000,
    box_epochs=300,
    lm_epochs={2: 60, 3: 80, 4: 150},
    time_limit_s=120.0,
    # Five starts, or as many as take about two minutes.
    starts=((20.0, 5), (60.0, 2), (math.inf, 1)),
    # The scatter of starts explains other rows; the final test is made on as many arms.
    starts_by_row={(2, 1): 10, (4, 4): 3},
    half_widths_deg=tuple(
        sorted({15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 60.0, SIMULATION.half_width_deg}),
    ),
)
QUICK_EFFORT = replace(
    FULL_EFFORT,
    quick=True,
    # What is estimated at 193 s.
    starts=((4.0, 1),),
    starts_by_row={(2, 1): 1, (4, 4): 1},
    half_widths_deg=(25.0, SIMULATION.half_width_deg),
)


def training_of(table: int, row: PaperRow, side: Method, effort: Effort, *, seed: int) -> Training:
    """A row's training; rows that differ in nothing that it depends on have the same."""
    served = equivalent_rows(table, row, side)
    faithful = side == "faithful"
    return Training(
        source=SOURCES[table],
        n_train=row.n_train,
        hidden=row.hidden,
        activations=activations_of(table, row, side),
        trainer=row.trainer if faithful else "varpro",
        epochs=effort.epochs if faithful else effort.lm_epochs[table],
        goal=served[0].goal if faithful else 0.0,
        set_aside=0.15 if faithful else 0.0,
        time_limit_s=effort.time_limit_s,
        seed=seed,
        levels_mm=tuple(sorted({other.mean_mm for other in served if other.trainer not in GRADIENT_TRAINERS})),
        expected_epochs=max(other.epochs for other in served) if faithful else None,
    )


def activations_of(table: int, row: PaperRow, side: Method = "faithful") -> tuple[str, ...]:
    """Of the row's hidden layers; ours are always tansig."""
    tansig = ("tansig",) * len(row.hidden)
    return ACTIVATIONS.get((table, row.row), tansig) if side == "faithful" else tansig


def equivalent_rows(table: int, row: PaperRow, side: Method) -> list[PaperRow]:
    """The rows of a table that one training serves.

    ``trainlm`` takes no learning rate. Rows that differ in nothing but the goal are alike as long as no start meets the
    goal of the first, which the row's note tells. Ours has no goal, one activation and one trainer.
    """

    def settings(other: PaperRow) -> tuple[Any, ...]:
        shape = other.n_train, other.hidden, activations_of(table, other, side)
        return (*shape, other.trainer) if side == "faithful" else shape

    return [other for other in TABLES[table] if settings(other) == settings(row)]


def trainings(table: int, row: PaperRow, side: Method, effort: Effort) -> list[Training]:
    """A row's trainings, one a seed; none if they are left out."""
    first = training_of(table, row, side, effort, seed=0)
    head = equivalent_rows(table, row, side)[0]
    return [replace(first, seed=seed) for seed in effort.seeds(table, head, first)]


def box_training(row: PaperRow, half_width_deg: float, effort: Effort) -> Training:
    """A row's faithful training in another box, with fewer epochs."""
    training = training_of(2, row, "faithful", effort, seed=0)
    return replace(
        training,
        source=Source(half_width_deg, virtual=False),
        epochs=min(training.epochs, effort.box_epochs),
        levels_mm=(),
        expected_epochs=None,
    )


def plan_trainings(parts: Sequence[str], effort: Effort) -> tuple[list[Training], list[str]]:
    """The trainings that the parts need, each once, and what is left out, in words."""
    wanted: list[Training] = []
    left_out: list[str] = []
    for table, rows in TABLES.items():
        for row in rows if f"table {table}" in parts else ():
            for side in METHODS:
                found = trainings(table, row, side, effort)
                wanted += found
                if not found and equivalent_rows(table, row, side)[0] is row:
                    one = training_of(table, row, side, effort, seed=0)
                    left_out.append(
                        f"Table {table}, row {row.row}, {one.trainer}: some {one.estimated_seconds:.0f} s a start"
                    )
    if "boxes" in parts:
        wanted += [box_training(row, h, effort) for row in box_rows() for h in effort.half_widths_deg]
        missing = [f"{h:g}" for h in FULL_EFFORT.half_widths_deg if h not in effort.half_widths_deg]
        if effort.quick and missing:
            left_out.append(f"Study of boxes: half-widths of {', '.join(missing)} deg")
    drawn: dict[int, tuple[int, Sequence[Method]]] = {4: (2, METHODS), 7: (4, ("ours",)), 8: (4, ("ours",))}
    for number, (table, sides) in drawn.items():
        if f"figure {number}" in parts:
            row = TABLES[2][0] if table == 2 else TABLES[4][-1]
            wanted += [one for side in sides for one in trainings(table, row, side, effort)[:1]]
    return list(dict.fromkeys(wanted)), left_out


def box_rows() -> tuple[PaperRow, PaperRow]:
    """Rows 1 and 15 of Table 2: few units and many, which ask for the same box."""
    rows = {row.row: row for row in TABLES[2]}
    return rows[1], rows[15]
