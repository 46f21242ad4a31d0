"""`artefacts_from_certificate`: the file of artefacts of a verification, filled in from an artefact's certificate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from truearm import __version__
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file, check_new_file
from truearm.solve.threads import one_blas_thread
from truearm.verbs.record import Record
from truearm.wings.laboratory.certificate.artefact_draft import ArtefactDraft, draft_artefact
from truearm.wings.laboratory.certificate.calibration_certificate import CalibrationCertificate
from truearm.wings.laboratory.certificate.dcc_reader import read_dcc_file
from truearm.wings.laboratory.certificate.dsi_quantities import clean
from truearm.wings.laboratory.signatures.xml_signatures import Signature
from truearm.wings.laboratory.verbs.certificate import describe_signature

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
    header = (
        f"Filled in by truearm {__version__} from {source}.",
        describe_signature(read.signature),
        *_HEADER,
    )
    try:
        draft = draft_artefact(certificate, chosen=results, header=header)
    except InputError as error:
        raise error.in_file(path) from None
    return ArtefactsFromCertificate(certificate, read.signature, draft)
