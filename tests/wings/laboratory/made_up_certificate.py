"""What a made-up certificate says beside the results, and a plan that a laboratory has confirmed."""

import re

from truearm.wings.laboratory.standards.decision import DECISION_RULES
from truearm.wings.laboratory.standards.verification_plan import GUARD_BANDS, plan_text


def confirm(plan, rule=DECISION_RULES[0]):
    """Confirm all entries of a plan's text, as a laboratory would."""
    for name, of in (("decision_rule", rule), ("guard_band", GUARD_BANDS[rule])):
        plan = re.sub(f'(?m)^{name} = {{ value = "[^"]*"', f'{name} = {{ value = "{of}"', plan)
    plan = re.sub('confirmed = false, source = "[^"]*"', 'confirmed = true, source = "clause 6.2"', plan)
    plan = plan.replace("# [confirmation]", "[confirmation]")
    plan = plan.replace('# confirmed_by = ""', 'confirmed_by = "First Example, head of the laboratory"')
    return plan.replace("# date = 1900-01-01", "date = 2026-11-02")


CONFIRMED_PLAN = confirm(plan_text("iso10360-12"))

ABOUT = """\
number = "V-2026-042"
issued = 2026-11-05
received = 2026-11-02
place = "laboratory"

[item]
name = "articulated arm coordinate measuring machine"
maker = "Example Arms"
model = "A 2500"
serial_number = "10017"

[set_up]
stylus = "ball of ruby, diameter 6 mm, length 50 mm, number 12"
mounting = "magnetic base on a granite table"
software = "Example Measure 4.2, firmware 1.17"

[laboratory]
name = "Example Laboratory"
code = "X-000-00"
street = "Gauge Street"
street_no = "1"
post_code = "00000"
city = "Exampletown"
country = "DE"

[customer]
name = "Example Customer"
post_code = "00001"
city = "Exampleville"
country = "FR"

[[persons]]
name = "First Example"
role = "head of the laboratory"
main_signer = true

[[persons]]
name = "Second Example"

[conditions]
temperature_degC = [19.6, 20.4]
relative_humidity_percent = [40.0, 55.0]
"""
