"""Packages of the extras, which are imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from truearm.errors import MissingTool


def extra_module(name: str, needs: str, install: str, *, file: str | Path | None = None) -> Any:
    """A module of a package that is no dependency.

    Parameters
    ----------
    name : str
    needs : str
        What needs which package, as ``PDF files need the package pypdf``.
    install : str
        The hint: how to get it, or how to do without.
    file : path, optional
        That needs it.

    Raises
    ------
    MissingTool
        If it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        raise MissingTool(f"{needs}, which is not installed", file=file, hint=install) from None
