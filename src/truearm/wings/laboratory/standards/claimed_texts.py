"""What a name or a title must not claim: a verdict, which is the result of the test, or another standard."""

from __future__ import annotations

import re

from truearm.errors import InputError

_VERDICT = re.compile(
    r"\b(?:conform(?:s|ed|ing|ity|ance)?|compl(?:y|ies|ied|iant|iance)|pass(?:es|ed)?|certified|approved|meets|"
    r"fulfils)\b",
    re.IGNORECASE,
)
_STANDARD = re.compile(r"\b(?:ISO|IEC|EN|DIN|ASME|ANSI|VDI|VDE|BS|JIS|JJF|GB)\b[A-Z/ ]*[ -]?[A-Z]?\d[\d.\-]*\d")


def check_no_verdict(text: str) -> str:
    """Return a name or title that states no verdict.

    Raises
    ------
    InputError
        If it does.
    """
    if (found := _VERDICT.search(text)) is not None:
        raise InputError(
            f"expected what is tested, got {text!r:.80}, which says {found[0]!r}",
            hint="leave the verdict out: it is the result of the test",
        )
    return text


def named_standards(text: str) -> list[str]:
    """The standards that a text names, without their years."""
    return [one[0] for one in _STANDARD.finditer(text)]
