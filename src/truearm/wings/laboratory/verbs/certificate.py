"""`certificate`: a verification as a certificate, for machines (DCC) and people; and what is read of certificates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from truearm import __version__
from truearm.acceptance import acceptance_remarks, accepts
from truearm.errors import FaultCollector, InputError
from truearm.files.atomic_write import atomic_file, check_new_file
from truearm.number_format import capitalize
from truearm.pages.drawings.page_record import PageRecord, check_page_path
from truearm.solve.threads import one_blas_thread
from truearm.verbs.outputs import check_output
from truearm.verbs.record import Record
from truearm.wings.laboratory.certificate.administrative_data import AdministrativeData, read_administrative_data
from truearm.wings.laboratory.certificate.artefact_draft import ArtefactDraft, draft_artefact
from truearm.wings.laboratory.certificate.calibration_certificate import CalibrationCertificate, describe
from truearm.wings.laboratory.certificate.certificate import (
    Certificate,
    check_about,
    check_artefacts,
    check_as_found,
    check_no_copies,
    check_plan,
    check_uncertainties,
    make_certificate,
)
from truearm.wings.laboratory.certificate.dcc import checked_dcc, dcc
from truearm.wings.laboratory.certificate.dcc_reader import parse_dcc_file, read_dcc_file
from truearm.wings.laboratory.certificate.dsi_quantities import clean
from truearm.wings.laboratory.certificate.statements import NOT_FOR_CONFORMITY
from truearm.wings.laboratory.signatures.xml_signatures import Signature
from truearm.wings.laboratory.standards.specification import describe_disagreement
from truearm.wings.laboratory.verbs.verify import VerificationResult, digests_of

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.wings.laboratory.signatures.x509_certificates import Signer

AdministrativeDataLike: TypeAlias = AdministrativeData | str | Path


@dataclass(frozen=True, eq=False, repr=False)
class CertificateResult(PageRecord):
    """A calibration certificate.

    Attributes
    ----------
    certificate : Certificate
        All that is stated.
    verification : VerificationResult
        The results that it states; as left, where there are results as found.
    digests : mapping of Path to str
        SHA-256 of the input files, with that of the administrative data.
    accepted : tuple of str
        What `accept` overrode.
    """

    certificate: Certificate
    verification: VerificationResult
    digests: Mapping[Path, str]
    accepted: tuple[str, ...] = ()

    @property
    def number(self) -> str:
        """Number of the certificate."""
        return self.certificate.about.number

    @property
    def input_files(self) -> tuple[Path, ...]:
        """See `PageRecord`."""
        return tuple(self.digests)

    def save(
        self,
        path: str | Path,
        page: str | Path | None = None,
        *,
        pdf: str | Path | None = None,
        logo: str | Path | None = None,
        signer: Signer | None = None,
        force: bool = False,
    ) -> None:
        """Write the digital calibration certificate (DCC, XML) and, if wanted, the same for people; all or nothing.

        Parameters
        ----------
        path : path
            Ends in ``.xml``.
        page : path, optional
            The same for a browser; ends in ``.html``.
        pdf : path, optional
            The same for paper, as PDF/A-3 with the XML file inside; ends in ``.pdf``.
        logo : path, optional
            Logo of the laboratory for the PDF, ``.png`` or ``.svg``.
        signer : Signer, optional
            Key and certificate with which the XML file is signed, see `ta.read_signer`.
        force : bool
            Whether files that exist are replaced: without it an issued certificate stays as it is.

        Raises
        ------
        InputError
            If a name has another ending, is that of an input file, or cannot be written; if a file exists already,
            without `force`; or the logo is none.
        MissingTool
            If there is a `pdf` and typst is not installed.
        """
        check_certificate_paths(path, page, pdf, *self.input_files, logo, force=force)
        xml = checked_dcc(self.certificate, signer)
        # All are complete before any takes its name, the certificate first: no page without its certificate.
        with ExitStack() as files:
            if pdf is not None:
                files.enter_context(atomic_file(pdf)).write_bytes(self.pdf(xml, logo=logo))
            if page is not None:
                from truearm.pages.html import write_page

                write_page(self.page(xml), files.enter_context(atomic_file(page)))
            files.enter_context(atomic_file(path)).write_bytes(xml)

    def pdf(self, xml: bytes | None = None, *, logo: str | Path | None = None) -> bytes:
        """Return the certificate for paper, as PDF/A-3.

        Parameters
        ----------
        xml : bytes, optional
            The digital calibration certificate to put inside; by default that of this certificate, unsigned.
        logo : path, optional
            Logo of the laboratory, ``.png`` or ``.svg``.
        """
        from truearm.pages.pdf import pdf_bytes, read_logo
        from truearm.wings.laboratory.pages.certificate_page import certificate_paper

        xml = checked_dcc(self.certificate) if xml is None else xml
        picture = None if logo is None else read_logo(logo)
        return pdf_bytes(self.page(xml), certificate_paper(self.certificate, xml, logo=picture))

    def page(self, xml: bytes | None = None) -> Page:
        """The certificate for people; `xml` is the file for machines that it names, by default the unsigned one."""
        from truearm.wings.laboratory.pages.certificate_page import certificate_page

        xml = dcc(self.certificate) if xml is None else xml
        signature = parse_dcc_file(xml).signature
        named = [("the same for machines (XML)", f"SHA-256 {sha256(xml).hexdigest()}")]
        if signature is not None:
            named.append(("signed by", f"{signature.signer}, certificate SHA-256 {signature.fingerprint}"))
        plan, *files, program = self.verification.facts()
        about = [
            (file.name, f"SHA-256 {digest}")
            for file, digest in self.digests.items()
            if file not in self.verification.digests
        ]
        return certificate_page(
            self.certificate, self.verification.verification, facts=[*named, plan, *files, *about, program]
        )

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        if self.certificate.reservation is None:
            yield f"certificate {self.number}, {self.verification.verdict.value}"
        else:
            yield f"certificate {self.number}, {NOT_FOR_CONFORMITY}"
            yield self.certificate.reservation
        yield from self.certificate.texts("coordinates")
        yield from self.certificate.texts("adjustment")
        if not self.certificate.is_traceable:
            yield from self.certificate.texts("traceability")
        yield from self.accepted
        of = self.verification.verification
        if apart := describe_disagreement(of.room.get("air_degC"), of.temperatures):
            yield f"{capitalize(apart)}."
        if not self.verification.serial_number:
            number = self.certificate.about.item.serial_number
            yield (
                f"The points do not state the serial number of the arm: truearm could not compare it with {number!r}. "
                "Compare it with the arm itself, or enter it into the column serial_number of the points."
            )

    def _json(self) -> object:
        return {
            "number": self.number,
            "conformity": self.certificate.conformity,
            "reservation": self.certificate.reservation,
            "accepted": self.accepted,
            "traceable": self.certificate.is_traceable,
            **self.verification.to_dict(),
            "serial_number": self.certificate.about.item.serial_number,
            "serial_number_in_points": self.verification.serial_number or None,
        }


@one_blas_thread()
@accepts
def certificate(
    verification: VerificationResult,
    about: AdministrativeDataLike,
    *,
    as_found: VerificationResult | None = None,
    unconfirmed: bool = False,
    accept: str | None = None,
) -> CertificateResult:
    """State a verification as a calibration certificate.

    Parameters
    ----------
    verification : VerificationResult
        The results.
    about : AdministrativeData or path
        Number, dates, arm, laboratory, customer, persons and environment; see `truearm verify template about`.
    as_found : VerificationResult, optional
        The results before the adjustment or repair that `about` states.
    unconfirmed : bool
        State the results even if numbers of the test plan are not confirmed against the standard. The certificate is
        then marked "not for conformity decisions" and states no conformity.
    accept : str, optional
        Why the certificate is right where `about` contradicts the points in serial number or temperature; the
        certificate states it.

    Returns
    -------
    CertificateResult
        `CertificateResult.save` writes a digital calibration certificate (DCC, the XML format of PTB).

    Raises
    ------
    InputError
        With all faults that were found: numbers of the test plan are not confirmed, a value that has a limit has no
        uncertainty, the laboratory that calibrated an artefact is not named, dates or temperatures do not fit those of
        the points, the points are of an arm with another serial number, or an input file has changed since it was read.

    Examples
    --------
    >>> import datetime
    >>> import truearm as ta
    >>> simulated = ta.simulate_verification("perfect", n_arms=1)
    >>> result = ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)
    >>> address = {"city": "Exampletown", "country": "DE", "post_code": "00000"}
    >>> about = ta.AdministrativeData(
    ...     number="V-1",
    ...     issued=datetime.date.today(),
    ...     place="laboratory",
    ...     item={
    ...         "name": "measuring arm",
    ...         "maker": "Example Arms",
    ...         "model": "A 2500",
    ...         "serial_number": "10017",
    ...     },
    ...     set_up={"stylus": "ball of ruby", "mounting": "granite table", "software": "Example Measure 4.2"},
    ...     laboratory={"name": "Example Laboratory", **address},
    ...     customer={"name": "Example Customer", **address},
    ...     persons=[{"name": "First Example", "main_signer": True}],
    ...     conditions={"temperature_degC": (19.5, 20.5)},
    ... )
    >>> print(repr(ta.certificate(result, about, unconfirmed=True)))
    <CertificateResult: certificate V-1, not for conformity decisions>
    """
    files = [Path(about)] if isinstance(about, str | Path) else []
    digests = {**verification.digests, **({} if as_found is None else as_found.digests), **digests_of(files)}
    before = None if as_found is None else as_found.verification
    both = (verification.verification,) if before is None else (verification.verification, before)
    found = FaultCollector()
    stated: AdministrativeData | None = None
    with found.collect():
        stated = about if isinstance(about, AdministrativeData) else read_administrative_data(about)
    if stated is not None:
        with found.collect(files[0] if files else None):
            for one in both:
                check_about(stated, one)
            check_as_found(stated, verification.verification, before)
    with found.collect():
        check_no_copies(verification.verification, before)
    if not unconfirmed:
        with found.collect():
            for one in both:
                check_plan(one)
    for check in (check_artefacts, check_uncertainties):
        with found.collect(verification.artefacts_file):
            for one in both:
                check(one)
    found.raise_any()
    assert stated is not None  # or there was a fault
    verification = replace(verification, verification=verification.verification.in_room(stated.room))
    made = make_certificate(stated, verification.verification, as_found=before, unconfirmed=unconfirmed)
    for file, digest in digests_of(list(digests)).items():
        if digest != digests[file]:
            raise InputError("the file changed while it was read", file=file, hint="repeat the command")
    return CertificateResult(made, verification, digests, acceptance_remarks(accept))


def check_certificate_paths(
    path: str | Path, page: str | Path | None, pdf: str | Path | None, *inputs: str | Path | None, force: bool
) -> None:
    """Check, before long work, that a certificate, its page and its PDF can be written, and replace no file.

    Raises
    ------
    InputError
        If a name has another ending than .xml, .html or .pdf, is one of `inputs` or of the certificate, or cannot be
        written; without `force` if one of the files exists.
    MissingTool
        If there is a `pdf` and typst is not installed.
    """
    check_output(path, *inputs, endings=(".xml",))
    check_page_path(page, *inputs, path)
    if pdf is not None:
        check_output(pdf, *inputs, path, endings=(".pdf",))
    for file in (path, page, pdf):
        if file is not None:
            check_new_file(file, force=force)
    if pdf is not None:
        from truearm.pages.pdf import check_pdf_writer

        check_pdf_writer()


@dataclass(frozen=True, eq=False, repr=False)
class ReadCertificate(Record):
    """A certificate that was read.

    Attributes
    ----------
    certificate : Certificate or CalibrationCertificate
        All that it states: `results`, `conformity`, `about` and so on; of another laboratory `items`, `results` and so
        on.
    signature : Signature or None
        Whether its signature is good, who made it, and whether the reader trusts that one; None if it is not signed.
    from_pdf : bool
        Whether it is the XML file attached to a PDF file.
    """

    certificate: Certificate | CalibrationCertificate
    signature: Signature | None
    from_pdf: bool = False

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        from truearm.wings.laboratory.pages.certificate_page import CONFORMITY_WORDS, NOT_DECIDED

        made = self.certificate
        origin = [describe_signature(self.signature)]
        if self.from_pdf:
            origin.append("This is the XML file attached to the PDF file; truearm does not read the sheets.")
        if isinstance(made, CalibrationCertificate):
            yield f"certificate {made.number} of {made.laboratory}, DCC {made.schema_version}"
            yield from origin
            yield from describe(made)
            return
        about = made.about
        verdict = NOT_DECIDED[0] if made.conformity is None else CONFORMITY_WORDS[made.conformity][0]
        if made.reservation is not None:
            verdict = NOT_FOR_CONFORMITY
        yield f"certificate {about.number}, {verdict}"
        yield from origin
        item = about.item
        yield f"{item.name} {item.maker} {item.model}, serial number {item.serial_number}"
        days = " to ".join(dict.fromkeys((str(made.begin), str(made.end))))
        yield f"issued on {about.issued} by {about.laboratory.name}; measured on {days}"
        yield from (one.text for one in made.statements if one.kind in ("reservation", "decision", "coordinates"))

    def _json(self) -> object:
        made = self.certificate
        if isinstance(made, CalibrationCertificate):
            return {**made.to_dict(), "signature": self.signature, "from_pdf": self.from_pdf}
        return {
            "number": made.about.number,
            "issued": made.about.issued,
            "serial_number": made.about.item.serial_number,
            "conformity": made.conformity,
            "reservation": made.reservation,
            "coordinates": next(iter(made.texts("coordinates")), None),
            "traceable": made.is_traceable,
            **self._named("signature", "from_pdf"),
        }


@one_blas_thread()
def read_certificate(path: str | Path, *, trusted: str | Path | None = None) -> ReadCertificate:
    """Read a digital calibration certificate, of this program or of another laboratory, and verify its signature.

    Parameters
    ----------
    path : path
        The XML file, or a PDF file that it is attached to.
    trusted : path, optional
        Certificates (PEM) of the signer, or of the authority that issued the signer's; a file that is not signed by
        them is refused.

    Raises
    ------
    InputError
        If the file is no such certificate, contradicts itself, its signature is broken, or it is not verifiable here
        although there is a `trusted`.
    MissingTool
        If the file is signed and signxml is not installed, or is a PDF file and pypdf is not.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.read_certificate("certificate.xml", trusted="signer.pem")
    Traceback (most recent call last):
    truearm.errors.InputError: certificate.xml: the file does not exist
    """
    read = read_dcc_file(path, trusted=trusted)
    return ReadCertificate(read.certificate, read.signature, read.from_pdf)


def describe_signature(signature: Signature | None) -> str:
    """Describe in a sentence who signed a file, or that nobody did."""
    return "The file is not signed: anybody can have changed it." if signature is None else signature.describe()


# What the file says of itself, below the certificate that it comes from.
_HEADER = (
    "Lengths are in mm at 20 degC. Uncertainties are standard ones (k = 1). Behind each value stands its source.",
    "A line that begins with # was not in the certificate: fill in its value and remove the #.",
)


@dataclass(frozen=True, eq=False, repr=False)
class ArtefactsFromCertificate(Record):
    """A file of artefacts to complete, from the certificate of an artefact.

    Attributes
    ----------
    certificate : CalibrationCertificate
        All that the certificate states.
    signature : Signature or None
        Who signed it; None if it is not signed.
    draft : ArtefactDraft
        The text of the file, the keys that are filled in, those that are missing, and what was assumed.
    """

    certificate: CalibrationCertificate
    signature: Signature | None
    draft: ArtefactDraft

    @property
    def text(self) -> str:
        """The file, TOML."""
        return self.draft.text

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the file; one that exists, and that somebody may have filled in, is replaced by `force` only.

        Raises
        ------
        InputError
            If the file exists, its name does not end in ``.toml``, or it cannot be written.
        """
        check_new_file(path, force=force, endings=(".toml",))
        with atomic_file(path) as beside:
            beside.write_text(self.text, encoding="utf-8")

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        yield f"{self.draft.kind}, from certificate {self.certificate.number} of {self.certificate.laboratory}"
        yield describe_signature(self.signature)
        yield f"filled in: {', '.join(self.draft.filled)}"
        if self.draft.missing:
            yield f"not in the certificate, to fill in: {', '.join(self.draft.missing)}"
        yield from self.draft.remarks

    def _json(self) -> object:
        return {
            "certificate": self.certificate.number,
            "laboratory": self.certificate.laboratory,
            "signature": self.signature,
            **self._named("draft"),
        }


@one_blas_thread()
def artefacts_from_certificate(
    path: str | Path, *, results: Mapping[str, str] | None = None, trusted: str | Path | None = None
) -> ArtefactsFromCertificate:
    """Fill in a file of artefacts from the digital calibration certificate (DCC 3.x) of a sphere or a bar.

    Expanded uncertainties are divided by their coverage factor, units are converted to mm; each value names the result
    that it comes from. What a certificate does not state is a commented key.

    Parameters
    ----------
    path : path
        The certificate, of any laboratory.
    results : mapping of str to str, optional
        For "diameter", "length" or "form" the name of the result that is meant, where the certificate leaves it open.
    trusted : path, optional
        Certificate (PEM) of the signer; a file that is not signed with its key is refused.

    Raises
    ------
    InputError
        If the file is no such certificate, its signature is broken, it is of an arm, or it leaves open which result is
        the diameter or the length.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.artefacts_from_certificate("sphere.xml", results={"diameter": "Mean diameter"})
    Traceback (most recent call last):
    truearm.errors.InputError: sphere.xml: the file does not exist
    """
    read = read_dcc_file(path, trusted=trusted)
    certificate = read.certificate
    if not isinstance(certificate, CalibrationCertificate):
        raise InputError("the certificate is of an arm, not of an artefact", file=path, hint="give the artefact's")
    source = f"{clean(Path(path).name)}: certificate {certificate.number} of {certificate.laboratory}"
    header = (f"Filled in by truearm {__version__} from {source}.", describe_signature(read.signature), *_HEADER)
    with InputError.of_file(path):
        draft = draft_artefact(certificate, chosen=results, header=header)
    return ArtefactsFromCertificate(certificate, read.signature, draft)
