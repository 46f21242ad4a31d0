"""Judgements that a person overrides with a reason, which stands in all that comes of it.

A judgement says that readings are contradicted: they are of another arm, in another unit, or described wrongly. It
calls `contradict`, which raises; within `accepting` a reason it notes the contradiction, and the calculation goes on.
What cannot be calculated, or is no request, is an `InputError` as ever, and has no override.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from typing import ParamSpec, TypeVar, cast

from truearm.errors import Contradiction, InputError, joined

MAX_TEXT = 300  # of a reason, and of a contradiction in short
MAX_PRINTED = 6  # contradictions
OVERRIDE = "if the readings are right all the same, --accept REASON (accept= in Python) goes on"

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Acceptance:
    """Contradictions that a person accepted.

    Attributes
    ----------
    reason : str
        Why they were accepted, as the person stated it: one line of at most `MAX_TEXT` characters.
    contradictions : tuple of str
        What would have been refused, in short.
    """

    reason: str
    contradictions: tuple[str, ...]

    def __post_init__(self) -> None:
        for text in (self.reason, *self.contradictions):
            if not text.strip() or len(text) > MAX_TEXT or not text.isprintable():
                raise InputError(
                    f"expected a reason of one line with 1 to {MAX_TEXT} characters, got {text[:60]!r}",
                    hint='say why the readings are right: --accept "the drawing follows, the base was rebuilt"',
                )

    def __str__(self) -> str:
        named, others = self.contradictions[:MAX_PRINTED], len(self.contradictions) - MAX_PRINTED
        return f"Accepted ({self.reason}): {'; '.join(named)}{f'; and {others} others' * (others > 0)}."


_current: ContextVar[tuple[str, list[str]] | None] = ContextVar("accepted", default=None)


@contextmanager
def accepting(reason: str | None) -> Iterator[None]:
    """Override judgements while a block runs; the verbs do so by their option `accept`.

    Parameters
    ----------
    reason : str or None
        Why the readings are right all the same: one line of at most 300 characters, which the model keeps. None
        changes nothing.

    Raises
    ------
    InputError
        If the reason is empty, too long, or of several lines.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=20, seed=1).session
    >>> wrong = ta.Session(session.angles, session.points * 25.4)
    >>> with ta.accepting("to see what the fit makes of inches"):
    ...     model = ta.NominalModel(ta.load_arm("ur10")).fit_readings(wrong)
    >>> len(model.accepted_)
    1
    """
    if reason is None:
        yield
        return
    if not isinstance(reason, str):
        raise InputError(f"expected a reason in words, got {reason!r:.60}", hint='accept="why the readings are right"')
    before = _current.set((Acceptance(reason, ()).reason, []))
    try:
        yield
    finally:
        _current.reset(before)


@contextmanager
def accepting_afresh() -> Iterator[None]:
    """Within `accepting`: `accepted` in this block is what it overrides itself, and nothing from before it."""
    current = _current.get()
    if current is None:
        yield
        return
    (reason, earlier), own = current, list[str]()
    before = _current.set((reason, own))
    try:
        yield
    finally:
        _current.reset(before)
        earlier += [one for one in own if one not in earlier]


def overridden() -> tuple[str, ...]:
    """What the running block has accepted until now, in short."""
    current = _current.get()
    return () if current is None else tuple(current[1])


def accept_also(contradictions: Sequence[str]) -> None:
    """Note in the running block what was `overridden` in parts of its work, which other processes may have done."""
    current = _current.get()
    if current is not None:
        current[1][:] = dict.fromkeys((*current[1], *contradictions))


def accepts(verb: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a verb with a keyword `accept`: it runs within `accepting` that reason, and a refusal names the way."""

    @wraps(verb)
    def within(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with accepting(cast("str | None", kwargs.get("accept"))), accepting_afresh():
            try:
                return verb(*args, **kwargs)
            except InputError as error:
                if (named := _with_override(error)) is error:
                    raise
                raise named from None

    return within


def _with_override(error: InputError) -> InputError:
    """The same error, the last contradiction among its faults with the way to accept it, which goes for all of them."""
    faults = list(error.faults)
    found = [number for number, fault in enumerate(faults) if isinstance(fault, Contradiction)]
    if not found or any(OVERRIDE in (fault.hint or "") for fault in faults):
        return error
    last = faults[found[-1]]
    hint = f"{last.hint}; {OVERRIDE}" if last.hint else OVERRIDE
    faults[found[-1]] = last.with_hint(hint)
    return joined(faults) or error


def contradict(error: InputError) -> None:
    """Refuse what is contradicted, or note it where a person accepts it.

    Parameters
    ----------
    error : InputError
        What contradicts the readings, and what to do.

    Raises
    ------
    Contradiction
        The same error, unless `accepting` a reason.
    """
    current = _current.get()
    if current is None:
        raise Contradiction.of(error)
    short = " ".join(error.problem.split())
    short = short if len(short) <= MAX_TEXT else f"{short[: MAX_TEXT - 3]}..."
    if short not in current[1]:
        current[1].append(short)


def accepted(before: Sequence[Acceptance] = ()) -> tuple[Acceptance, ...]:
    """What was accepted `before`, and what the running block has accepted until now; one for each reason."""
    found = {one.reason: one.contradictions for one in before}
    current = _current.get()
    if current is not None and current[1]:
        reason, now = current
        found[reason] = tuple(dict.fromkeys((*found.get(reason, ()), *now)))
    return tuple(Acceptance(reason, contradictions) for reason, contradictions in found.items())


def acceptance_remarks(accept: str | None) -> tuple[str, ...]:
    """What a verb says of its option `accept`: what it overrode, or that there was nothing; without it, nothing."""
    return () if accept is None else tuple(map(str, accepted())) or ("Nothing had to be accepted.",)


def accepted_in_fit(accepted: Sequence[Acceptance], model: str = "the model") -> tuple[str, ...]:
    """What whoever uses a model must know of the contradictions that were `accepted` in its fit, in sentences."""
    return tuple(f"When {model} was fitted: {one}" for one in accepted)
