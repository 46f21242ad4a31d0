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
napoleon_preprocess_types = True  # what a function returns is a link
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


# A box of help is as wide as the text of a page: nothing is cut off.
HELP_COLUMNS = 80

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
            env={"COLUMNS": str(HELP_COLUMNS), "TERM": "dumb", "NO_COLOR": "1"},
        )
        if ran.exit_code != 0:
            raise RuntimeError(f"truearm {command} --help: {ran.output}")
        text = re.sub(r"\x1b\[[0-9;]*m", "", ran.output).strip()
        parts += [f"## truearm {command}\n", f"```text\n{text}\n```\n"]
        listed = re.findall(r"^  ([a-z]+) ", text.partition("\nCommands:")[2], flags=re.MULTILINE)
        place = commands.index(command) + 1
        commands[place:place] = [f"{command} {name}" for name in listed]
    (HERE / "commands.md").write_text("\n".join(parts), encoding="utf-8")


# The public names by what they are for; the pages of the guide that tell it.
TASKS: dict[str, tuple[str, str]] = {
    "Describe an arm": (
        "Arm load_arm list_arms diagnose plan_circles CirclesPlan arm_from_circles CircleArm Diagnosis",
        "describe-your-arm arm-file arms",
    ),
    "Read and write files": (
        "Session read_session import_table Lengths read_lengths load_model fetch PublishedReadings datasets",
        "session-file import two-logs model-file",
    ),
    "Plan": (
        "plan PlanResult plan_check CheckPlan simulate SimulationResult rehearse VirtualArm",
        "planning virtual-arm",
    ),
    "Measure with a camera": (
        (
            "draw_board BoardSheet plan_images ImagePlan simulate_images ImageSimulation find_corners CornersResult "
            "fit_images ImageFit hand_eye HandEyeResult"
        ),
        "camera hand-eye",
    ),
    "Identify": (
        (
            "fit FitResult refit RefitResult KinematicModel PhysicalModel HybridModel NetworkModel NominalModel Term "
            "Expression accepting InputError"
        ),
        "fitting imperfect-readings terms networks",
    ),
    "Test and compare": ("evaluate Evaluation compare ModelChange report ReportResult", "fitting"),
    "Compensate": (
        (
            "predict Prediction correct CorrectedTargets correct_program CorrectedProgram export ExportResult "
            "check_export ExportCheck"
        ),
        "measure correct programs export",
    ),
    "Live": (
        "record live open_source list_sources SourceList try_source SourceTrial Source Sample Notice StandstillRule",
        "live",
    ),
    "Verify": (
        (
            "verify VerificationResult simulate_verification SimulatedVerification operator_sheet OperatorSheetResult "
            "load_verification_plan VerificationPlan read_specification Specification read_artefacts Artefacts "
            "read_points MeasuredPoints fill_points artefacts_from_certificate ArtefactsFromCertificate task "
            "TaskResult measure MeasuredFeatures shapes check CheckResult withdraw_check WithdrawalResult"
        ),
        "verification task-uncertainty measure interim-check",
    ),
    "Certify": (
        "certificate CertificateResult read_certificate ReadCertificate AdministrativeData Signer read_signer",
        "certificate assessor",
    ),
    "Many arms": ("Fleet FleetRun FleetStatus LearnedTypePrior", "fleet type-prior"),
    "The founding paper": ("reproduce ReproductionResult ProcedureResult", "reproduction"),
}


def write_api_reference() -> None:
    """Write the page of the public names by task: what does it first, then what it returns or takes."""
    listed = [name for names, _ in TASKS.values() for name in names.split()]
    if sorted(listed) != sorted({*truearm.__all__} - {"__version__"}):
        raise RuntimeError(f"no task, or two, in docs/conf.py: {sorted({*listed} ^ {*truearm.__all__})}")
    parts = [
        "# Python reference\n",
        (
            "The public names of `import truearm as ta`, by task. Lengths are in mm and angles in rad. A result "
            "prints as text, shows as HTML in a notebook, and has `to_dict()`; where it is a table, `to_frame()`.\n"
        ),
    ]
    for task, (names, pages) in TASKS.items():
        entries = "\n".join(f"   {name}" for name in names.split())
        links = ", ".join(f"[{page.replace('-', ' ')}]({page}.md)" for page in pages.split())
        parts += [f"## {task}\n", f"See also {links}.\n", f"```{{eval-rst}}\n{AUTOSUMMARY}\n{entries}\n```\n"]
    (HERE / "api.md").write_text("\n".join(parts), encoding="utf-8")


def add_see_also(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Name the others of a task below each public name: what it returns, its counterpart, classes of its options."""
    del app, what, thing, options
    package, _, own = name.rpartition(".")
    for names, _ in TASKS.values() if package == "truearm" else ():
        if own in names.split():
            others = ", ".join(f":obj:`~truearm.{other}`" for other in names.split() if other != own)
            lines += ["", ".. seealso::", "", f"   {others}", ""]


def write_papers() -> None:
    """Write the page of the papers, whose entries are those of paper/paper.bib."""
    entries = (HERE.parent / "paper" / "paper.bib").read_text(encoding="utf-8").strip()
    citation = f"""@software{{truearm,
  author  = {{{{The truearm contributors}}}},
  title   = {{truearm: true coordinates from the joint angles of an articulated arm}},
  version = {{{release}}}
}}"""
    text = (
        "# Papers\n\nHow to cite truearm, and the paper that it began with:\n\n"
        f"```bibtex\n{citation}\n\n{entries.partition(chr(10) + '@')[0]}\n```\n\n"
        "The methods that it builds on, and the data that it is tested on:\n\n"
        f"```bibtex\n@{entries.partition(chr(10) + '@')[2]}\n```\n"
    )
    (HERE / "papers.md").write_text(text, encoding="utf-8")


def skip_foreign(app: object, what: str, name: str, thing: object, skip: bool, options: object) -> bool | None:
    """Leave out what scikit-learn gives to every estimator: its own site describes it."""
    del app, what, name, skip, options
    home = getattr(inspect.unwrap(thing) if callable(thing) else thing, "__module__", None) or ""
    return True if home.startswith("sklearn") or "RequestMethod" in getattr(thing, "__qualname__", "") else None


def write_references(app: object, config: object) -> None:
    """Write what comes from the program itself: three pages, and the pictures of the front page."""
    from site_pictures import write_front_page

    del app, config
    write_command_reference()
    write_api_reference()
    write_papers()
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
    app.connect("autodoc-process-docstring", add_see_also, priority=900)  # after the sections are read
