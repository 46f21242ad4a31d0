"""XML files attached to a PDF file, as PDF/A-3 has them (ISO 19005-3)."""

from __future__ import annotations

import io
import logging

from truearm.errors import InputError, extra_module

_BEGIN = b"%PDF-"
MAX_ATTACHMENTS = 100
_SILENT = logging.NullHandler()  # what a PDF file lacks is no remark of this program


def is_pdf(content: bytes) -> bool:
    """Whether a file is a PDF file, by its first bytes."""
    return content.startswith(_BEGIN)


def attached_xml(content: bytes, *, limit_bytes: int) -> bytes:
    """Return the XML file that is attached to a PDF file.

    Parameters
    ----------
    content : bytes
    limit_bytes : int
        Its largest size, unpacked.

    Raises
    ------
    InputError
        If none or more than one is attached, it is too large, or the PDF file is damaged or encrypted.
    MissingTool
        If pypdf is not installed.
    """
    pypdf = extra_module("pypdf", "reading PDF files needs the package pypdf", "pip install 'truearm[pdf]'")
    logging.getLogger("pypdf").addHandler(_SILENT)
    try:
        names, found = [], []
        for one in pypdf.PdfReader(io.BytesIO(content)).attachment_list:
            names.append(one.name)
            if one.name.lower().endswith(".xml") or one.subtype in ("/application/xml", "/text/xml"):
                found.append(one)
            if len(names) == MAX_ATTACHMENTS:
                break
        attached: bytes = found[0].content if len(found) == 1 else b""
    except Exception as error:  # damaged files fail in many ways
        raise InputError(f"the PDF file cannot be read ({error!s:.200})", hint="read the XML file itself") from None
    if len(found) != 1:
        what = f"attached are {', '.join(map(ascii, names[:5]))}" if names else "nothing is attached"
        raise InputError(
            f"expected one XML file attached to the PDF file, got {len(found)}; {what}"[:400],
            hint="ask the laboratory for the XML file of the certificate",
        )
    if len(attached) > limit_bytes:
        raise InputError(f"the attached XML file is larger than {limit_bytes / 1e6:.3g} MB")
    return attached
