"""Whether what a certificate says in words agrees with its data: names, days, conditions, the plan's counts.

Words are those of the version that wrote them. So only what a sentence of a known form states is compared, and a
sentence of another form contradicts nothing. What this version always states may be missing only from another one's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from math import inf

from truearm import __version__
from truearm.wings.laboratory.certificate.administrative_data import MOST_K_FROM_ROOM
from truearm.wings.laboratory.certificate.certificate import (
    CONFORMITY_VERDICTS,
    DECISION_RULE,
    LISTED_ENTRIES,
    TITLE,
    Certificate,
    Method,
    days_in,
    overall_conformity,
)
from truearm.wings.laboratory.certificate.statements import ESTABLISHED, traceability_gap
from truearm.wings.laboratory.standards.decision import Verdict
from truearm.wings.laboratory.standards.measured_points import LEAST_HUMIDITY_PERCENT
from truearm.wings.laboratory.standards.verification import RULE_STANDARDS
from truearm.wings.laboratory.standards.verification_plan import PLANS, TESTS, load_verification_plan

# A temperature is stated to two decimals, and to four digits in words [K].
_ROUNDING_K = 0.06
# What this version states in every certificate.
_ALWAYS = ("coordinates", "uncertainty", "traceability", "rated conditions", "limits of use", "item", "reproduction")
_LIMITS_OF_DECISION = r" Limits: (?P<source>.+), for a measuring range of (?P<mm>[\d.e+]+) mm"
_CONDITION = re.compile(
    r"(?P<name>[a-z][a-z' ]*?) (?P<low>-?[\d.]+)(?: to (?P<high>-?[\d.]+))? [^\s,;]+(?: at some of the points)?, "
    r"rated (?P<least>-?[\d.]+)(?: to (?P<most>-?[\d.]+))? \S+?(?P<end> or more| or less)?(?=[;.])"
)
_ENTRY = r"\b{key} = ([\d.]+(?:e[-+]?\d+)?) \("
_AS_FOUND = re.compile(r"As found, measured on ([^:]*): (Conform|Not conform|Undecided)\b")


def word_contradictions(certificate: Certificate) -> Iterator[str]:
    """Yield what the words of a certificate say otherwise than its data."""
    for check in (_missing, _names, _measured_on, _conditions, _methods, _plan, _traceable, _as_found, _results):
        yield from check(certificate)


def _said(certificate: Certificate, kind: str, pattern: str) -> str | None:
    """What a statement of a kind says at the only group of a pattern; None where it has another form."""
    found = (re.search(pattern, text) for text in certificate.texts(kind))
    return next((one[1] for one in found if one is not None), None)


def _missing(certificate: Certificate) -> Iterator[str]:
    if certificate.release != __version__:
        return
    for kind in _ALWAYS:
        if not certificate.texts(kind):
            yield f"it does not state {kind}, as every certificate of this version does"
    if len(certificate.methods) < (2 if certificate.reservation else 3):
        yield f"it states {len(certificate.methods)} methods; uncertainty, test plan and decision each have one"


def _names(certificate: Certificate) -> Iterator[str]:
    about, title = certificate.about, certificate.title.removeprefix(TITLE)
    software = about.set_up.software
    limits = next(
        (found for text in certificate.texts("decision") if (found := re.search(_LIMITS_OF_DECISION, text))), None
    )
    # Of which statement, the form in which it is compared, and what it then says.
    for what, kind, form, needed in (
        ("serial number", "item", r"item with serial number .+\.$", f" serial number {about.item.serial_number}."),
        ("laboratory", "reproduction", r"written approval of .+\.$", f" approval of {about.laboratory.name}."),
        (
            "software of the arm",
            "limits of use",
            r"\bthe software .+, the stylus, ",
            f" software {software}, the stylus,",
        ),
        ("software of the arm", "limits of use", r"\) without that model", f" ({software}) without that model"),
        ("name of the limits", "rated conditions", "^The limits are those of ", f"The limits are those of {title} ("),
        (
            "source of the limits, or measuring range",
            "rated conditions",
            r"with a measuring range of" if limits else r"(?!)",
            f"({limits['source']}), with a measuring range of {limits['mm']} mm" if limits else "",
        ),
    ):
        for text in certificate.texts(kind):
            if re.search(form, text) and needed not in text:
                yield f"{what}: expected {needed.strip()!r:.100} in words, got {text[:200]!r}"
    models = {kind: _hashes(certificate, kind) for kind in ("coordinates", "limits of use")}
    if all(map(certificate.texts, models)) and models["coordinates"] != models["limits of use"]:
        yield "the coordinates are of another model than the one that the limits of use name"


def _hashes(certificate: Certificate, kind: str) -> set[str]:
    return {one for text in certificate.texts(kind) for one in re.findall(r"SHA-256 ([0-9a-f]{64})", text)}


def _measured_on(certificate: Certificate) -> Iterator[str]:
    said = _said(certificate, "limits of use", r"days of the measurement \(([^)]*)\)")
    days = days_in(said or "")
    if not days:
        return
    begins = days[0] >= certificate.begin if certificate.as_found else days[0] == certificate.begin
    if not begins or days[-1] != certificate.end:
        stated = f"{certificate.begin} to {certificate.end}"
        yield f"measured from {stated}; the days of the measurement are {said} in words"


def _conditions(certificate: Certificate) -> Iterator[str]:
    low, high = certificate.about.conditions.temperature_degC
    artefacts = certificate.artefact_degC
    if artefacts is not None and artefacts[0] > artefacts[1]:
        yield f"the artefacts had {artefacts[0]} to {artefacts[1]} degC: the lowest is the higher"
    accepted = any(text.startswith("Accepted (") for text in certificate.texts("remark"))
    if artefacts is not None and not accepted:
        apart = max(low - float(artefacts[0]), float(artefacts[1]) - high)
        if apart > MOST_K_FROM_ROOM + _ROUNDING_K:
            yield f"the room was at {low:g} to {high:g} degC, the artefacts at {artefacts[0]} to {artefacts[1]} degC"
    humidity = certificate.about.conditions.relative_humidity_percent
    if humidity is not None and humidity[1] < LEAST_HUMIDITY_PERCENT and not accepted:
        yield f"the room had {humidity[0]:g} to {humidity[1]:g} % relative humidity: drier than any room"
    stated: dict[str, tuple[float, float]] = {"temperature of the air": (low, high)}
    if artefacts is not None:
        stated["temperature of the artefacts"] = (float(artefacts[0]), float(artefacts[1]))
    for text in certificate.texts("rated conditions"):
        for one in _CONDITION.finditer(text.rpartition(" rated for: ")[2]):
            yield from _condition(certificate, one, stated)


def _condition(
    certificate: Certificate, said: re.Match[str], stated: Mapping[str, tuple[float, float]]
) -> Iterator[str]:
    """A rated condition in words: within its range where conformity is stated, and as the data state it."""
    low, high = float(said["low"]), float(said["high"] or said["low"])
    least, most = float(said["least"]), float(said["most"] or said["least"])
    if said["end"]:
        least, most = (least, inf) if said["end"] == " or more" else (-inf, most)
    if (low < least or high > most) and certificate.conformity not in (None, "fail"):
        yield f"{said[0]!r:.120}: not met, and it states {certificate.conformity}"
    if said["name"] in stated:
        lowest, highest = stated[said["name"]]
        # The air of single points may have been outside of what is stated of the room, not within.
        beyond = max(low - lowest, highest - high)
        if said["name"] == "temperature of the artefacts":
            beyond = max(beyond, lowest - low, high - highest)
        if beyond > _ROUNDING_K:
            yield f"{said['name']}: {lowest:g} to {highest:g} degC, and {low:g} to {high:g} degC in words"


def _plan_method(certificate: Certificate) -> Method | None:
    return next((one for one in certificate.methods if LISTED_ENTRIES in one.description), None)


def _methods(certificate: Certificate) -> Iterator[str]:
    """The standard of the plan and of the decision, by heading, norm, statement and entries."""
    plan, decides = _plan_method(certificate), certificate.reservation is None
    if plan is not None:
        _, is_after, standard = plan.name.partition(", after ")
        if is_after and plan.norm != standard:
            norm = plan.norm or "no standard"
            yield f"its tests are after {standard!r:.80} by their heading, after {norm!r:.80} by their norm"
        if plan.norm and (not decides or ", own plan" in plan.name or " not confirmed against " in plan.name):
            yield f"it names the standard {plan.norm} as followed; the heading says {plan.name!r:.120}"
        if decides and (" (not confirmed)" in plan.description or " not confirmed against " in plan.name):
            yield "it states conformity by a plan of which entries are not confirmed"
    for method in certificate.methods:
        if method.name != DECISION_RULE or method.norm is None:
            continue
        for text in (method.description, *certificate.texts("decision rule")):
            if "ISO 14253-1:" in text and method.norm not in text:
                yield f"its decision rule is that of {method.norm}; in words {text[-120:]!r}"
        rules = {norm: rule for rule, norm in RULE_STANDARDS.items()}
        said = None if plan is None else re.search(r"\bdecision_rule: (\S+) \(", plan.description)
        if said and method.norm in rules and said[1] != rules[method.norm]:
            yield f"its decision rule is that of {method.norm}, that of its plan {said[1]!r:.40}"


def _entries(certificate: Certificate) -> dict[str, str]:
    """The entries of each test in the words of the plan's description."""
    plan = _plan_method(certificate)
    listed = "" if plan is None else plan.description.partition(LISTED_ENTRIES)[2]
    begins = [(one.start(), one.end(), one[1]) for one in re.finditer(rf"(?:^|; )({'|'.join(TESTS)}): ", listed)]
    ends = [*(start for start, *_ in begins), len(listed)][1:]
    return {name: listed[begin:end] for (_, begin, name), end in zip(begins, ends, strict=True)}


def _number(entries: str, key: str) -> float | None:
    found = re.search(_ENTRY.format(key=key), entries)
    return None if found is None else float(found[1])


def _plan(certificate: Certificate) -> Iterator[str]:
    """The counts of the plan against the results, and a plan of this version against the standard that it names."""
    of_tests, plan = _entries(certificate), _plan_method(certificate)
    counted = {one.name: len(one.quantities) for one in certificate.individual}
    names = [one.quantity.name for one in certificate.results]

    def times(*keys: str) -> Callable[[str], float | None]:
        def of(entries: str) -> float | None:
            product = 1.0
            for key in keys:
                number = _number(entries, key)
                if number is None:
                    return None
                product *= number
            return product

        return of

    def lengths_of(symbol: str) -> tuple[str, ...]:
        lengths = (name.partition(", position ")[0] for name in names if name.startswith(symbol))
        return tuple(one for one in dict.fromkeys(lengths) if "sets measured again" not in one)

    rows = {
        "uni": ("E_Uni", times("lengths")),
        "bi": ("E_Bi", times("lengths")),
        "single_point": ("SPAT.Max", times("positions")),
    }
    lists = {
        "probing": (("P_Size.Sph.1x25", "P_Form.Sph.1x25"), times("positions")),
        "articulation": (("L_Dia.5x5",), times("positions")),
        "uni": (lengths_of("E_Uni, "), times("positions", "repeats")),
        "bi": (lengths_of("E_Bi, "), times("positions", "repeats")),
        "effective_diameter": (("EffectiveDiameter",), times("repeats")),
        "volumetric": (("Volumetric.Max",), times("positions")),
    }
    for test, entries in of_tests.items():
        if test in rows:
            symbol, of = rows[test]
            n = sum(name.startswith(f"{symbol}, ") and "sets measured again" not in name for name in names)
            if (planned := of(entries)) is not None and n != planned:
                yield f"the plan asks for {planned:g} results {symbol}; it states {n}"
        again = bool(_number(entries, "tolerated_sets"))
        for symbol in lists.get(test, ((), None))[0]:
            planned, n = lists[test][1](entries), counted.get(symbol, 1)
            if planned is not None and n != planned and not (again and n > planned):
                yield f"the plan asks for {planned:g} individual results of {symbol}; it states {n}"
    if plan is None or plan.norm is None or certificate.release != __version__:
        return
    for known in map(load_verification_plan, PLANS):
        if known.standard == plan.norm:
            for test, there in known.tests.items():
                if there.required and test not in of_tests:
                    yield f"it names {plan.norm} as followed, without the test {test}"
            for entry in known.entries(of_tests):
                number = _number(of_tests.get(entry.test, ""), entry.name)
                if not isinstance(entry.value, str) and number is not None and number != float(f"{entry.value:g}"):
                    yield f"it names {plan.norm} as followed, with {entry.key} = {number:g} in place of {entry.value:g}"


def _traceable(certificate: Certificate) -> Iterator[str]:
    """The certificates of the artefacts as the statement of traceability names them."""
    for text in certificate.texts("traceability"):
        if ESTABLISHED not in text:
            continue
        shown = text.partition(ESTABLISHED)[2].partition(" It is not shown of ")[0]
        named = shown.count(" by certificate ")
        traced = [
            one
            for one in certificate.equipment
            if not traceability_gap(one.certificate, one.issued_by, one.accreditation)
        ]
        if named and named != len(traced):
            yield f"{len(traced)} artefacts show traceability, its statement names {named}"
        for one in traced:
            day = days_in(one.description)[:1]
            source = f" by certificate {one.certificate} of {one.issued_by}, accreditation {one.accreditation}"
            if named and (source not in shown or (day and f"{source} ({day[0]})" not in shown)):
                yield f"its statement of traceability names the certificate of {one.name} otherwise than the artefacts"


def _as_found(certificate: Certificate) -> Iterator[str]:
    done, found = certificate.about.adjustment, certificate.as_found
    texts = certificate.texts("adjustment")
    if done is None and (found or texts):
        yield "it states results as found or as left, and no adjustment or repair"
    for text in texts:
        if ("not available" in text) == bool(found):
            yield f"it states {len(found)} results as found; its statement says {text[-120:]!r}"
        said = _AS_FOUND.search(text)
        if said is None:
            continue
        stated = overall_conformity([one.conformity for one in found if one.limit is not None])
        verdict = CONFORMITY_VERDICTS[stated] if stated else Verdict.UNDECIDED
        if found and verdict.value != said[2].lower():
            yield f"the results as found are {verdict.value!r} by their conformities, {said[2].lower()!r} in words"
        days = days_in(said[1])
        if days and (days[0] != certificate.begin or days[-1] > certificate.end):
            yield f"measured from {certificate.begin} to {certificate.end}; as found on {said[1]} in words"


def _results(certificate: Certificate) -> Iterator[str]:
    """Lists and budgets without their value, and the number of values in the decision."""
    names = [one.quantity.name for one in certificate.results]
    for one in certificate.individual:
        if not any(name == one.name or name.startswith(f"{one.name}, ") for name in names):
            yield f"there are individual results of {one.name:.100}, and no value"
    for one in certificate.budgets:
        if not any(f"; {name}; " in f"; {one.name}; " for name in names):
            yield f"there is a budget of {one.name:.100}, and no value"
        elif not _covered(one.name, names):
            yield f"the budget of {one.name:.100} is also of values that it does not state"
    said = _said(certificate, "decision", r"\b(\d+) values? with a limit")
    n = sum(one.limit is not None for one in certificate.results)
    if said is not None and int(said) != n:
        yield f"it states {n} values with a limit; {said} in words"
    yield from _calibrations(certificate)


def _covered(of: str, names: list[str]) -> bool:
    """Whether the names of values make up a list of names."""
    rest = f"; {of}; "
    for name in sorted(names, key=len, reverse=True):
        rest = rest.replace(f"; {name}; ", "; ")
    return rest == "; "


def _calibrations(certificate: Certificate) -> Iterator[str]:
    """Contributions of the calibrations that are those of no artefact."""
    sizes = [
        (one.name.removesuffix(" at 20 degC").removeprefix("length "), one.name.partition(" ")[0], one.standard)
        for artefact in certificate.equipment
        for one in artefact.quantities
        if one.standard is not None
    ]
    for listed in certificate.budgets:
        if listed.name.startswith(("Volumetric.2", "Volumetric, ")):
            continue  # of all lengths together
        for line in listed.quantities:
            of = line.name.removeprefix("calibration of the ")
            known = [
                u for name, kind, u in sizes if kind == of and (of != "length" or f", {name}, " in f"{listed.name}, ")
            ]
            if known and line.name != of and not any(_agree(line.value, u) for u in known):
                stated = f"a {line.name} of {line.value} mm, the artefacts {known[0]} mm"
                yield f"the budget of {listed.name:.100} has {stated}"


def _agree(one: Decimal, other: Decimal) -> bool:
    half = max(Decimal(10) ** int(each.as_tuple().exponent) for each in (one, other)) / 2
    return abs(one - other) <= half
