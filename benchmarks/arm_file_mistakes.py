"""Planted mistakes in arm files and tables of readings: how often the doctor names them, and false proposals.

    python benchmarks/arm_file_mistakes.py [--quick] [--seats] [--arms N] [--verbose]

Every mistake of `truearm.arm.description_mistakes` is planted, one at a time, into sessions of 60 readings with eight
virtual arms; a mistake that the readings do not contradict (the zero of joint 1 beside a free base) is counted apart.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import truearm as ta
from truearm.arm import Arm, load_arm
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.description_mistakes import Interpretation, Mistake, likely_mistakes
from truearm.errors import InputError
from truearm.identification.judgement.description_check import DescriptionCheck, check_description
from truearm.identification.judgement.reference_table import reference_table
from truearm.readings import Lengths, Session

READINGS = 60
# Arm, preset of its errors, strategy of the poses.
ARMS = (
    ("gao2017", "research", "box"),
    ("gao2017", "research", "uniform"),
    ("measuring7", "shop", "measuring"),
    ("measuring7", "worn", "uniform"),
    ("ur10", "shop", "measuring"),
    ("ur5", "research", "box"),
    ("panda", "research", "uniform"),
    ("wam", "shop", "uniform"),
)


def sessions(*, seats: bool, seed: int) -> Iterator[tuple[str, Arm, Session, Lengths | None]]:
    """Readings of virtual arms, with points or with seats and a bar."""
    kinds = {(name, preset): (name, preset, strategy) for name, preset, strategy in ARMS} if seats else {}
    for name, preset, strategy in kinds.values() or ARMS:
        arm = replace(load_arm(name), lower=None, upper=None)
        with_limits = load_arm(name)
        options = {"strategy": "seat", "seats": 3, "bars": 2, "reference": False} if seats else {"strategy": strategy}
        try:
            simulated = ta.simulate(with_limits, poses=READINGS, preset=preset, seed=seed, arm_seed=seed, **options)  # type: ignore[arg-type]
        except InputError as error:
            print(f"{name} {preset}: {error}")
            continue
        yield f"{name} {preset}{'' if seats else ' ' + strategy}", arm, simulated.session, simulated.lengths


def planted(
    arm: Arm, session: Session, lengths: Lengths | None, mistake: Mistake
) -> tuple[Arm, Session, Lengths | None]:
    """Arm file and readings of a person who makes a mistake: without it they are right."""
    stated = Interpretation.stated(arm)
    mended = mistake.mend(stated)
    angles = np.linalg.solve(mended.angle_matrix, (session.angles - mended.angle_offset).T).T
    changes: dict[str, object] = {"angles": angles}
    if session.points is not None:
        points = session.points / mended.point_factor @ mended.points_turn  # it undoes itself
        changes["points"] = np.roll(points, mended.shift, axis=0)
        changes["point_std"] = None
    elif mended.shift:
        assert session.seat is not None
        changes["seat"] = np.roll(session.seat, mended.shift)
    if mended.length_factor != 1 and lengths is not None:
        lengths = replace(lengths, length_mm=lengths.length_mm / mended.length_factor)
    table = wrong_table(stated.table, mended.table, mistake)
    wrong = replace(arm, chain=table.chain(), table=table)
    return wrong, replace(session, **changes), lengths  # type: ignore[arg-type]


def wrong_table(right: DHTable, mended: DHTable, mistake: Mistake) -> DHTable:
    """The table that mending turns into the right one: exchanges undo themselves, factors do not."""
    if mistake.subject == "arm unit":
        factor = right.chain().reach / mended.chain().reach
        lengths = {name: factor * getattr(right, name) for name in ("a", "d", "b", "tip_in_flange")}
        frames = {name: getattr(right, name).copy() for name in ("base", "flange")}
        for frame in frames.values():
            frame[:3, 3] *= factor
        return replace(right, **lengths, **frames)
    if mistake.subject == "table angles":
        factor = np.abs(right.alpha).max() / np.abs(mended.alpha).max()
        return replace(right, alpha=factor * right.alpha, theta=factor * right.theta)
    return mended


def outcome(check: DescriptionCheck, mistake: Mistake) -> str:
    """What became of a planted mistake."""
    named = [name for one in check.findings for name in one.mistakes]
    aim = mistake.subject if mistake.subject == "convention" else mistake.description
    if any(("convention" in name) if aim == "convention" else name == aim for name in named):
        first = check.findings[0]
        return "named alone" if len(check.findings) == 1 else "named first" if aim in first.mistakes else "named beside"
    if not check.findings:
        return "not contradicted" if check.stated.is_usual else "nothing found"
    return "wrong proposal"


def mistakes_found(*, seats: bool, quick: bool, verbose: bool) -> Counter[str]:
    """Outcomes of all planted mistakes."""
    count: Counter[str] = Counter()
    for name, arm, session, lengths in sessions(seats=seats, seed=1):
        begun, of_arm = time.process_time(), Counter[str]()
        listed = likely_mistakes(arm, has_points=not seats, has_lengths=lengths is not None)
        for mistake in listed[:: 5 if quick else 1]:
            try:
                wrong, readings, between = planted(arm, session, lengths, mistake)
            except InputError:
                continue  # a length of kilometres
            table = reference_table(readings, between)
            assert table is not None
            check = check_description(wrong, table)
            found = outcome(check, mistake)
            of_arm[found] += 1
            if verbose and found in ("nothing found", "wrong proposal"):
                best = (*check.findings, *check.others)[0]
                print(
                    f"  {found}: {mistake.description}; stated {check.stated}: {check.stated.error_mm:.3g} of "
                    f"{check.stated.usual_mm:.3g} mm, log odds {check.stated.log_odds:.0f}; best {best}: "
                    f"{best.error_mm:.3g} of {best.usual_mm:.3g} mm, log odds {best.log_odds:.0f}"
                )
                right = [one for one in check.others if mistake.description in one.mistakes]
                print(f"      the right one: {right[:1]}")
        n = of_arm.total()
        print(f"{name:28} {n:4} {dict(of_arm)}, {(time.process_time() - begun) / n:.2f} s each", flush=True)
        count += of_arm
    return count


def false_proposals(*, arms: int, seats: bool) -> tuple[int, int]:
    """Proposals for right arms, and their number."""
    n = wrong = 0
    for seed in range(1, 2 + arms // len(ARMS)):
        for name, arm, session, lengths in sessions(seats=seats, seed=100 + seed):
            table = reference_table(session, lengths)
            assert table is not None
            check = check_description(arm, table)
            n += 1
            wrong += bool(check.findings)
            if check.findings:
                print(f"  false: {name} seed {seed}: {check.findings[0]}")
            if n == arms:
                return wrong, n
    return wrong, n


def main() -> None:
    """Print all outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="every fifth mistake")
    parser.add_argument("--seats", action="store_true", help="seats and a bar in place of points")
    parser.add_argument("--arms", type=int, default=100, help="right arms")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    count = mistakes_found(seats=options.seats, quick=options.quick, verbose=options.verbose)
    contradicted = count.total() - count["not contradicted"]
    named = sum(n for what, n in count.items() if what.startswith("named"))
    print(
        f"{named} of {contradicted} mistakes that the readings contradict are named ({named / contradicted:.1%}); "
        f"{count['not contradicted']} others change nothing; {dict(count)}"
    )
    wrong, n = false_proposals(arms=options.arms, seats=options.seats)
    print(f"{wrong} false proposals on {n} right arms")


if __name__ == "__main__":
    main()
