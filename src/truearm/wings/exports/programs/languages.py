"""The languages of robot programs that can be corrected."""

from __future__ import annotations

from truearm.wings.exports.programs.fanuc_ls import FanucListing
from truearm.wings.exports.programs.krl import Krl
from truearm.wings.exports.programs.polyscope import PolyScope
from truearm.wings.exports.programs.program import Language, text_start
from truearm.wings.exports.programs.rapid import Rapid
from truearm.wings.exports.programs.urscript import URScript
from truearm.wings.exports.programs.yaskawa_jbi import YaskawaJob

LANGUAGES: tuple[Language, ...] = (Rapid(), Krl(), FanucListing(), YaskawaJob(), PolyScope(), URScript())

# Files that are no program in a text of their own, by their endings.
UNREADABLE = {
    ".ls": "a Fanuc program begins with /PROG: this is a log, or a part of a program",
    ".tp": "a program .TP is binary: save it on the controller as text (.ls)",
}


def language_of(data: bytes) -> Language | None:
    """The language of a file, by its content."""
    text = data[text_start(data) :]
    return next((language for language in LANGUAGES if language.recognises(text)), None)
