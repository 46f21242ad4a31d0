"""The page "From an empty folder to the first certificate" works word for word, in an empty folder."""

from __future__ import annotations

import re
import shlex
import zipfile
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

PAGE = Path(__file__).parents[2] / "docs" / "first-certificate.md"
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# A pose that inverse kinematics finds on one processor it may miss on another: the plan differs, and the fit with it.
SHARE = 0.5
# A check that has too few checks before it, and a verification by a plan that nobody has confirmed, say so.
INCONCLUSIVE = 3


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


def arrays(path):
    """The arrays of a model file, to the last bit."""
    with zipfile.ZipFile(path) as members:
        found = {name: members.read(name) for name in members.namelist() if name.endswith(".npy")}
    assert "fit_.coefficients.npy" in found
    return found


def is_alike(shown, printed):
    """The same words, and numbers that agree to a share."""
    numbers = [list(map(float, NUMBER.findall(text))) for text in (shown, printed)]
    words = [NUMBER.sub("#", text) for text in (shown, printed)]
    return words[0] == words[1] and numbers[1] == pytest.approx(numbers[0], rel=SHARE)


def test_the_page_goes_from_an_empty_folder_to_three_monthly_checks(truearm, tmp_path, monkeypatch):
    pytest.importorskip("fpdf", reason="the PDF of a certificate needs the extra pdf")
    monkeypatch.chdir(tmp_path)
    ran = []
    for kind, name, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if kind == "toml":
            Path(name).write_text(text, encoding="utf-8")
            continue
        for (program, *arguments), shown in commands(text):
            assert program == "truearm"
            # Two threads of the linear algebra, and one: a transcript does not hang on their number.
            with threadpool_limits(2):
                result = truearm(*arguments)
            if arguments[0] == "fit":
                model = arrays("arm.truearm")
                with threadpool_limits(1):
                    assert truearm(*arguments).out == result.out
                assert arrays("arm.truearm") == model
            decides_nothing = arguments[0] == "check" or arguments[:2] == ["verify", "--plan"]
            assert result.code == (INCONCLUSIVE if decides_nothing else 0), (arguments, result.err)
            check_printed(shown, result.out.splitlines())
            ran.append(arguments[0])
    assert ran.count("check") == 3
    assert Path("certificate.pdf").read_bytes().startswith(b"%PDF-1.7")
    # Files that a person types: the arm's, its specification, its artefacts, and who certifies.
    typed = {path.name for path in tmp_path.glob("*.toml")}
    assert typed == {"my-arm.toml", "mpe.toml", "artefacts.toml", "about.toml"}


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        (["a 1"], ["a 1", "b"]),
        (["b"], ["a", "b"]),
        (["a 1", "..."], ["a 2"]),
        (["a", "...", "c"], ["a", "c", "b"]),
    ],
)
def test_a_page_that_says_something_else_is_found_out(shown, printed):
    with pytest.raises(AssertionError):
        check_printed(shown, printed)
