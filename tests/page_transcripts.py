"""Pages whose commands are run: their blocks, and whether a command printed what its page shows."""

from __future__ import annotations

import re
import shlex

import pytest

BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# A pose that inverse kinematics finds on one processor it may miss on another: the plan differs, and the fit with it.
SHARE = 0.5


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
    """The same words, and numbers that agree to a share."""
    numbers = [list(map(float, NUMBER.findall(text))) for text in (shown, printed)]
    words = [NUMBER.sub("#", text) for text in (shown, printed)]
    return words[0] == words[1] and numbers[1] == pytest.approx(numbers[0], rel=SHARE)
