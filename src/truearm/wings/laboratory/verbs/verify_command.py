"""``truearm verify``: measured points against a standard's test plan and an arm's specification."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from truearm.drawings.page_record import check_page_path
from truearm.errors import InputError
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.options import AcceptOption, Force, Json, refuse_typed, typed_options
from truearm.verbs.outputs import check_new_output
from truearm.wings.laboratory import DecisionRule, TemplateKind

ArtefactsFile = Annotated[Path | None, Option(help="Certificates of the artefacts, .toml.")]
MpeFile = Annotated[Path | None, Option(help="The arm's specification: its limits and measuring range, .toml.")]
RuleOption = Annotated[
    DecisionRule | None, Option(help="Decision rule; by default that of the plan. simple ignores a small uncertainty.")
]

# The ways to use the command: the options that each needs, and those that it takes beside them.
WAYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "points": (("plan", "artefacts", "mpe"), ("rule", "accept", "report", "as_json")),
    "simulate": ((), ("plan", "artefacts", "mpe", "rule", "arm", "arms", "seed", "as_json")),
    "sheet": (("out",), ("artefacts", "mpe", "points", "tip_diameter", "force")),
    "print_plan": ((), ()),
    "template": ((), ()),
    "artefacts_from": ((), ("out", "result", "trusted", "force", "as_json")),
}


def verify(
    context: typer.Context,
    plan: Annotated[
        str | None, Option(help="Test plan: iso10360-12, asme-b89.4.22, or a file of your own, .toml.")
    ] = None,
    points: Annotated[
        Path | None, Option(help="Measured points, .csv; with --sheet: points to measure, to write.")
    ] = None,
    artefacts: ArtefactsFile = None,
    mpe: MpeFile = None,
    rule: RuleOption = None,
    accept: AcceptOption = None,
    report: Annotated[Path | None, Option(help="Page to write, .html: values, budgets, artefacts, decision.")] = None,
    simulate: Annotated[
        str | None,
        Option(
            metavar="MODEL|PRESET",
            help="Simulate the test with virtual arms: a model file, or research, shop, worn, printed or perfect.",
        ),
    ] = None,
    arm: Annotated[str | None, Option(help="With --simulate PRESET: the nominal arm (measuring7).")] = None,
    arms: Annotated[int | None, Option(min=1, max=100_000, help="With --simulate: number of arms (100).")] = None,
    seed: Annotated[int | None, Option(min=0, help="With --simulate: seed of arms, poses and noise (0).")] = None,
    sheet: Annotated[
        str | None, Option(metavar="PLAN", help="Write the operator's sheet of a plan: places, directions, order.")
    ] = None,
    out: Annotated[
        Path | None,
        Option(help="With --sheet: page to write, .html. With --artefacts-from: file of artefacts to write, .toml."),
    ] = None,
    tip_diameter: Annotated[
        float | None, Option(min=0, help="With --sheet --points: diameter of the stylus tip [mm].")
    ] = None,
    print_plan: Annotated[
        str | None, Option(metavar="NAME", help="Print a test plan, to edit: > my-plan.toml.")
    ] = None,
    template: Annotated[
        TemplateKind | None,
        Option(help="Print an empty file for --artefacts or --mpe, to fill in: > mpe.toml."),
    ] = None,
    artefacts_from: Annotated[
        Path | None,
        Option(
            metavar="CERTIFICATE",
            help="Fill in a file of artefacts from a sphere's, a bar's or a gauge block's digital certificate, .xml.",
        ),
    ] = None,
    result: Annotated[
        list[str] | None,
        Option(
            metavar="ROLE=NAME",
            help="With --artefacts-from: which result is the diameter, length or form, as 'diameter=Mean diameter'.",
        ),
    ] = None,
    trusted: Annotated[
        Path | None, Option(help="With --artefacts-from: the signer's certificate that you trust, .pem.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Verify an arm by the tests of a standard.

    The points may come from any program. Each test value is printed with its expanded uncertainty U, its limit and
    the verdict by ISO 14253-1 (--rule). Exit code 0: conform; 1: not conform; 3: undecided, or not for
    conformity decisions, as nobody has confirmed the numbers of the plan.

    With --simulate instead of --points: what virtual arms would obtain, before anything is measured. Plan, artefacts
    and limits are iso10360-12 and examples where they are not given. Exit code 0.

    With --sheet: a page to print and to measure by, for the artefacts and the measuring range of --artefacts and --mpe.
    --points then writes the points to measure, a row for each with all names filled in; truearm predict --into enters
    the coordinates.

    With --artefacts-from: a file for --artefacts, with what an artefact's digital calibration certificate (DCC) states;
    the rest is named. Without --out it is printed.
    """
    _check_together(context)
    if print_plan is not None:
        from truearm.wings.laboratory.standards.verification_plan import plan_text

        typer.echo(plan_text(print_plan), nl=False)
    elif template is not None:
        from truearm.wings.laboratory.standards.file_templates import template as template_text

        typer.echo(template_text(template), nl=False)
    elif artefacts_from is not None:
        _fill_in_artefacts(artefacts_from, out, result or [], trusted=trusted, force=force, as_json=as_json)
    elif sheet is not None and out is not None:
        _write_sheet(sheet, out, points, artefacts=artefacts, mpe=mpe, tip_diameter=tip_diameter, force=force)
    elif simulate is not None:
        from truearm.wings.laboratory.verbs.simulate_verification import simulate_verification

        n_arms = arms or 100
        with progress(f"simulating the test with {n_arms} virtual arms", n_arms) as tell:
            simulated = simulate_verification(
                simulate,
                arm=arm,
                plan=plan or "iso10360-12",
                artefacts=artefacts,
                specification=mpe,
                rule=rule,
                n_arms=n_arms,
                seed=seed or 0,
                progress=tell,
            )
        print_record(simulated, as_json=as_json)
    elif points is not None and plan is not None and artefacts is not None and mpe is not None:
        _verify_points(points, plan, artefacts, mpe, rule=rule, accept=accept, report=report, as_json=as_json)


def _fill_in_artefacts(
    certificate: Path, out: Path | None, chosen: list[str], *, trusted: Path | None, force: bool, as_json: bool
) -> None:
    from truearm.wings.laboratory.verbs.artefacts_from_certificate import artefacts_from_certificate

    pairs = [text.partition("=") for text in chosen]
    if wrong := [text for text, (_, equals, name) in zip(chosen, pairs, strict=True) if not (equals and name)]:
        raise InputError(f"--result: expected ROLE=NAME, got {wrong[0]!r}", hint="--result 'diameter=Mean diameter'")
    if out is not None:
        check_new_output(out, certificate, trusted, force=force, endings=(".toml",))
    filled_in = artefacts_from_certificate(
        certificate, results={role: name for role, _, name in pairs}, trusted=trusted
    )
    if out is None and not as_json:
        typer.echo(filled_in.text, nl=False)
        return
    if out is not None:
        filled_in.save(out, force=force)
    print_record(filled_in, as_json=as_json, files={"artefacts": out})


def _write_sheet(
    plan: str,
    out: Path,
    points: Path | None,
    *,
    artefacts: Path | None,
    mpe: Path | None,
    tip_diameter: float | None,
    force: bool,
) -> None:
    from truearm.wings.laboratory.verbs.operator_sheet import operator_sheet

    check_page_path(out, plan, artefacts, mpe)
    if points is not None:
        check_new_output(points, plan, artefacts, mpe, force=force, endings=(".csv",))
    laid_out = operator_sheet(plan, artefacts=artefacts, specification=mpe)
    if points is not None:
        laid_out.save_points(points, tip_diameter_mm=tip_diameter, force=force)
    laid_out.save_page(out)
    print_line(f"{out}: {laid_out}")
    if points is not None:
        print_line(f"points to measure written to {points}")


def _verify_points(
    points: Path,
    plan: str,
    artefacts: Path,
    mpe: Path,
    *,
    rule: DecisionRule | None,
    accept: str | None,
    report: Path | None,
    as_json: bool,
) -> None:
    from truearm.wings.laboratory.standards.decision import Verdict
    from truearm.wings.laboratory.verbs.verify import verify as verified

    check_page_path(report, plan, points, artefacts, mpe)
    result = verified(points, plan=plan, artefacts=artefacts, specification=mpe, rule=rule, accept=accept)
    if report is not None:
        result.save_page(report)
    print_record(result, as_json=as_json, files={"page": report})
    raise typer.Exit({Verdict.CONFORM: 0, Verdict.NOT_CONFORM: 1}.get(result.verdict, 3))


def _check_together(context: typer.Context) -> None:
    """Check that exactly one way to use the command is asked for, with all options it needs and no other."""

    def options(names: Iterable[str]) -> list[str]:
        return ["--" + name.replace("_", "-") for name in names]

    typed = typed_options(context)
    ways = [way for way in WAYS if way in typed and not (way == "points" and "sheet" in typed)]
    if len(ways) != 1:
        raise InputError(f"expected one of {', '.join(options(WAYS))}", hint="truearm verify --help")
    (way,) = ways
    needs, takes = WAYS[way]
    if missing := options(name for name in needs if name not in typed):
        raise InputError(f"--{way} needs {' and '.join(missing)} as well", hint="truearm verify --help")
    refuse_typed(context, typed.keys() - {way, *needs, *takes}, f"does not apply to {options([way])[0]}")
