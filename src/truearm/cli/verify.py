"""``truearm verify``: measured points against a standard's test plan and an arm's specification."""

from __future__ import annotations

from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, say, say_json, say_table

if TYPE_CHECKING:
    from truearm.verify.decision import Row

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

    planned, specification = load_plan(plan), read_specification(mpe)
    found = verified(
        read_points(points),
        plan=planned,
        artefacts=read_artefacts(artefacts),
        specification=specification,
        rule="simple" if simple else "iso14253-1",
    )
    if as_json:
        say_json(
            {
                "plan": planned.name,
                "standard": planned.standard,
                "specification": specification.name,
                "rule": "simple" if simple else "iso14253-1",
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
