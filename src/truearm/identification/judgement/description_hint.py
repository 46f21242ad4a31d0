"""A refusal of readings that contradict the nominal arm says which mistake explains them, if one does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from truearm.arm.arm import Arm
from truearm.errors import InputError
from truearm.identification.judgement.description_check import check_description
from truearm.identification.judgement.reference_table import reference_table
from truearm.readings.lengths import Lengths
from truearm.readings.session import Session

# Mistakes that a hint names.
MOST_NAMED = 3


@contextmanager
def explaining(
    arm: Arm, readings: Session, *, lengths: Lengths | None = None, free: tuple[str, ...] = ("base", "tip")
) -> Iterator[None]:
    """Add what explains the readings to the hint of an `InputError` that is raised inside.

    Parameters
    ----------
    arm : Arm
        The nominal one.
    readings : Session
    lengths : Lengths, optional
        Known lengths between seats.
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown.
    """
    try:
        yield
    except InputError as error:
        explained = explain_readings(arm, readings, lengths=lengths, free=free)
        if explained is None:
            raise
        raise error.with_hint(f"{explained}; or {error.hint}" if error.hint else explained) from None


def explain_readings(
    arm: Arm, readings: Session, *, lengths: Lengths | None = None, free: tuple[str, ...] = ("base", "tip")
) -> str | None:
    """Which mistake in the arm file or the readings explains them, as a remedy; None if there is none to tell.

    Parameters are those of `explaining`. See `check_description`.
    """
    table = reference_table(readings, lengths, free=free)
    if table is None:
        return None
    check = check_description(arm, table)
    if not check.findings and check.stated.is_usual and readings.quaternion is not None and table.has_points:
        return (
            f"the points agree with the arm to {check.stated.error_mm:.2g} mm and the orientations do not: check their "
            "unit (--orientation-unit of import), the order of their numbers (quaternions: w first), and that they are "
            "of the flange in the frame of the reference"
        )
    if not check.findings:
        return None
    found = ", or ".join(str(one) for one in check.findings[:MOST_NAMED])
    return (
        f"put this right: {found} ({check.findings[0].error_mm:.2g} mm remain; `truearm arms` with your arm "
        f"file and --readings {readings.file or 'session.csv'} says more, and "
        "`truearm docs describe-your-arm` where each is put right)"
    )
