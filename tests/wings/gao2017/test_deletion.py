"""The paper can be deleted: without its folder every other module imports, and every command but `reproduce` starts."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import truearm
from truearm.command_line import VERBS

IMPORT_ALL = """
import importlib, pkgutil, truearm
for module in pkgutil.walk_packages(truearm.__path__, "truearm."):
    if not module.name.endswith(("__main__", ".reproduce", "workflows.procedure")):
        importlib.import_module(module.name)
for name in truearm.__all__:
    if truearm._HOME_OF.get(name) not in ("truearm.wings.gao2017.reproduce", "truearm.wings.gao2017.carry_out"):
        getattr(truearm, name)
"""

START_ALL = """
import sys
from typer.testing import CliRunner
from truearm.command_line import make_app
for verb in sys.argv[1:]:
    assert CliRunner().invoke(make_app(), [verb, "--help"]).exit_code == 0, verb
"""


def test_without_papers_every_other_module_imports_and_every_other_command_starts(tmp_path):
    shutil.copytree(Path(truearm.__file__).parent, tmp_path / "truearm", ignore=shutil.ignore_patterns("papers"))

    command = [sys.executable, "-B", "-c", IMPORT_ALL + START_ALL, *(verb for verb, _ in VERBS if verb != "reproduce")]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    ran = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


def test_no_source_outside_the_papers_folder_imports_it_but_the_reproduce_verb():
    package = Path(truearm.__file__).parent
    users = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if "truearm.wings" in path.read_text(encoding="utf-8") and "papers" not in path.relative_to(package).parts
    }
    # The verb's files: its command, the paper's tables, and the paper's procedure on readings of one's own.
    verb = {"cli/reproduce.py", "workflows/reproduce.py", "workflows/procedure.py"}
    assert users <= verb
    # Nothing else calls them, not even within a function: the program finds command and results by their names.
    names = re.compile(r"(workflows|cli)\.(reproduce|procedure) import|import (reproduce|procedure)\b")
    callers = {path.relative_to(package).as_posix() for path in package.rglob("*.py") if names.search(path.read_text())}
    assert callers <= verb
