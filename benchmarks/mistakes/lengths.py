"""References of a wrong size, or of none: bars, trackers, boards, controllers; and arms that are warm or printed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import truearm as ta
from benchmarks.mistakes import mistake, right
from truearm.readings import Lengths, Session

LONGER, SHORTER = "% longer than drawn", "% shorter than drawn"


def measured(arm: str = "ur10", *, poses: int = 40, preset: str = "research", scale: float = 1.0) -> Session:
    """Readings of an arm, with points times a scale."""
    session = ta.simulate(arm, poses=poses, preset=preset, strategy="uniform", seed=2, arm_seed=9).session
    return replace(session, points=scale * session.points)


def in_seats() -> tuple[Session, Lengths]:
    """Readings in the seats of a bar of 500 mm at two places."""
    made = ta.simulate(
        "measuring7", poses=60, strategy="seat", reference=False, seats=3, bars=2, bar_mm=500, seed=2, arm_seed=9
    )
    assert made.lengths is not None
    return made.session, made.lengths


def fitted(session: Session, lengths: Lengths | None = None, *, arm: str = "ur10") -> str:
    return str(ta.fit(arm, session, lengths=lengths, model="kinematic"))


def with_bar(mm_more: float) -> str:
    session, lengths = in_seats()
    return fitted(session, replace(lengths, length_mm=lengths.length_mm + mm_more), arm="measuring7")


def board(scale: float) -> str:
    """Poses of a board on the flange, whose squares are larger than stated by a scale."""
    session = measured("ur5", poses=25)
    R = Rotation.from_matrix(ta.load_arm("ur5").chain.pose(session.angles).R_base_tip)
    return fitted(replace(session, points=session.points * scale, quaternion=R.as_quat(scalar_first=True)), arm="ur5")


@mistake("a bar typed 505 for 500 mm, seats only", said=LONGER)
def bar_1_percent() -> str:
    return with_bar(5.0)


@mistake("a bar typed 520 for 500 mm, seats only", said=LONGER)
def bar_4_percent() -> str:
    return with_bar(20.0)


@mistake("a bar typed 500 for 501 mm, seats only", said=SHORTER)
def bar_2_permille() -> str:
    return with_bar(-1.0)


@mistake("points of a tracker times 1.005", said=LONGER)
def tracker_scale() -> str:
    return fitted(measured(scale=1.005))


@mistake("points of a tracker times 0.997, of an arm from a workshop", said=SHORTER)
def tracker_scale_of_shop() -> str:
    return fitted(measured(scale=0.997, preset="shop"))


@mistake("poses of a board with squares of 30 mm stated as 25.5", said=SHORTER)
def smaller_board() -> str:
    return board(0.85)


@mistake("poses of a board printed at 103 %", said=SHORTER)
def printed_at_97_percent() -> str:
    return board(0.97)


@right("the bar as certified", unsaid="than drawn")
def right_bar() -> str:
    return with_bar(0.0)


@right("poses of a board as stated", unsaid="than drawn")
def right_board() -> str:
    return board(1.0)


@right("an arm of aluminium in 30 degC", unsaid="no arm is made so")
def warm_aluminium() -> str:
    return fitted(measured(scale=1 + 23e-6 * 10))


@right("a printed arm with links 0.7 % too long", unsaid="than drawn|contradict")
def shrunk_plastic() -> str:
    return fitted(measured("so101", scale=1.007, preset="printed"), arm="so101")


@right("nine readings", unsaid="than drawn|contradict")
def few_readings() -> str:
    return fitted(measured(poses=9))


@right("a rough drawing that says so", unsaid="no arm is made so")
def rough_drawing() -> str:
    arm = replace(ta.load_arm("ur10"), nominal_error_mm=12.0)
    return str(ta.fit(arm, measured(scale=1.005), model="kinematic"))


@mistake("points of the controller's own forward kinematics, to 0.01 mm", said="calculated from the angles")
def calculated_points() -> str:
    session = measured()
    points = ta.load_arm("ur10").chain.tip_in_base(session.angles)
    return fitted(Session(session.angles, np.round(points, 2)))


@right("points of a tracker to 0.01 mm, of an arm that its maker compensated", unsaid="calculated")
def rounded_points() -> str:
    session = measured(preset="shop")
    return fitted(replace(session, points=np.round(session.points, 2)))
