"""A test plan whose numbers a laboratory has confirmed against its copy of the standard."""

from __future__ import annotations

import datetime

from truearm.verification.standards.verification_plan import VerificationPlan


def confirmed(plan, day=datetime.date(2026, 11, 3)):
    """The plan with all numbers confirmed."""

    def set_(value):
        if isinstance(value, dict):
            return {key: True if key == "confirmed" else set_(one) for key, one in value.items()}
        return value

    by = {"confirmed_by": "First Example", "date": day}
    return VerificationPlan.model_validate(set_(plan.model_dump()) | {"confirmation": by})
