"""Rows of the page on imperfect readings: a frame that moves, a wrong unit of the stated uncertainty, wrong arms.

    python benchmarks/imperfect_diagnosis.py [--quick] [--json]

The remarks of `fit` are what counts, so that the same command measures programs that have no test for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import truearm as ta
from imperfect_arms import rows as arm_rows
from imperfect_finding import Finding, print_findings
from truearm import datasets
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.identification.planning.sampling import STRATEGIES
from truearm.identification.virtual import VirtualArm
from truearm.readings import Session

ARM = "gao2017"
SHIFT_MM = 0.05
SAYS = ("moved", "drift")


def sessions(arms: int) -> Iterator[tuple[str, int, Session]]:
    """Readings of everyday work with virtual arms, as an instrument gives them."""
    arm = load_arm(ARM)
    for preset in ("shop", "research"):
        for seed in range(arms):
            angles = STRATEGIES["measuring"](arm, 100, seed=50 + seed).angles
            found = VirtualArm.draw(arm, preset, seed=seed).measure(angles, seed=50 + seed).readings
            yield preset, seed, Session(found.angles, found.points, point_std=found.point_std)


def says(arm: object, session: Session, *words: str, model: str = "kinematic") -> str | None:
    """The remark of a fit with one of the words; the message of a refusal; None if there is neither."""
    try:
        result = ta.fit(arm, session, model=model, limits="ignore")  # type: ignore[arg-type]
    except InputError as error:
        return f"refused: {error}"
    return next((remark for remark in result.remarks if any(word in remark for word in words)), None)


def frame_rows(*, arms: int) -> list[Finding]:
    """A tracker that moved half way, and good sessions."""
    n = alarms = found = named = 0
    for _, seed, session in sessions(arms):
        n += 1
        row = 53
        along = np.random.default_rng(seed).standard_normal(3)
        points = np.array(session.points)
        points[row:] += SHIFT_MM * along / np.linalg.norm(along)
        alarms += says(ARM, session, *SAYS) is not None
        remark = says(ARM, replace(session, points=points), *SAYS)
        found += remark is not None
        near = [f"between reading {row + k} and reading {row + k + 1}," for k in (-1, 0, 1)]
        named += remark is not None and any(text in remark for text in near)
    real = []
    for name in ("ur10-b", "ur5", "wam"):
        arm = replace(load_arm(datasets.DATASETS[name].arm), lower=None, upper=None)
        remark = says(arm, datasets.load_readings(name), *SAYS, model="physical")
        real.append(f"{name}: {'nothing' if remark is None else remark.split(' (95')[0].split(', by')[0]}")
    return [
        Finding(
            f"a tracker moved by {SHIFT_MM} mm half way through 100 readings",
            "the row is named",
            f"said in {found} of {n} sessions, the row to one reading in {named}",
            named >= 0.9 * n,
        ),
        Finding("good sessions of 100 readings", "1 % alarms at most", f"{alarms} of {n}", alarms == 0),
        Finding("real sessions", "reported", "; ".join(real), None),
    ]


def uncertainty_rows(*, arms: int) -> list[Finding]:
    """Stated uncertainties in another unit."""
    found = []
    for factor, what, wanted in (
        (1e3, "micrometres entered as mm", "refused with the likely unit"),
        (30.0, "30 times too large", "said"),
        (1e-3, "entered in metres", "said"),
        (1.0, "right", "not questioned"),
    ):
        answers = []
        for _, _, session in sessions(arms):
            assert session.point_std is not None
            stated = replace(session, point_std=factor * session.point_std)
            answers.append(says(ARM, stated, "stated uncertainty"))
        said = sum(answer is not None for answer in answers)
        refused = sum(answer is not None and answer.startswith("refused") for answer in answers)
        target = {1e3: refused, 30.0: said, 1e-3: said, 1.0: len(answers) - said}[factor]
        now = f"{refused} of {len(answers)} refused, {said - refused} said"
        found.append(Finding(f"stated u of the points {what}", wanted, now, target == len(answers)))
    return found


def rows(*, quick: bool) -> list[Finding]:
    """All rows of this part."""
    arms = 3 if quick else 10
    return [*frame_rows(arms=arms), *uncertainty_rows(arms=2 if quick else 5), *arm_rows(quick=quick)]


if __name__ == "__main__":
    print_findings(__doc__, rows)
