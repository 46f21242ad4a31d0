"""``truearm certificate``: a verification as a digital calibration certificate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truearm.cli.console import Json, RuleOption, print_line, print_record

if TYPE_CHECKING:
    from truearm.files.xml_signatures import Signer


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
    sign: Annotated[
        Path | None,
        typer.Option(
            "--sign",
            help="Private key to sign the XML file with, .pem: RSA of 2048 bits or more, or an elliptic curve of 256 "
            "bits or more.",
        ),
    ] = None,
    signer: Annotated[Path | None, typer.Option("--signer", help="With --sign: the key's certificate, .pem.")] = None,
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
    read: Annotated[
        Path | None, typer.Option("--read", help="Read a certificate, .xml, and verify its signature.")
    ] = None,
    trusted: Annotated[
        Path | None, typer.Option("--trusted", help="With --read: the signer's certificate that you trust, .pem.")
    ] = None,
    as_json: Json = False,
) -> None:
    """State a verification as a calibration certificate.

    The result is a digital calibration certificate (DCC), an XML file in the format of PTB. The files are those of
    truearm verify; --about has the other data of a certificate. --pdf writes the certificate for paper.

    With --read: what a certificate states, and who signed it. A broken signature is refused.
    """
    if template:
        from truearm.verification.certificate.administrative_data import template as template_text

        print_line(template_text().rstrip("\n"))
        return
    if read is not None:
        inputs_of_a_new_one = {"--points": points, "--artefacts": artefacts, "--mpe": mpe, "--about": about}
        outputs = {"--out": out, "--html": html, "--pdf": pdf, "--logo": logo, "--sign": sign, "--signer": signer}
        others = {"--plan": plan or None, **inputs_of_a_new_one, **outputs, "--rule": rule}
        _check_reads_only(others | {"--unconfirmed": unconfirmed or None})
        from truearm.workflows.certificate import read_certificate

        print_record(read_certificate(read, trusted=trusted), as_json=as_json)
        return
    _check_options({"--pdf": pdf, "--logo": logo, "--sign": sign, "--signer": signer, "--trusted": trusted})
    given = {"--points": points, "--artefacts": artefacts, "--mpe": mpe, "--about": about, "--out": out}
    points_file, artefacts_file, mpe_file, about_file, certificate_file = _needed({"--plan": plan or None}, given)
    from truearm.workflows.certificate import certificate as stated
    from truearm.workflows.certificate import check_certificate_paths
    from truearm.workflows.verify import verify

    inputs = (Path(plan), points_file, artefacts_file, mpe_file, about_file, logo, sign, signer)
    check_certificate_paths(certificate_file, html, pdf, *inputs)
    signing = None if sign is None or signer is None else _signer(sign, signer)
    verification = verify(points_file, plan=plan, artefacts=artefacts_file, specification=mpe_file, rule=rule)
    result = stated(verification, about_file, unconfirmed=unconfirmed)
    result.save(certificate_file, html, pdf=pdf, logo=logo, signer=signing)
    print_record(result, as_json=as_json, files={"certificate": out, "page": html, "PDF": pdf})


def _needed(plan: dict[str, str | None], files: dict[str, Path | None]) -> tuple[Path, ...]:
    """The files that a certificate needs, if the plan and all of them are given."""
    from truearm.errors import InputError

    for option, value in (plan | files).items():
        if value is None:
            hint = "truearm certificate --template > about.toml" if option == "--about" else None
            raise InputError(f"{option} is missing", hint=hint or "truearm certificate --help")
    return tuple(file for file in files.values() if file is not None)


def _check_reads_only(others: dict[str, object]) -> None:
    """Check that no option of a new certificate is given with --read: it would have no effect."""
    from truearm.errors import InputError

    if given := [option for option, value in others.items() if value is not None]:
        raise InputError(
            f"{', '.join(given)} has no effect with --read", hint="use --read with --trusted or --json only"
        )


def _check_options(options: dict[str, Path | None]) -> None:
    """Check that no option is given without the one that it belongs to."""
    from truearm.errors import InputError

    for option, other in (("--logo", "--pdf"), ("--sign", "--signer"), ("--signer", "--sign"), ("--trusted", "--read")):
        if options[option] is not None and options.get(other) is None:
            raise InputError(f"{option} applies to {other} only", hint=f"add {other}")


def _signer(key: Path, certificate: Path) -> Signer:
    """Read the key and its certificate; ask for the password of an encrypted key."""
    from truearm.files.xml_signatures import is_encrypted, read_signer

    asked = is_encrypted(key)
    password = typer.prompt(f"Password of {key}", hide_input=True, err=True) if asked else None
    return read_signer(key, certificate, password=password)
