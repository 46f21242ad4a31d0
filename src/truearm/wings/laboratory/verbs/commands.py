"""The commands of the laboratory but verify: task, measure, check and certificate."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from truearm.errors import InputError
from truearm.pages.drawings.page_record import check_page_path
from truearm.verbs import options
from truearm.verbs.console import print_json, print_record, print_status, progress
from truearm.wings.laboratory import FeatureKind
from truearm.wings.laboratory.verbs.verify_command import MeasuredPoints, RuleOption, TestPlan, Trusted

if TYPE_CHECKING:
    from truearm.wings.laboratory.signatures.x509_certificates import Signer
    from truearm.wings.laboratory.verbs.check import CheckResult, WithdrawalResult

CODES = {"yes": 0, "no": 1, "only with guard bands": 3}


@options.of_verb("truearm.wings.laboratory.verbs.task:task", omit=("size_mm", "second"))
def task(
    verb: Any,
    what: Annotated[
        str | None, Argument(metavar="MODEL|PRESET", help="A model file, or a preset of virtual arms: shop, research.")
    ] = None,
    feature: Annotated[FeatureKind, Option(help="What is measured.")] = "length",
    length: Annotated[float | None, Option(help="Nominal length, or distance of two planes [mm].")] = None,
    diameter: Annotated[float | None, Option(help="Diameter of a sphere, circle, cylinder or cone [mm].")] = None,
    size: Annotated[float | None, Option(help="Side of a square plane; of a distance of two planes 50 [mm].")] = None,
    depth: Annotated[float | None, Option(help="Depth of a cylinder (50) [mm].")] = None,
    angle: Annotated[float | None, Option(help="Angle of a cone or of two planes (90) [deg].")] = None,
    at: Annotated[
        list[str] | None,
        Option(
            help="Middle of the feature X,Y,Z [mm] in the arm's base frame, by default of the working volume; given "
            "twice: both seats of a length."
        ),
    ] = None,
    along: Annotated[
        str | None,
        Option(help="Direction X,Y,Z of a length (across the front), normal of a plane, axis (up), edge of an angle."),
    ] = None,
    specification: options.MpeFile = None,
    page: options.Page = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Estimate the uncertainty of measuring a length or a shape.

    With --tolerance, also decide whether the arm is fit for it. truearm draws many arms that may be the one in
    question; each measures the feature, with systematic errors drawn once per arm and random errors drawn per point.
    With a model: arms from its posterior. With a preset: virtual arms. With --mpe, a specification: arms whose worst
    test result is half to all of its limit. Without --arm, a preset or a specification is of the arm measuring7.

    Exit code with --tolerance, 0: fit; 1: not fit; 3: only with guard bands. Without, 0.
    """
    check_page_path(page, what, specification, given["arm"])
    sizes = _sizes(feature, {"length": length, "diameter": diameter, "size": size, "depth": depth, "angle": angle})
    with progress(f"measuring a {feature}", total=given["n_arms"]) as tell:
        direction = None if along is None else _vector("--along", along)
        of_feature = {"at": _places(feature, at or []), "along": direction, "second": sizes[1]}
        source = _source(what, specification)
        result = verb(source, feature, sizes[0], **of_feature, **given, progress=tell)
        if page is not None:
            result.save_page(page)
    print_record(result, as_json=as_json, files={"page": page})
    if result.fitness is not None:
        raise typer.Exit(CODES[result.fitness.answer.value])


def _source(what: str | None, spec: Path | None) -> str | Path:

    stated = [one for one in (what, spec) if one is not None]
    if len(stated) != 1:
        raise InputError(
            "expected one of a model, a preset and --mpe",
            hint="a model file, perfect, research, shop, worn, printed, or --mpe",
        )
    return stated[0]


def _sizes(feature: str, sizes: dict[str, float | None]) -> tuple[float | None, float | None]:
    """Both sizes of a feature out of its options."""
    from truearm.wings.laboratory.tasks.feature_postures import SECOND_SIZES, SIZES

    first, second = SIZES[feature], SECOND_SIZES.get(feature, ("", 0.0))[0]
    for name, value in sizes.items():
        if value is not None and name not in (first, second):
            known = f"--{first} and --{second}" if second else f"--{first}"
            raise InputError(f"--{name} does not apply to a {feature}", hint=known)
    return sizes[first], sizes.get(second)


def _places(feature: str, texts: list[str]) -> list[float] | list[list[float]] | None:
    """One place, or both ends of a length."""
    places = [_vector("--at", text) for text in texts]
    if len(places) > 1 + (feature == "length"):
        raise InputError(f"expected --at once, for a length once or twice, got it {len(places)} times")
    return places if len(places) == 2 else places[0] if places else None


def _vector(option: str, text: str) -> list[float]:
    """Three finite numbers."""
    from math import isfinite

    numbers = options.numbers_of(text, option, "600,0,300")
    if len(numbers) != 3 or not all(map(isfinite, numbers)):
        raise InputError(f"{option} expects three numbers X,Y,Z, got {text!r}", hint=f"{option} 600,0,300")
    return numbers


@options.of_verb("truearm.wings.laboratory.verbs.measure:measure")
def measure(
    verb: Any, model: options.ModelFile, session: options.SessionFile, as_json: options.Json = False, **given: Any
) -> None:
    """Measure a length, sphere, plane, circle, cylinder or cone.

    It is fitted to the compensated points of the readings. Each name in the column seat is a feature of its own, of
    lengths an end; without names all readings are of one feature. Of each two spheres or circles the distance of their
    centres is measured too, of planes, cylinders and cones distance and angle. The uncertainty is that of the arm, by
    the simulation of `truearm task` at the measured poses, together with the scatter of the points.
    """
    with progress(f"measuring a {given['feature']}", total=given["n_arms"]) as tell:
        result = verb(model, session, **given, progress=tell)
    print_record(result, as_json=as_json)


@dataclass(frozen=True)
class CheckOptions:
    """The options of a check, in a file of history or in a fleet's registry: each attribute is one, with its help."""

    session: Annotated[
        Path | None, Argument(metavar="SESSION", help="Session file, .csv or .parquet; none with --withdraw.")
    ] = None
    lengths: options.LengthsFile = None
    retired: Annotated[
        list[str] | None, Option(help="Artefact that was repaired or replaced, and is no longer assessed.")
    ] = None
    mpe: options.MpeFile = None
    date: options.Date = None
    page: options.Page = None
    withdrawn: Annotated[
        str | None, Option("--withdraw", metavar="NUMBER|DATE", help="Withdraw a wrong check; it stays in the history.")
    ] = None
    reason: Annotated[str | None, Option(help="With --withdraw: what was wrong with it.")] = None
    accept: options.AcceptOption = None
    as_json: options.Json = False

    def run(
        self,
        context: typer.Context,
        usage: str,
        check: Callable[..., CheckResult],
        withdraw: Callable[..., WithdrawalResult],
        *files: Path,
    ) -> None:
        """Make a check, or withdraw one; write its page, print it, and exit with what it says."""
        from truearm.wings.laboratory.monitor.assessment import RecalibrationAdvice

        result: CheckResult | WithdrawalResult
        if self.withdrawn is not None:
            of_check = ("session", "lengths", "retired", "mpe", "date", "accept")
            options.refuse_typed(context, of_check, "does not apply to --withdraw")
            if self.reason is None:
                raise InputError("--withdraw needs --reason as well", hint='--reason "the ball was dirty"')
            check_page_path(self.page, *files)
            result = withdraw(self.withdrawn, reason=self.reason)
            page = None if result.assessment is None else self.page
            if page is not None:
                result.save_page(page)
            print_record(result, as_json=self.as_json, files={"page": page})
            return
        options.refuse_typed(context, ["reason"], "applies to --withdraw only")
        if self.session is None:
            raise InputError("the session is missing", hint=usage)
        check_page_path(self.page, *files, self.session, self.lengths, self.mpe)
        given = {"lengths": self.lengths, "specification": self.mpe, "retired": self.retired or ()}
        with progress(f"checking {self.session.name}"):
            result = check(self.session, **given, date=self.date, accept=self.accept)
            if self.page is not None:
                result.save_page(self.page)
        print_record(result, as_json=self.as_json, files={"page": self.page})
        raise typer.Exit({RecalibrationAdvice.NO: 0, RecalibrationAdvice.YES: 1}.get(result.recalibrate, 3))


@options.with_shared
def check(
    context: typer.Context,
    model: options.ModelFile,
    history: Annotated[Path, Option(help="File of the checks so far, .sqlite; the first check creates it.")],
    given: CheckOptions,
) -> None:
    """Check whether the arm is still as it was identified.

    A few readings in a seat, in both seats of a bar, on a sphere. Scatter, length error, form and diameter are added to
    the history and charted: is it time to recalibrate, and since when? The result on an artefact stays valid while the
    artefact is not measured. A session that is in the history already is not added again; the last one is completed
    if it comes with more, such as --lengths.

    --withdraw 12 --reason "the ball was dirty", without a session: check 12 no longer counts. It stays in the history
    with the reason, and on the page (--page), struck through. Exit code 0.

    Exit code 0: no need; 1: recalibrate; 3: undecided (repeat the check), or not enough checks.
    """
    from truearm.wings.laboratory.verbs.check import check as checked
    from truearm.wings.laboratory.verbs.check import withdraw_check

    def of_session(session: Path, **others: Any) -> CheckResult:
        return checked(model, session, history, **others)

    usage = "truearm check MODEL SESSION --history HISTORY"
    given.run(context, usage, of_session, partial(withdraw_check, model, history), model, history)


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
