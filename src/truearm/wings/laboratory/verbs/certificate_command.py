"""``truearm certificate``: a verification as a digital calibration certificate."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_json, print_record, print_status
from truearm.wings.laboratory.verbs.verify_command import MeasuredPoints, RuleOption, TestPlan, Trusted

if TYPE_CHECKING:
    from truearm.wings.laboratory.signatures.x509_certificates import Signer

# Options that a certificate needs.
NEEDED = ("--test-plan", "--measured", "--artefacts", "--mpe", "--about", "--out")


def certificate(
    context: typer.Context,
    plan: TestPlan = None,
    points: MeasuredPoints = None,
    as_found: Annotated[
        Path | None, Option(help="Points measured before the adjustment or repair that --about states, .csv.")
    ] = None,
    artefacts: options.ArtefactsFile = None,
    mpe: options.MpeFile = None,
    about: Annotated[
        Path | None, Option(help="Number, dates, arm, laboratory, customer, persons, room, .toml.")
    ] = None,
    out: Annotated[Path | None, Option(help="Certificate to write, .xml.")] = None,
    page: options.Page = None,
    pdf: Annotated[Path | None, Option(help="The same for paper, .pdf: PDF/A-3 with the XML file inside.")] = None,
    logo: Annotated[Path | None, Option(help="With --pdf: the laboratory's logo, .png or .svg.")] = None,
    key: Annotated[
        Path | None,
        Option(help="Private key to sign with, .pem: RSA of 2048 bits or more, or an elliptic curve of 256 or more."),
    ] = None,
    signer: Annotated[Path | None, Option(help="With --key: the key's certificate, .pem.")] = None,
    rule: RuleOption = None,
    unconfirmed: Annotated[
        bool, Option("--unconfirmed", help="Certify a plan that is not confirmed: 'not for conformity decisions'.")
    ] = False,
    accept: options.AcceptOption = None,
    read: Annotated[Path | None, Option(help="Read a certificate, .xml or .pdf, and verify its signature.")] = None,
    trusted: Trusted = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """State a verification as a calibration certificate.

    The result is a digital calibration certificate (DCC), an XML file in the format of PTB. The files are those of
    truearm verify; --about has the other data of a certificate. --pdf writes the certificate for paper.

    With --read: what a certificate states, of truearm or of another laboratory, and who signed it. One that contradicts
    itself is refused. The exit code is 0 if the signature is good or there is none, 1 if it is broken (do not use the
    file), 3 if it is not verifiable here.
    """
    if read is not None:
        _check_reads_only(context)
        _print_read(read, trusted, as_json)
        return
    _check_pairs(context, {"logo": ("pdf", pdf), "key": ("signer", signer), "signer": ("key", key)})
    files = _all_given((plan, points, artefacts, mpe, about, out))
    from truearm.wings.laboratory.verbs.certificate import certificate as stated
    from truearm.wings.laboratory.verbs.certificate import check_certificate_paths
    from truearm.wings.laboratory.verbs.verify import verify

    _, measured, of_artefacts, specification, administrative, file_out = files
    inputs = (plan, measured, as_found, of_artefacts, specification, administrative, logo, key, signer)
    check_certificate_paths(file_out, page, pdf, *inputs, force=force)
    signing = None if key is None or signer is None else _signer(key, signer)
    given: dict[str, Any] = {"artefacts": of_artefacts, "specification": specification, "rule": rule}
    given |= {"plan": str(plan), "accept": accept}
    after, before = verify(measured, **given), None if as_found is None else verify(as_found, **given)
    result = stated(after, administrative, as_found=before, unconfirmed=unconfirmed, accept=accept)
    result.save(file_out, page, pdf=pdf, logo=logo, signer=signing, force=force)
    print_record(result, as_json=as_json, files={"certificate": out, "page": page, "PDF": pdf})


def _print_read(file: Path, trusted: Path | None, as_json: bool) -> None:
    """Print what a certificate states; exit with a code for a signature that is broken or not verifiable here."""
    from truearm.wings.laboratory.signatures.xml_references import BrokenSignature, UnverifiedSignature
    from truearm.wings.laboratory.signatures.xml_signatures import BROKEN, NOT_VERIFIABLE
    from truearm.wings.laboratory.verbs.certificate import read_certificate

    try:
        result = read_certificate(file, trusted=trusted)
    except (BrokenSignature, UnverifiedSignature) as error:
        broken = isinstance(error, BrokenSignature)
        if as_json:
            answer = BROKEN if broken else NOT_VERIFIABLE
            print_json({"signature": {"answer": answer, "reason": error.problem.partition(": ")[2]}})
        print_status(f"truearm: {error}")
        raise typer.Exit(1 if broken else 3) from None
    print_record(result, as_json=as_json)
    if result.signature is not None and result.signature.answer == NOT_VERIFIABLE:
        raise typer.Exit(3)


def _check_reads_only(context: typer.Context) -> None:
    """Check that no option of a new certificate is given with --read: it would have no effect."""
    typed = options.typed_options(context)
    if surplus := [option for name, option in typed.items() if name not in ("read", "trusted", "as_json")]:
        raise InputError(
            f"{', '.join(surplus)} has no effect with --read", hint="use --read with --trusted or --json only"
        )


def _signer(key: Path, certificate: Path) -> Signer:
    """Read the key and its certificate; ask for the password of an encrypted key."""
    from truearm.wings.laboratory.signatures.x509_certificates import is_encrypted, read_signer

    asked = is_encrypted(key)
    if asked and not sys.stdin.isatty():
        raise InputError(
            "the key is encrypted, and there is no terminal to ask for its password",
            file=key,
            hint="sign in a terminal, or in Python with read_signer(KEY, CERTIFICATE, password=...)",
        )
    password = typer.prompt(f"Password of {key}", hide_input=True, err=True) if asked else None
    return read_signer(key, certificate, password=password)


def _check_pairs(context: typer.Context, needs: Mapping[str, tuple[str, Path | None]]) -> None:
    """Refuse options without the one that each of them needs."""
    for option, (other, value) in needs.items():
        if value is None:
            options.refuse_typed(context, [option], f"applies to --{other} only", hint=f"add --{other}")
    options.refuse_typed(context, ["trusted"], "applies to --read only", hint="add --read")


def _all_given(files: Sequence[str | Path | None]) -> list[Path]:
    """The files of `NEEDED` options; one that is missing is refused."""
    for option, file in zip(NEEDED, files, strict=True):
        if file is None:
            make = "verify template about > about.toml" if option == "--about" else "certificate --help"
            raise InputError(f"{option} is missing", hint=f"truearm {make}")
    return [Path(file) for file in files if file is not None]
