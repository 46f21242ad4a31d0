"""Pages know no domain: no import of one, and no word of one."""

import ast
import re
from pathlib import Path

import truearm.pages

SOURCES = sorted(Path(truearm.pages.__file__).parent.iterdir())
WORDS = re.compile(
    r"\b(arms?|joints?|tips?|probe|stylus|poses?|robots?|readings?|models?|networks?|neurons?|trainers?|trainings?|"
    r"trackers?|calibrat\w*|compensat\w*|verif\w*|artefacts?|seats?|paper's|gao\w*)\b",
    re.IGNORECASE,
)


def test_pages_import_no_domain():
    allowed = {"errors", "files", "number_format", "pages", "printable_text", "typing"}
    for path in (path for path in SOURCES if path.suffix == ".py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("truearm."):
                assert node.module.split(".")[1] in allowed, f"{path.name}: {node.module}"


def test_pages_use_no_word_of_a_domain():
    for path in (path for path in SOURCES if path.is_file()):
        words = {word.lower() for word in WORDS.findall(path.read_text(encoding="utf-8"))}
        assert not words, f"{path.name}: {sorted(words)}"
