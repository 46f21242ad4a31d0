"""Unsigned certificates of which somebody changed one thing: what contradicts the rest is named.

A file in which all is changed alike is no case: who has no signature cannot know it, and the guide says so.
"""

from __future__ import annotations

import re
from functools import cache

from benchmarks.certificates import mistake, right
from benchmarks.certificates.campaign import (
    ASME,
    DAY,
    ISO,
    PointsChange,
    at,
    campaign,
    edited,
    in_test,
    read,
    read_edited,
    written,
)
from benchmarks.certificates.copies import ADJUSTED
from benchmarks.certificates.days import measured_on

VALUE = r"(<si:value>)-?[\d.]+(</si:value>)"


def result_of(name: str) -> str:
    """The beginning of a test value in the file, up to its number."""
    return rf"(<dcc:result>\s*<dcc:name>\s*<dcc:content lang=.en.>{name}.*?refType=.basic_measuredValue.>.*?)"


def whole_result(name: str, kind: str = "<dcc:result>") -> str:
    """A whole entry of the results."""
    return rf"<?{kind}\s*<dcc:name>\s*<dcc:content lang=.en.>{name}(?:(?!</dcc:result>).)*</dcc:result>\s*"


INDIVIDUAL = '<dcc:result refType="truearm_individualResults">'
BUDGET = '<dcc:result refType="truearm_uncertaintyBudget">'
FIRST_OF = rf"({INDIVIDUAL}\s*<dcc:name>\s*<dcc:content lang=.en.>{{}}.*?<dcc:list>\s*)<dcc:quantity>.*?</dcc:quantity>"

# What is changed, the file of which standard, from what to what, and what is said of it.
NUMBERS = {
    "a test value made smaller": (
        ISO,
        result_of("E_Uni, 1700") + VALUE,
        r"\g<1>\g<2>0.0010\3",
        "none of its individual",
    ),
    "a test value beyond its limit that still passes": (
        ISO,
        result_of("P_Size") + VALUE,
        r"\g<1>\g<2>0.0900\3",
        "by the decision rule",
    ),
    "the sign of a test value": (ASME, result_of("EffectiveDiameter") + r"<si:value>-", r"\1<si:value>", "none of its"),
    "an expanded uncertainty made smaller": (
        ISO,
        result_of("E_Uni, 900") + r"(<si:valueExpandedMU>)[\d.]+",
        r"\g<1>\g<2>0.0011",
        "its budget has",
    ),
    "a coverage factor of 1": (
        ISO,
        result_of("E_Uni, 900") + r"(<si:coverageFactor>)[\d.]+",
        r"\g<1>\g<2>1.00",
        "with k of Student's t",
    ),
    "a coverage probability of 0.99": (
        ISO,
        result_of("E_Uni, 900") + r"(<si:coverageProbability>)[\d.]+",
        r"\g<1>\g<2>0.99",
        "truearm states U for",
    ),
    "an uncertainty taken out of a value": (
        ISO,
        result_of("L_Dia") + r"<si:measurementUncertaintyUnivariate>.*?</si:measurementUncertaintyUnivariate>",
        r"\1",
        "expanded uncertainty|no budget|individual",
    ),
    "a test value in metres": (ISO, result_of("E_Uni, 900") + r"\\milli\\metre", r"\1\\metre", "expected a unit"),
    "a limit made wider for a value that fails": (
        ASME,
        result_of("SPAT.Max, position 3") + VALUE,
        r"\g<1>\g<2>0.0600\3",
        "by the decision rule",
    ),
    "a statistic of all lengths": (
        ASME,
        result_of(r"Volumetric\.2RMS") + VALUE,
        r"\g<1>\g<2>0.0020\3",
        "by the individual results",
    ),
    "the range of all lengths": (
        ASME,
        result_of(r"Volumetric, range") + VALUE,
        r"\g<1>\g<2>0.0020\3",
        "by the individual results",
    ),
    "the mean of all lengths": (
        ASME,
        result_of(r"Volumetric, mean") + VALUE,
        r"\g<1>\g<2>0.0420\3",
        "by the individual results",
    ),
    "an individual result made worse": (
        ISO,
        rf"({INDIVIDUAL}\s*<dcc:name>\s*<dcc:content lang=.en.>E_Uni, 150.*?){VALUE}",
        r"\g<1>\g<2>0.0900\3",
        "but the individual result",
    ),
    "a contribution of a budget": (
        ISO,
        rf"({BUDGET}\s*<dcc:name>\s*<dcc:content lang=.en.>E_Uni, 150.*?fixture.*?){VALUE}",
        r"\g<1>\g<2>0.0100\3",
        "sums up to",
    ),
    "the sum of a budget": (
        ISO,
        rf"({BUDGET}\s*<dcc:name>\s*<dcc:content lang=.en.>E_Uni, 150.*?combined standard.*?){VALUE}",
        r"\g<1>\g<2>0.0002\3",
        "sums up to",
    ),
    "the uncertainty of a calibrated length": (
        ISO,
        r"(length 900 at 20 degC.*?<si:valueStandardMU>)[\d.]+",
        r"\g<1>0.0001",
        "calibration of the length",
    ),
    "the uncertainty of a calibrated ball": (
        ISO,
        r"(diameter at 20 degC.*?<si:valueStandardMU>)[\d.]+",
        r"\g<1>0.00001",
        "calibration of the diameter",
    ),
    "a value that is no number": (ISO, result_of("E_Uni, 900") + VALUE, r"\g<1>\g<2>nan\3", "number|expected"),
    "a value with two numbers": (
        ISO,
        result_of("E_Uni, 900") + r"<si:real>(.*?)</si:real>",
        r"\1<si:real>\2</si:real><si:real>\2</si:real>",
        "expected one",
    ),
}
VERDICTS = {
    "one conformity fail, all else as it was": (
        ISO,
        result_of("E_Uni, 900") + "conformity>pass",
        r"\1conformity>fail",
        "by the decision rule pass",
    ),
    "one conformity conditional": (
        ISO,
        result_of("L_Dia") + "conformity>pass",
        r"\1conformity>conditionalPass",
        "by the decision rule pass",
    ),
    "a conformity taken out of one value": (
        ISO,
        result_of("E_Uni, 900") + r"<dcc:conformity>pass</dcc:conformity>\s*",
        r"\1",
        "the decision is none",
    ),
    "the decision of the whole": (
        ISO,
        r"(with a limit\.</dcc:content>\s*</dcc:declaration>\s*<dcc:conformity>)pass",
        r"\1fail",
        "the decision is pass",
    ),
    "the words of the decision": (
        ISO,
        r"Example Arms A: conform\.",
        "Example Arms A: not conform.",
        "the decision says",
    ),
    "the number of values that conform": (ISO, r"conform: \d+ values", "conform: 31 values", "values with a limit"),
    "a conformity that no schema has": (ISO, "conformity>pass", "conformity>excellent", "expected a conformity"),
    "the standard of the decision rule": (ISO, r"(<dcc:norm>)ISO 14253-1:2017", r"\1ISO 14253-1:2013", "decision rule"),
    "the decision rule in its statement": (
        ISO,
        r"This is the default rule of ISO 14253-1:2017",
        "This is the default rule of ISO 14253-1:2013",
        "decision rule",
    ),
    "the decision rule among the entries of the plan": (
        ISO,
        r"decision_rule: iso14253-1:2017",
        "decision_rule: simple",
        "decision rule",
    ),
    "a decision rule of nobody": (ISO, r"<dcc:norm>ISO 14253-1:2017", "<dcc:norm>own rule", "not one decision rule"),
    "the reservation of a plan that is not confirmed, as an entry": (
        ISO,
        r"lengths = 5 \(clause 6\.2\.3\)",
        "lengths = 5 (not confirmed)",
        "not confirmed",
    ),
}
MISSING = {
    "a value left out, its individual results kept": (ISO, whole_result("E_Uni, 1700"), "", "E_Uni, 1700"),
    "a value left out with its individual results, its budget kept": (
        ISO,
        rf"{whole_result('E_Uni, 1700')}|{whole_result('E_Uni, 1700', INDIVIDUAL[1:])}",
        "",
        "E_Uni",
    ),
    "a value without a list left out": (ASME, whole_result("SPAT.2s, position 2"), "", "SPAT.2s, position 2"),
    "the individual results of a value left out": (ISO, whole_result("E_Uni, 900", INDIVIDUAL[1:]), "", "individual"),
    "a budget left out": (ISO, whole_result("E_Bi, 450", BUDGET[1:]), "", "and no budget"),
    "an individual result left out": (
        ISO,
        FIRST_OF.format("E_Uni, 150"),
        r"\1",
        "asks for|none of its individual|plan",
    ),
    "a length of the volumetric test left out of the list": (
        ASME,
        FIRST_OF.format(r"Volumetric\.Max"),
        r"\1",
        "plan|by the individual results",
    ),
    "the artefacts left out": (
        ISO,
        r"<dcc:measuringEquipments>.*?</dcc:measuringEquipments>",
        "",
        "measuringEquipment",
    ),
    "the bar left out of the artefacts": (
        ISO,
        (
            r"<dcc:measuringEquipment refType=.basic_normalUsed.>\s*<dcc:name>\s*<dcc:content lang=.en.>bar bar.*?"
            r"</dcc:measuringEquipment>"
        ),
        "",
        "traceability|bar",
    ),
    "the method of uncertainty left out": (
        ISO,
        r"<dcc:usedMethod refType=.basic_uncertainty.>.*?</dcc:usedMethod>",
        "",
        "uncertainty",
    ),
    "the plan left out of the methods": (
        ISO,
        r"<dcc:usedMethod>(?:(?!</dcc:usedMethod>).)*Numbers and formulas.*?</dcc:usedMethod>",
        "",
        "plan",
    ),
    "the statement that it is of one item left out": (
        ISO,
        r"<dcc:statement refType=.truearm_onlyThisItem.>.*?</dcc:statement>",
        "",
        "item",
    ),
    "the conditions of the limits left out": (
        ISO,
        r"<dcc:statement refType=.truearm_ratedConditions.>.*?</dcc:statement>",
        "",
        "rated conditions",
    ),
    "the origin of the coordinates left out": (
        ISO,
        r"<dcc:statement refType=.truearm_coordinates.>.*?</dcc:statement>",
        "",
        "coordinates",
    ),
    "the traceability left out": (
        ISO,
        r"<dcc:statement refType=.truearm_traceability.>.*?</dcc:statement>",
        "",
        "traceability",
    ),
    "the one who signs": (ISO, "mainSigner>true", "mainSigner>false", "no person signs"),
    "the serial number of the arm": (ISO, r"(manufacturer</dcc:issuer>\s*<dcc:value>)10017", r"\1", "empty|serial"),
}
WORDS = {
    "the serial number of the arm": (ISO, r"<dcc:value>10017<", "<dcc:value>10018<", "serial number"),
    "the serial number in the statement": (
        ISO,
        r"item with serial number 10017",
        "item with serial number 10018",
        "serial number",
    ),
    "the laboratory": (
        ISO,
        r"(calibrationLaboratory>\s*<dcc:contact>\s*<dcc:name>\s*<dcc:content lang=.en.>)Example Laboratory",
        r"\1Accredited Institute",
        "laboratory",
    ),
    "the country of the laboratory": (ISO, r"(countryCodeISO3166_1>)DE", r"\1CH", "country"),
    "the software of the arm": (ISO, r"(lang=.en.>)Example Measure 4.2<", r"\1Example Measure 5.0<", "software"),
    "the arm in the title": (ISO, "Verification: Example Arms A", "Verification: Example Arms B", "limits"),
    "the measuring range in the conditions of the limits": (
        ISO,
        "with a measuring range of 2500 mm",
        "with a measuring range of 3500 mm",
        "measuring range",
    ),
    "the source of the limits": (ISO, r"Example Arms A \(data sheet 7\)", "Example Arms A (data sheet 9)", "limits"),
    "the standard as followed, of an own plan": (
        ISO,
        "Articulated arm with tactile probe, after ISO 10360-12:2016",
        "Articulated arm with tactile probe, own plan",
        "own plan",
    ),
    "another standard in the heading": (
        ISO,
        "probe, after ISO 10360-12:2016",
        "probe, after ISO 10360-2:2009",
        "by their norm",
    ),
    "another standard as the norm": (ISO, "<dcc:norm>ISO 10360-12:2016", "<dcc:norm>ISO 10360-8:2013", "by their norm"),
    "the standard taken out of the norm alone": (ISO, r"<dcc:norm>ISO 10360-12:2016</dcc:norm>", "", "standard"),
    "the number of lengths in the plan": (ISO, "uni: lengths = 5", "uni: lengths = 9", "E_Uni"),
    "the repeats in the plan": (ISO, r"(uni: .*?repeats = )3", r"\g<1>10", "E_Uni"),
    "the positions of the ball in the plan": (ISO, r"(probing: .*?positions = )2", r"\g<1>5", "P_Size"),
    "the positions of the articulation in the plan": (ISO, r"(articulation: .*?positions = )2", r"\g<1>6", "L_Dia"),
    "the runs on the ball in the plan": (ASME, r"(effective_diameter: .*?repeats = )3", r"\g<1>6", "EffectiveDiameter"),
    "the seats in the plan": (ASME, r"(single_point: .*?positions = )3", r"\g<1>6", "SPAT"),
    "the positions of the bars in the plan": (ASME, r"(volumetric: .*?positions = )20", r"\g<1>40", "Volumetric"),
    "a plan of fewer points that still names the standard": (
        ISO,
        r"probing: points = 25",
        "probing: points = 9",
        "with probing.points = 9",
    ),
    "traceability denied in words": (
        ISO,
        "(Metrological traceability[^<]*)",
        r"\1 It is not shown of bar.",
        "traceability",
    ),
    "traceability denied in the mark": (ISO, "traceable>true", "traceable>false", "traceable"),
    "the number of an artefact's certificate": (ISO, r"<dcc:value>K-102<", "<dcc:value>K-777<", "traceability"),
    "an artefact's certificate that is none": (ISO, r"<dcc:value>K-102<", "<dcc:value>none<", "traceab"),
    "the accreditation of an issuer": (
        ISO,
        r"<dcc:value>X-K-00001-01-00<",
        "<dcc:value>D-K-15070-01-00<",
        "traceability",
    ),
    "an accreditation taken out": (
        ISO,
        r"<dcc:identification refType=.truearm_issuerAccreditation.*?</dcc:identification>",
        "",
        "traceab",
    ),
    "the laboratory that calibrated an artefact": (
        ISO,
        r"<dcc:value>Example Calibration<",
        "<dcc:value>National Institute<",
        "traceability",
    ),
    "two languages that say two things": (
        ISO,
        r"(<dcc:content lang=.en.>Example Arms A: conform[^<]*</dcc:content>)",
        r"\1<dcc:content lang='de'>nicht konform</dcc:content>",
        "expected one",
    ),
    "another name of a result than of its value": (
        ISO,
        r"(<dcc:result>\s*<dcc:name>\s*<dcc:content lang=.en.>)E_Uni, 1700[^<]*",
        r"\1E_Uni, 2400",
        "E_Uni, 2400",
    ),
    "a value that stands there a second time, with the name of another length": (
        ISO,
        rf"({whole_result('E_Uni, 900')})",
        lambda found: found[0] + found[0].replace("E_Uni, 900", "E_Uni, 2400"),
        "asks for 5 results E_Uni",
    ),
    "a value called one as found": (
        ISO,
        r"<dcc:result>(\s*<dcc:name>\s*<dcc:content lang=.en.>E_Uni, 900)",
        r'<dcc:result refType="truearm_asFound">\1',
        "as found",
    ),
}
CONDITIONS = {
    "the air outside the rated conditions, in words": (
        ISO,
        r"temperature of the air 19\.5 to 20\.5 degC",
        "temperature of the air 19.5 to 28.5 degC",
        "rated",
    ),
    "artefacts outside the rated conditions, in words": (
        ISO,
        r"temperature of the artefacts 20 degC",
        "temperature of the artefacts 28 degC",
        "rated",
    ),
    "the rated conditions narrower than what was measured": (
        ISO,
        r"rated 15 to 25 degC",
        "rated 21 to 22 degC",
        "rated",
    ),
    "the temperature of the room": (ISO, r"(>19\.5<.*?)>20\.5<", r"\1>24.5<", "room|air"),
    "the room colder at the most than at the least": (ISO, r">19\.5<", ">21.5<", "lowest"),
    "the temperature of the artefacts": (ISO, r">20\.00<", ">27.00<", "artefacts"),
    "the highest temperature of the artefacts below the lowest": (
        ISO,
        r"(artefactTemperatureMin.*?)>20\.00<",
        r"\1>20.40<",
        "artefacts",
    ),
    "a humidity of 155 %": (ISO, r">0\.55<", ">1.55<", "from 0 to 100"),
    "a room drier than any": (ISO, r"<si:value>0\.(4|55)<", r"<si:value>0.00\1<", "drier"),
    "a temperature in kelvin": (ISO, r"\\degreecelsius", r"\\kelvin", "expected a unit"),
}
for _kind, _cases in {
    "numbers": NUMBERS,
    "verdicts": VERDICTS,
    "left out": MISSING,
    "words": WORDS,
    "conditions": CONDITIONS,
}.items():
    for _what, (_standard, _before, _after, _said) in _cases.items():
        mistake(f"an unsigned certificate, changed, {_kind}: {_what}", said=f"^truearm: .*(?:{_said})")(
            lambda standard=_standard, edit=(_before, _after): read_edited(edit, standard=standard)
        )


@cache
def unconfirmed() -> str:
    """A certificate by a plan that nobody confirmed."""
    return campaign(
        plan=[(r"\[confirmation\][^\[]*date = 2026-01-15", ""), (r"lengths = ({[^}]*)true", r"lengths = \1false")]
    ).xml(unconfirmed=True)


@cache
def failing() -> str:
    """A certificate of an arm of which a value does not conform."""
    return campaign(ASME, points=too_far()).xml()


def too_far() -> PointsChange:
    """A point in the first seat that lies 0.2 mm off."""

    def change(one, _):  # type: ignore[no-untyped-def]
        points = one.points.copy()
        points[0] += [0.2 * (one.keys["position"] == "1"), 0, 0]
        return at(one, points)

    return in_test("single_point", change)


@cache
def adjusted() -> str:
    """A certificate with results as found, which did not conform, and as left."""
    found = campaign(ASME, seed=2, points=lambda given: too_far()(measured_on(DAY.replace(day=19))(given)))
    return campaign(ASME, about=ADJUSTED).xml(as_found=found.verified())


@cache
def warm() -> str:
    """A certificate of a room outside the rated conditions: nothing is decided."""
    return campaign(limits=[("min = 15, max = 25", "min = 22, max = 25")]).xml()


OTHERS = {
    "the reservation left out": (
        unconfirmed,
        r"<dcc:statement refType=.truearm_notForConformityDecisions.>.*?</dcc:statement>",
        "",
        "has no",
    ),
    "the reservation as a remark, and a decision in its place": (
        unconfirmed,
        r"truearm_notForConformityDecisions(.*?</dcc:declaration>)",
        r"basic_conformity\1<dcc:conformity>pass</dcc:conformity>",
        "not confirmed|the decision is none",
    ),
    "a conformity in one that is not for decisions": (
        unconfirmed,
        r"(refType=.truearm_limit.>)(\s*<dcc:data>)",
        r"\1<dcc:conformity>pass</dcc:conformity>\2",
        "but states a conformity",
    ),
    "the standard named as followed, nobody having confirmed it": (
        unconfirmed,
        r"(Numbers and formulas.*?</dcc:description>)",
        r"\1<dcc:norm>ISO 10360-12:2016</dcc:norm>",
        "standard|not confirmed",
    ),
    "the heading without its reservation": (
        unconfirmed,
        r"\(plan not confirmed against ISO 10360-12:2016\)",
        ", after ISO 10360-12:2016",
        "standard|confirmed",
    ),
    "fail made pass in one value": (
        failing,
        "conformity>fail</dcc:conformity>\\s*<dcc:data>",
        "conformity>pass</dcc:conformity><dcc:data>",
        "by the decision rule fail",
    ),
    "fail made pass in the decision": (
        failing,
        r"(</dcc:declaration>\s*<dcc:conformity>)fail",
        r"\1pass",
        "the decision is fail",
    ),
    "not conform made conform in words": (
        failing,
        "Example Arms A: not conform",
        "Example Arms A: conform",
        "decision says",
    ),
    "the failing value left out": (
        failing,
        whole_result(r"SPAT\.Max, position 1"),
        "",
        "SPAT.Max, position 1|the decision",
    ),
    "the failing value made a limit wider": (
        failing,
        result_of(r"SPAT\.Max, position 1") + r"(.*?limit of the magnitude.*?<si:value>)[\d.]+",
        r"\1\g<2>0.5",
        "by the decision rule pass",
    ),
    "as found made conform in words": (
        adjusted,
        "As found, measured on ([^:]*): Not conform",
        r"As found, measured on \1: Conform",
        "as found",
    ),
    "a failing value as found made pass": (
        adjusted,
        r"(truearm_asFound.*?conformity>)fail",
        r"\1pass",
        "by the decision rule fail",
    ),
    "the results as found left out": (
        adjusted,
        r"<dcc:result refType=.truearm_asFound.>.*?</dcc:result>\s*",
        "",
        "as found",
    ),
    "the adjustment left out": (
        adjusted,
        r"<dcc:influenceCondition refType=.truearm_adjustment.>.*?</dcc:influenceCondition>",
        "",
        "adjustment",
    ),
    "the day as found": (adjusted, r"As found, measured on 2026-01-19", "As found, measured on 2025-11-19", "as found"),
    "nothing decided made pass": (
        warm,
        r"truearm_notDecided(.*?</dcc:declaration>)",
        r"basic_conformity\1<dcc:conformity>pass</dcc:conformity>",
        "the decision is none",
    ),
    "undecided made conform in words": (warm, "Example Arms A: undecided", "Example Arms A: conform", "decision says"),
}
for _what, (_made, _before, _after, _said) in OTHERS.items():
    mistake(f"an unsigned certificate, changed, of another state: {_what}", said=_said)(
        lambda made=_made, edit=(_before, _after): read(edited(made(), [edit]))
    )


# Of another version of the program -----------------------------------------------------------------------------------

OLD_WORDS = {
    "the decision": (r"(<dcc:content lang=.en.>)[^<]*: conform\. Limits: ", r"\1The arm is found to conform. Limits "),
    "the decision rule": (r"(<dcc:content lang=.en.>)Decision rule: [^<]*", r"\1Decisions by ISO 14253-1:2017."),
    "what U is": ("U is the expanded uncertainty of a test value", "Expanded uncertainties are given"),
    "the rated conditions": ("The limits are those of [^<]*", "Limits apply from 15 to 25 degC."),
    "the limits of use": ("The results hold for the arm with [^<]*", "Results hold on the days of the test only."),
    "the item": ("The results relate only to the item with serial number 10017", "These results are of arm 10017 only"),
    "reproduction": ("This certificate may not be reproduced [^<]*", "Copies in full only."),
    "the coordinates": ("Coordinates: from the software of the arm[^<]*", "Points came from the arm's own program."),
    "a remark": ("Limits of the specification that were not tested", "Not tested, although limited"),
    "the plan": (r"Its entries were confirmed against", "All numbers were compared with"),
    "uncertainty": ("Standard uncertainty times the coverage factor k of Student's t [^<]*", "After the GUM."),
    "the heading of the method": (", after ISO 10360-12:2016<", "<"),
}
for _what, _edit in OLD_WORDS.items():
    right(f"the words of another version, of {_what}", unsaid="contradict|refused|expected")(
        lambda edit=_edit: read_edited(edit)
    )


@right("traceability in the words of a version that asked for no accreditation", unsaid="contradict|refused|expected")
def other_words_of_traceability() -> str:
    return read_edited(
        (r"<dcc:identification refType=.truearm_issuerAccreditation.*?</dcc:identification>", ""),
        ("<dcc:traceable>true</dcc:traceable>", ""),
        ("Metrological traceability to the SI units is established by", "Traceability to the SI units rests on"),
    )


@right("a certificate of a version that identified no artefacts", unsaid="contradict|refused|expected")
def without_serial_numbers() -> str:
    return read_edited((r"<dcc:identification refType=.truearm_serialNumber.*?</dcc:identification>", ""))


@right("a release of next year", unsaid="contradict|refused|expected")
def another_release() -> str:
    return read_edited((r"<dcc:release>v[^<]*", "<dcc:release>v9.9"))


@right("white space, comments and the order of attributes as another program writes them", unsaid="contradict|expected")
def written_again() -> str:
    return read(re.sub(r">\s+<", "><", written()).replace("<dcc:items>", "<!-- items --><dcc:items>"))


for _what, _made in {
    "nobody confirmed the plan": unconfirmed,
    "the arm does not conform": failing,
    "the arm was adjusted": adjusted,
    "the room was too cold for the limits": warm,
}.items():
    right(f"a certificate as it was written: {_what}", unsaid="contradict|refused|expected")(
        lambda made=_made: read(made())
    )
