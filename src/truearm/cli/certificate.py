"""``truearm certificate``: a verification as a digital calibration certificate."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truearm.cli.console import check_output_is_not_input, check_page_path, print_line

if TYPE_CHECKING:
    from truearm.verification.standards.decision import DecisionRule


def certificate(
    plan: Annotated[str, typer.Option("--plan", help="Test plan, as of truearm verify.")] = "",
    points: Annotated[Path | None, typer.Option("--points", help="Measured points, .csv.")] = None,
    artefacts: Annotated[Path | None, typer.Option("--artefacts", help="Certificates of the artefacts, .toml.")] = None,
    mpe: Annotated[Path | None, typer.Option("--mpe", help="The arm's specification: its limits, .toml.")] = None,
    about: Annotated[
        Path | None, typer.Option("--about", help="Number, days, arm, laboratory, customer, persons, room, .toml.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Certificate to write, .xml.")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="The same for people, .html.")] = None,
    simple: Annotated[
        bool, typer.Option("--simple", help="Simple acceptance: leave the uncertainty out where it is small.")
    ] = False,
    template: Annotated[bool, typer.Option("--template", help="Print a file for --about to fill in, and end.")] = False,
) -> None:
    """State a verification as a calibration certificate.

    Written is a digital calibration certificate (DCC), an XML file in PTB's form. The files are those of truearm
    verify; --about says what a certificate has beside the results. Print the page of --html for a certificate on
    paper.
    """
    from truearm.errors import InputError
    from truearm.files.atomic_write import atomic_file, check_writable
    from truearm.verification.certificate.administrative_data import read_administrative_data
    from truearm.verification.certificate.administrative_data import template as template_text

    if template:
        print_line(template_text().rstrip("\n"))
        return
    given = {"--plan": plan or None, "--points": points, "--artefacts": artefacts, "--mpe": mpe, "--about": about}
    for option, value in (given | {"--out": out}).items():
        if value is None:
            hint = (
                "truearm certificate --template > about.toml" if option == "--about" else "truearm certificate --help"
            )
            raise InputError(f"{option} is missing", hint=hint)
    assert points is not None
    assert artefacts is not None
    assert mpe is not None
    assert about is not None
    assert out is not None
    inputs = (Path(plan), points, artefacts, mpe, about)
    if out.suffix != ".xml":
        raise InputError(f"expected a file name that ends in .xml, got {out.name!r}", file=out)
    check_output_is_not_input(out, *inputs)
    check_writable(out)
    if html is not None:
        check_page_path(html, *inputs, out)

    from truearm.cli.verify import digests, facts, files_of
    from truearm.pages.html import write_page
    from truearm.verification.certificate.certificate import check_uncertainties, make_certificate
    from truearm.verification.certificate.certificate_page import certificate_page
    from truearm.verification.certificate.dcc import write_dcc
    from truearm.verification.standards.artefacts import read_artefacts
    from truearm.verification.standards.measured_points import read_points
    from truearm.verification.standards.specification import read_specification
    from truearm.verification.standards.verification import verify
    from truearm.verification.standards.verification_plan import load_verification_plan

    files = files_of(plan, *inputs[1:])
    known = digests(files)
    told = read_administrative_data(about)
    rule: DecisionRule = "simple" if simple else "iso14253-1"
    planned, specification = load_verification_plan(plan), read_specification(mpe)
    measured, certified = read_points(points), read_artefacts(artefacts)
    outcome = verify(
        measured,
        plan=planned,
        artefacts=certified,
        specification=specification,
        rule=rule,
        plan_sha256=known.get(Path(plan)),
    )
    try:
        check_uncertainties(outcome)
    except InputError as error:
        raise error.in_file(artefacts) from None
    try:
        stated = make_certificate(told, outcome)
    except InputError as error:
        raise error.in_file(about) from None
    now = digests(files)
    for file in files:
        if now.get(file) != known.get(file):
            raise InputError("the file changed while it was read", file=file, hint="the same command again")
    if html is None:
        write_dcc(stated, out)
    else:
        # Both are written before one of them stands, the certificate first: no page of one that is not there.
        with atomic_file(html) as page_beside, atomic_file(out) as beside:
            write_dcc(stated, beside)
            same = f"the same for machines, SHA-256 {sha256(beside.read_bytes()).hexdigest()}"
            page = certificate_page(stated, outcome, facts=[(out.name, same), *facts(known, plan=planned)])
            write_page(page, page_beside)
    print_line(f"{out}: certificate {told.number}, {outcome.verdict.value}")
