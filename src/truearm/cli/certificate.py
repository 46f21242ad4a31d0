"""``truearm certificate``: a verification as a digital calibration certificate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truearm.cli.console import RuleOption, check_page_path, print_line, print_record


def certificate(
    plan: Annotated[str, typer.Option("--plan", help="Test plan, as of truearm verify.")] = "",
    points: Annotated[Path | None, typer.Option("--points", help="Measured points, .csv.")] = None,
    artefacts: Annotated[Path | None, typer.Option("--artefacts", help="Certificates of the artefacts, .toml.")] = None,
    mpe: Annotated[Path | None, typer.Option("--mpe", help="The arm's specification: its limits, .toml.")] = None,
    about: Annotated[
        Path | None, typer.Option("--about", help="Number, dates, arm, laboratory, customer, persons, room, .toml.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Certificate to write, .xml.")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="The same for people, .html.")] = None,
    pdf: Annotated[
        Path | None, typer.Option("--pdf", help="The same for paper, .pdf: PDF/A-3 with the XML file inside.")
    ] = None,
    logo: Annotated[
        Path | None, typer.Option("--logo", help="With --pdf: the laboratory's logo, .png or .svg.")
    ] = None,
    rule: RuleOption = None,
    unconfirmed: Annotated[
        bool,
        typer.Option(
            "--unconfirmed",
            help="Certify although numbers of the plan are not confirmed: marked 'not for conformity decisions'.",
        ),
    ] = False,
    template: Annotated[
        bool, typer.Option("--template", help="Print a file to fill in for --about, and nothing else.")
    ] = False,
) -> None:
    """State a verification as a calibration certificate.

    The result is a digital calibration certificate (DCC), an XML file in the format of PTB. The files are those of
    truearm verify; --about has the other data of a certificate. --pdf writes the certificate for paper.
    """
    from truearm.errors import InputError

    if template:
        from truearm.verification.certificate.administrative_data import template as template_text

        print_line(template_text().rstrip("\n"))
        return
    given = {"--plan": plan or None, "--points": points, "--artefacts": artefacts, "--mpe": mpe, "--about": about}
    for option, value in (given | {"--out": out}).items():
        if value is None:
            hint = "truearm certificate --template > about.toml" if option == "--about" else None
            raise InputError(f"{option} is missing", hint=hint or "truearm certificate --help")
    assert points is not None
    assert artefacts is not None
    assert mpe is not None
    assert about is not None
    assert out is not None
    from truearm.workflows.certificate import certificate as stated
    from truearm.workflows.certificate import check_certificate_path, check_pdf_path
    from truearm.workflows.verify import verify

    inputs = (Path(plan), points, artefacts, mpe, about)
    check_certificate_path(out, *inputs)
    if html is not None:
        check_page_path(html, *inputs, out)
    if logo is not None and pdf is None:
        raise InputError("--logo applies to --pdf only", hint="add --pdf certificate.pdf")
    if pdf is not None:
        check_pdf_path(pdf, *inputs, out)
    verification = verify(points, plan=plan, artefacts=artefacts, specification=mpe, rule=rule)
    result = stated(verification, about, unconfirmed=unconfirmed)
    result.save(out, html, pdf=pdf, logo=logo)
    print_record(result, files={"certificate": out, "page": html, "PDF": pdf})
