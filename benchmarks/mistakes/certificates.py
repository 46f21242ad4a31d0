"""Certificates that would say more than was measured, and campaigns near them that are right."""

from __future__ import annotations

import datetime
import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import truearm as ta
from benchmarks.mistakes import mistake, right, seen
from benchmarks.rows import scratch
from truearm.verification.standards.coordinate_origin import NOT_STATED
from truearm.verification.standards.measured_points import MeasuredPoints, PointGroup
from truearm.verification.standards.verification_plan import plan_text

NUMBERS = itertools.count(1)
CONTRADICTED = "contradict|refused|expected|apart|not clause"
ABOUT = """\
number = "V-1"
issued = 2026-01-05
received = 2026-01-01
place = "laboratory"
item = {{ name = "arm", maker = "Example Arms", model = "A", serial_number = "10017" }}
set_up = {{ stylus = "ball of ruby, 6 mm", mounting = "granite table", software = "Example Measure 4.2" }}
laboratory = {{ name = "Example Laboratory", city = "Exampletown", country = "DE", post_code = "00000" }}
customer = {{ name = "Example Customer", city = "Exampleville", country = "FR", post_code = "00001" }}
persons = [{{ name = "First Example", main_signer = true }}]
conditions = {{ temperature_degC = [19.5, 20.5], relative_humidity_percent = {humidity} }}
"""


def file(text: str, ending: str) -> str:
    path = scratch() / f"certificate-{next(NUMBERS)}.{ending}"
    path.write_text(text, encoding="utf-8")
    return str(path)


@cache
def plan(source: str = "clause 6.2.3") -> ta.VerificationPlan:
    """The plan as a laboratory confirms it, with the place where it read every entry."""
    text = re.sub(
        'confirmed = false, source = "[^"]*"', f'confirmed = true, source = "{source}"', plan_text("iso10360-12")
    )
    text = text.replace("# [confirmation]", "[confirmation]").replace('# confirmed_by = ""', 'confirmed_by = "Example"')
    return ta.load_verification_plan(file(text.replace("# date = 1900-01-01", "date = 2026-01-01"), "toml"))


@cache
def campaign() -> tuple[MeasuredPoints, ta.Artefacts, ta.Specification]:
    """Points of an arm without errors, measured on 1 January 2026, its artefacts and limits."""
    made = ta.simulate_verification("perfect", n_arms=1)
    known = {"certificate": "K-1", "issued_by": "Example Calibration", "issuer_accreditation": "X-1"}
    artefacts = made.artefacts.model_dump(exclude_defaults=True)
    for one in (*artefacts["spheres"], *artefacts["bars"], *artefacts["seats"]):
        one |= known
    points = replace(made.points(0), origin=NOT_STATED, serial_number="10017")
    return points, ta.Artefacts.model_validate(artefacts), made.specification


def verified(
    *,
    points: Callable[[PointGroup], PointGroup] = lambda group: group,
    artefact: dict[str, object] | None = None,
    **specification: object,
) -> ta.VerificationResult:
    """The verification of the campaign with changes: of each group, of bars and spheres, of the specification."""
    measured, artefacts, limits = campaign()
    tests = {name: tuple(map(points, groups)) for name, groups in measured.tests.items()}
    changed = artefacts.model_dump(exclude_defaults=True)
    for one in (*changed["spheres"], *changed["bars"]):
        one |= artefact or {}
    return ta.verify(
        replace(measured, tests=tests),
        plan=plan(),
        artefacts=ta.Artefacts.model_validate(changed),
        specification=ta.Specification.model_validate(limits.model_dump(exclude_defaults=True) | specification),
    )


def certified(humidity: str = "[40.0, 55.0]", **changes: object) -> str:
    """The file of the certificate of the campaign."""
    result = ta.certificate(verified(**changes), file(ABOUT.format(humidity=humidity), "toml"))  # type: ignore[arg-type]
    path = str(scratch() / f"certificate-{next(NUMBERS)}.xml")
    result.save(path)
    return path


def read_changed(*changes: tuple[str, str]) -> str:
    """What is said of the certificate of the campaign after somebody changed its text; it is not signed."""
    path = certified()
    with open(path, encoding="utf-8") as read:
        text = read.read()
    for before, after in changes:
        if not re.search(before, text):
            raise ValueError(f"the certificate has no {before!r}")
        text = re.sub(before, after, text)
    return seen("certificate", "--read", file(text, "xml"))


def heated(degC: float) -> Callable[[PointGroup], PointGroup]:
    return lambda group: replace(group, degC=degC)


def on_another_day(day: datetime.date) -> Callable[[PointGroup], PointGroup]:
    """All points on the bar a day or more after those on the ball."""
    return lambda group: replace(group, date=day) if group.artefact == "bar" else group


@mistake("an arm of 250 mm that measured bars of 1700 mm", said="more than the measuring range of 250 mm")
def range_of_a_toy() -> str:
    return str(verified(measuring_range_mm=250.0))


@mistake("a range stated smaller so that a short bar is long enough", said="more than the measuring range of 1500 mm")
def range_to_fit_the_bar() -> str:
    return str(verified(measuring_range_mm=1500.0))


@mistake(
    "an artefact calibrated after the measurement, in an unsigned certificate", said="was calibrated on 2026-02-01"
)
def calibrated_later() -> str:
    return read_changed(("Calibrated on 2026-01-01", "Calibrated on 2026-02-01"))


@mistake("an artefact that had expired, in an unsigned certificate", said="expired on 2025-12-31")
def expired_before() -> str:
    return read_changed(("Calibrated on 2026-01-01, certificate valid until 2028-01-01",
                         "Calibrated on 2023-01-01, certificate valid until 2025-12-31"))  # fmt: skip


@mistake("an arm that arrived after it was measured, in an unsigned certificate", said="received on 2026-01-03")
def received_later() -> str:
    return read_changed(("receiptDate>2026-01-01", "receiptDate>2026-01-03"))


for _source in (
    "from memory, clause 5",
    "TODO",
    "clause 0",
    "clause 5 (to do: check)",
    "probably clause 6.1",
    "??? 5.1",
):
    mistake(f"an entry confirmed by the source {_source!r}", said="confirmed = true, but its source")(
        lambda source=_source: str(plan(source))
    )


@mistake("a limit of 25 mm: nanometres typed as micrometres", said="25000, too large for any arm")
def limit_in_nm() -> str:
    text = 'name = "arm"\nsource = "sheet"\nmeasuring_range_mm = 2500\n[limits]\nE_Uni = { B_um = 25000 }\n'
    return str(ta.read_specification(file(text, "toml")))


def points_file(column: str, value: str) -> str:
    rows = [f"single_point,cone,2026-01-20,1,0,0,{i / 1000},{value}" for i in range(10)]
    head = f"test,artefact,date,position,x_mm,y_mm,z_mm,{column}"
    return str(ta.read_points(file("\n".join([head, *rows]) + "\n", "csv")))


@mistake("a stylus tip of 0.01 mm", said="got 0.01")
def tip_in_other_units() -> str:
    return points_file("tip_diameter_mm", "0.01")


@mistake("a humidity of 0.40: a share in a column of per cent", said="from 2 to 100, got 0.4")
def humidity_as_a_share() -> str:
    return points_file("humidity_percent", "0.40")


@mistake("a room of 0.40 to 0.55 % relative humidity", said="drier than any room")
def room_as_a_share() -> str:
    return certified("[0.40, 0.55]")


@mistake("a thermometer without uncertainty at 28 degC", said="u_temperature_K = 0")
def exact_thermometer() -> str:
    return str(verified(points=heated(28.0), artefact={"u_temperature_K": 0.0}, rated_conditions={}))


@mistake("points of one test 32 months apart", said="days apart")
def months_apart() -> str:
    return str(
        verified(points=on_another_day(datetime.date(2028, 9, 1)), artefact={"expires": datetime.date(2030, 1, 1)})
    )


@mistake("an artefact whose serial number nobody stated", said="serial number not stated")
def no_serial_number() -> str:
    return str(verified())


@right("a verification and its certificate as they were measured", unsaid=CONTRADICTED)
def whole_campaign() -> str:
    return seen("certificate", "--read", certified())


@right("an arm that reaches 1 % beyond its range, which the maker rounds", unsaid="more than the measuring range")
def rounded_range() -> str:
    measured, *_ = campaign()
    places = [group.points.mean(axis=0) for group in measured.tests["uni"]]
    farthest = max(float(((one - other) ** 2).sum() ** 0.5) for one in places for other in places)
    return str(verified(measuring_range_mm=farthest / 1.01))


@right("a campaign of three days", unsaid=CONTRADICTED)
def three_days() -> str:
    return seen("certificate", "--read", certified(points=on_another_day(datetime.date(2026, 1, 3))))


@right("a campaign that was interrupted for five weeks", unsaid=CONTRADICTED)
def interrupted() -> str:
    return str(verified(points=on_another_day(datetime.date(2026, 2, 5))))


@right("a room at 28 degC with a real thermometer", unsaid="u_temperature_K")
def warm_room() -> str:
    return str(verified(points=heated(28.0), rated_conditions={}))


@right("the decision in the words of another version", unsaid=CONTRADICTED)
def other_words() -> str:
    return read_changed(
        (r"(<dcc:content lang=\"en\">)[^<]*: conform\. Limits: ", r"\1The arm is found to conform. Limits ")
    )


@right("traceability in the words of a version that asked for no accreditation", unsaid=CONTRADICTED)
def other_words_of_traceability() -> str:
    return read_changed(
        ("(?s)<dcc:identification refType=.truearm_issuerAccreditation.*?</dcc:identification>", ""),
        ("<dcc:traceable>true</dcc:traceable>", ""),
        ("Metrological traceability to the SI units is established by", "Traceability to the SI units rests on"),
    )


@right("an artefact's days in the words of another version", unsaid=CONTRADICTED)
def other_words_of_days() -> str:
    return read_changed(("Calibrated on (2026-01-01), certificate valid until ", r"Certificate of \1, expires "))


for _source in ("clause 6.2.3", "ISO 10360-12:2016, 6.2", "agreement no. 2026/10", "§ 10", "page 100", "Annex B"):
    right(f"an entry confirmed by the source {_source!r}", unsaid="confirmed = true, but")(
        lambda source=_source: str(plan(source))
    )


@right("a large stylus tip, a dry winter day, a wide limit", unsaid="expected")
def near_the_bounds() -> str:
    text = 'name = "printed arm"\nsource = "sheet"\nmeasuring_range_mm = 600\n[limits]\nE_Uni = { B_um = 5000 }\n'
    limits = str(ta.read_specification(file(text, "toml")))
    return limits + points_file("tip_diameter_mm", "38.1") + points_file("humidity_percent", "5")
