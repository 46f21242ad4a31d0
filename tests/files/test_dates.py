"""Days in the past: tomorrow may be today elsewhere, next week is a mistake."""

import datetime

import pytest

from refusals import refuses
from truearm.files import dates


def test_a_day_is_past_within_a_day_of_now(monkeypatch):
    monkeypatch.setattr(dates, "now", lambda: datetime.datetime(2026, 11, 3, 23, 30))
    for day in (datetime.date(2026, 11, 4), datetime.date(1999, 1, 1), datetime.datetime(2026, 11, 4, 23, 30)):
        dates.check_past(day)
    for day, told in (
        (datetime.date(2026, 11, 5), "the date 2026-11-05 is in the future"),
        (datetime.datetime(2026, 11, 4, 23, 31), "the date 2026-11-04 23:31:00 is in the future"),
    ):
        refuses(told, dates.check_past, day)


def test_a_clock_that_was_set_back_is_named(monkeypatch):
    monkeypatch.setattr(dates, "now", lambda: datetime.datetime(2001, 1, 1, 0, 5))
    assert "set the clock of this computer, which says 2001-01-01" in str(refuses(None, dates.parse_day, "2026-03-01"))


@pytest.mark.parametrize("text", ["2026-03-01", "01.03.2026", "1.3.2026"])
def test_a_day_is_written_year_first_or_with_points(text):
    assert dates.parse_day(text) == datetime.date(2026, 3, 1)


@pytest.mark.parametrize("text", ["3/1/2026", "2026-3-1", "31.02.2026", "1.3.26", "", "01.03.2999"])
def test_other_days_are_refused(text):
    refuses("expected a date|in the future", dates.parse_day, text)
