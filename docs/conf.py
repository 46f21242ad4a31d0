"""The documentation site: Sphinx with the pydata theme, MyST pages and an executed gallery."""

from __future__ import annotations

import inspect
import os
import re
import sys
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer
from sphinx.highlighting import lexers
from sphinx.util import logging

import truearm

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]  # site_pictures.py, benchmarks
# Figures are drawn without a display, and every example runs with the same number of BLAS threads.
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

project = "truearm"
copyright = "the truearm contributors, Apache-2.0"
version = release = truearm.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "gallery/**/*.ipynb", "gallery/**/*.py", "gallery/**/*.json", "gallery/**/*.zip"]
root_doc = "index"

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3

templates_path = ["templates"]
autosummary_generate = True
autodoc_typehints = "none"  # the docstrings give types with shapes and units
autodoc_default_options = {"members": True, "inherited-members": False}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # attributes of a record are one list, and no second description of each
default_role = "code"
# Words such as n_joints in the shapes of docstrings are attributes of several classes.
suppress_warnings = ["ref.python"]
lexers["csv"] = TextLexer()

# Builds must pass without a network: references to other projects are resolved only where it is asked for.
intersphinx_mapping = (
    {
        "numpy": ("https://numpy.org/doc/stable/", None),
        "scipy": ("https://docs.scipy.org/doc/scipy/", None),
        "sklearn": ("https://scikit-learn.org/stable/", None),
    }
    if os.environ.get("TRUEARM_DOCS_LINKS")
    else {}
)

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "remove_config_comments": True,
    "capture_repr": ("_repr_html_", "__repr__"),
    "image_scrapers": ("matplotlib", "site_pictures.record_figure"),
    "reset_modules": ("matplotlib", "site_pictures.house_style"),
    "ignore_pattern": "json_reader",  # its example shows it
    "write_computation_times": False,
}

html_theme = "pydata_sphinx_theme"
html_title = "truearm"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options: dict[str, Any] = {
    "show_prev_next": False,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}


AUTOSUMMARY = """.. currentmodule:: truearm

.. autosummary::
   :toctree: generated
   :nosignatures:
"""


def write_command_reference() -> None:
    """Write the page of the commands from what each prints for ``--help``."""
    from typer.testing import CliRunner

    from truearm.command_line import COMMANDS, make_app

    runner, program = CliRunner(), make_app()
    parts = ["# Commands\n", "What every command prints for `--help`.\n"]
    commands = list(COMMANDS)
    for command in commands:  # a group adds its own
        ran = runner.invoke(
            program,
            [*command.split(), "--help"],
            prog_name="truearm",
            env={"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"},
        )
        if ran.exit_code != 0:
            raise RuntimeError(f"truearm {command} --help: {ran.output}")
        text = re.sub(r"\x1b\[[0-9;]*m", "", ran.output).strip()
        parts += [f"## truearm {command}\n", f"```text\n{text}\n```\n"]
        listed = re.findall(r"^  ([a-z]+) ", text.partition("\nCommands:")[2], flags=re.MULTILINE)
        place = commands.index(command) + 1
        commands[place:place] = [f"{command} {name}" for name in listed]
    (HERE / "commands.md").write_text("\n".join(parts), encoding="utf-8")


def write_api_reference() -> None:
    """Write the page of the public names from ``truearm.__all__``: classes apart from functions."""
    kinds: dict[str, list[str]] = {"Functions": [], "Classes": []}
    for name in sorted(truearm.__all__, key=str.lower):
        thing = getattr(truearm, name)
        if inspect.isclass(thing):
            kinds["Classes"].append(name)
        elif inspect.isroutine(thing):
            kinds["Functions"].append(name)
    parts = [
        "# Python reference\n",
        "The public names of `import truearm as ta`. Lengths are in mm and angles in rad.\n",
    ]
    for kind, names in kinds.items():
        listed = "\n".join(f"   {name}" for name in names)
        parts += [
            f"## {kind}\n",
            f"```{{eval-rst}}\n{AUTOSUMMARY}\n{listed}\n```\n",
        ]
    (HERE / "api.md").write_text("\n".join(parts), encoding="utf-8")


def skip_foreign(app: object, what: str, name: str, thing: object, skip: bool, options: object) -> bool | None:
    """Leave out what scikit-learn gives to every estimator: its own site describes it."""
    del app, what, name, skip, options
    home = getattr(inspect.unwrap(thing) if callable(thing) else thing, "__module__", None) or ""
    return True if home.startswith("sklearn") or "RequestMethod" in getattr(thing, "__qualname__", "") else None


def write_references(app: object, config: object) -> None:
    """Write what comes from the program itself: two pages, and the pictures of the front page."""
    from site_pictures import write_front_page

    del app, config
    write_command_reference()
    write_api_reference()
    write_front_page(HERE / "_static" / "front")


def log_stale_figures(app: object) -> None:
    """Mark in the log of the build the figures whose code has changed since they were measured."""
    from benchmarks.figures import stale

    del app
    for one in stale():
        logging.getLogger(__name__).info(
            "figures of `%(benchmark)s %(row)s`, measured at %(commit)s: changed since are %(changed since)s", one
        )


def setup(app: Any) -> None:
    """Have what the program writes written before Sphinx reads its sources."""
    app.connect("config-inited", write_references)
    app.connect("builder-inited", log_stale_figures)
    app.connect("autodoc-skip-member", skip_foreign)
