"""Cases of a benchmark: mistakes that people make, how many are believed; what is right, how much is questioned.

A case is a function without arguments that does what a person does and returns all that this person sees: what `seen`
gives of a command, or the text of a record; a refusal counts as its text. Of a mistake it shall say `said`, a regular
expression; of what is right it shall not say `unsaid`, nor refuse. Where a number decides, the function returns whether
it is as it should be. Cases make their files in `scratch()`::

    CASES = Cases()

    @CASES.mistake("a bar typed 505 for 500 mm", said="1.0 % longer than drawn")
    def bar_too_long() -> str:
        return seen("fit", session, "--arm", "measuring7", "--lengths", lengths)

    @CASES.right("a bar 0.02 % longer than stated", unsaid="longer than drawn")
    def warm_bar() -> str: ...

    @CASES.mistake("repeats of a pose counted as poses")
    def noise_of_one_reading() -> bool:
        return 0.93 <= coverage <= 0.97
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from benchmarks.commands import command_output
from benchmarks.rows import RowResult, Target
from truearm.errors import InputError, TruearmError

Run = Callable[[], str | bool]


@dataclass(frozen=True)
class Case:
    """What a person does, and by what its answer is judged.

    Attributes
    ----------
    what : str
    run : callable
        Returns what the person sees, or whether a number is as it should be.
    pattern : str
        A regular expression that the answer to a mistake holds, and that to a right session does not.
    is_mistake : bool
    """

    what: str
    run: Run
    pattern: str
    is_mistake: bool

    def outcome(self) -> tuple[bool, str]:
        """Whether it was answered as it should be, and what was said, in one line."""
        try:
            said, is_refused = self.run(), False
        except TruearmError as error:
            said, is_refused = str(error), True
        if isinstance(said, bool):
            return said, ""
        said = " ".join(said.split())  # lines of a terminal are wrapped anywhere
        holds = bool(self.pattern and re.search(self.pattern, said))
        return holds if self.is_mistake else not (is_refused or holds), said


class Cases(list[Case]):
    """The cases of a benchmark, which the modules of its folder declare."""

    def mistake(self, what: str, *, said: str = "") -> Callable[[Run], Run]:
        """Declare a function as a mistake that a person makes."""
        return self._declare(what, said, is_mistake=True)

    def right(self, what: str, *, unsaid: str = "") -> Callable[[Run], Run]:
        """Declare a function as something right, which shall not be questioned."""
        return self._declare(what, unsaid, is_mistake=False)

    def _declare(self, what: str, pattern: str, *, is_mistake: bool) -> Callable[[Run], Run]:
        def declare(run: Run) -> Run:
            self.append(Case(what, run, pattern, is_mistake))
            return run

        return declare

    def load(self, package: str) -> list[Case]:
        """Import the modules of a package, which declare their cases."""
        for file in sorted((Path(__file__).parent / package).glob("[a-z]*.py")):
            import_module(f"benchmarks.{package}.{file.stem}")
        names = [case.what for case in self]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"two cases have one name: {', '.join(twice)}")
        return self

    def judged(self, package: str, *, is_mistake: bool, what: str, only: str, every: bool) -> RowResult:
        """Run the cases whose names have `only` in them; the table has those that failed, or `every` one."""
        table, failed, n = [], 0, 0
        for case in self.load(package):
            if case.is_mistake != is_mistake or only not in case.what:
                continue
            begun = time.perf_counter()
            is_held, said = case.outcome()
            n, failed = n + 1, failed + (not is_held)
            if every or not is_held:
                seconds = time.perf_counter() - begun
                table.append({
                    "case": case.what, "": "held" if is_held else "FAILED", "s": seconds, "said": said[-400:]
                })  # fmt: skip
        if not n:
            raise ValueError(f"no case has {only!r} in its name")
        return RowResult(table, [Target(f"of {n} {what}", failed, 0)])


def seen(*arguments: object, code: int = 0) -> str:
    """What a command prints; a refusal if it ends with another exit code."""
    ended, said = command_output(*arguments)
    if ended != code:
        raise InputError(said)
    return said
