"""The wings: features that stand on the core, a folder each. To take a wing off, delete its folder.

A wing says in its ``__init__`` which public names and which commands it brings; `import truearm` and ``truearm --help``
gather them here. No module of the core imports a wing.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

# The wings that are here, without what is in them.
WINGS: list[ModuleType] = [import_module(f"{__name__}.{info.name}") for info in iter_modules(__path__)]


def public_names() -> dict[str, tuple[str, ...]]:
    """The public names that wings bring, by the module that defines them."""
    return {f"{wing.__name__}.{module}": names for wing in WINGS for module, names in wing.NAMES.items()}


def public_modules() -> dict[str, str]:
    """The modules that are public as they stand, by name."""
    return {name: f"{wing.__name__}.{name}" for wing in WINGS for name in getattr(wing, "MODULES", ())}


def instruments() -> dict[str, str]:
    """Instruments by which wings measure a virtual arm: the word, and the module and function that has it."""
    found = ((wing, getattr(wing, "INSTRUMENTS", {})) for wing in WINGS)
    return {word: f"{wing.__name__}.{place}" for wing, brought in found for word, place in brought.items()}


def commands() -> dict[str, str]:
    """The commands that wings bring: the word, and the module and function that has it."""
    return {word: f"{wing.__name__}.{place}" for wing in WINGS for word, place in wing.COMMANDS.items()}
