"""References of XML signatures: which part of a document each covers, and whether its digest is right.

After W3C, XML Signature Syntax and Processing 1.1 (2013), sections 4.4.3 and 6, and Canonical XML 1.0 and 1.1. Nothing
of a signature is executed: XPath and XSLT never run, nothing is loaded. Two XPath expressions are known by their text,
as programs write them in place of the enveloped-signature transform.
"""

from __future__ import annotations

import hashlib
import io
import xml.etree.ElementTree as ET
from base64 import b64decode
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from truearm.errors import InputError
from truearm.wings.laboratory.signatures.x509_certificates import package

DSIG = "{http://www.w3.org/2000/09/xmldsig#}"
MAX_REFERENCES = 10
MAX_ELEMENTS, MAX_ATTRIBUTES = 500_000, 100  # of the file, of one element
# Of namespaces declared at one place, which canonicalization sorts; and of their sum over all elements.
MAX_NAMESPACES, MAX_NAMESPACE_STEPS = 1000, 10_000_000

_ENVELOPED = "http://www.w3.org/2000/09/xmldsig#enveloped-signature"
_XPATH = "http://www.w3.org/TR/1999/REC-xpath-19991116"
_FILTER = "http://www.w3.org/2002/06/xmldsig-filter2"
_CANONICAL = {
    "http://www.w3.org/TR/2001/REC-xml-c14n-20010315": {},
    "http://www.w3.org/TR/2001/REC-xml-c14n-20010315#WithComments": {"with_comments": True},
    "http://www.w3.org/2006/12/xml-c14n11": {},
    "http://www.w3.org/2006/12/xml-c14n11#WithComments": {"with_comments": True},
    "http://www.w3.org/2001/10/xml-exc-c14n#": {"exclusive": True},
    "http://www.w3.org/2001/10/xml-exc-c14n#WithComments": {"exclusive": True, "with_comments": True},
}
_PREFIXES = "{http://www.w3.org/2001/10/xml-exc-c14n#}InclusiveNamespaces"
_DIGESTS = {
    "http://www.w3.org/2001/04/xmlenc#sha256": "sha256",
    "http://www.w3.org/2001/04/xmldsig-more#sha384": "sha384",
    "http://www.w3.org/2001/04/xmlenc#sha512": "sha512",
}
_XML_ATTRIBUTES = "{http://www.w3.org/XML/1998/namespace}"


class BrokenSignature(InputError):
    """A file was changed after it was signed, or its signature does not cover it."""


class UnverifiedSignature(InputError):
    """A signature that can be neither confirmed nor refuted here."""


class Covered(NamedTuple):
    """What the references of a signature cover: the document, and elements by their tag; all in canonical form."""

    document: bytes
    elements: Mapping[str, bytes]


def check_size(text: str) -> None:
    """Check that the canonical form of well-formed XML takes seconds at most: that of hostile files may take days."""
    in_scope = steps = elements = 0
    for event, element in ET.iterparse(io.StringIO(text), ("start", "start-ns", "end-ns")):  # noqa: S314, no document type
        if event != "start":
            in_scope += 1 if event == "start-ns" else -1
            continue
        elements, steps = elements + 1, steps + in_scope
        if elements > MAX_ELEMENTS:
            raise InputError(f"expected at most {MAX_ELEMENTS} elements")
        if len(element.attrib) > MAX_ATTRIBUTES:
            raise InputError(f"an element has {len(element.attrib)} attributes; at most {MAX_ATTRIBUTES} are expected")
        if in_scope > MAX_NAMESPACES or steps > MAX_NAMESPACE_STEPS:
            raise InputError(f"{in_scope} namespaces are declared at one place, too many for a file of its size")


def parse_signed(content: bytes) -> Any:
    """The tree of a document in UTF-8 without a document type."""
    etree = package("lxml.etree")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, encoding="utf-8")
    try:
        return etree.fromstring(content, parser).getroottree()
    except etree.XMLSyntaxError as error:  # well-formed, but nested deeper than 256 elements, or a text of 10 MB
        raise InputError(f"expected a certificate, got XML of another size ({error.msg:.200})") from None


def canonical(node: Any, method: Any | None = None, *, comments: bool = False) -> bytes:
    """The canonical form of a tree or an element.

    Parameters
    ----------
    node : ElementTree or Element
        A tree with what stands outside of its root, as the standard wants it.
    method : Element, optional
        The Transform or CanonicalizationMethod that names the algorithm; by default Canonical XML 1.0.
    comments : bool
        Keep comments if the algorithm does. References of whole documents and by bare names never have them (4.4.3.3).
    """
    if method is not None and algorithm(method) not in _CANONICAL:
        raise unknown("canonicalization", algorithm(method))
    options: dict[str, Any] = {} if method is None else dict(_CANONICAL[algorithm(method)])
    options["with_comments"] = comments and options.get("with_comments", False)
    if method is not None and options.get("exclusive"):
        prefixes = method.find(_PREFIXES)
        options["inclusive_ns_prefixes"] = None if prefixes is None else prefixes.get("PrefixList", "").split()
    elif not hasattr(node, "getroot"):
        inherited = (key for above in node.iterancestors() for key in above.attrib)
        if any(key.startswith(_XML_ATTRIBUTES) for key in inherited):
            raise UnverifiedSignature("signed elements inherit attributes such as xml:lang, which is not supported")
    written: bytes = package("lxml.etree").tostring(node, method="c14n", **options)
    return written


def covered(tree: Any, signature: Any, references: Sequence[Any]) -> Covered:
    """Check the digests of all references of a signature, and return what they cover.

    Parameters
    ----------
    tree : ElementTree
        The document. Its signature is removed.
    signature : Element
        A child of the root.
    references : sequence of Element

    Raises
    ------
    BrokenSignature
        If a digest is wrong, or no reference covers the whole document.
    UnverifiedSignature
        If a reference has a form that is not supported.
    """
    if len(references) > MAX_REFERENCES:
        raise UnverifiedSignature(f"it has {len(references)} references; at most {MAX_REFERENCES} are supported")
    elements = {}
    for reference in references:
        if (uri := reference.get("URI")) != "":
            found = _named(tree, uri)
            transforms = _transforms(reference)
            if len(transforms) > 1:
                raise unknown("chain of transforms", ", ".join(map(algorithm, transforms)))
            elements[found.tag] = canonical(found, *transforms)
            _check_digest(reference, elements[found.tag], f"the part {uri!r:.80}")
    wholes = [reference for reference in references if reference.get("URI") == ""]
    if not wholes:
        raise BrokenSignature("it covers only a part of the file; what stands beside that part can be by anybody")
    methods = [_without_removal(tree, signature, _transforms(reference)) for reference in wholes]
    _remove(signature)
    for reference, method in zip(wholes, methods, strict=True):
        document = canonical(tree, *method)
        if not _has_digest(reference, document) and _has_digest(reference, canonical(tree.getroot(), *method)):
            raise BrokenSignature(f"{_outside(tree)} outside of the root is not signed")
        _check_digest(reference, document, "the content")
    return Covered(document, elements)


def algorithm(element: Any) -> str:
    """The name of the algorithm that an element of a signature states."""
    return str(element.get("Algorithm", ""))


def _named(tree: Any, uri: str | None) -> Any:
    """The element that a reference names by its identifier."""
    if uri is None or not uri.startswith("#") or "(" in uri:
        raise UnverifiedSignature(f"it signs something outside of the file or by an XPointer ({uri!r:.80}), not loaded")
    names = {"Id", "ID", "id", f"{_XML_ATTRIBUTES}id"}
    found = [one for one in tree.iter("*") if any(one.get(name) == uri[1:] for name in names)]
    if len(found) != 1:
        raise BrokenSignature(f"it covers the element {uri!r:.80}, which is in the file {len(found)} times")
    return found[0]


def _transforms(reference: Any) -> list[Any]:
    return list(reference.iterfind(f"{DSIG}Transforms/{DSIG}Transform"))


def _without_removal(tree: Any, signature: Any, transforms: Sequence[Any]) -> Sequence[Any]:
    """The canonicalization among the transforms of a document, if any; the others must remove the signature."""
    removals = [one for one in transforms if algorithm(one) in (_ENVELOPED, _XPATH, _FILTER)]
    others = [one for one in transforms if one not in removals]
    if len(others) > 1 or (others and transforms[-1] is not others[0]):
        raise unknown("chain of transforms", ", ".join(map(algorithm, transforms)))
    if not removals:
        raise UnverifiedSignature("it signs the file with the signature itself in it, without removing it first")
    for one in removals:
        if algorithm(one) != _ENVELOPED and not _removes_signatures(tree, signature, one):
            raise UnverifiedSignature("it selects what it signs by an XPath expression, which truearm does not run")
    return others


def _removes_signatures(tree: Any, signature: Any, transform: Any) -> bool:
    """Whether an XPath transform is known to remove all signatures, and there is this one only."""
    outside = [one for one in tree.iter(f"{DSIG}Signature") if signature not in (one, *one.iterancestors())]
    if outside or len(transform) != 1:
        return False
    expression = transform[0]
    known = [f"{prefix}:Signature" for prefix, space in expression.nsmap.items() if prefix and space == DSIG[1:-1]]
    text = "".join((expression.text or "").split())
    if algorithm(transform) == _XPATH:
        return expression.tag == f"{DSIG}XPath" and text in (f"not(ancestor-or-self::{name})" for name in known)
    subtracts = expression.tag == f"{{{_FILTER}}}XPath" and expression.get("Filter") == "subtract"
    return subtracts and text in (f"/descendant::{name}" for name in known)


def _remove(element: Any) -> None:
    """Remove an element, not the text behind it."""
    above, before = element.getparent(), element.getprevious()
    if before is not None:
        before.tail = (before.tail or "") + (element.tail or "")
    else:
        above.text = (above.text or "") + (element.tail or "")
    above.remove(element)


def _check_digest(reference: Any, data: bytes, what: str) -> None:
    if not _has_digest(reference, data):
        raise BrokenSignature(f"{what} was changed after it was signed")


def _has_digest(reference: Any, data: bytes) -> bool:
    method, value = reference.find(f"{DSIG}DigestMethod"), reference.findtext(f"{DSIG}DigestValue")
    if method is None or value is None:
        raise BrokenSignature("a reference states no digest")
    if algorithm(method) not in _DIGESTS:
        raise unknown("digest", algorithm(method))
    return hashlib.new(_DIGESTS[algorithm(method)], data).digest() == decoded(value)


def _outside(tree: Any) -> str:
    """What stands outside of the root, for a message."""
    root, instruction = tree.getroot(), package("lxml.etree").PI
    siblings = [*root.itersiblings(preceding=True), *root.itersiblings()]
    return ", ".join(f"<?{one.target:.40}?>" for one in siblings[:3] if one.tag is instruction)


def decoded(text: str) -> bytes:
    """The bytes of a text in base64, whose lines may be divided."""
    try:
        return b64decode("".join(text.split()), validate=True)
    except ValueError:
        raise BrokenSignature(f"expected base64, got {text[:40]!r}") from None


def unknown(what: str, name: str) -> UnverifiedSignature:
    """The error of an algorithm that is not supported."""
    return UnverifiedSignature(f"its {what} is not supported ({name!r:.120})")
