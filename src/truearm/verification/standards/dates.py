"""Days on which something was measured or signed: they lie in the past, or a figure of the year is mistyped."""

from __future__ import annotations

import datetime

from truearm.errors import InputError


def now() -> datetime.datetime:
    """Local time to the second."""
    return datetime.datetime.now().replace(microsecond=0)


def check_past(day: datetime.date | datetime.datetime) -> None:
    """Check that a day, or a moment of local time, has come.

    Raises
    ------
    InputError
        If it lies more than a day ahead: clocks and time zones differ by less.
    """
    moment = day if isinstance(day, datetime.datetime) else datetime.datetime.combine(day, datetime.time())
    if moment > now() + datetime.timedelta(days=1):
        raise InputError(f"the date {day} is in the future", hint="year, month, day: 2026-11-03")
