"""What people get wrong when they describe an arm or tabulate its readings, each as a change that mends it.

An `Interpretation` says how an arm file and a table of readings are to be understood: the rows of the table, what the
columns of angles mean, the units and the handedness of the references, and which reference belongs to which reading. A
`Mistake` changes one thing of it, as a person would correct it. Nothing here knows readings: which mistake explains
them is decided in `truearm.identification.judgement.description_check`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from truearm.arm.arm import Arm, with_zeros
from truearm.arm.catalogue import similar_arms
from truearm.arm.denavit_hartenberg import DHTable
from truearm.arm.nearest_table import drawn_convention, drawn_table, has_table_form
from truearm.choices import Convention
from truearm.errors import InputError
from truearm.typing import FloatArray

# The subject of a mistake that the arm itself is.
OTHER_ARM = "arm"
# A change below this is none: of a table [mm, rad] and of the meaning of the angles.
_NO_CHANGE = 1e-9
# What an interpretation says of readings alone.
_OF_READINGS = ("point_factor", "length_factor", "shift")
# Units in which lengths are entered as if they were mm.
ARM_UNITS_MM = {"m": 1e3, "cm": 10.0, "inch": 25.4}
POINT_UNITS_MM = {"m": 1e3, "cm": 10.0, "inch": 25.4, "ft": 304.8, "um": 1e-3}
# What is read as degrees was divided by 57.3.
_ANGLE_UNITS = ((180 / np.pi, "in rad, stated in deg"), (np.pi / 180, "in deg, stated in rad"))
# 400 gon are a turn. Of a single joint that factor is the gain of a servo, which readings show.
_GON = ((0.9, "in gon, stated in deg"), (1 / 0.9, "in deg, stated in gon"))


@dataclass(frozen=True, eq=False)
class Interpretation:
    """How an arm's table and its readings are to be understood.

    Attributes
    ----------
    table : DHTable
        The rows of the arm.
    angle_matrix : (n_joints, n_joints) array
        The angles of the chain are ``angle_matrix @ stated + angle_offset``.
    angle_offset : (n_joints,) array
        [rad, or mm for sliding joints].
    point_factor, length_factor : float
        Of the reference points and of known lengths: mm by stated unit.
    points_turn : (3, 3) array
        The reference points are ``points_turn @ stated``: a mirrored axis, or two exchanged ones.
    shift : int
        The reference of reading i stands in row i + shift.
    """

    table: DHTable
    angle_matrix: FloatArray
    angle_offset: FloatArray
    point_factor: float = 1.0
    length_factor: float = 1.0
    points_turn: FloatArray = field(default_factory=lambda: np.eye(3))
    shift: int = 0

    @classmethod
    def stated(cls, arm: Arm) -> Interpretation:
        """The arm and its readings as they are stated."""
        n = arm.n_joints
        coupling = arm.chain.coupling
        return cls(_stated_table(arm), np.eye(n) if coupling is None else coupling, np.zeros(n))

    def angles(self, stated: FloatArray) -> FloatArray:
        """(m, n_joints) angles of the chain by the stated ones [rad, or mm]."""
        return stated @ self.angle_matrix.T + self.angle_offset

    def is_same(self, other: Interpretation) -> bool:
        """Whether both understand every arm file and every reading in the same way."""
        if any(getattr(self, name) != getattr(other, name) for name in _OF_READINGS):
            return False
        mine, theirs = (
            (one.angle_matrix, one.angle_offset, one.points_turn)
            + (() if self.table is other.table else (one.table.chain().fixed, one.table.tip_in_flange))
            for one in (self, other)
        )
        return all(np.abs(a - b).max() < _NO_CHANGE for a, b in zip(mine, theirs, strict=True))


@dataclass(frozen=True)
class Mistake:
    """One thing that a person got wrong.

    Attributes
    ----------
    description : str
        What is wrong, as a part of a sentence: "sign of J4 reversed".
    mend : callable
        Returns the interpretation without it.
    subject : str
        What it concerns. Two mistakes of one subject do not occur together.
    shown_by : int or None
        The joint, counted from 0, without whose movement no readings show it.
    """

    description: str
    mend: Callable[[Interpretation], Interpretation]
    subject: str
    shown_by: int | None = None


def likely_mistakes(
    arm: Arm, *, has_points: bool = True, has_lengths: bool = False, base_is_known: bool = False
) -> tuple[Mistake, ...]:
    """List the mistakes that can be made with an arm, without those that would change nothing.

    Parameters
    ----------
    arm : Arm
        Mistakes in a table are listed if its chain has the form of one, as arms of TOML files have.
    has_points, has_lengths : bool
        Whether the readings have reference points, and known lengths between seats.
    base_is_known : bool
        Whether it matters which axis of the points is mirrored; a base that is fitted turns one case into another.
    """
    stated = Interpretation.stated(arm)
    found = [*other_arms(arm), *_of_joints(arm), *_of_pairs(arm), *_of_all_angles(arm), *_of_units()]
    if stated.table is arm.table or has_table_form(arm.chain):
        found += _of_rows(arm, stated.table)
    if has_points:
        found += _of_points(base_is_known)
    if has_lengths:
        for unit, mm in ARM_UNITS_MM.items():
            found.append(Mistake(f"known lengths are in {unit}, stated in mm", _with(length_factor=mm), "length unit"))
    for step, where in ((1, "later"), (-1, "earlier")):
        found.append(Mistake(f"references stand one row {where} than their readings", _with(shift=step), "rows"))
    return tuple(mistake for mistake in found if _changes(mistake, stated))


def other_arms(arm: Arm) -> list[Mistake]:
    """An arm of the catalogue was taken for one with a similar name."""

    def mend(other: Arm) -> Callable[[DHTable], DHTable]:
        return lambda table: replace(_stated_table(other), tip_in_flange=table.tip_in_flange)

    others = similar_arms(arm)
    return [Mistake(f"the arm is {one.name}, not {arm.name}", _of_table(mend(one)), OTHER_ARM) for one in others]


def mended_arm(arm: Arm, descriptions: Sequence[str]) -> Arm:
    """The arm without mistakes, by their descriptions: its table, zeros and the meaning of its angles.

    Signs, order and sums of angles become its coupling; of joints that it changes the limits are not known.

    Raises
    ------
    InputError
        If a mistake is in the table of readings: units, references.
    """
    stated = one = Interpretation.stated(arm)
    for mistake in likely_mistakes(arm, has_lengths=True, base_is_known=True):
        if mistake.description in descriptions:
            if mistake.subject == OTHER_ARM:
                raise InputError(
                    f"no file of {arm.name} mends this: {mistake.description}", hint="give that arm's name"
                )
            one = mistake.mend(one)
    points = (one.points_turn == stated.points_turn).all()
    matrix = one.angle_matrix
    is_of_arm = points and all(getattr(one, name) == getattr(stated, name) for name in _OF_READINGS)
    if (
        not is_of_arm
        or one is stated
        or not np.isin(np.abs(matrix @ np.linalg.pinv(stated.angle_matrix)), [0, 1]).all()
    ):
        raise InputError(
            f"no arm file mends this: {' and '.join(descriptions)}",
            hint="correct the readings; truearm import has options",
        )
    own = (matrix == stated.angle_matrix).all(axis=1)
    chain = replace(arm.chain if one.table is stated.table else one.table.chain(), coupling=matrix)
    lower, upper = np.where(own[:, None], arm.limits, [-np.inf, np.inf]).T
    at_encoders = np.linalg.lstsq(matrix, arm.chain.joint_angles(arm.working), rcond=None)[0]
    working = np.clip(np.where(own, arm.working, at_encoders), lower, upper)
    found = replace(arm, chain=chain, lower=lower, upper=upper, working_pose=working, table=None)
    return with_zeros(found, one.angle_offset) if one.angle_offset.any() else found


def _changes(mistake: Mistake, stated: Interpretation) -> bool:
    """Whether an arm without the mistake can exist and is another one."""
    try:
        return not mistake.mend(stated).is_same(stated)
    except InputError:  # a length in km
        return False


def _stated_table(arm: Arm) -> DHTable:
    """The table of the arm's file if it still is that of its chain, else one that is read off the chain."""
    table, fixed = arm.table, arm.chain.fixed
    if table is not None and len(table.a) == arm.n_joints:
        chain = table.chain()
        off = max(np.abs(chain.fixed - fixed).max(), np.abs(chain.tip_in_flange - arm.chain.tip_in_flange).max())
        if off < _NO_CHANGE:
            return table
    return drawn_table(arm.chain, drawn_convention(arm.chain))


def _with(**changes: object) -> Callable[[Interpretation], Interpretation]:
    """A change of plain fields."""
    return lambda one: replace(one, **changes)  # type: ignore[arg-type]


def _of_stated_angles(matrix: FloatArray) -> Callable[[Interpretation], Interpretation]:
    """The stated angles are first multiplied by a matrix: their columns mean something else."""
    return lambda one: replace(one, angle_matrix=one.angle_matrix @ matrix)


def _of_offset(joint: int, offset: float) -> Callable[[Interpretation], Interpretation]:
    """The zero of a joint of the chain is elsewhere."""

    def mend(one: Interpretation) -> Interpretation:
        return replace(one, angle_offset=one.angle_offset + offset * (np.arange(len(one.angle_offset)) == joint))

    return mend


def _of_table(change: Callable[[DHTable], DHTable]) -> Callable[[Interpretation], Interpretation]:
    return lambda one: replace(one, table=change(one.table))


def _scaled(n: int, joints: list[int], factor: float) -> FloatArray:
    """A matrix that multiplies the angles of joints by a factor."""
    diagonal = np.ones(n)
    diagonal[joints] = factor
    return np.diag(diagonal)


def _of_joints(arm: Arm) -> Iterator[Mistake]:
    """Sign, zero and unit of each joint."""
    n = arm.n_joints
    for j in range(n):
        name = f"J{j + 1}"
        yield Mistake(f"sign of {name} reversed", _of_stated_angles(_scaled(n, [j], -1.0)), f"sign {j}", j)
        if arm.chain.is_prismatic[j]:
            for unit, mm in ARM_UNITS_MM.items():
                matrix = _scaled(n, [j], mm)
                yield Mistake(f"{name} is in {unit}, stated in mm", _of_stated_angles(matrix), f"unit {j}", j)
            continue
        for degrees in (90, -90, 180):
            mend = _of_offset(j, np.radians(degrees))
            yield Mistake(f"zero of {name} off by {degrees} deg: add {degrees} deg to its theta", mend, f"zero {j}")
        for factor, says in _ANGLE_UNITS:
            yield Mistake(f"{name} is {says}", _of_stated_angles(_scaled(n, [j], factor)), f"unit {j}", j)


def _of_pairs(arm: Arm) -> Iterator[Mistake]:
    """Exchanged joints, and angles that a parallelogram or a belt measures against the base or another link."""
    n, slides = arm.n_joints, arm.chain.is_prismatic
    for i, j in combinations(range(n), 2):
        if slides[i] == slides[j]:
            order = list(range(n))
            order[i], order[j] = j, i
            yield Mistake(f"J{i + 1} and J{j + 1} exchanged", _of_stated_angles(np.eye(n)[order]), "order")
    for i in range(n - 1):
        if slides[i] or slides[i + 1]:
            continue
        for factor, word in ((-1.0, "contains that of"), (1.0, "lacks that of")):
            matrix = np.eye(n)
            matrix[i + 1, i] = factor
            says = f"angle of J{i + 2} {word} J{i + 1} (coupled joints)"
            yield Mistake(says, _of_stated_angles(matrix), f"coupling {i}", i)


def _of_all_angles(arm: Arm) -> Iterator[Mistake]:
    n, slides = arm.n_joints, arm.chain.is_prismatic
    turning = np.flatnonzero(~slides).tolist()
    if not slides.any():
        yield Mistake("joints in reverse order", _of_stated_angles(np.eye(n)[::-1]), "order")
    yield Mistake("signs of all joints reversed", _of_stated_angles(-np.eye(n)), "all signs")
    for factor, says in (*_ANGLE_UNITS, *_GON):
        yield Mistake(f"all angles are {says}", _of_stated_angles(_scaled(n, turning, factor)), "all units")


def _of_rows(arm: Arm, table: DHTable) -> Iterator[Mistake]:
    """Signs and places of the constants in a table."""

    def changed(name: str, i: int, by: Callable[[DHTable], float]) -> Callable[[DHTable], DHTable]:
        def change(one: DHTable) -> DHTable:
            column = getattr(one, name).copy()
            column[i] = by(one)
            return replace(one, **{name: column})

        return change

    for i in range(arm.n_joints):
        for name in ("alpha", "a", "d"):
            mend = _of_table(changed(name, i, lambda one, name=name, i=i: -getattr(one, name)[i]))  # type: ignore[misc]
            yield Mistake(f"sign of {name} of J{i + 1} reversed", mend, f"{name} {i}")

        def exchange(one: DHTable, i: int = i) -> DHTable:
            a, d = one.a.copy(), one.d.copy()
            a[i], d[i] = one.d[i], one.a[i]
            return replace(one, a=a, d=d)

        yield Mistake(f"a and d of J{i + 1} exchanged", _of_table(exchange), f"a {i}")
    other: Convention = "mdh" if table.convention == "dh" else "dh"
    says = f'the table is of convention "{other}", stated "{table.convention}"'
    yield Mistake(says, _of_table(lambda one: replace(one, convention=other)), "convention")
    for factor, says in _ANGLE_UNITS:
        mend = _of_table(lambda one, f=factor: replace(one, alpha=f * one.alpha, theta=f * one.theta))  # type: ignore[misc]
        yield Mistake(f"alpha and theta of the arm are {says}", mend, "table angles")


def _of_units() -> Iterator[Mistake]:
    """Unit of the arm's lengths."""
    for unit, mm in ARM_UNITS_MM.items():
        yield Mistake(f"lengths of the arm are in {unit}, stated in mm", _of_table(_sized(mm)), "arm unit")
    yield Mistake("lengths of the arm are in mm, stated in m", _of_table(_sized(1e-3)), "arm unit")


def _sized(factor: float) -> Callable[[DHTable], DHTable]:
    def change(one: DHTable) -> DHTable:
        frames = {}
        for name in ("base", "flange"):
            frame = getattr(one, name).copy()
            frame[:3, 3] *= factor
            frames[name] = frame
        lengths = {name: factor * getattr(one, name) for name in ("a", "d", "b", "tip_in_flange")}
        return replace(one, **lengths, **frames)

    return change


def _of_points(base_is_known: bool) -> Iterator[Mistake]:
    for unit, mm in POINT_UNITS_MM.items():
        yield Mistake(f"reference points are in {unit}, stated in mm", _with(point_factor=mm), "point unit")
    if not base_is_known:
        says = "frame of the reference points is left-handed (an axis mirrored, or two axes exchanged)"
        yield Mistake(says, _with(points_turn=np.diag([-1.0, 1.0, 1.0])), "handedness")
        return
    for i, axis in enumerate("xyz"):
        mirror = np.diag(np.where(np.arange(3) == i, -1.0, 1.0))
        yield Mistake(f"sign of {axis} of the reference points reversed", _with(points_turn=mirror), "handedness")
    for i, j in combinations(range(3), 2):
        order = list(range(3))
        order[i], order[j] = j, i
        says = f"{'xyz'[i]} and {'xyz'[j]} of the reference points exchanged"
        yield Mistake(says, _with(points_turn=np.eye(3)[order]), "handedness")
