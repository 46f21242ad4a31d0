"""``truearm verify``: measured points against a standard's test plan and an arm's specification."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_new_output, check_output_is_not_input
from truearm.wings.laboratory import DecisionRule, TemplateKind

RuleOption = Annotated[
    DecisionRule | None, Option(help="Decision rule; by default that of the plan. simple ignores a small uncertainty.")
]

TestPlan = Annotated[
    str | None, Option("--test-plan", help="Test plan: iso10360-12, asme-b89.4.22, or a file of your own, .toml.")
]
MeasuredPoints = Annotated[Path | None, Option("--measured", help="Measured points, .csv.")]
Trusted = Annotated[
    Path | None, Option("--trusted", help="Certificates that you trust, of the signer or of who issued theirs, .pem.")
]
PointsToFill = Annotated[Path, Option(help="Points to measure to fill in (truearm verify sheet), .csv.")]
TipDiameter = Annotated[float | None, Option(min=0, help="With --out: diameter of the stylus tip [mm].")]

verify = typer.Typer(cls=options.Group, rich_markup_mode=None, invoke_without_command=True)


@verify.callback()
def points_verified(
    context: typer.Context,
    plan: TestPlan = None,
    points: MeasuredPoints = None,
    artefacts: options.ArtefactsFile = None,
    mpe: options.MpeFile = None,
    rule: RuleOption = None,
    accept: options.AcceptOption = None,
    page: options.Page = None,
    as_json: options.Json = False,
) -> None:
    """Verify an arm by the tests of a standard.

    --test-plan, --measured, --artefacts and --mpe verify measured points, which may come from any program. Each test
    value is printed with its expanded uncertainty U, its limit and the verdict by ISO 14253-1 (--rule). Exit code 0:
    conform; 1: not conform; 3: undecided, or not for conformity decisions, as nobody has confirmed the numbers of the
    plan. --page writes values, budgets, artefacts and decision.

    The commands below come before: a simulation of the test, the sheet to measure by, and files to fill in.
    """
    if context.invoked_subcommand is not None:
        rule_of_place = f"applies to measured points, not to {context.invoked_subcommand}"
        options.refuse_typed(
            context, context.params, rule_of_place, hint=f"truearm verify {context.invoked_subcommand} --help"
        )
        return
    if points is None or plan is None or artefacts is None or mpe is None:
        needed = {"--measured": points, "--test-plan": plan, "--artefacts": artefacts, "--mpe": mpe}
        missing = ", ".join(name for name, stated in needed.items() if stated is None)
        raise InputError(f"expected {missing}", hint="truearm verify --help")
    from truearm.wings.laboratory.standards.decision import Verdict
    from truearm.wings.laboratory.verbs.verify import verify as verified

    check_page_path(page, plan, points, artefacts, mpe)
    result = verified(points, plan=plan, artefacts=artefacts, specification=mpe, rule=rule, accept=accept)
    if page is not None:
        result.save_page(page)
    print_record(result, as_json=as_json, files={"page": page})
    raise typer.Exit({Verdict.CONFORM: 0, Verdict.NOT_CONFORM: 1}.get(result.verdict, 3))


@verify.command()
@options.of_verb("truearm.wings.laboratory.verbs.simulate_verification:simulate_verification")
def simulate(
    verb: Any,
    model: Annotated[
        str, Argument(metavar="MODEL|PRESET", help="A model file, or research, shop, worn, printed or perfect.")
    ],
    plan: TestPlan = "iso10360-12",
    rule: RuleOption = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Simulate the test with virtual arms.

    Before anything is measured. Artefacts and limits are examples where they are not given, and without
    --arm a preset is of the arm measuring7. Exit code 0, whatever the arms obtain.
    """
    with progress(f"simulating the test with {given['n_arms']} virtual arms", given["n_arms"]) as tell:
        simulated = verb(model, plan=plan, rule=rule, **given, progress=tell)
    print_record(simulated, as_json=as_json)


@verify.command()
def sheet(
    context: typer.Context,
    plan: Annotated[str, Argument(help="Test plan, by name or file.")],
    page: Annotated[Path, Option(help="Page to write, .html.")],
    out: Annotated[Path | None, Option(help="Points to measure, to write too, .csv.")] = None,
    artefacts: options.ArtefactsFile = None,
    mpe: options.MpeFile = None,
    tip_diameter: TipDiameter = None,
    force: options.Force = False,
) -> None:
    """Write the operator's sheet of a plan.

    Places, directions, order: a page to print and to measure by, for the artefacts and the measuring range of
    --artefacts and --mpe. --out writes the points to measure, a row for each with all names filled in; truearm
    verify fill enters the coordinates.
    """
    from truearm.wings.laboratory.verbs.operator_sheet import operator_sheet

    if out is None:
        options.refuse_typed(context, ("tip_diameter", "force"), "applies to --out only")
    check_page_path(page, plan, artefacts, mpe)
    if out is not None:
        check_new_output(out, plan, artefacts, mpe, force=force, endings=(".csv",))
    laid_out = operator_sheet(plan, artefacts=artefacts, specification=mpe)
    if out is not None:
        laid_out.save_points(out, tip_diameter_mm=tip_diameter, force=force)
    laid_out.save_page(page)
    print_line(f"{page}: {laid_out}")
    if out is not None:
        print_line(f"points to measure written to {out}")


@verify.command()
@options.of_verb("truearm.verbs.predict:predict", omit=("out",))
def fill(
    verb: Any,
    model: options.ModelFile,
    session: options.SessionFile,
    into: PointsToFill,
    date: options.Date = None,
    artefact_temperature: options.ArtefactTemperature = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Fill in points to measure with a model.

    A reading for each row without coordinates, in their order. The rows state which model computed them
    (coordinates_from, model, model_sha256, outside_training).
    """
    from truearm.wings.laboratory.verbs.operator_sheet import fill_points

    with progress(f"predicting {session.name}"):
        prediction = verb(model, session, **given)
        check_output_is_not_input(into, model, session)
        fill_points(prediction, into, date=date, artefact_degC=artefact_temperature)
    print_record(prediction, as_json=as_json, files={"points": into})


@verify.command("plan")
def print_plan(name: Annotated[str, Argument(help="iso10360-12 or asme-b89.4.22.")]) -> None:
    """Print a test plan, to edit: > my-plan.toml."""
    from truearm.wings.laboratory.standards.verification_plan import plan_text

    typer.echo(plan_text(name), nl=False)


@verify.command()
def template(kind: Annotated[Literal[TemplateKind, "about"], Argument(help="For which option the file is.")]) -> None:
    """Print an empty file for --artefacts, --mpe or --about.

    To fill in: > mpe.toml.
    """
    from truearm.wings.laboratory.certificate.administrative_data import template as about
    from truearm.wings.laboratory.standards.artefacts import template as template_text

    typer.echo(about() if kind == "about" else template_text(kind), nl=False)


@verify.command("artefacts")
def fill_in_artefacts(
    context: typer.Context,
    certificate: Annotated[Path, Argument(help="Digital certificate (DCC) of a sphere, bar or gauge block, .xml.")],
    out: Annotated[Path | None, Option(help="File of artefacts to write, .toml; printed without it.")] = None,
    result: Annotated[
        list[str] | None,
        Option(metavar="ROLE=NAME", help="Which result is the diameter, length or form, as 'diameter=Mean diameter'."),
    ] = None,
    trusted: Trusted = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Fill in --artefacts from a certificate (DCC).

    With what an artefact's digital calibration certificate states; the rest is named.
    """
    from truearm.wings.laboratory.verbs.certificate import artefacts_from_certificate

    if out is None:
        options.refuse_typed(context, ("force",), "applies to --out only")
    pairs = [text.partition("=") for text in result or []]
    if wrong := ["".join(pair) for pair in pairs if not (pair[1] and pair[2])]:
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
