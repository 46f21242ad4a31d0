"""The languages of robot programs that can be corrected."""

from __future__ import annotations

from truearm.wings.exports.programs.program import Language
from truearm.wings.exports.programs.rapid import Rapid

LANGUAGES: tuple[Language, ...] = (Rapid(),)


def language_of(data: bytes) -> Language | None:
    """The language of a file, by its content."""
    return next((language for language in LANGUAGES if language.recognises(data)), None)
