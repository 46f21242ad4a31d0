"""What a calibration certificate states in words beside the results."""

from __future__ import annotations

import re
from dataclasses import dataclass

from truearm.acceptance import accepted
from truearm.number_format import capitalize
from truearm.wings.laboratory.certificate.administrative_data import AdministrativeData, xml_text
from truearm.wings.laboratory.standards.artefacts import Artefact
from truearm.wings.laboratory.standards.decision import Verdict
from truearm.wings.laboratory.standards.verification import (
    LEVEL_TEXT,
    Verification,
    describe_decision,
    describe_rule,
    verdict_sentence,
)

NOT_FOR_CONFORMITY = Verdict.NOT_FOR_DECISIONS.value
ESTABLISHED = "Metrological traceability to the SI units is established by the calibration of "


@dataclass(frozen=True)
class Statement:
    """A statement of a certificate; `kind` is one of `STATEMENTS` of the reader."""

    kind: str
    text: str


def make_statements(
    about: AdministrativeData, verification: Verification, gap: str | None, *, as_found: Verification | None = None
) -> tuple[Statement, ...]:
    """Return the statements of a certificate.

    Parameters
    ----------
    about : AdministrativeData
    verification : Verification
    gap : str or None
        Why the plan's numbers do not count as those of the standard. Without a gap, the certificate states the
        decision and its rule; with one, it states that it is not for conformity decisions.
    as_found : Verification, optional
        The one before the adjustment or repair that `about` states.
    """
    said = {"reservation": _reservation(gap)} if gap is not None else {}
    if gap is None:
        said |= {"decision": describe_decision(verification), "decision rule": describe_rule(verification.rule)}
    said |= {
        "coordinates": verification.measured.origin.describe(),
        **_adjustment(about, as_found),
        "uncertainty": _UNCERTAINTY,
        "traceability": _traceability(verification, as_found),
        **_rated_conditions(verification),
        "limits of use": _limits_of_use(about, verification),
        "item": f"The results relate only to the item with serial number {about.item.serial_number}.",
        "reproduction": _reproduction(about),
    }
    remarks = [Statement("remark", xml_text(f"{capitalize(remark)}.")) for remark in verification.remarks]
    remarks += [Statement("remark", xml_text(str(one))) for one in accepted()]
    return (*(Statement(kind, xml_text(text)) for kind, text in said.items()), *remarks)


_UNCERTAINTY = (
    f"U is the expanded uncertainty of a test value for a coverage probability of {LEVEL_TEXT}: the standard "
    "uncertainty times the coverage factor k, evaluated after JCGM 100:2008 (GUM). It comes from artefact and set-up. "
    "It does not contain the errors of the arm, which are the object of the test."
)


def _reservation(gap: str) -> str:
    """Why nothing is stated; the entries themselves stand with the plan, once."""
    reason, _, entries = gap.partition(": ")
    where = " (listed with the test plan)" if entries and " confirmed against " in reason else ""
    mark = capitalize(NOT_FOR_CONFORMITY)
    return f"{mark}: {reason}{where}. This certificate states values and limits, but no conformity."


def _limits_of_use(about: AdministrativeData, verification: Verification) -> str:
    origin, software = verification.measured.origin, about.set_up.software
    days = sorted({str(group.date) for group in verification.groups})
    when = days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"
    computed, bounds = f"the software {software}", ""
    if origin.is_model:
        computed = f"coordinates computed by {origin.computed_with}"
        bounds = (
            f"They do not hold for coordinates of the software of the arm ({software}) without that model, which is "
            f"another item. {origin.n_outside} of {origin.n_points} readings were outside the range that the model was "
            "trained on. "
        )
    return (
        f"The results hold for the arm with {computed}, the stylus, the mounting and the conditions that this "
        f"certificate states, on the days of the measurement ({when}). {bounds}The certificate states no period of "
        "validity."
    )


def _rated_conditions(verification: Verification) -> dict[str, str]:
    """The arm and the range that the limits are of, the conditions that they are rated for, and those measured."""
    limits = verification.specification
    of_range = f"with a measuring range of {limits.measuring_range_mm:g} mm"
    said = f"The limits are those of {limits.name} ({limits.source}), {of_range}."
    if listed := "; ".join(map(str, verification.conditions)):
        said += f" Conditions of the measurement, and those that the limits are rated for: {listed}."
    return {"rated conditions": said}


def _reproduction(about: AdministrativeData) -> str:
    return (
        "This certificate may not be reproduced except in full without the written approval of "
        f"{about.laboratory.name}."
    )


def _adjustment(about: AdministrativeData, as_found: Verification | None) -> dict[str, str]:
    """What was done to the arm before the results, and what was found before it (ISO/IEC 17025:2017, 7.8.4.1 d)."""
    done = about.adjustment
    if done is None:
        return {}
    said = f"The results are as left, after this {done.kind}: {done.work.removesuffix('.')}."
    if as_found is None:
        return {"adjustment": f"{said} Results as found, before it, are not available."}
    days = sorted({group.date for group in as_found.groups})
    when = " and ".join(map(str, dict.fromkeys((days[0], days[-1]))))
    found = f"As found, measured on {when}: {verdict_sentence(as_found)} {as_found.measured.origin.describe()}"
    return {"adjustment": f"{said} {found}"}


def traceability_gap(certificate: str, issued_by: str | None, accreditation: str | None) -> str | None:
    """What is missing of an artefact's certificate before traceability may be stated of it; None if nothing.

    Parameters
    ----------
    certificate : str
        Its number; one has a digit.
    issued_by, accreditation : str or None
        The laboratory that issued it, and its accreditation.
    """
    numbered = any(map(str.isdigit, certificate))
    known = {
        "number of the certificate": numbered,
        "laboratory that issued it": _is_name(issued_by),
        "accreditation of that laboratory": _is_name(accreditation),
    }
    return ", ".join(what for what, there in known.items() if not there) or None


def _is_name(text: str | None) -> bool:
    words = "" if text is None else re.sub(r"[^\w/]", "", text).casefold()
    return words not in _NO_NAMES and any(map(str.isalnum, words))


_NO_NAMES = ("none", "no", "nobody", "na", "n/a", "unknown", "tbd", "missing")


def used_artefacts(verification: Verification, as_found: Verification | None) -> list[tuple[Artefact, Verification]]:
    """The artefacts of the results, and those of results as found that were others, each with where it was used."""
    used = [(one, verification) for one in verification.used_artefacts]
    if as_found is not None:
        used += [(one, as_found) for one in as_found.used_artefacts if one not in verification.used_artefacts]
    return used


def _traceability(verification: Verification, as_found: Verification | None) -> str:
    """Which artefacts carry the traceability, and which do not (ISO/IEC 17025:2017, 7.8.4.1 c)."""
    shown, missing = [], []
    for one, _ in used_artefacts(verification, as_found):
        by = f"{one.name} by certificate {one.certificate} of {one.issued_by}"
        gap = traceability_gap(one.certificate, one.issued_by, one.issuer_accreditation)
        if gap is None:
            shown.append(f"{by}, accreditation {one.issuer_accreditation} ({one.date})")
        else:
            missing.append(f"{one.name} (not stated: {gap})")
    said = "No metrological traceability to the SI units is shown."
    if shown:
        said = f"{ESTABLISHED}{'; '.join(shown)}."
    return f"{said} It is not shown of {'; '.join(missing)}." if missing else said
