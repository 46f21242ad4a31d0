"""Empty files of artefacts and of a specification, with comments, to fill in."""

from __future__ import annotations

from importlib.resources import files

from truearm.wings.laboratory import TemplateKind


def template(kind: TemplateKind) -> str:
    """Return the text of an empty file; it is refused until it is filled in.

    Parameters
    ----------
    kind : {"artefacts", "mpe"}
        The certificates of the artefacts, or the specification of the arm.
    """
    return files("truearm.wings.laboratory.standards").joinpath(f"{kind}_template.toml").read_text(encoding="utf-8")
