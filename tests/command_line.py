"""The command line as a user has it: arguments in, exit code and two streams out."""

import contextlib
import importlib
import io
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, get_args

import pytest
import typer

from truearm.command_line import COMMANDS, make_app, run

CHECKOUT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Ran:
    """What a run of the command line left."""

    code: int
    out: str
    err: str

    def done(self) -> "Ran":
        """This run, which ended well and has nothing on standard error."""
        assert (self.code, self.err) == (0, ""), self
        return self

    def refused(self) -> "Ran":
        """This run, which was refused and has nothing on standard output."""
        assert (self.code, self.out) == (2, ""), self
        return self


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


def called(command: str, *arguments: object, **options: object) -> int:
    """The exit code of a command whose errors come as they are; options by name, lists once for each value."""
    words = [command, *map(str, arguments)]
    for name, value in options.items():
        option = f"--{name.replace('_', '-')}"
        for one in value if isinstance(value, list) else [] if value is None else [value]:
            words += [option] if one is True else [option, str(one)]
    code: int | None = make_app(command)(words, standalone_mode=False)
    return code or 0


@dataclass(frozen=True)
class Declared:
    """An option or argument as a command declares it: `name` is ``--out``, or that of the argument."""

    command: str
    name: str
    types: tuple[Any, ...]
    help: str


def functions() -> Iterator[tuple[str, Any]]:
    """The function of each command and of each in a group, with the options that it has from its verb."""
    for verb, place in COMMANDS.items():
        module, _, function = place.partition(":")
        command = getattr(importlib.import_module(module), function)
        found = {verb: command}
        if isinstance(command, typer.Typer):
            found = {f"{verb} {one.name or one.callback.__name__}": one.callback for one in command.registered_commands}
            if command.registered_callback is not None:
                found[verb] = command.registered_callback.callback
        yield from ((name, getattr(one, "with_options", lambda one=one: one)()) for name, one in found.items())


def declared() -> Iterator[Declared]:
    """Every option and argument of every command."""
    for command, function in functions():
        for one in signature(function, eval_str=True).parameters.values():
            if one.annotation is typer.Context:
                continue
            kind, info = get_args(one.annotation)
            names = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
            is_option = isinstance(info, typer.models.OptionInfo)
            name = next((word for word in names if word.startswith("--")), "--" + one.name.replace("_", "-"))
            types = (kind, *get_args(kind), *(part for some in get_args(kind) for part in get_args(some)))
            yield Declared(command, name if is_option else one.name, types, info.help or "")


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


@pytest.fixture
def refused(tmp_path: Path) -> Callable[..., str]:
    """Run; expect a refusal that holds every one of some phrases, and that no file of the test is touched."""

    def check(arguments: Iterable[object], *phrases: str) -> str:
        folders = {tmp_path, Path.cwd()} - {CHECKOUT}
        before = [contents(folder) for folder in folders]
        said = truearm_run(*arguments).refused().err
        first, *others = said.splitlines()
        assert first.startswith("truearm: ")
        assert not others or first.endswith(" faults"), said  # which are listed, a line each
        for phrase in phrases:
            assert phrase in said, said
        assert [contents(folder) for folder in folders] == before
        return said

    return check


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
