"""The command line: the commands of the core and of the wings, which parse, call and print."""

from __future__ import annotations

import atexit
import codecs
import errno
import gc
import importlib
import io
import os
import re
import signal
import sys
import threading
import traceback
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, Protocol, runtime_checkable

import typer
from typer import Option

from truearm import __version__, wings
from truearm.errors import TruearmError
from truearm.printable_text import printable
from truearm.verbs.options import Group

# The first screen of the help: what a person has in hand, and in it the order in which a newcomer needs the commands.
GROUPS = {
    "Start": ("demo", "arms", "docs", "fetch"),
    "Measure": ("plan", "plan-images", "simulate", "board", "corners", "sources", "record", "live", "import", "split"),
    "Identify and correct": ("fit", "fit-images", "refit", "predict", "correct", "export"),
    "Judge": ("evaluate", "compare", "report"),
    "Verify in a laboratory": ("verify", "task", "measure", "check", "certificate"),
    "Many arms, and the paper": ("fleet", "reproduce"),
}


def _commands() -> dict[str, str]:
    """The module and function of each command of the core and of the wings that are here, in the order of the help."""
    core = {word: f"truearm.verbs.commands:{word}" for word in ("split", "fit", "refit", "predict", "evaluate")}
    found = wings.commands() | core  # a wing replaces no command of the core
    listed = [word for words in GROUPS.values() for word in words if word in found]
    return {word: found[word] for word in [*listed, *(word for word in found if word not in listed)]}


COMMANDS = _commands()
# What other people call commands, and what earlier releases called options; of one command where others differ, and
# with a sentence where its use differs. An entry of one command also answers that the option or its value is missing.
OTHER_NAMES = {
    "calibrate": "fit",
    "identify": "fit",
    "compensate": "predict",
    "-o": "--out",
    "--arm-file": "--out",
    "--bar-mm": "--bar",
    "--html": "--page",
    "--into": "--out",
    "--length": "--bar",
    "--lengths": "--out-lengths",
    "--model": "--model-file",
    "--out": "--page",
    "--plan": "--test-plan",
    "--points": "--measured",
    "--position": "--column position=NAME",
    "--readings": "--session",
    "--report": "--page",
    "--seat": "--column seat=NAME",
    "--session": "--column session=NAME",
    "--sign": "--key",
    "--source": "--original",
    "--spec": "--mpe",
    "--standstill-seconds": "--still",
    "--table": "--table-top",
    "--temperature": "--column temperature_degC=NAME",
    "--test": "--test-session",
    "--tip": "--column tip=NAME",
    "arms --page": "--page expects the page to write. Try: truearm arms NAME --page arm.html",
    "import --images": "images are read by another command. "
    "Try: truearm corners JOINTS.csv FOLDER --board charuco:8x11,15mm,11mm --out pixels.csv",
    "import --points": "--point",
    "simulate --reference": "a reference instrument measures unless --no-reference is given. Try: omit --reference",
    "verify sheet --page": "--page is the page to write now, and --out the points to measure. "
    "Try: truearm verify sheet PLAN --page sheet.html",
    "verify sheet --points": "--out",
    "certificate --template": "truearm verify template about",
    "fetch --list": "without NAME the sets are listed. Try: omit --list",
    "predict --into": "truearm verify fill MODEL SESSION --into points.csv",
    "verify --artefacts-from": "truearm verify artefacts CERTIFICATE",
    "verify --print-plan": "truearm verify plan NAME",
    "verify --sheet": "truearm verify sheet PLAN --page sheet.html",
    "verify --simulate": "truearm verify simulate MODEL|PRESET",
    "verify --template": "truearm verify template artefacts",
}
# What pydantic, and with it Typer, says of 0,2 and of 5um.
NO_NUMBER = "Input should be a valid number, unable to parse string as a number"


class _InGroups(Group):
    """The program, whose help lists its commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 - what click hands over
        """Write the commands, group by group."""
        width = formatter.width - 6 - max(map(len, self.commands))
        others = tuple(word for word in self.commands if not any(word in words for words in GROUPS.values()))
        for group, words in (GROUPS | {"More": others}).items():
            rows = [(word, self.commands[word].get_short_help_str(width)) for word in words if word in self.commands]
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)


@runtime_checkable
class SupportsMessage(Protocol):
    """Usage errors of click and of Typer."""

    def format_message(self) -> str:
        """The message, with the name of the option at fault."""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truearm {__version__}")
        raise typer.Exit


def _about(
    version: bool = Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """True coordinates from the joint angles of an articulated arm.

    Identify the arm from readings against something known, compensate its angles into corrected coordinates.
    """


def make_app(word: str = "") -> typer.Typer:
    """The command line with its commands; a command is a function, or a group of them.

    Where the first word of the arguments is a command, with that one alone: twenty parsers take a tenth of a second.
    """
    # Plain help and messages: they wrap anywhere, pass through pipes, and "[mm]" is no markup.
    app = typer.Typer(
        cls=_InGroups,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_about)
    for verb in [word] if word in COMMANDS else COMMANDS:
        module, _, function = COMMANDS[verb].partition(":")
        try:
            command = getattr(importlib.import_module(module), function)
        except ModuleNotFoundError as missing:
            if not str(missing.name).startswith("truearm."):
                raise
            if word == verb:
                return make_app()
            continue  # it builds on a wing that was taken off
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=verb)
        else:
            app.command(verb)(command)
    return app


# The parent of all usage errors: Typer's own or click's, depending on its version.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]

INTERRUPTED = 130  # 128 + SIGINT, as in a shell
OUTPUT_CLOSED = 141  # 128 + SIGPIPE
FAULT = 70  # EX_SOFTWARE of sysexits.h; 1 would look like a verdict


def console() -> NoReturn:
    """The command ``truearm``, in a process of its own: see `run`."""
    # What a short command makes lasts: to look for garbage in it, and once more at its end, is a tenth of a small fit.
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)
    run()


def run(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line and end the program.

    Exit codes: 0 done; 2 wrong input, or the system refuses (one message on standard error); 70 a fault of this
    program, with its traceback on standard error; 130 interrupted (Ctrl-C); 129 and 143 ended by SIGHUP and SIGTERM;
    141 output pipe closed, or no standard output. 1 and 3 are verdicts, never faults: of `verify` not conform,
    undecided; of `task` not fit, fit only with guard bands; of `check` recalibrate, repeat the check or too few
    checks; of `correct` some targets refused, none corrected; of `fleet run` some arms failed; of `export --check` the
    file does not agree, is not verified; of `certificate --read` the signature is broken, not verifiable here; of
    `sources --try` no sample arrived; of `arms --from-circles` a joint is not measured.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    # Pydantic's plugins watch what it checks: to look for them it reads about every package that is installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    _settle_encodings()
    try:
        with _signals_unwind():
            code = make_app(*arguments[:1])(arguments or ["--help"], standalone_mode=False, prog_name="truearm")
    except SystemExit as ended:
        code = OUTPUT_CLOSED if _output_closed(ended) else ended.code
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except (TruearmError, _UsageError, OSError, MemoryError) as error:
        _print_error(_message(error, *arguments[:1]))
        code = 2
    except Exception as error:
        if (wing := _wing_taken_off(error)) is not None:
            _print_error(f"this needs the wing {wing}, which was taken off")
            sys.exit(2)
        traceback.print_exc()
        _print_error("this is a fault of the program, not of its input. Please report it with the lines above")
        code = FAULT
    if not code and sys.stdout is None:  # closed before the start: the result was printed nowhere
        code = OUTPUT_CLOSED
    if code == INTERRUPTED:
        _print_error("interrupted")
    sys.exit(code or 0)


def _wing_taken_off(error: Exception) -> str | None:
    """The wing that an import did not find, if its folder was deleted."""
    name = str(error.name).split(".") if isinstance(error, ModuleNotFoundError) else []
    return name[2] if name[:2] == ["truearm", "wings"] and len(name) > 2 else None


def _output_closed(ended: SystemExit) -> bool:
    """Whether Typer ended the program because nobody reads its output pipe; its own exit code for that is 1."""
    closed = errno.EPIPE, errno.EINVAL  # the latter is what Windows says of such a pipe
    return isinstance(ended.__context__, OSError) and ended.__context__.errno in closed


def _settle_encodings() -> None:
    """Write to files and pipes in another encoding than UTF-8, as on Windows, without what that encoding lacks."""
    codecs.register_error("nearest", _nearest_characters)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="nearest")


def _nearest_characters(error: UnicodeError) -> tuple[str, int]:
    """Characters that the encoding lacks as their ASCII equivalents (a narrow space is a space), others as escapes."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    alike = str.maketrans({"\N{MINUS SIGN}": "-", "\N{RIGHTWARDS ARROW}": "->", "\N{GREEK SMALL LETTER MU}": "u"})
    lacking = unicodedata.normalize("NFKD", error.object[error.start : error.end]).translate(alike)
    return lacking.encode("ascii", "backslashreplace").decode(), error.end


def _message(error: Exception, word: str = "") -> str:
    """One line: what happened, where, and what to do."""
    if isinstance(error, TruearmError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"not enough memory{f' ({error})' if str(error) else ''}. Try: fewer readings at a time"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}"
    problem = error.format_message() if isinstance(error, SupportsMessage) else str(error)
    problem = " ".join(problem.split()).replace("Value error, ", "").removesuffix(".")
    unit = " of mm" * (getattr(getattr(error, "param", None), "metavar", None) == "MM")
    problem = problem.replace(NO_NUMBER, f"expected a number{unit} with a decimal point, such as 0.2")
    if ". Try: " in problem:  # of the parser of an option
        return problem.partition("': ")[2]
    context = getattr(error, "ctx", None)  # none where the value of an option is missing
    path = context.command_path if context else f"truearm {word}" if word in COMMANDS else "truearm"
    if answer := _other_name(problem, path.partition(" ")[2], context):
        return answer
    stop = "" if problem.endswith("?") else "."
    return f"{problem}{stop} Try: {path} --help"


def _other_name(problem: str, command: str, context: Any) -> str | None:
    """The answer to a command or option that has another name or another use here."""
    found = re.match(r"(No such (?:command '|option: )|Missing option '|Option ')([\w-]+)", problem)
    if found is None:
        return None
    word, is_unknown = found[2], found[1].startswith("No such")
    now = OTHER_NAMES.get(f"{command} {word}") or (OTHER_NAMES.get(word, "") if is_unknown else "")
    if ". Try: " in now:
        return now
    if now.startswith("truearm "):
        return f"{word} is a command now. Try: {now}"
    name = now.partition(" ")[0]
    if not name or (name.startswith("-") and all(name not in one.opts for one in context.command.params)):
        return None
    return (
        f"{word} is called {name} here. Try: truearm {f'{command} {now}' if name.startswith('-') else f'{now} --help'}"
    )


def _print_error(message: str) -> None:
    typer.echo(printable(f"truearm: {message}"), err=True)


@contextmanager
def _signals_unwind() -> Iterator[None]:
    """Unwind at SIGTERM and SIGHUP as at Ctrl-C, so that no temporary file remains."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, _end) for number in numbers if signal.getsignal(number) == signal.SIG_DFL}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(number: int, frame: object) -> NoReturn:
    del frame
    sys.exit(128 + number)
