"""``truearm verify``: measured points against a standard's test plan and an arm's specification."""

from __future__ import annotations

from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, check_page, say, say_json, say_table

if TYPE_CHECKING:
    from truearm.verify.decision import Row, Rule
    from truearm.verify.test_plan import Plan

CODES = {"conform": 0, "not conform": 1, "undecided": 3}


def verify(
    plan: Annotated[
        str, typer.Option("--plan", help="Test plan: iso10360-12, asme-b89.4.22, or a file of your own, .toml.")
    ],
    points: Annotated[Path, typer.Option("--points", help="Measured points, .csv.")],
    artefacts: Annotated[Path, typer.Option("--artefacts", help="Certificates of the artefacts, .toml.")],
    mpe: Annotated[Path, typer.Option("--mpe", help="The arm's specification: its limits, .toml.")],
    simple: Annotated[
        bool, typer.Option("--simple", help="Simple acceptance: leave the uncertainty out where it is small.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option("--report", help="Page to write, .html: values, budgets, artefacts, decision.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Verify an arm by the tests of a standard.

    The points may come from any program. Each test value is printed with its expanded uncertainty U, its limit and
    the verdict by ISO 14253-1. Exit code 0: conform; 1: not conform; 3: undecided within the uncertainty.
    """
    from truearm.verify.artefacts import read_artefacts
    from truearm.verify.decision import LEVEL, Verdict
    from truearm.verify.limits import read_specification
    from truearm.verify.measured import read_points
    from truearm.verify.test_plan import load_plan
    from truearm.verify.verification import verify as verified

    if report is not None:
        check_page(report, Path(plan), points, artefacts, mpe)
    rule: Rule = "simple" if simple else "iso14253-1"
    planned, specification = load_plan(plan), read_specification(mpe)
    measured, certified = read_points(points), read_artefacts(artefacts)
    found = verified(measured, plan=planned, artefacts=certified, specification=specification, rule=rule)
    if report is not None:
        from truearm.report.html import write_page
        from truearm.report.verification import Outcome, verification_page

        outcome = Outcome(found, measured, planned, certified, specification, rule)
        write_page(verification_page(outcome, facts=facts(points, artefacts, mpe, plan=planned)), report)
    if as_json:
        say_json(
            {
                "plan": planned.name,
                "standard": planned.standard,
                "specification": specification.name,
                "rule": rule,
                "verdict": found.verdict.value,
                "rows": [_for_machines(row) for row in found.rows],
                "remarks": list(found.remarks),
            }
        )
    else:
        say(f"{planned.title}: {specification.name}")
        say_table(
            ["test", "value [mm]", "U [mm]", "limit [mm]", "verdict", "where"],
            [_cells(row) for row in found.rows],
            left=(0, 4, 5),
        )
        say(f"U: expanded uncertainty of artefact and set-up, {LEVEL:.2%} (k = 2, or more of few degrees of freedom)")
        for remark in found.remarks:
            say(remark)
        closing = {
            Verdict.CONFORM: "conform: within the specification",
            Verdict.NOT_CONFORM: "not conform: outside the specification",
            Verdict.UNDECIDED: "undecided: within the uncertainty of a limit; a better artefact or set-up decides",
        }
        say(closing[found.verdict])
    raise typer.Exit(CODES[found.verdict.value])


def facts(*files: Path, plan: Plan) -> list[tuple[str, str]]:
    """What a page about a verification rests on."""
    from hashlib import sha256

    import numpy
    import scipy

    from truearm import __version__

    return [
        ("plan", f"{plan.name}: {plan.standard}"),
        *((file.name, f"SHA-256 {sha256(file.read_bytes()).hexdigest()}") for file in files),
        ("versions", f"truearm {__version__}, NumPy {numpy.__version__}, SciPy {scipy.__version__}"),
    ]


def _cells(row: Row) -> list[str]:
    verdict = "" if row.verdict is None else row.verdict.value
    limit = "" if row.limit is None else f"{row.limit:.4f}"
    if row.unit != "mm":  # a count
        return [row.label, f"{row.value:g}", "", limit, verdict, row.where]
    return [row.label, f"{row.value:+.4f}", f"{row.uncertainty:.4f}", limit, verdict, row.where]


def _for_machines(row: Row) -> dict[str, Any]:
    dof = row.budget.dof
    return {
        "label": row.label,
        "value": row.value,
        "unit": row.unit,
        "uncertainty": row.uncertainty,
        "coverage_factor": row.budget.coverage_factor,
        "degrees_of_freedom": None if isinf(dof) else dof,
        "limit": row.limit,
        "verdict": None if row.verdict is None else row.verdict.value,
        "where": row.where,
        "budget": [
            {"label": one.label, "u": one.u, "degrees_of_freedom": None if isinf(one.dof) else one.dof}
            for one in row.budget.contributions
        ],
    }
