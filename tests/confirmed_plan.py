"""A test plan that a laboratory has confirmed against its copy of the standard."""

import datetime

from truearm.wings.laboratory.standards.verification_plan import VerificationPlan


def confirmed(plan, day=datetime.date(2026, 11, 3), rule=None):
    """The plan with all entries confirmed; perhaps with another decision rule."""

    def set_(value):
        if not isinstance(value, dict):
            return value
        looked_up = {"confirmed": True, "source": "clause 6.2"} if "confirmed" in value else {}
        return {key: set_(one) for key, one in value.items()} | looked_up

    by = {"confirmed_by": "First Example", "date": day}
    given = plan.model_dump(exclude={"guard_band", "decision_rule"} if rule else None)
    if rule:
        given = VerificationPlan.model_validate(given | {"decision_rule": rule}).model_dump()
    return VerificationPlan.model_validate(set_(given) | {"confirmation": by})
