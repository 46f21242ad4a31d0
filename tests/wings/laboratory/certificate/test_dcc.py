"""Digital calibration certificates: what is written is what is read, by the schemas' rules, and no file does harm."""

import datetime
import xml.etree.ElementTree as ET
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_outcome import CONFIRMED, DAY, RECALLED, ROWS, about, certificate, outcome, row

from refusals import refuses
from truearm.errors import InputError, TruearmError
from truearm.wings.laboratory.certificate import dcc_reader as module
from truearm.wings.laboratory.certificate.administrative_data import xml_text as one_line
from truearm.wings.laboratory.certificate.certificate import (
    CONFORMITIES,
    Equipment,
    Method,
    StatedList,
    StatedQuantity,
    StatedResult,
    conformity_of,
)
from truearm.wings.laboratory.certificate.dcc import checked_dcc, dcc
from truearm.wings.laboratory.certificate.dcc_reader import parse_dcc, parse_dcc_file, read_dcc
from truearm.wings.laboratory.certificate.statements import Statement
from truearm.wings.laboratory.pages.certificate_page import CONFORMITY_WORDS, certificate_page
from truearm.wings.laboratory.signatures.x509_certificates import Signer
from truearm.wings.laboratory.signatures.xml_references import BrokenSignature
from truearm.wings.laboratory.standards.decision import (
    DECISION_RULES,
    Budget,
    Contribution,
    outside_rated_conditions,
    worst_result,
)
from truearm.wings.laboratory.standards.specification import RatedRange
from truearm.wings.laboratory.standards.verification_plan import VerificationPlan

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
WHOLE = certificate()
LEAN = certificate(
    about(
        received=None,
        place="laboratory",
        **dict.fromkeys(("site", "replaces", "adjustment", "notes")),
        item={"name": "arm", "maker": "m", "model": "A", "serial_number": "7"},
        laboratory={"name": "l", "post_code": "0", "city": "c", "country": "DE"},
        persons=[{"name": "p", "main_signer": True}],
        conditions={"temperature_degC": (20.0, 20.0)},
    ),
    outcome(
        [
            row(one.value, one.limit, label=one.label, budget=one.budget, rule="simple") if one.limit else one
            for one in ROWS
            if one.limit is None or one.value < 0.04
        ],
        rule="simple",
        degC=float("nan"),
    ),
)
MARKED = certificate(made=outcome(plan=RECALLED), unconfirmed=True)
BOTH = certificate(made=outcome(ROWS[:1]), as_found=outcome())
CASES = pytest.mark.parametrize("made", [WHOLE, LEAN, MARKED, BOTH], ids=["whole", "lean", "marked", "as found"])

# Round trip ----------------------------------------------------------------------------------------------------------

words = st.text(min_size=1, max_size=30).filter(str.strip)
plain = words.map(one_line)
numbers = st.decimals(allow_nan=False, allow_infinity=False, min_value=-1e6, max_value=1e6, places=5)
positive = st.decimals(min_value="0.00001", max_value=1000, places=5)


@st.composite
def quantities(draw, unit="mm"):
    kind = draw(st.sampled_from(["expanded", "standard", "none"]))
    stated = {
        "expanded": {"expanded": draw(positive), "factor": Decimal("2.09"), "level": Decimal("0.9545")},
        "standard": {"standard": draw(positive)},
        "none": {},
    }[kind]
    return StatedQuantity(draw(plain), draw(numbers), unit, **stated)


@st.composite
def results(draw):
    limited = draw(st.booleans())
    limit = draw(quantities()) if limited else None
    return StatedResult(draw(quantities()), limit, draw(st.sampled_from(CONFORMITIES)) if limited else None)


lists = st.lists(
    st.builds(StatedList, plain, st.lists(quantities(), min_size=1, max_size=2).map(tuple)), max_size=2
).map(tuple)


@st.composite
def certificates(draw):
    told = about(
        number=draw(words),
        item={"name": draw(words), "maker": draw(words), "model": draw(words), "serial_number": draw(words)},
        set_up=draw(st.fixed_dictionaries({"stylus": words, "mounting": words, "software": words})),
        conditions={
            "temperature_degC": sorted([draw(st.floats(-50, 100)), draw(st.floats(-50, 100))]),
            "relative_humidity_percent": sorted([draw(st.floats(0, 100)), draw(st.floats(0, 100))]),
        },
    )
    return replace(
        WHOLE,
        about=told,
        title=draw(plain),
        statements=(
            Statement("decision", draw(plain)),
            *draw(st.lists(st.builds(Statement, st.sampled_from([*module.STATEMENTS][2:]), plain), max_size=3)),
        ),
        conformity=draw(st.sampled_from(CONFORMITIES)),
        methods=(Method(draw(plain), draw(plain), draw(st.none() | plain)),),
        equipment=(
            Equipment(
                draw(plain),
                draw(plain),
                draw(plain),
                tuple(draw(st.lists(quantities(), max_size=2))),
                draw(plain),
                draw(st.none() | plain),
            ),
        ),
        artefact_degC=draw(st.none() | st.tuples(numbers, numbers)),
        results=tuple(draw(st.lists(results(), min_size=1, max_size=3))),
        as_found=tuple(draw(st.lists(results(), max_size=2))),
        individual=draw(lists),
        budgets=draw(lists),
    )


@settings(max_examples=40)
@given(certificates())
def test_what_is_written_is_what_is_read(made):
    content = dcc(made)
    again = parse_dcc(content)
    assert again == made
    assert dcc(again) == content  # with the same digits, trailing zeros too


@CASES
def test_a_certificate_of_a_verification_goes_to_a_file_and_back(made, tmp_path):
    assert checked_dcc(made) == dcc(made)
    (tmp_path / "certificate.xml").write_bytes(dcc(made))
    assert read_dcc(tmp_path / "certificate.xml") == made


def test_what_would_be_read_differently_is_not_written():
    with pytest.raises(TruearmError, match="please report this"):
        checked_dcc(replace(WHOLE, release="two  spaces\r\n"))


# What stands in it ---------------------------------------------------------------------------------------------------


def found(made, path):
    return [element.text for element in ET.fromstring(dcc(made)).iterfind(path, SPACES)]


def test_values_are_stated_to_the_digits_of_their_uncertainty():
    real = ".//dcc:result/dcc:data/dcc:quantity[@refType='basic_measuredValue']/si:real/"
    assert found(WHOLE, f"{real}si:value") == ["0.010", "-0.045", "0.051", "0.080", "0.010", "0.02000", "0"]
    assert set(found(WHOLE, f"{real}si:unit")) == {r"\milli\metre", r"\one"}
    expanded = f"{real}si:measurementUncertaintyUnivariate/si:expandedMU/"
    assert found(WHOLE, f"{expanded}si:valueExpandedMU") == [*["0.010"] * 5, "0.00020"]  # a count has none
    assert set(found(WHOLE, f"{expanded}si:coverageFactor")) == {"2.09", "2.00"}
    assert set(found(WHOLE, f"{expanded}si:coverageProbability")) == {"0.9545"}
    sizes = ".//dcc:measuringEquipmentQuantity/si:real/"
    assert found(WHOLE, f"{sizes}si:value") == ["25.00040", "900.00300"]
    assert found(WHOLE, f"{sizes}si:measurementUncertaintyUnivariate/si:standardMU/si:valueStandardMU") == [
        "0.00020",
        "0.00050",
    ]


def test_undecided_values_pass_or_fail_on_a_condition_and_the_worst_counts():
    said = ".//dcc:metaData[@refType='basic_conformity']/dcc:conformity"
    assert found(WHOLE, said) == [
        "pass",
        "conditionalPass",
        "conditionalFail",
        "fail",
        "pass",
    ]  # the fifth has no limit
    overall = ".//dcc:statement/dcc:conformity"
    assert found(WHOLE, overall) == ["fail"]
    for n, worst in ((1, "pass"), (2, "conditionalPass"), (3, "conditionalFail"), (4, "fail")):
        assert found(certificate(made=outcome(ROWS[:n])), overall) == [worst]


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        (0.016875, "0.016875"),  # 15 um + 150 mm / (80 mm/um), which U = 0.0104 would make 0.017
        ((15 + 150.001 / 80) / 1000, "0.0168750125"),  # the nearest float is 0.016875012500000002
        (0.1 + 0.2, "0.3"),
        (50.0, "50"),
        (1e-7, "0.0000001"),
    ],
)
def test_limits_are_the_makers_not_rounded(limit, text):
    made = certificate(made=outcome([row(0.0, limit)]))
    path = ".//dcc:quantity[@refType='truearm_limit']/si:real/si:value"
    assert found(made, path) == [text]
    assert parse_dcc(dcc(made)) == made


@given(st.floats(-0.2, 0.2), st.floats(1e-5, 0.1), st.sampled_from(DECISION_RULES))
def test_what_is_stated_of_a_value_is_what_value_and_uncertainty_say(value, u, rule):
    judged = row(value, 0.05, budget=Budget((Contribution("all", u),)), rule=rule)
    expanded, said = judged.uncertainty, conformity_of(judged)
    if rule == "simple" and expanded <= 0.05 / 4:
        assert said == ("pass" if abs(value) <= 0.05 else "fail")
    elif rule == "iso14253-1:2017":
        within = abs(value) <= 0.05
        assert said in (("pass", "conditionalPass") if within else ("fail", "conditionalFail"))
        assert (said == "pass") == (judged.conformance_probability >= 0.95)
    elif abs(value) <= 0.05:
        assert said == ("pass" if abs(value) + expanded <= 0.05 else "conditionalPass")
    else:
        assert said == ("fail" if abs(value) - expanded > 0.05 else "conditionalFail")


def test_a_value_with_a_limit_but_no_uncertainty_gets_no_certificate():
    with pytest.raises(InputError, match=r"P_Form, position 1: its expanded uncertainty is 0.*form_mm and u_fixture"):
        certificate(made=outcome([row(0.01), row(0.02, label="P_Form", budget=Budget())]))
    assert certificate(made=outcome([row(0.01), row(0.02, None, budget=Budget())])).results[1].conformity is None


def test_the_rule_is_named_by_its_edition_or_not_at_all():
    norms = [found(certificate(made=outcome(ROWS[:1], rule=rule)), ".//dcc:norm") for rule in DECISION_RULES]
    assert norms == [
        ["JCGM 100:2008", "ISO 10360-12:2016", "ISO 14253-1:2017"],
        ["JCGM 100:2008", "ISO 10360-12:2016", "ISO 14253-1:2013"],
        ["JCGM 100:2008", "ISO 10360-12:2016"],
    ]


def test_a_plan_of_the_user_is_stated_with_its_digest_and_numbers():
    shipped = MARKED.methods[1].description
    assert shipped.startswith("Test plan iso10360-12 of truearm")
    assert "where they stand: probing: points = 25 (not confirmed), pattern: evenly over half" in shipped
    assert "; uni: lengths = 5 (not confirmed)," in shipped
    assert "; decision: decision_rule: iso14253-1:2017 (not confirmed), guard_band: 1.645 u" in shipped
    assert "articulation" not in shipped  # no points
    cut = CONFIRMED.model_copy(update={"articulation": None, "uni": None, "bi": None})
    own = certificate(made=outcome(ROWS[:1], plan=cut, plan_sha256="ab12")).methods[1].description
    assert own.startswith(
        "Test plan of the user, named iso10360-12, SHA-256 ab12. Its entries were confirmed against ISO 10360-12:2016 "
        f"by First Example on {DAY}. Numbers and formulas, and where they stand: probing: points = 25 (clause 6.2), "
    )
    assert "uni:" not in own
    # It tests less than the standard as truearm knows it: its results are not named after the standard.
    made = certificate(made=outcome(ROWS[:1], plan=cut))
    assert made.methods[1].name == "Articulated arm with tactile probe, own plan"
    assert found(made, ".//dcc:norm") == ["JCGM 100:2008", "ISO 14253-1:2013"]
    nameless = certificate(made=outcome(ROWS[:1], plan=cut.model_copy(update={"name": "mine"})))
    assert "the user, named mine. Its entries" in nameless.methods[1].description


def test_without_confirmed_numbers_there_is_no_certificate_or_one_without_conformity():
    with pytest.raises(InputError, match=r"certificate: 21 entries are not confirmed against .* in .*: prob"):
        certificate(made=outcome(plan=RECALLED))
    assert MARKED.reservation is not None
    assert MARKED.reservation.startswith("Not for conformity decisions: ")
    assert MARKED.conformity is None
    assert MARKED.texts("decision") == MARKED.texts("decision rule") == ()
    assert found(MARKED, ".//dcc:conformity") == []
    assert found(MARKED, ".//dcc:norm") == ["JCGM 100:2008"]
    assert MARKED.methods[1].name == "Articulated arm with tactile probe (plan not confirmed against ISO 10360-12:2016)"
    # Limits are stated all the same, and confirmed numbers need no mark.
    assert [one.limit for one in MARKED.results] == [one.limit for one in WHOLE.results]
    assert certificate(unconfirmed=True) == WHOLE
    assert WHOLE.reservation is None
    assert WHOLE.methods[1].name == "Articulated arm with tactile probe, after ISO 10360-12:2016"


def test_numbers_set_to_confirmed_need_the_name_of_who_did_it():
    nameless = CONFIRMED.model_copy(update={"confirmation": None})
    with pytest.raises(
        InputError, match=r"does not state who confirmed its entries .*\[confirmation\] with confirmed_by"
    ):
        certificate(made=outcome(plan=nameless))
    # Tests without points do not count.
    own = CONFIRMED.model_copy(update={"bi": RECALLED.bi})
    assert certificate(made=outcome(plan=own)).conformity == WHOLE.conformity


def test_nothing_is_stated_of_a_value_outside_the_rated_conditions_of_its_limit():
    outside = outside_rated_conditions(row(0.001, label="E_Uni, 150"))
    made = certificate(made=outcome([row(0.01), outside]))
    assert [one.conformity for one in made.results] == ["pass", None]
    assert made.conformity is None
    assert parse_dcc(dcc(made)) == made
    assert found(made, ".//dcc:statement/dcc:conformity") == []
    # A value within them that fails is a fail of all.
    failed = certificate(made=outcome([row(0.08), outside]))
    assert failed.conformity == "fail"
    assert parse_dcc(dcc(failed)) == failed


def rated(**ranges):
    made = outcome([row(0.01), row(0.08, label="E_Bi, 900")])
    limits = made.specification.model_copy(
        update={"rated_conditions": {key: RatedRange(**one) for key, one in ranges.items()}}
    )
    return replace(made, specification=limits)


def measured_at(made, **conditions):
    """The verification with conditions at the points of its first test only."""
    tests = dict(made.measured.tests)
    name, groups = next(iter(tests.items()))
    tests[name] = tuple(replace(group, conditions=conditions) for group in groups)
    return replace(made, measured=replace(made.measured, tests=tests))


@pytest.mark.parametrize(
    ("ranges", "told", "stated", "said"),
    [
        ({"air_degC": {"min": 15, "max": 25}}, {"temperature_degC": (20.0, 27.9)}, {}, "27.9 degC, rated 15 to 25"),
        ({"humidity_percent": {"max": 30}}, {}, {}, "humidity 40.1 to 55 %, rated 30"),
        ({"warm_up_min": {"min": 30}}, {}, {}, "fill in the column warm_up_min of the points"),
        # One group that states a condition does not state it for the others.
        ({"warm_up_min": {"min": 30}}, {}, {"warm_up_min": (40.0, 40.0)}, "at some of the points, rated 30 min"),
        (
            {"humidity_percent": {"max": 70}},
            {"relative_humidity_percent": None},
            {},
            "humidity_percent of the points or relative_humidity_percent of the room",
        ),
    ],
)
def test_rated_conditions_that_the_room_contradicts_or_nobody_states_leave_all_undecided(ranges, told, stated, said):
    room = about(conditions={"temperature_degC": (19.5, 20.5), "relative_humidity_percent": (40.1, 55.0)} | told)
    made = certificate(room, measured_at(rated(**ranges), **stated))
    assert made.conformity is None
    assert [one.conformity for one in made.results] == [None, None]
    assert found(made, ".//dcc:conformity") == []
    assert said in made.texts("decision")[0]
    assert "guard band about" not in made.texts("decision")[0]
    assert parse_dcc(dcc(made)) == made


def test_rated_conditions_that_the_room_states_are_met():
    made = certificate(made=rated(air_degC={"min": 15, "max": 25}, humidity_percent={"max": 70}))
    assert [one.conformity for one in made.results] == ["pass", "fail"]
    assert "relative humidity 40.1 to 55 %, rated 70 % or less" in made.texts("rated conditions")[0]
    assert not any("not stated" in one for one in made.texts("remark"))


def test_the_verdict_on_paper_lists_no_values_of_unmet_conditions():
    made = rated(humidity_percent={"max": 30}).in_room(about().room)
    verdict = certificate_page(certificate(made=made), made).verdict
    assert verdict.sentence.startswith("Undecided: rated conditions not met: relative humidity")
    assert (verdict.state, verdict.detail) == ("doubtful", "")


def test_a_plan_confirmed_after_the_certificate_was_issued_is_refused():
    late = CONFIRMED.confirmation.model_copy(update={"date": DAY.replace(day=6)})
    with pytest.raises(InputError, match="before the numbers of the test plan were confirmed on 2026-11-06"):
        certificate(made=outcome(plan=CONFIRMED.model_copy(update={"confirmation": late})))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"confirmed_by": " "}, "expected who confirmed the numbers"),
        ({"confirmed_by": "-1-"}, "expected who confirmed the numbers"),
        ({"date": datetime.date(1900, 1, 1)}, "before ISO 10360-12:2016 was published"),
    ],
)
def test_a_confirmation_names_somebody_and_a_day_after_the_standard(changes, told):
    plan = CONFIRMED.model_dump()
    with pytest.raises((InputError, ValueError), match=told):
        VerificationPlan.model_validate(plan | {"confirmation": plan["confirmation"] | changes})


def test_states_and_statements_are_whole():
    assert CONFORMITY_WORDS.keys() == {*CONFORMITIES, None}
    conditioned = certificate(made=rated(humidity_percent={"max": 70}))
    kinds = {one.kind for made in (WHOLE, MARKED, conditioned) for one in made.statements}
    assert kinds == module.STATEMENTS.keys()


def test_a_mark_and_a_conformity_in_one_file_are_refused():
    text = dcc(WHOLE).decode().replace("truearm_limitsOfUse", "truearm_notForConformityDecisions")
    refuses("not for conformity decisions, but states a conformity", parse_dcc, text.encode())


def test_every_individual_result_and_budget_is_stated():
    rows = [row(value, label="E_Uni, 900") for value in (0.0102, -0.0207, 0.0049)]
    made = certificate(made=outcome([worst_result(rows)]))
    (listed,) = made.individual
    assert listed.name == "E_Uni, 900"
    assert [str(one.value) for one in listed.quantities] == ["0.010", "-0.021", "0.005"]
    assert {str(one.expanded) for one in listed.quantities} == {"0.010"}
    (budget,) = made.budgets
    assert [(one.name, str(one.value)) for one in budget.quantities] == [
        ("calibration", "0.0030"),
        ("calibration: degrees of freedom", "4.0"),
        ("fixture", "0.0040"),
        ("combined standard uncertainty", "0.0050"),
        ("combined standard uncertainty: degrees of freedom", "30.9"),  # 0.005^4 / (0.003^4 / 4)
    ]
    assert parse_dcc(dcc(made)) == made


def test_a_certificate_names_who_calibrated_the_artefacts():
    made = outcome()
    nameless = made.artefacts.spheres[0].model_copy(update={"issued_by": None})
    artefacts = made.artefacts.model_copy(update={"spheres": (nameless,)})
    with pytest.raises(InputError, match=r"'ball': a certificate names the laboratory .*issued_by"):
        certificate(made=replace(made, artefacts=artefacts))
    assert "bar by certificate K-1 of Gauge & Co, accreditation X-K-12 (2026-11-03)" in WHOLE.texts("traceability")[0]


def with_artefacts(**changes):
    """The verification with other certificates of its artefacts, by name."""
    made = outcome()
    kinds = {
        kind: tuple(one.model_copy(update=changes.get(one.name, {})) for one in getattr(made.artefacts, kind))
        for kind in ("spheres", "bars", "seats")
    }
    return replace(made, artefacts=made.artefacts.model_copy(update=kinds))


@pytest.mark.parametrize(
    ("change", "missing"),
    [
        ({"certificate": "none"}, "number of the certificate"),
        ({"certificate": "made here"}, "number of the certificate"),
        ({"issued_by": "-"}, "laboratory that issued it"),
        ({"issued_by": "Nobody."}, "laboratory that issued it"),
        ({"issuer_accreditation": None}, "accreditation of that laboratory"),
        ({"issuer_accreditation": "n/a"}, "accreditation of that laboratory"),
        ({"certificate": "none", "issuer_accreditation": None}, "number of the certificate, accreditation of that"),
    ],
)
def test_no_traceability_is_stated_of_an_artefact_without_number_issuer_or_accreditation(change, missing):
    assert WHOLE.is_traceable
    assert found(WHOLE, ".//dcc:statement/dcc:traceable") == ["true"]
    made = certificate(made=with_artefacts(cone=change))
    (said,) = made.texts("traceability")
    shown, _, rest = said.partition(" It is not shown of ")
    assert "cone" not in shown
    assert rest.startswith(f"cone (not stated: {missing}")
    assert not made.is_traceable
    assert found(made, ".//dcc:statement/dcc:traceable") == ["false"]
    assert parse_dcc(dcc(made)) == made
    none = certificate(made=with_artefacts(ball=change, bar=change, cone=change)).texts("traceability")[0]
    assert none.startswith("No metrological traceability to the SI units is shown. It is not shown of ball (")


def test_what_was_found_before_an_adjustment_is_stated_beside_what_was_left():
    (said,) = BOTH.texts("adjustment")
    assert said.startswith(
        "The results are as left, after this repair: cable of joint 4 renewed. As found, measured on "
    )
    assert "Not conform: 1 of 5 tested values does not conform" in said
    assert len(BOTH.as_found) == len(ROWS)
    assert BOTH.conformity == "pass"  # that of the arm as left
    status = ".//dcc:influenceCondition[@refType='truearm_adjustment']/dcc:status"
    assert found(BOTH, status) == ["afterRepair"]
    assert len(found(BOTH, ".//dcc:result[@refType='truearm_asFound']")) == len(ROWS)
    (alone,) = WHOLE.texts("adjustment")
    assert alone.endswith("Results as found, before it, are not available.")
    assert LEAN.texts("adjustment") == ()


def test_results_as_found_need_an_adjustment_after_them():
    with pytest.raises(InputError, match=r"no adjustment or repair is stated.*\[adjustment\]"):
        certificate(about(adjustment=None), as_found=outcome())
    before = outcome(ROWS[:1])
    tests = {
        name: tuple(replace(one, date=DAY.replace(day=2)) for one in groups)
        for name, groups in before.measured.tests.items()
    }
    earlier = replace(before, measured=replace(before.measured, tests=tests))
    made = certificate(as_found=earlier)
    assert (made.begin, made.end) == (DAY.replace(day=2), DAY)
    with pytest.raises(
        InputError, match="as found were measured on 2026-11-03, after the first points as left on 2026-"
    ):
        certificate(made=earlier, as_found=outcome())
    after = outcome()
    with pytest.raises(
        InputError,
        match=r"^points.csv, line 2: points as found: .* has the same coordinates as position 1 as left: a copy",
    ):
        certificate(made=after, as_found=replace(before, measured=after.measured))


def test_temperatures_are_said_to_be_means():
    name = ".//dcc:influenceCondition[@refType='truearm_artefactTemperature']/dcc:name/dcc:content"
    assert found(WHOLE, name) == ["artefact temperature, means of groups of points"]


# Rules of the schemas ------------------------------------------------------------------------------------------------

# The order of children in dcc.xsd 3.3.0 and SI_Format.xsd 2.2.1 (xs:sequence), as far as they are written.
ORDER = {
    "digitalCalibrationCertificate": "administrativeData measurementResults",
    "coreData": "countryCodeISO3166_1 usedLangCodeISO639_1 mandatoryLangCodeISO639_1 uniqueIdentifier receiptDate "
    "beginPerformanceDate endPerformanceDate performanceLocation issueDate reportAmendedSubstituted",
    "reportAmendedSubstituted": "typeOfChange replacedUniqueIdentifier",
    "software": "name release type",
    "item": "name description manufacturer model identifications",
    "identification": "issuer value name",
    "calibrationLaboratory": "calibrationLaboratoryCode contact",
    "contact": "name eMail phone location",
    "customer": "name eMail phone location",
    "respPerson": "person role mainSigner",
    "statement": "name traceable declaration conformity location",
    "measurementResult": "name usedMethods usedSoftware measuringEquipments influenceConditions results",
    "usedMethod": "name description norm",
    "measuringEquipment": "name description identifications measuringEquipmentQuantities",
    "influenceCondition": "name status data",
    "result": "name data",
    "quantity": "name real measurementMetaData",
    "measuringEquipmentQuantity": "name real",
    "metaData": "conformity data",
    "real": "value unit measurementUncertaintyUnivariate",
    "expandedMU": "valueExpandedMU coverageFactor coverageProbability",
}


@CASES
def test_children_stand_in_the_order_of_the_schemas(made):
    seen = set()
    for element in ET.fromstring(dcc(made)).iter():
        name = element.tag.rpartition("}")[2]
        if name in ORDER:
            children = [child.tag.rpartition("}")[2] for child in element]
            places = [ORDER[name].split().index(child) for child in children]
            assert places == sorted(places), (name, children)
            seen.add(name)
        elif len(element) and name not in ("location", "data", "list"):
            assert len({child.tag for child in element}) == 1 or name == "administrativeData", name
    assert seen >= set(ORDER) - {"expandedMU", "reportAmendedSubstituted"}


@CASES
def test_the_schema_of_ptb_and_its_rules_find_nothing_wrong(made, tmp_path):
    validation = pytest.importorskip("dcclib.validation", reason="pip install truearm[dcc] checks against the schemas")
    schema = pytest.importorskip("dcclib.validation.xsd").SchemaVersion
    (tmp_path / "certificate.xml").write_bytes(dcc(made))
    checked = validation.XsdValidator.from_version(schema.v3_3_0).validate_file(str(tmp_path / "certificate.xml"))
    assert [error.message for error in checked.errors] == []
    assert checked.is_valid
    rules = validation.SchematronValidator.for_dcc().validate_file(str(tmp_path / "certificate.xml"))
    assert [(one.role, one.text) for one in rules.failed_assertions] == []
    assert [one.text for one in rules.successful_reports if one.role != "information"] == []


def test_a_signed_certificate_is_valid_by_the_schema(tmp_path):
    validation = pytest.importorskip("dcclib.validation", reason="pip install truearm[dcc] checks against the schemas")
    schema = pytest.importorskip("dcclib.validation.xsd").SchemaVersion
    pytest.importorskip("signxml", reason="pip install truearm[sign] signs")
    from made_up_signers import certified, curve_key

    key = curve_key()
    content = checked_dcc(WHOLE, Signer(certified(key), key))
    (tmp_path / "certificate.xml").write_bytes(content)
    checked = validation.XsdValidator.from_version(schema.v3_3_0).validate_file(str(tmp_path / "certificate.xml"))
    assert [error.message for error in checked.errors] == []
    assert read_dcc(tmp_path / "certificate.xml") == WHOLE


# Hostile files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: "", "not valid XML"),
        (lambda text: text[: len(text) // 2], "not valid XML"),
        (
            lambda text: text.replace("<?xml version='1.0' encoding='utf-8'?>", "<!DOCTYPE a [<!ENTITY b 'c'>]>"),
            "DOCTYPE",
        ),
        (lambda text: text.replace("digitalCalibrationCertificate", "other"), "digital calibration certificate"),
        (lambda text: text.replace('Version="3.3.0"', 'Version="2.4.0"'), "schema version 3.3.0, got '2.4.0'"),
        (
            lambda text: text.replace("https://ptb.de/si", "https://ptb.example"),
            "expected one value, an si:real, got 0",
        ),
        (lambda text: text.replace(">0.010<", ">NaN<"), "expected a number, got 'NaN'"),
        (lambda text: text.replace(">0.010<", ">1e999999999<"), "expected a number"),
        (lambda text: text.replace(r"\milli\metre", r"\inch"), r"unit of .*got '\\\\inch'"),
        (lambda text: text.replace(">conditionalPass<", ">perhaps<"), "conformity of pass.*got 'perhaps'"),
        (lambda text: text.replace(">2026-11-05<", ">05.11.2026<"), "issueDate.*expected a date"),
        (lambda text: text.replace("<dcc:model>A</dcc:model>", ""), "<item> has no model"),
        (lambda text: text.replace("<dcc:model>A</dcc:model>", "<dcc:model>A</dcc:model>" * 2), "expected one model"),
        (lambda text: text.replace(">DE<", ">Germany<"), "two capital letters"),
        (
            lambda text: text.replace(">true</dcc:traceable>", ">false</dcc:traceable>"),
            "<traceable> is true; .*'false'",
        ),
        (lambda text: text.replace("truearm_onlyInFull", "truearm_notDecided"), "a decision, and that there is none"),
        (
            lambda text: text.replace("</dcc:metaData>", "</dcc:metaData><dcc:metaData/>"),
            "expected one measurementMetaData/metaData, got 2",
        ),
        (lambda text: text.replace(">0.010<", ">0.0_10<"), "expected a number"),
    ],
)
def test_a_broken_certificate_is_refused_with_the_reason(change, told, tmp_path):
    file = tmp_path / "certificate.xml"
    file.write_text(change(dcc(WHOLE).decode()))
    assert refuses(told, read_dcc, file).file == file


def test_no_other_encoding_hides_a_document_type():
    text = dcc(WHOLE).decode().replace("encoding='utf-8'", "encoding='utf-16'")
    refuses("UTF-8", parse_dcc, text.encode("utf-16"))
    refuses(r"UTF-8|XML", parse_dcc, b"\x00" + dcc(WHOLE))
    # What the declaration says does not count: the bytes are UTF-8.
    assert parse_dcc(text.encode()) == WHOLE


def test_texts_are_read_in_one_line():
    """So that none pretends to be a line of truearm, such as that on the signature."""
    assert parse_dcc(dcc(WHOLE).replace(b"The results relate", b"The\n\xc2\x85results relate")) == WHOLE


def test_a_long_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_BYTES", 1000)
    (tmp_path / "certificate.xml").write_bytes(dcc(WHOLE))
    refuses(r"larger than 0\.001 MB", read_dcc, tmp_path / "certificate.xml")


@pytest.mark.parametrize("every", [7, pytest.param(3, marks=pytest.mark.weekly)])
def test_whatever_element_is_missing_empty_or_double_the_reader_refuses_or_reads(every):
    """Never any other exception."""
    small = certificate(made=outcome([worst_result(ROWS[:2])]))
    root = ET.fromstring(dcc(small))
    refused = 0
    for parent in list(root.iter())[::every]:  # they repeat
        for child in list(parent):
            at, text = list(parent).index(child), child.text
            variants = [lambda: parent.remove(child), lambda: parent.insert(at, child)]  # noqa: B023
            for change in variants:
                change()
                try:
                    parse_dcc(ET.tostring(root))
                except InputError:
                    refused += 1
                parent[:] = [one for i, one in enumerate(parent) if one is not child]
                parent.insert(at, child)
            child.text = None
            try:
                parse_dcc(ET.tostring(root))
            except InputError:
                refused += 1
            child.text = text
    assert parse_dcc(ET.tostring(root)) == small
    assert refused > 150 / every


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ("2026-02-10T09:00:00Z", "made on 2026-02-10, before what it signs was measured on 2026-11-03"),
        ("2026-11-03T09:00:00Z", "made on 2026-11-03, before what it signs was issued on 2026-11-05"),
        ("2026-11-04T10:00:00Z", None),  # already the 5th, 14 hours east of Greenwich
        ("2026-11-06T09:00:00+02:00", None),
    ],
)
def test_what_is_signed_was_measured_and_issued_before(time, said):
    """A key that has expired signs only with its clock set back."""
    pytest.importorskip("signxml", reason="pip install truearm[sign] verifies")
    from made_up_signers import advanced, certified, curve_key

    key = curve_key()
    signed = advanced(certified(key), key, content=dcc(certificate()).rstrip(), time=time)
    if said is None:
        assert parse_dcc_file(signed).signature.answer == "good"
    else:
        with pytest.raises(BrokenSignature, match=f"signature is broken: by its own time it was {said}"):
            parse_dcc_file(signed)
