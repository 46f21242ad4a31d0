"""The page "From an empty folder to the first certificate" works word for word, in an empty folder."""

import contextlib
import re
import shlex
import zipfile
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from page_transcripts import BLOCK, check_printed, commands
from truearm.wings.reports.docs_command import steps_of

pytestmark = pytest.mark.usefixtures("undrawn", "quick_plans")

PAGE = Path(__file__).parents[3] / "docs" / "first-certificate.md"
# A check that has too few checks before it, and a verification by a plan that nobody has confirmed, say so.
INCONCLUSIVE = 3
WRITTEN = ("--out", "--page", "--pdf", "--history")


def arrays(path):
    """The arrays of a model file, to the last bit."""
    with zipfile.ZipFile(path) as members:
        found = {name: members.read(name) for name in members.namelist() if name.endswith(".npy")}
    assert "fit_.coefficients.npy" in found
    return found


@pytest.fixture(scope="module")
def laboratory(truearm, tmp_path_factory):
    """Folder where every command of the page was run and printed what the page shows."""
    pytest.importorskip("typst", reason="the PDF of a certificate needs the extra pdf")
    folder = tmp_path_factory.mktemp("laboratory")
    with contextlib.chdir(folder):
        for kind, name, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
            if kind == "toml":
                Path(name).write_text(text, encoding="utf-8")
                continue
            for (program, *arguments), shown in commands(text):
                assert program == "truearm"
                result = truearm(*arguments)
                if arguments[0] == "fit":
                    # With two threads of the linear algebra, as with the one of the tests: the same to the last bit.
                    model = arrays("arm.truearm")
                    with threadpool_limits(2):
                        assert truearm(*arguments).out == result.out
                    assert arrays("arm.truearm") == model
                decides_nothing = arguments[0] == "check" or arguments[:2] == ["verify", "--test-plan"]
                assert result.code == (INCONCLUSIVE if decides_nothing else 0), (arguments, result.err)
                check_printed(shown, result.out.splitlines())
    return folder


def test_the_page_goes_from_an_empty_folder_to_three_monthly_checks(laboratory):
    assert len(list(laboratory.glob("*.sqlite"))) == 1
    assert len(re.findall(r"^\$ truearm check ", PAGE.read_text(encoding="utf-8"), flags=re.M)) == 3
    assert (laboratory / "coordinates.csv").exists()
    assert (laboratory / "certificate.pdf").read_bytes().startswith(b"%PDF-1.7")
    # Files that a person types: the arm's, its specification, its artefacts, and who certifies.
    typed = {path.name for path in laboratory.glob("*.toml")}
    assert typed == {"my-arm.toml", "mpe.toml", "artefacts.toml", "about.toml"}


@pytest.fixture(scope="module")
def virtual_laboratory():
    """Files and commands of the page of example data: what fills the folder, and then those to try."""
    text = (PAGE.parent / "example-data.md").read_text(encoding="utf-8")
    before, *steps = steps_of(text)
    assert before == ["docs", "first-certificate", "--run", "."]
    (to_try,) = re.findall(r"^```sh\n(.*?)^```", text.partition("## To try")[2], flags=re.M | re.S)
    tried = [shlex.split(command)[1:] for command in to_try.splitlines()]
    assert len(tried) > 10
    return [*steps, *tried]


def test_every_file_of_the_virtual_laboratory_is_there_before_it_is_read(virtual_laboratory):
    """What the commands do is tested each for itself; that each finds its files is what this page adds."""
    there = set()
    for step in [*steps_of(PAGE.read_text(encoding="utf-8")), *virtual_laboratory]:
        if isinstance(step, tuple):
            there.add(step[0])
            continue
        for option, name in zip(["", *step], step, strict=False):
            if re.fullmatch(r"[\w-]+\.[a-z]+", name):
                is_written = (
                    option in WRITTEN
                    or (step[0], option) == ("simulate", "--out-lengths")
                    or (option == "--out" and "sheet" in step)
                )
                assert is_written or name in there, (step, name)
                there |= {name, name.replace(".csv", "-lengths.csv")}  # which a plan and its readings have beside them


@pytest.mark.weekly
def test_the_virtual_laboratory_has_the_files_of_every_command(truearm, laboratory, virtual_laboratory, monkeypatch):
    monkeypatch.chdir(laboratory)
    for step in virtual_laboratory:
        if isinstance(step, tuple):
            Path(step[0]).write_text(step[1], encoding="utf-8")
            continue
        ran = truearm(*step)
        assert ran.code == 0 or (step[0] in ("check", "verify") and ran.code == INCONCLUSIVE), (step, ran.err)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [(["a 1"], ["a 1", "b"]), (["b"], ["a", "b"]), (["a 1", "..."], ["a 2"]), (["a", "...", "c"], ["a", "c", "b"])],
)
def test_a_page_that_says_something_else_is_found_out(shown, printed):
    with pytest.raises(AssertionError):
        check_printed(shown, printed)
