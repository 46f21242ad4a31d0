"""Dates of measurements and signatures: checked and printed in one way."""

from __future__ import annotations

import datetime
import re

from truearm.errors import InputError


def now() -> datetime.datetime:
    """Return the local time to the second."""
    return datetime.datetime.now().replace(microsecond=0)


def check_past(day: datetime.date | datetime.datetime) -> None:
    """Check that a day, or a moment of local time, is not in the future.

    Raises
    ------
    InputError
        If it is more than a day ahead; clocks and time zones differ by less.
    """
    moment = day if isinstance(day, datetime.datetime) else datetime.datetime.combine(day, datetime.time())
    if moment > (clock := now()) + datetime.timedelta(days=1):
        raise InputError(
            f"the date {day} is in the future",
            hint="write year, month, day: 2026-11-03; to rehearse the coming months, state days in the past; or set "
            f"the clock of this computer, which says {clock:%Y-%m-%d}",
        )


def parse_day(text: str) -> datetime.date:
    """Read a day in the past: ``2026-11-03``, or with points ``03.11.2026``, as many spreadsheets save it.

    Days between slashes are refused: 3/11/2026 means two days.

    Raises
    ------
    InputError
        If the text is no day, or the day is in the future.
    """
    day_first = re.fullmatch(r"(\d{1,2})\.(\d{1,2})\.(\d{4})", text, re.ASCII)
    try:
        day = datetime.date(*map(int, day_first.groups()[::-1])) if day_first else datetime.date.fromisoformat(text)
    except ValueError:
        hint = "write year, month, day: 2026-03-31"
        raise InputError(f"expected a date, got {text!r:.80}", hint=hint) from None
    check_past(day)
    return day


def parse_moment(text: str) -> datetime.datetime:
    """Read a day, or a day and a time, in the past: ``2026-11-03``, ``2026-11-03T08:30``.

    Returns
    -------
    datetime.datetime
        Local time to the second, without a zone.

    Raises
    ------
    InputError
        If the text is no date, or the date is in the future.
    """
    try:
        moment = datetime.datetime.fromisoformat(text)
        if moment.tzinfo is not None:
            moment = moment.astimezone().replace(tzinfo=None)  # may be before year 1 or after 9999
    except (ValueError, OverflowError):
        raise InputError(f"expected a date, got {text!r:.80}", hint="write 2026-11-03 or 2026-11-03T08:30") from None
    check_past(moment)
    return moment.replace(microsecond=0)


def format_date(date: datetime.datetime) -> str:
    """Format a moment for tables: the day, and the time to the minute unless it is midnight."""
    return date.date().isoformat() if date.time() == datetime.time() else date.isoformat(sep=" ", timespec="minutes")
