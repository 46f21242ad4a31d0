"""Diagnose: what is wrong in an arm file or a table of readings that contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from truearm.arm.arm import Arm
from truearm.arm.description_mistakes import mended_arm
from truearm.errors import InputError
from truearm.findings import format_mm
from truearm.identification.identify import compare_with_nominal, place
from truearm.identification.judgement.description_check import (
    DescriptionCheck,
    Explanation,
    check_description,
    likelier_arm,
)
from truearm.identification.judgement.nominal_check import NominalCheck
from truearm.identification.references.prepared_readings import PreparedReadings
from truearm.identification.references.reference_table import LEAST_READINGS, MOST_READINGS, reference_table
from truearm.readings import Lengths, Session, read_lengths
from truearm.readings.checks import check_angles, frozen_joints
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ArmLike, LengthsLike, SessionLike, to_arm, to_free_parts, to_session
from truearm.verbs.record import TableRecord, TextTable, columns_of

# Below this, errors of the constants move no reading against the others: rounding [mm].
_NO_EFFECT_MM = 1e-6
# Interpretations listed behind the findings.
N_OTHERS = 5


@one_blas_thread()
def diagnose(
    arm: ArmLike, session: SessionLike, *, lengths: LengthsLike | None = None, free: Iterable[str] = ("base", "tip")
) -> Diagnosis:
    """Find what a person got wrong in an arm file or a table of readings.

    Some 100 single mistakes are tried (signs, zeros, order and units of joints, signs of the constants of a table, its
    convention, units and handedness of the references), and all pairs of them where no single one explains the
    readings. A mistake is named if it explains most of the error, on readings held out; joints that yield under the
    weight of the arm are tried beside them. Nothing is changed.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    session : Session, DataFrame, str or Path
        Readings with reference points, or in seats.
    lengths : Lengths, str or Path, optional
        Known lengths between seats of the session.
    free : iterable of {"base", "tip"}
        What is unknown of the placement of the arm.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If the number of joints is wrong, or there are too few readings with points or in seats.

    Examples
    --------
    >>> import numpy as np
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=30, strategy="uniform", seed=1).session
    >>> wrong = ta.Session(session.angles * [1, 1, 1, -1, 1, 1], session.points)
    >>> ta.diagnose("ur10", wrong).check.findings[0].mistakes
    ('sign of J4 reversed',)
    """
    nominal = to_arm(arm)
    parts = to_free_parts(free)
    given = to_session(session, n_joints=nominal.n_joints)
    check_angles(given, n_joints=nominal.n_joints)
    known = lengths if lengths is None or isinstance(lengths, Lengths) else read_lengths(lengths)
    table = reference_table(given, known, free=parts)
    if table is None:
        raise InputError(
            f"expected {LEAST_READINGS} or more readings with a reference point or in a seat, the readings have fewer",
            file=given.file,
            hint="add columns x_mm, y_mm, z_mm, or a column seat with the names of seats",
        )
    judged = _as_fit_judges(nominal, given, known, parts)
    check = judged.description if judged is not None else None
    check = check or check_description(nominal, table)
    if not check.findings and (other := likelier_arm(nominal, table)) is not None:
        check = replace(check, findings=(other,))
    frozen = frozen_joints(given, nominal.chain.is_prismatic)
    return Diagnosis(nominal, check, n_given=len(given), judged=judged, frozen=frozen)


def _as_fit_judges(arm: Arm, session: Session, lengths: Lengths | None, free: tuple[str, ...]) -> NominalCheck | None:
    """How `fit` judges the nominal arm; None where it refuses the readings for another reason."""
    try:
        readings = PreparedReadings.of(arm, session, lengths, free=free, robust=True)
        return compare_with_nominal(readings, place(readings))
    except InputError:
        return None


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(TableRecord):
    """What explains the readings of an arm that contradict its description.

    Attributes
    ----------
    arm : Arm
        As it was given.
    check : DescriptionCheck
        The arm as stated, the mistakes that explain the readings, and the next likely ones.
    n_given : int
        Number of readings of the session.
    judged : NominalCheck or None
        How `fit` judges the nominal arm: what its constants and gains of its joints explain.
    frozen : tuple of str
        Joints whose angle stands still for some readings though the others move.
    """

    arm: Arm
    check: DescriptionCheck
    n_given: int
    judged: NominalCheck | None = None
    frozen: tuple[str, ...] = ()

    def mended_arm(self) -> Arm:
        """The arm without the mistake that was found. `truearm.arm.write_arm` writes it.

        Raises
        ------
        InputError
            If none was found, or several that the readings do not distinguish, or it is in the readings.
        """
        if len(self.check.findings) != 1:
            raise InputError(f"there is no single mistake to mend. {self.summary()}")
        found = self.check.findings[0].mistakes
        source = f"{self.arm.source}; mended: {' and '.join(found)}".strip("; ")
        return replace(mended_arm(self.arm, found), source=source)

    def summary(self) -> str:
        """The answer in one sentence."""
        stated, findings = self.check.stated, self.check.findings
        of = "its reference points" if self.check.has_points else "the means of its seats"
        if findings:
            first = findings[0]
            return f"{first}: {format_mm(stated.error_mm)} as stated, {format_mm(first.error_mm)} if this is put right."
        if stated.usual_mm < _NO_EFFECT_MM:
            return (
                "The poses of these readings show nothing of the arm: no error of its constants would be seen in them. "
                "Read at poses in which all joints move."
            )
        if stated.is_usual:
            return (
                f"The readings do not contradict the arm: it misses {of} by {format_mm(stated.error_mm)}, and arms "
                f"like it miss by up to {format_mm(stated.usual_mm)}."
            )
        if (sagging := self.check.sagging) is not None:
            return (
                f"No mistake in the arm file: {sagging}. It misses {of} by {format_mm(stated.error_mm)} as stated, and "
                f"by {format_mm(sagging.error_mm)} with that: --model physical identifies it."
            )
        beside = None if self.judged is None else self.judged.beside_mistakes
        if beside is not None:
            return f"{beside}. As stated the arm misses {of} by {format_mm(stated.error_mm)}."
        return (
            f"No known mistake explains the readings: the arm misses {of} by {format_mm(stated.error_mm)}, and arms "
            f"like it miss by up to {format_mm(stated.usual_mm)}."
        )

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record.blocks`."""
        check = self.check
        yield self.summary()
        yield from self.frozen
        yield from self.arm.remarks
        if len(check.findings) > 1:
            yield f"These readings do not tell {len(check.findings)} mistakes apart: look at the arm for each of them."
        rows = self._interpretations()
        yield TextTable(
            ("what is wrong", "error mm", "usual mm", ""),
            [(name, f"{one.error_mm:.3g}", f"{one.usual_mm:.2g}", self._verdict(one)) for name, one in rows],
            left_aligned=(0, 3),
        )
        yield (
            f"error: three of four of {check.n_readings} readings miss by less, with base and tip fitted; usual: what "
            f"errors of the constants cause. {check.n_tried} interpretations were tried."
        )
        if check.n_readings < self.n_given:
            yield f"Compared: {check.n_readings} of {self.n_given} readings, {self._which_readings()}."
        if check.stated.is_usual or check.sagging is not None:
            yield "Nothing was changed."
        else:
            yield "Nothing was changed: correct the arm file or the readings, and run this again."

    def _which_readings(self) -> str:
        if self.check.n_readings == MOST_READINGS:
            return "evenly spaced: what is wrong in an arm file shows in each of them"
        what = "a reference point" if self.check.has_points else "a seat"
        return (
            f"those with {what}, of one session and tip, and with such "
            "readings before and after them: a shift of the references by one row is tried too"
        )

    def _interpretations(self) -> list[tuple[str, Explanation]]:
        """The arm as stated, what explains the readings, and other interpretations where it is contradicted."""
        check = self.check
        others = () if check.stated.is_usual else check.others[:N_OTHERS]
        explain = (*check.findings, *(() if check.sagging is None else (check.sagging,)), *others)
        return [("as stated", check.stated), *((str(one), one) for one in explain)]

    def columns(self) -> dict[str, list[Any]]:
        """A row for the arm as stated and for each interpretation beside it; ``log_odds`` are against it as stated."""
        return columns_of(
            {
                "interpretation": name,
                "error_mm": one.error_mm,
                "usual_mm": one.usual_mm,
                "log_odds": one.log_odds,
                "verdict": self._verdict(one),
            }
            for name, one in self._interpretations()
        )

    def _verdict(self, one: Explanation) -> str:
        if one in self.check.findings or one is self.check.sagging:
            return "explains the readings"
        return "" if one.is_plausible else "contradicted"

    def _json(self) -> object:
        check = self.check
        return {
            "summary": self.summary(),
            "arm": self.arm.name,
            "references": "points" if self.check.has_points else "seats",
            "is_contradicted": not check.stated.is_usual,
            "stated": check.stated,
            "findings": check.findings,
            "sagging": check.sagging,
            "others": check.others,
            "n_readings": check.n_readings,
            "n_tried": check.n_tried,
        }
