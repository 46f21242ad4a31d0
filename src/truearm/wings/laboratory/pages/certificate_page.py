"""The page of a calibration certificate, for the screen and for paper: verdict, results, arm, evidence."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from truearm.number_format import RoundedNumber, capitalize, format_number
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.pdf import Attachment, Logo, Paper
from truearm.wings.laboratory.certificate.administrative_data import NOTES, AdministrativeData, Person, Site
from truearm.wings.laboratory.certificate.certificate import (
    LISTED_ENTRIES,
    Certificate,
    StatedList,
    StatedQuantity,
    StatedResult,
)
from truearm.wings.laboratory.certificate.statements import NOT_FOR_CONFORMITY
from truearm.wings.laboratory.pages.limits_figure import limits_figure
from truearm.wings.laboratory.pages.verification_page import sources_section
from truearm.wings.laboratory.standards.verification import (
    Verification,
    limit_uncertainty,
    verdict_sentence,
    worst_values,
)
from truearm.wings.laboratory.standards.verification_plan import CHECK_STANDARD

Entries = Sequence[tuple[str, str | None]]

# What the statements of conformity of the XML file are called for people, and their states.
CONFORMITY_WORDS: dict[str | None, tuple[str, State]] = {
    "pass": ("conform", "good"),
    "conditionalPass": ("undecided, within the limit", "doubtful"),
    "conditionalFail": ("undecided, beyond the limit", "doubtful"),
    "fail": ("not conform", "bad"),
    None: ("", "none"),
}
# Of a value with a limit, or a verification, of which no conformity is stated because of rated conditions.
NOT_DECIDED: tuple[str, State] = ("not decided", "doubtful")
PLACES = {
    "laboratory": "at the laboratory",
    "laboratoryBranch": "at a branch of the laboratory",
    "customer": "at the customer",
    "customerBranch": "at a branch of the customer",
    "other": "elsewhere",
}
XML_NAME = "certificate.xml"
MOST_IN_ONE_COLUMN = 6


def certificate_page(
    certificate: Certificate, verification: Verification, *, facts: Sequence[tuple[str, str]] = ()
) -> Page:
    """Lay out the page of a calibration certificate.

    Parameters
    ----------
    certificate : Certificate
    verification : Verification
        The one that it states.
    facts : sequence of (str, str)
        Certificate, plan, files with their SHA-256, versions.
    """
    about, item = certificate.about, certificate.about.item
    limited = [one for one in certificate.results if one.limit is not None]
    return Page(
        title=f"Calibration certificate {about.number}",
        subtitle=f"{capitalize(item.name)} {item.maker} {item.model}, serial number {item.serial_number}. "
        f"Calibrated by {about.laboratory.name} for {about.customer.name}, issued on {about.issued}. "
        f"{_replaced(about)}{' '.join(certificate.texts('coordinates'))}".strip(),
        summary=(
            LabelledValue("values with a limit", len(limited)),
            LabelledValue("individual results", sum(len(one.quantities) for one in certificate.individual)),
            LabelledValue("measured points", sum(len(group.points) for group in verification.groups)),
        ),
        sections=(
            _results(certificate, verification),
            *_as_found(certificate),
            _item(certificate),
            _conditions(certificate),
            _parties(certificate),
            _traceability(certificate),
            _method(certificate),
            sources_section(verification.plan, verification.measured.tests),
            _use(certificate),
            _individual(certificate),
            _budgets(certificate),
        ),
        facts=tuple(facts),
        verdict=_verdict(certificate, verification),
        mark="" if certificate.reservation is None else NOT_FOR_CONFORMITY,
    )


def _replaced(about: AdministrativeData) -> str:
    """Which certificate this one amends or substitutes, and why."""
    if (other := about.replaces) is None:
        return ""
    amends = "Amendment to" if other.change == "amended" else "This certificate replaces"
    return f"{amends} certificate No. {other.number}; reason: {other.reason.removesuffix('.')}. "


def certificate_paper(certificate: Certificate, xml: bytes, *, logo: Logo | None = None) -> Paper:
    """Return what the certificate has on paper beside its page: number, issuer, signature lines, the XML file inside.

    Parameters
    ----------
    certificate : Certificate
    xml : bytes
        The digital calibration certificate; the paper is the same for people.
    logo : Logo, optional
    """
    about = certificate.about
    laboratory = about.laboratory
    address = [text for what, text in _address(laboratory) if what != "name" and text is not None]
    if laboratory.code is not None:
        address.append(f"accreditation {laboratory.code}")
    return Paper(
        heading=f"Calibration certificate {about.number}",
        issuer=(laboratory.name, ", ".join(address)),
        date=about.issued,
        mark="" if certificate.reservation is None else NOT_FOR_CONFORMITY,
        signatures=tuple(
            ", ".join(part for part in (person.name, person.role) if part)
            for person in about.persons
            if person.main_signer
        ),
        attachments=(
            Attachment(XML_NAME, xml, "application/xml", "digital calibration certificate (DCC) with the same content"),
        ),
        logo=logo,
    )


def _verdict(certificate: Certificate, verification: Verification) -> PageVerdict:
    if certificate.reservation is not None:
        return PageVerdict(f"{capitalize(NOT_FOR_CONFORMITY)}.", "doubtful", certificate.reservation.partition(": ")[2])
    state = NOT_DECIDED[1] if certificate.conformity is None else CONFORMITY_WORDS[certificate.conformity][1]
    return PageVerdict(verdict_sentence(verification), state, worst_values(verification))


def _results(certificate: Certificate, verification: Verification) -> Section:
    stated = certificate.reservation is None
    rows_with_limit = verification.rows_with_limit
    return Section(
        "Results",
        "Limits apply to magnitudes, with all their digits in the file. Values are compared before rounding."
        if stated
        else "Limits apply to magnitudes, with all their digits in the file. Nothing is said on conformity.",
        tables=(_table(certificate.results, stated),),
        figures=(limits_figure(rows_with_limit, rule=verification.rule),) if stated else (),
    )


def _as_found(certificate: Certificate) -> tuple[Section, ...]:
    """What was done to the arm, and the results before it."""
    said = "\n\n".join(certificate.texts("adjustment"))
    tables = (_table(certificate.as_found, certificate.reservation is None),) if certificate.as_found else ()
    return (Section("As found and as left", said, tables=tables),) if said else ()


def _table(results: Sequence[StatedResult], stated: bool) -> Table:
    """Test values, those that do not conform first; `stated` if the certificate is for conformity decisions."""
    columns = [Column("test"), Column("value", "mm"), Column("U", "mm"), Column("k"), Column("limit", "mm")]
    if stated:
        columns.append(Column("verdict"))
    ordered = sorted(results, key=lambda one: _URGENCY[_words(one, stated)[1]])
    rows = tuple(_result_cells(one, stated)[: len(columns)] for one in ordered)
    states = tuple(_words(one, stated)[1] for one in ordered)
    return Table(tuple(columns), rows, "Test values with their expanded uncertainty U and limits.", states=states)


_URGENCY: dict[State, int] = {"bad": 0, "doubtful": 1, "good": 2, "none": 2}


def _words(result: StatedResult, stated: bool) -> tuple[str, State]:
    """The verdict of a value for people, and its state; `stated` if the certificate is for conformity decisions."""
    undecided = stated and result.limit is not None and result.conformity is None
    return NOT_DECIDED if undecided else CONFORMITY_WORDS[result.conformity]


def _result_cells(result: StatedResult, stated: bool) -> tuple[Cell, ...]:
    quantity = result.quantity
    limit = None
    if result.limit is not None:
        exact = float(result.limit.value)
        limit = RoundedNumber(exact, limit_uncertainty(exact))
    words = _words(result, stated)[0] or None
    return (quantity.name, _number(quantity), _uncertainty(quantity), _factor(quantity), limit, words)


def _number(quantity: StatedQuantity) -> Cell:
    if quantity.unit == "1":
        return _text(quantity.value)
    return RoundedNumber(float(quantity.value), float(quantity.expanded or quantity.standard or 0))


def _uncertainty(quantity: StatedQuantity) -> Cell:
    u = quantity.expanded or quantity.standard
    return None if u is None else RoundedNumber(float(u), float(u))


def _factor(quantity: StatedQuantity) -> Cell:
    return None if quantity.factor is None else f"{quantity.factor:f}"


def _text(value: Decimal) -> str:
    return f"{value:f}".replace("-", "\u2212")


def _item(certificate: Certificate) -> Section:
    item, set_up = certificate.about.item, certificate.about.set_up
    of_item = ("name", "maker", "model", "serial number", "inventory number", "condition")
    parts: Sequence[tuple[object, Sequence[str]]] = ((item, of_item), (set_up, ("stylus", "mounting", "software")))
    entries = [(what, getattr(of, what.replace(" ", "_"))) for of, names in parts for what in names]
    return Section("Arm", tables=(_entries(entries),))


def _conditions(certificate: Certificate) -> Section:
    about, artefact_degC = certificate.about, certificate.artefact_degC
    degC, humidity = about.conditions.temperature_degC, about.conditions.relative_humidity_percent
    days = [str(day) for day in dict.fromkeys((certificate.begin, certificate.end))]
    entries: Entries = (
        ("measured", " to ".join(days)),
        ("arm received", None if about.received is None else str(about.received)),
        ("place", f"{PLACES[about.place]}: {_in_line(about.measured_at)}"),
        ("temperature of the room", f"{degC[0]:g} to {degC[1]:g} °C"),
        ("relative humidity", None if humidity is None else f"{humidity[0]:g} to {humidity[1]:g} %"),
        (
            "temperature of the artefacts",
            None
            if artefact_degC is None
            else f"{artefact_degC[0]:f} to {artefact_degC[1]:f} °C, means of groups of points",
        ),
    )
    return Section("Conditions", tables=(_entries(entries),))


def _parties(certificate: Certificate) -> Section:
    about = certificate.about
    laboratory: Entries = (*_address(about.laboratory), ("accreditation", about.laboratory.code))
    persons = [(one.name, _role(one)) for one in about.persons]
    return Section(
        "Laboratory and customer",
        tables=(
            _entries(laboratory, "laboratory"),
            _entries(_address(about.customer), "customer"),
            _entries(persons, "responsible persons"),
        ),
    )


def _traceability(certificate: Certificate) -> Section:
    cells: list[tuple[Cell, ...]] = []
    for one in certificate.equipment:
        issuer = f"{one.issued_by}, accreditation {one.accreditation or 'not stated'}"
        names = (one.certificate, issuer, one.description)
        name = f"{one.name}, serial number {one.serial_number or 'not stated'}"
        if not one.quantities:
            cells.append((name, None, None, *names))
        for quantity in one.quantities:
            size = f"{name}, {quantity.name}"
            cells.append((size, _number(quantity), _uncertainty(quantity), *names))
    columns = Column.of("artefact", "calibrated [mm]", "u (k = 1) [mm]", "certificate", "issued by", "dates")
    table = Table(columns, tuple(cells), "Artefacts and their certificates.")
    return Section("Traceability", "\n\n".join(certificate.texts("traceability")), tables=(table,))


def _method(certificate: Certificate) -> Section:
    kinds = ("decision", "decision rule", "uncertainty")
    texts = [text for kind in kinds for text in certificate.texts(kind)]
    methods = [
        # The entries of the plan are a table of the page.
        f"{method.name}: {method.description.partition(LISTED_ENTRIES)[0]}"
        for method in certificate.methods
        if method.name != "Decision rule"
    ]
    return Section("Method, uncertainty and decision", "\n\n".join([*texts, *methods]))


def _use(certificate: Certificate) -> Section:
    kinds = ("item", "reproduction", "rated conditions", "limits of use", "remark")
    notes = certificate.about.notes
    own = [f"{name}: {words}" for key, name in NOTES.items() if (words := getattr(notes, key)) is not None]
    # What is not confirmed is a table of the page.
    stated = [text for kind in kinds for text in certificate.texts(kind) if CHECK_STANDARD not in text]
    return Section("Use of this certificate", "\n\n".join([*own, *stated]))


def _individual(certificate: Certificate) -> Section:
    text = "All results behind the test values; the test value is the one nearest to its limit, or beyond it."
    tables = tuple(map(_side_by_side, certificate.individual))
    return Section("Individual results", text, tables=tables, folded=True)


def _side_by_side(listed: StatedList) -> Table:
    """A list of results in up to three columns, two with U, each read downwards; U in the caption if all have it."""
    quantities, u = listed.quantities, listed.quantities[0].expanded
    same = u is not None and all(one.expanded == u for one in quantities)
    width = 2 if same else 3
    columns = Column.of("where", "value [mm]", "U [mm]")[:width]
    cells: list[tuple[Cell, ...]] = [(one.name, _number(one), _uncertainty(one))[:width] for one in quantities]
    beside = (3 if same else 2) if len(cells) > MOST_IN_ONE_COLUMN else 1
    height = -(-len(cells) // beside)
    cells += [("",) * width] * (beside * height - len(cells))
    rows = tuple(tuple(cell for part in range(beside) for cell in cells[part * height + at]) for at in range(height))
    stated = f"; U = {_text(u)}\u00a0mm for each" if same and u is not None else ""
    return Table(columns * beside, rows, f"{listed.name}{stated}.")


def _budgets(certificate: Certificate) -> Section:
    return Section(
        "Uncertainty budgets",
        "Standard uncertainties of the contributions to a test value. They are independent: their squares add. U is "
        "the combined standard uncertainty times k. Degrees of freedom by Welch and Satterthwaite (GUM G.4.1) are in "
        "brackets where they are finite.",
        tables=_budget_tables(certificate.budgets),
        folded=True,
    )


def _budget_tables(budgets: Sequence[StatedList]) -> tuple[Table, ...]:
    """A table for the test values that have the same contributions, a column each; degrees of freedom in brackets."""
    alike: dict[tuple[str, ...], list[tuple[Cell, ...]]] = {}
    for budget in budgets:
        parts: dict[str, Cell] = {}
        for one in budget.quantities:
            if one.unit == "1" and parts:  # the degrees of freedom of the one before; infinite without a number
                name = next(reversed(parts))
                u = parts[name]
                assert isinstance(u, RoundedNumber)
                parts[name] = f"{format_number(u.value, uncertainty=u.uncertainty)} ({_text(one.value)})"
            else:
                parts[one.name] = RoundedNumber(float(one.value), float(one.value))
        alike.setdefault(tuple(parts), []).append((budget.name, *parts.values()))
    return tuple(
        Table((Column("u of the contributions [mm]"), *map(Column, names)), tuple(rows), "")
        for names, rows in alike.items()
    )


def _entries(entries: Entries, caption: str = "") -> Table:
    """A table of entries without heads; those without a text are omitted."""
    rows = tuple((what, text) for what, text in entries if text is not None)
    return Table((Column(""), Column("")), rows, caption)


def _address(site: Site) -> Entries:
    street = " ".join(part for part in (site.street, site.street_no) if part) or None
    place = f"{site.post_code} {site.city}, {site.country}"
    reached = [(what, getattr(site, what, None)) for what in ("email", "phone")]
    return [("name", site.name), ("street", street), ("place", place), *reached]


def _in_line(site: Site) -> str:
    return ", ".join(text for what, text in _address(site) if text is not None and what not in ("email", "phone"))


def _role(person: Person) -> str:
    parts = (person.role, "signs the certificate" if person.main_signer else None)
    return ", ".join(part for part in parts if part) or "responsible"
