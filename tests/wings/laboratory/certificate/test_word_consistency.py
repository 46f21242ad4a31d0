"""What a certificate says in words agrees with its data: what is said otherwise is named, and nothing else."""

import re
from dataclasses import replace
from decimal import Decimal
from functools import cache

import pytest
from made_up_outcome import about

import truearm as ta
from confirmed_plan import confirmed
from truearm.wings.laboratory.certificate.certificate import make_certificate
from truearm.wings.laboratory.certificate.word_consistency import word_contradictions
from truearm.wings.laboratory.standards.artefacts import Artefacts
from truearm.wings.laboratory.standards.coordinate_origin import NOT_STATED
from truearm.wings.laboratory.standards.specification import Specification
from truearm.wings.laboratory.standards.verification import verify
from truearm.wings.laboratory.standards.verification_plan import load_verification_plan

PLANS = ("iso10360-12", "asme-b89.4.22")
NAMES = ("arm", "Arm A (of 2024); uni: lengths = 9, rated 1 to 2 mm.", "a. b, for a measuring range of 3 mm")


@cache
def whole(plan="asme-b89.4.22", name="arm", rated="{}"):
    """The certificate of an arm without errors, with names of the laboratory's own."""
    made = ta.simulate_verification("perfect", plan=plan, n_arms=1)
    traced = {"certificate": "K-1", "issued_by": f"Gauge & Co ({name})"[:100], "issuer_accreditation": "X-1"}
    artefacts = made.artefacts.model_dump(exclude_defaults=True)
    for one in (*artefacts["spheres"], *artefacts["bars"], *artefacts["seats"]):
        one |= traced
    limits = made.specification.model_dump(exclude_defaults=True) | {"name": name, "source": f"sheet of {name}"}
    points = made.points(0)
    day = points.tests[next(iter(points.tests))][0].date
    found = verify(
        replace(points, origin=NOT_STATED, serial_number="7"),
        plan=confirmed(load_verification_plan(plan), day),
        artefacts=Artefacts.model_validate(artefacts),
        specification=Specification.model_validate(limits),
    )
    told = about(issued=day, received=None, adjustment=None, replaces=None)
    software = told.set_up.model_copy(update={"software": f"Measure 4 ({name})"})
    laboratory = told.laboratory.model_copy(update={"name": f"Laboratory, {name}"})
    return make_certificate(told.model_copy(update={"set_up": software, "laboratory": laboratory}), found)


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("name", [NAMES[1], *(pytest.param(name, marks=pytest.mark.weekly) for name in NAMES[::2])])
def test_a_certificate_as_it_is_made_says_nothing_otherwise(plan, name):
    """Whatever names have in them: brackets, full stops, words of the plan."""
    assert list(word_contradictions(whole(plan, name))) == []


def said(kind, pattern, after):
    def change(made):
        statements = [
            replace(one, text=re.sub(pattern, after, one.text)) if one.kind == kind else one for one in made.statements
        ]
        assert tuple(statements) != made.statements
        return replace(made, statements=tuple(statements))

    return change


def plan_says(pattern, after):
    def change(made):
        methods = [replace(one, description=re.sub(pattern, after, one.description)) for one in made.methods]
        assert tuple(methods) != made.methods
        return replace(made, methods=tuple(methods))

    return change


def without(kind):
    return lambda made: replace(made, statements=tuple(one for one in made.statements if one.kind != kind))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (said("item", "number 7", "number 8"), "serial number"),
        (said("reproduction", "Laboratory, arm", "Institute"), "laboratory"),
        (said("limits of use", r"Measure 4 \(arm\)", "Measure 5"), "software of the arm"),
        (said("limits of use", r"\(20[\d-]+\)", "(2025-01-01)"), "the days of the measurement are"),
        (said("rated conditions", "range of 2", "range of 3"), "measuring range"),
        (said("rated conditions", "those of arm", "those of robot"), "name of the limits"),
        (said("rated conditions", "air 19.5", "air 12.5"), "not met, and it states pass"),
        (said("rated conditions", "artefacts 20 degC", "artefacts 21 degC"), "temperature of the artefacts: 20 to 20"),
        (
            said("traceability", "certificate K-1 of", "certificate K-9 of"),
            "names the certificate of sphere ball otherwise",
        ),
        (said("decision", r"\d+ values with", "99 values with"), "values with a limit; 99 in words"),
        (said("decision rule", "14253-1:2017", "14253-1:2013"), "its decision rule is that of ISO 14253-1:2017"),
        (said("coordinates", "$", f" SHA-256 {'a' * 64}"), "of another model"),
        (
            plan_says("single_point: points = 10", "single_point: points = 3"),
            "with single_point.points = 3 in place of 10",
        ),
        (
            plan_says(r"(volumetric:.*?positions = )20", r"\g<1>40"),
            "40 individual results of Volumetric.Max; it states 20",
        ),
        (plan_says(r"(single_point:.*?positions = )3", r"\g<1>6"), "asks for 6 results SPAT.Max; it states 3"),
        (plan_says("decision_rule: iso14253-1:2017", "decision_rule: simple"), "that of its plan 'simple'"),
        (plan_says(r"points = 9 \([^)]*\)", "points = 9 (not confirmed)"), "entries are not confirmed"),
        (plan_says("effective_diameter: ", "roundness: "), "without the test effective_diameter"),
        (lambda made: replace(made, artefact_degC=(Decimal(26), Decimal(26))), "the room was at"),
        (lambda made: replace(made, as_found=made.results), "no adjustment or repair"),
        (lambda made: replace(made, results=made.results[1:]), "individual results of EffectiveDiameter, and no value"),
        (lambda made: replace(made, methods=made.methods[1:]), "2 methods"),
        *((without(kind), f"does not state {kind}") for kind in ("coordinates", "traceability", "item")),
    ],
)
def test_what_is_said_otherwise_is_named(change, named):
    contradictions = list(word_contradictions(change(whole())))
    assert any(named in one for one in contradictions), contradictions


@pytest.mark.parametrize(
    "change",
    [
        *(without(kind) for kind in ("coordinates", "rated conditions", "item")),
        plan_says("single_point: points = 10", "single_point: points = 3"),
    ],
)
def test_what_only_this_version_states_may_be_otherwise_in_another_release(change):
    assert list(word_contradictions(replace(change(whole()), release="9.9"))) == []


@pytest.mark.parametrize(
    "kind", ["item", "reproduction", "limits of use", "rated conditions", "decision", "traceability"]
)
def test_a_sentence_of_another_form_contradicts_nothing(kind):
    assert list(word_contradictions(said(kind, "^.*$", "As another version says it.")(whole()))) == []
