"""``truearm verify --sheet``: the operator's sheet of a test plan."""

from __future__ import annotations

from pathlib import Path

from truearm.cli.console import check_page_path, print_line

RANGE_MM = 2500.0


def write_sheet(plan: str, out: Path, *, artefacts: Path | None, mpe: Path | None) -> None:
    """Write the page by which an operator measures a plan's points."""
    from truearm.cli.standard_test import given_or_example
    from truearm.pages.html import write_page
    from truearm.verification.standards.layout import SHOULDER_SHARE, lay_out_tests
    from truearm.verification.standards.operator_sheet import OperatorSheet, operator_sheet_page
    from truearm.verification.standards.verification_plan import load_verification_plan

    check_page_path(out, *(file for file in (Path(plan), artefacts, mpe) if file is not None))
    planned = load_verification_plan(plan)
    specification, certified = given_or_example(RANGE_MM, mpe=mpe, artefacts=artefacts)
    range_mm = specification.measuring_range_mm
    layout = lay_out_tests(planned, certified, range_mm)
    sheet = OperatorSheet(
        planned,
        layout,
        certified,
        measuring_range_mm=range_mm,
        shoulder_mm=SHOULDER_SHARE * range_mm / 2,
        arm="" if mpe is None else specification.name,
    )
    examples = [what for what, file in (("measuring range", mpe), ("artefacts", artefacts)) if file is None]
    write_page(operator_sheet_page(sheet), out)
    print_line(f"{out}: {sum(len(one.points) for one in layout)} points of {planned.title}, to print")
    if examples:
        print_line(f"{' and '.join(examples)}: examples; give your own by --mpe and --artefacts")
