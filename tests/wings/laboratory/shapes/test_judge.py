"""The judge does not know the accused."""

from __future__ import annotations

import ast
from pathlib import Path

import truearm.wings.laboratory

ACCUSED = ("models", "identify", "terms", "nets", "virtual", "poses", "plan", "datasets", "papers", "report", "cli")


def test_verification_imports_nothing_that_makes_points():
    for path in Path(truearm.wings.laboratory.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                room = name.removeprefix("truearm.").partition(".")[0]
                assert not (name.startswith("truearm.") and room in ACCUSED), f"{path.name} imports {name}"
