"""The command line as a user has it: arguments in, exit code and two streams out."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from truearm.command_line import run


@dataclass(frozen=True)
class Ran:
    """What a run of the command line left."""

    code: int
    out: str
    err: str


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def truearm_run(*arguments: object, terminal: bool = False) -> Ran:
    out, err = io.StringIO(), Terminal() if terminal else io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as ended:
        run([str(a) for a in arguments])
    assert isinstance(ended.value.code, int)
    return Ran(ended.value.code, out.getvalue(), err.getvalue())


def contents(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder and below, hidden files too."""
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in sorted(folder.rglob("*"))}


@pytest.fixture(scope="session")
def truearm() -> Callable[..., Ran]:
    """Run the command line in this process."""
    return truearm_run


@pytest.fixture(scope="session")
def snapshot() -> Callable[[Path], dict[str, bytes | None]]:
    """Everything in a folder and below, to compare with later."""
    return contents


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with sessions and models of one virtual arm; tests read it and write elsewhere."""
    folder = tmp_path_factory.mktemp("made")

    def done(*arguments: object) -> None:
        ran = truearm_run(*arguments)
        assert ran.code == 0, ran.err

    session, train, test = (folder / f"{name}.csv" for name in ("session", "train", "test"))
    done("simulate", "gao2017", "--poses", 400, "--seed", 1, "--out", session)
    done("simulate", "gao2017", "--poses", 40, "--seed", 2, "--no-reference", "--out", folder / "angles.csv")
    done("simulate", "wam", "--poses", 40, "--strategy", "uniform", "--out", folder / "wam.csv")
    done("split", session, "--by", "row", "--hold-out", 0.25, "--train", train, "--test", test)
    for model in ("nominal", "kinematic", "network"):
        own = ["--hidden", "12", "--epochs", 60] if model == "network" else []
        out = folder / f"{model}.truearm"
        done("fit", train, "--arm", "gao2017", "--free", "none", "--model", model, *own, "--out", out)
    return folder
