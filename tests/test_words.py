"""The language of the house: the terms of `docs/glossary.md`, not the dialect that the project once grew."""

import ast
import re
from pathlib import Path

import truearm

HOUSE = Path(truearm.__file__).parent
CHECKOUT = Path(__file__).resolve().parents[1]

# What each of these words stood for has a name in the glossary.
DIALECT = re.compile(
    r"\b(told|untold|anew|whence|hitherto|besides|gone on with|goes on with|go on with|by custom|is made of"
    r"|goes together|too sure|how sure|how surely|stands? for itself|comes? out as|far off|left out|leaves? out"
    r"|as drawn|set aside|sets aside|serves? to|served to|so many|wherefrom|thereof|nobody knows|what it knows"
    r"|for want of)\b",
    re.IGNORECASE,
)
# A phrase that a term of the field needs, or that quotes another's name.
ALLOWED = re.compile(r"leave[- ]one[- ]out|leave[- ]out|leave-group-out", re.IGNORECASE)


def text_of_module(nodes: list[ast.AST]) -> list[tuple[int, str]]:
    """Strings, docstrings among them, and names of functions and classes, each with its line."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append((node.lineno, node.value))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.append((node.lineno, node.name.replace("_", " ")))
    return found


def dialect_in(texts: list[tuple[int, str]]) -> list[str]:
    return [
        f"{line}: {match[0]!r} in {text.strip()[max(0, match.start() - 40) : match.end() + 40]!r}"
        for line, text in texts
        for match in DIALECT.finditer(ALLOWED.sub("", " ".join(text.split())))
    ]


def test_modules_speak_the_language_of_the_field(files):
    found = {module: dialect_in(text_of_module(source.nodes)) for module, source in files.items()}
    assert not {module: said for module, said in found.items() if said}


PAGES = [
    *sorted(CHECKOUT.glob("*.md")),
    *sorted((CHECKOUT / "docs").glob("*.md")),
    *sorted((CHECKOUT / "docs/start").glob("*.md")),
]
PAGES = [path for path in PAGES if path.name not in ("api.md", "commands.md")]  # generated from docstrings and helps
PAGES += sorted(HOUSE.rglob("*.toml")) + sorted(HOUSE.rglob("*.j2"))


def test_pages_speak_the_language_of_the_field():
    found = {path.name: dialect_in(list(enumerate(path.read_text("utf-8").splitlines(), 1))) for path in PAGES}
    assert not {name: said for name, said in found.items() if said}


def test_the_dialect_is_recognised():
    assert dialect_in([(1, "The base is identified\n    anew, besides.")]) != []
    assert dialect_in([(1, "The base is re-identified; leave-one-out residuals.")]) == []
