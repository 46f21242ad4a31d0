"""``truearm verify``: measured points against a standard's test plan and an arm's specification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truearm.cli.console import Json, check_page_path, print_json, print_line, print_table, version_row

if TYPE_CHECKING:
    from truearm.verification.standards.decision import ConformityResult, DecisionRule
    from truearm.verification.standards.verification_plan import VerificationPlan

CODES = {"conform": 0, "not conform": 1, "undecided": 3}


def verify(
    plan: Annotated[
        str | None, typer.Option("--plan", help="Test plan: iso10360-12, asme-b89.4.22, or a file of your own, .toml.")
    ] = None,
    points: Annotated[Path | None, typer.Option("--points", help="Measured points, .csv.")] = None,
    artefacts: Annotated[Path | None, typer.Option("--artefacts", help="Certificates of the artefacts, .toml.")] = None,
    mpe: Annotated[Path | None, typer.Option("--mpe", help="The arm's specification: its limits, .toml.")] = None,
    simple: Annotated[
        bool, typer.Option("--simple", help="Simple acceptance: leave the uncertainty out where it is small.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option("--report", help="Page to write, .html: values, budgets, artefacts, decision.")
    ] = None,
    simulate: Annotated[
        str | None,
        typer.Option(
            "--simulate",
            metavar="MODEL|PRESET",
            help="Take the test with virtual arms: a model file, or research, shop or perfect.",
        ),
    ] = None,
    arm: Annotated[
        str | None, typer.Option("--arm", help="With --simulate PRESET: the nominal arm (measuring7).")
    ] = None,
    arms: Annotated[
        int | None, typer.Option("--arms", min=1, max=100_000, help="With --simulate: how many arms (100).")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="With --simulate: of arms, poses and noise (0).")
    ] = None,
    sheet: Annotated[
        str | None,
        typer.Option(
            "--sheet", metavar="PLAN", help="Write the operator's sheet of a plan: where, whence, in which order."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="With --sheet: page to write, .html.")] = None,
    print_plan: Annotated[
        str | None, typer.Option("--print-plan", metavar="NAME", help="Print a test plan, to edit: > my-plan.toml.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Verify an arm by the tests of a standard.

    The points may come from any program. Each test value is printed with its expanded uncertainty U, its limit and
    the verdict by ISO 14253-1. Exit code 0: conform; 1: not conform; 3: undecided within the uncertainty.

    With --simulate instead of --points: what virtual arms would pass, before anything is measured. Plan, artefacts and
    limits are iso10360-12 and examples where they are not given. Exit code 0.

    With --sheet: a page to print and to measure by, for the artefacts and the measuring range of --artefacts and --mpe.
    """
    modes = {"--points": points, "--simulate": simulate, "--sheet": sheet, "--print-plan": print_plan}
    _check_together(
        [name for name, value in modes.items() if value is not None],
        {
            "--plan": plan,
            "--artefacts": artefacts,
            "--mpe": mpe,
            "--simple": simple or None,
            "--report": report,
            "--arm": arm,
            "--arms": arms,
            "--seed": seed,
            "--out": out,
            "--json": as_json or None,
        },
    )
    rule: DecisionRule = "simple" if simple else "iso14253-1"
    if print_plan is not None:
        from truearm.verification.standards.verification_plan import plan_text

        typer.echo(plan_text(print_plan), nl=False)
    elif sheet is not None and out is not None:
        from truearm.cli.operator_sheet import write_sheet

        write_sheet(sheet, out, artefacts=artefacts, mpe=mpe)
    elif simulate is not None:
        from truearm.cli.standard_test import simulate_test

        simulate_test(
            simulate,
            arm=arm,
            plan=plan or "iso10360-12",
            artefacts=artefacts,
            mpe=mpe,
            n_arms=100 if arms is None else arms,
            seed=seed or 0,
            rule=rule,
            as_json=as_json,
        )
    elif points is not None and plan is not None and artefacts is not None and mpe is not None:
        _judge(points, plan=plan, artefacts=artefacts, mpe=mpe, rule=rule, report=report, as_json=as_json)


# What each way to use the command needs, and what else it takes.
NEEDS = {"--points": ("--plan", "--artefacts", "--mpe"), "--simulate": (), "--sheet": ("--out",), "--print-plan": ()}
TAKES = {
    "--points": ("--simple", "--report", "--json"),
    "--simulate": ("--plan", "--artefacts", "--mpe", "--simple", "--arm", "--arms", "--seed", "--json"),
    "--sheet": ("--artefacts", "--mpe"),
    "--print-plan": (),
}


def _check_together(modes: list[str], others: dict[str, object]) -> None:
    """Check that one way to use the command is asked for, with all that it needs and nothing that it would not heed."""
    from truearm.errors import InputError

    if len(modes) != 1:
        raise InputError(f"expected one of {', '.join(NEEDS)}", hint="truearm verify --help")
    (mode,) = modes
    given = [name for name, value in others.items() if value is not None]
    missing = [name for name in NEEDS[mode] if name not in given]
    if missing:
        raise InputError(f"{mode} needs {' and '.join(missing)} as well", hint="truearm verify --help")
    if unheeded := [name for name in given if name not in (*NEEDS[mode], *TAKES[mode])]:
        raise InputError(f"{unheeded[0]} does nothing with {mode}", hint="leave it out")


def _judge(
    points: Path, *, plan: str, artefacts: Path, mpe: Path, rule: DecisionRule, report: Path | None, as_json: bool
) -> None:
    """Judge measured points, print the verdict and end with its exit code."""
    from truearm.verification.standards.artefacts import read_artefacts
    from truearm.verification.standards.decision import COVERAGE_PROBABILITY, Verdict
    from truearm.verification.standards.measured_points import read_points
    from truearm.verification.standards.specification import read_specification
    from truearm.verification.standards.verification import verify as verified
    from truearm.verification.standards.verification_plan import load_verification_plan

    if report is not None:
        check_page_path(report, Path(plan), points, artefacts, mpe)
    read = files_of(plan, points, artefacts, mpe)
    known = {} if report is None else digests(read)
    planned, specification = load_verification_plan(plan), read_specification(mpe)
    measured, certified = read_points(points), read_artefacts(artefacts)
    found = verified(measured, plan=planned, artefacts=certified, specification=specification, rule=rule)
    if report is not None:
        from truearm.pages.html import write_page
        from truearm.verification.standards.verification_page import verification_page

        write_page(verification_page(found, facts=facts(known, plan=planned)), report)
    if as_json:
        print_json(
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
        print_line(f"{planned.title}: {specification.name}")
        print_table(
            ["test", "value [mm]", "U [mm]", "limit [mm]", "verdict", "where"],
            [_cells(row) for row in found.rows],
            left_aligned=(0, 4, 5),
        )
        print_line(
            f"U: expanded uncertainty of artefact and set-up, {COVERAGE_PROBABILITY:.2%} (k = 2, or more of few degrees of freedom)"
        )
        for remark in found.remarks:
            print_line(remark)
        closing = {
            Verdict.CONFORM: "conform: the values tested are within their limits",
            Verdict.NOT_CONFORM: "not conform: outside the specification",
            Verdict.UNDECIDED: "undecided: within the uncertainty of a limit; a better artefact or set-up decides",
        }
        print_line(closing[found.verdict])
    raise typer.Exit(CODES[found.verdict.value])


def files_of(plan: str, *others: Path) -> tuple[Path, ...]:
    """The files that are read: the plan's, unless it comes with the program, and the others."""
    from truearm.verification.standards.verification_plan import PLANS

    return others if plan in PLANS else (Path(plan), *others)


def digests(files: Sequence[Path]) -> dict[Path, str]:
    """SHA-256 of the files that can be read more than once: what comes through a pipe is gone after that."""
    from hashlib import file_digest

    found = {}
    for file in files:
        if file.is_file():
            with file.open("rb") as stream:
                found[file] = file_digest(stream, "sha256").hexdigest()
    return found


def facts(known: Mapping[Path, str], *, plan: VerificationPlan) -> list[tuple[str, str]]:
    """What a page about a verification rests on: the plan, the files with their SHA-256, the program."""
    return [
        ("plan", f"{plan.name}: {plan.standard}"),
        *((file.name, f"SHA-256 {digest}") for file, digest in known.items()),
        version_row(),
    ]


def _cells(row: ConformityResult) -> list[str]:
    verdict = "" if row.verdict is None else row.verdict.value
    limit = "" if row.limit is None else f"{row.limit:.4f}"
    if row.unit != "mm":  # a count
        return [row.label, f"{row.value:g}", "", limit, verdict, row.where]
    return [row.label, f"{row.value:+.4f}", f"{row.uncertainty:.4f}", limit, verdict, row.where]


def _for_machines(row: ConformityResult) -> dict[str, Any]:
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
