"""Pages whose commands are run: their blocks, and whether a command printed what its page shows."""

import re
import shlex
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```(\w+) ?([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# A pose that inverse kinematics finds on one processor it may miss on another: the plan differs, and the fit with it.
SHARE = 0.5
# The largest of two errors of a few micrometres may be any of these, in mm.
FEW_MM = 0.008


def blocks(page, kind):
    """The blocks of a page of the guide of this kind, as "python" or "toml mpe"."""
    found = BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))
    return [text for language, name, text in found if f"{language} {name}".strip() == kind]


def block(page, kind):
    """The one block of this kind."""
    (text,) = blocks(page, kind)
    return text


def walk(truearm, text):
    """Run the commands of a block; what is shown below a command is what it prints, anything in place of "..."."""
    for (program, *arguments), shown in commands(text):
        assert program == "truearm"
        ran = truearm(*arguments)
        assert ran.code == 0, (arguments, ran.err)
        if shown:
            assert re.fullmatch(re.escape("\n".join(shown)).replace(r"\.\.\.", "(?s:.*?)"), ran.out.strip()), ran.out


def commands(block):
    """Each command with the lines below it."""
    for part in block.split("$ ")[1:]:
        command, *lines = part.splitlines()
        yield shlex.split(command), lines


def check_printed(shown, printed):
    """Every line shown is printed, in this order; at the beginning, in a row or at the end unless "..." is between."""
    at, gap = 0, False
    for line in shown:
        if line == "...":
            gap = True
            continue
        found = [i for i in range(at, len(printed)) if is_alike(line, printed[i])]
        assert found, f"not printed: {line}\n" + "\n".join(printed[at:])
        assert gap or found[0] == at, f"printed before {line}: {printed[at]}"
        at, gap = found[0] + 1, False
    assert gap or at == len(printed), f"not shown: {printed[at:]}"


def is_alike(shown, printed):
    """The same words, and numbers that agree to a share, or are a few micrometres both."""
    numbers = [list(map(float, NUMBER.findall(text))) for text in (shown, printed)]
    if NUMBER.sub("#", shown) != NUMBER.sub("#", printed):
        return False
    pairs = zip(*numbers, strict=True)
    return all(b == pytest.approx(a, rel=SHARE) or 0 < max(a, b) < FEW_MM for a, b in pairs)
