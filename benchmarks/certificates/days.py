"""Days out of order: of the campaign when it is certified, and in a certificate that is read."""

from __future__ import annotations

import datetime
from dataclasses import replace

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import ASME, DAY, ISO, Edits, PointsChange, campaign, file, read_edited
from benchmarks.certificates.copies import both
from truearm.wings.laboratory.standards.measured_points import read_points

TODAY = datetime.date.today()
LATER = TODAY + datetime.timedelta(days=40)


def measured_on(*days: datetime.date) -> PointsChange:
    """All points on a day; of more days those of each test on the next one."""

    def change(given):  # type: ignore[no-untyped-def]
        names = list(given.tests)
        tests = {
            name: tuple(replace(one, date=days[min(i, len(days) - 1)]) for one in given.tests[name])
            for i, name in enumerate(names)
        }
        return replace(given, tests=tests)

    return change


def of_artefact(name: str, key: str, day: str) -> Edits:
    """Another day of an artefact in its file."""
    return [(rf'(name = "{name}"\n.*?\n{key} = )\d{{4}}-\d\d-\d\d', rf"\g<1>{day}")]


# When the campaign is certified --------------------------------------------------------------------------------------

IN_ABOUT = {
    "issued before the last points were measured": (
        "issued = [0-9-]+",
        "issued = 2026-01-19",
        "before the last points",
    ),
    "issued in the future": ("issued = [0-9-]+", f"issued = {LATER}", "in the future"),
    "received after points were measured": (
        "received = [0-9-]+",
        "received = 2026-01-25",
        "after points were measured",
    ),
    "received after the issue": ("received = [0-9-]+", "received = 2026-02-11", "before the arm was received"),
    "issued on a day that no calendar has": ("issued = [0-9-]+", "issued = 2026-02-30", "line 2"),
}
for _what, (_before, _after, _said) in IN_ABOUT.items():
    mistake(f"a certificate {_what}", said=_said)(
        lambda before=_before, after=_after: campaign(about=[(before, after)]).stated()
    )
IN_PLAN = {
    "confirmed after the issue": ("date = 2026-01-15", "date = 2026-02-20", "before the numbers of the test plan were"),
    "confirmed in the future": ("date = 2026-01-15", f"date = {LATER}", "in the future"),
    "confirmed before its standard was published": ("date = 2026-01-15", "date = 2014-01-15", "was published"),
}
for _what, (_before, _after, _said) in IN_PLAN.items():
    mistake(f"a plan {_what}", said=_said)(
        lambda before=_before, after=_after: campaign(plan=[(before, after)]).stated()
    )
for _name, _standard in {"ball": ISO, "bar": ISO, "seat": ASME}.items():
    for _what, _key, _day, _said in (
        ("calibrated after the measurement", "date", "2026-01-25", "was calibrated on 2026-01-25"),
        ("whose certificate had expired", "expires", "2026-01-19", "expired on 2026-01-19"),
        ("whose certificate ends before it begins", "expires", "2025-12-01", "not after its calibration"),
    ):
        mistake(f"a {_name} {_what}", said=_said)(
            lambda standard=_standard, of=(_name, _key, _day): campaign(standard, artefacts=of_artefact(*of)).stated()
        )


@mistake("points of one test 32 months after those of another", said="days apart")
def months_apart() -> str:
    return campaign(
        points=measured_on(DAY, datetime.date(2023, 5, 1)), artefacts=[("date = 2026-01-01", "date = 2023-01-01")]
    ).stated()


def points_of(*rows: str) -> str:
    head = "test,artefact,date,position,x_mm,y_mm,z_mm"
    return str(read_points(file("\n".join([head, *rows]) + "\n", "csv")))


@mistake("points of one group on two days", said="points of one group were measured on")
def two_days_in_a_group() -> str:
    return points_of("single_point,seat,2026-01-20,1,0,0,0.1", "single_point,seat,2026-01-21,1,0,0,0.2")


@mistake("points measured in the future", said="in the future")
def points_of_tomorrow() -> str:
    return points_of(f"single_point,seat,{LATER},1,0,0,0.1")


@mistake("points on a day that may be March or November", said="expected a date")
def day_or_month() -> str:
    return points_of("single_point,seat,3/11/2025,1,0,0,0.1")


@mistake("results as found that were measured after those as left", said="after the first points as left")
def found_after_left() -> str:
    return both(campaign(ASME), campaign(ASME, seed=2, points=measured_on(DAY + datetime.timedelta(days=5))))


@mistake("an artefact that had expired when the arm was found", said="was calibrated on 2026-01-01")
def found_without_calibration() -> str:
    return both(campaign(ASME), campaign(ASME, seed=2, points=measured_on(datetime.date(2025, 12, 20))))


@mistake("as found with another calibration of the artefacts than as left", said="by certificate K-77 of")
def calibrated_between() -> str:
    before = [
        ("date = 2026-01-01", "date = 2024-01-01"),
        ("expires = 2028-01-01", "expires = 2026-01-01"),
        ('"K-101"', '"K-77"'),
    ]
    found = campaign(ASME, seed=2, artefacts=before, points=measured_on(datetime.date(2025, 12, 20)))
    return both(campaign(ASME), found)


@mistake("as found years before the adjustment that the certificate states", said="days before those as left")
def found_long_before() -> str:
    old = [("date = 2026-01-01", "date = 2022-01-01")]
    found = campaign(ASME, seed=2, artefacts=old, points=measured_on(datetime.date(2022, 6, 1)))
    return both(campaign(ASME, artefacts=old), found)


# When it is read -----------------------------------------------------------------------------------------------------

READ = {
    "issued before the last points": ("issueDate>[0-9-]+", "issueDate>2026-01-19", "before the last points"),
    "issued in the future": ("issueDate>[0-9-]+", f"issueDate>{LATER}", "in the future"),
    "measured to a day before its begin": (
        "endPerformanceDate>[0-9-]+",
        "endPerformanceDate>2026-01-19",
        "measured from 2026-01-20 to 2026-01-19",
    ),
    "received after points were measured": ("receiptDate>[0-9-]+", "receiptDate>2026-01-21", "after points were"),
    "received after the issue": ("receiptDate>[0-9-]+", "receiptDate>2026-03-21", "before the arm was received"),
    "measured earlier than its own statement says": (
        "beginPerformanceDate>[0-9-]+",
        "beginPerformanceDate>2026-01-18",
        "days of the measurement",
    ),
    "measured later than its own statement says": (
        "(begin|end)PerformanceDate>[0-9-]+",
        r"\1PerformanceDate>2026-02-01",
        "days of the measurement",
    ),
    "with a plan that was confirmed after the issue": (
        r"Second Example on [0-9-]+",
        "Second Example on 2026-02-11",
        "before the test plan was confirmed",
    ),
    "with a plan that was confirmed before its standard": (
        r"Second Example on [0-9-]+",
        "Second Example on 2012-02-11",
        "was published",
    ),
}
for _what, (_before, _after, _said) in READ.items():
    mistake(f"an unsigned certificate, changed: {_what}", said=_said)(
        lambda before=_before, after=_after: read_edited((before, after))
    )
for _name, _standard in {"sphere ball": ISO, "bar bar": ISO, "seat seat": ASME}.items():
    for _what, _days, _said in (
        ("calibrated after the measurement", ("2026-02-01", "2028-01-01"), "was calibrated on 2026-02-01"),
        ("that had expired", ("2023-01-01", "2025-12-31"), "expired on 2025-12-31"),
        ("whose certificate ends before it begins", ("2026-01-01", "2025-12-01"), "expired on 2025-12-01"),
        ("calibrated on another day than its traceability says", ("2025-06-01", "2028-01-01"), "traceability"),
    ):
        mistake(f"an unsigned certificate, changed: {_name} {_what}", said=_said)(
            lambda name=_name, standard=_standard, days=_days: read_edited(
                (
                    rf"(>{name}<.*?)Calibrated on [0-9-]+, certificate valid until [0-9-]+",
                    rf"\1Calibrated on {days[0]}, certificate valid until {days[1]}",
                ),
                standard=standard,
            )
        )


# What is right -------------------------------------------------------------------------------------------------------


@right("a campaign of three days", unsaid="contradict|refused|apart")
def three_days() -> str:
    return campaign(points=measured_on(DAY, DAY + datetime.timedelta(1), DAY + datetime.timedelta(2))).stated()


@right("a campaign that was interrupted for two weeks", unsaid="contradict|days apart")
def interrupted() -> str:
    return campaign(points=measured_on(DAY, DAY + datetime.timedelta(14))).stated()


@right("all in one day: calibrated, received, confirmed, measured and issued", unsaid="before|after points|expired")
def all_in_one_day() -> bool:
    made = campaign(
        about=[("issued = [0-9-]+", f"issued = {DAY}"), ("received = [0-9-]+", f"received = {DAY}")],
        plan=[("date = 2026-01-15", f"date = {DAY}")],
        artefacts=[("date = 2026-01-01", f"date = {DAY}")],
    ).certified()
    return made.certificate.conformity == "pass"


@right("measured on the last day of the artefacts' certificates", unsaid="expired")
def last_day() -> str:
    return campaign(artefacts=[("expires = 2028-01-01", f"expires = {DAY}")]).stated()


@right("issued three weeks later, when an artefact's certificate had ended", unsaid="expired")
def issued_after_expiry() -> str:
    return campaign(artefacts=[("expires = 2028-01-01", "expires = 2026-01-31")]).stated()


@right("a day of receipt that nobody stated", unsaid="received")
def no_receipt() -> str:
    return campaign(about=[("received = [0-9-]+\n", "")]).stated()


@right("as found ten days before as left", unsaid="copy|days apart|refused")
def found_ten_days_before() -> str:
    return both(campaign(ASME), campaign(ASME, seed=2, points=measured_on(DAY - datetime.timedelta(days=10))))


@right("days with points, as a spreadsheet saves them", unsaid="expected a date")
def days_with_points() -> str:
    return points_of("single_point,seat,20.01.2026,1,0,0,0.1", "single_point,seat,20.01.2026,1,0,0,0.2")


@right("a certificate of an artefact in the words of another version", unsaid="contradict")
def other_words_of_days() -> str:
    return read_edited(("Calibrated on (2026-01-01), certificate valid until ", r"Certificate of \1, expires "))
