"""Packages that some sources need, imported when such a source is opened."""

from __future__ import annotations

import importlib
from typing import Any

from truearm.errors import MissingTool


def extra_package(module: str, extra: str, what: str) -> Any:
    """A module of a package of an extra.

    Parameters
    ----------
    module : str
    extra : str
        Of truearm, which installs it.
    what : str
        What needs it, for the message.

    Raises
    ------
    MissingTool
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingTool(
            f"{what} needs the package {PACKAGES.get(package, package)}, which is not installed",
            hint=f"pip install 'truearm[{extra}]'",
        ) from None


PACKAGES = {"serial": "pyserial", "paho": "paho-mqtt"}  # whose modules have another name
