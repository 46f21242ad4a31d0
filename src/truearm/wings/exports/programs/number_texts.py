"""Numbers in the text of a program: six between commas, and new ones, written as their neighbours are."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cache
from math import ceil, log10
from zlib import crc32

from truearm.wings.exports.programs.numbers import Number
from truearm.wings.exports.programs.program import Language, Target

# The unit of the last digit is at most this share of the largest change: rounding is half of that.
_DIGIT = 0.05
# A larger change is another set of the same angles, as near B = 90 deg: its last digit is that of a change of so much.
_ANOTHER_SET, _USUAL = 1.0, 0.02
# Of metres and rad: lengths that cancel between parallel axes are some kilometres.
_LARGEST = 1e6
_LONG = 16  # bytes of a number of so many decimals
_ENOUGH = 4  # of six joints: once in 1e11 targets by chance
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SIX = re.compile(rf"\s*({NUMBER})\s*" + rf",\s*({NUMBER})\s*" * 5)
_MAY_BE_LARGE = re.compile(r"(?<![\d.])\d{7}|[eE]")
_JOINT = re.compile(r"(?:.*\.)?[jaA]\d")


def six_numbers(text: str, start: int) -> list[Number] | None:
    """Six numbers between commas, in a text that begins at a place; None of anything else, or of a number too large."""
    parts = _SIX.fullmatch(text)
    if parts is None:
        return None
    found = [Number(start + parts.start(i), start + parts.end(i), parts[i].encode("ascii")) for i in range(1, 7)]
    return found if not _MAY_BE_LARGE.search(text) or all(abs(one.value) < _LARGEST for one in found) else None


def new_numbers(language: Language, target: Target, values: Mapping[str, float]) -> dict[str, bytes]:
    """Texts of the numbers of a target that change.

    Numbers of one kind (position, orientation, joints) have the most decimals that one of them has in the program, and
    more where the change would be lost in the last digit, if the language takes them.
    """
    found = {}
    for names in _by_kind(tuple(values)):
        before = [target.numbers[name] for name in names]
        old, new = [number.value for number in before], [values[name] for name in names]
        decimals = max(map(_decimals, before))
        change = max(abs(one - other) for one, other in zip(old, new, strict=True))
        if change > 0:
            change = _USUAL if change > _ANOTHER_SET and _kind_of(names[0]) == "orientation" else change
            decimals = max(decimals, min(ceil(-log10(_DIGIT * change)), language.decimals))
        for name, number, was, value in zip(names, before, old, new, strict=True):
            text = language.number_text(number, value, decimals)
            if float(text) != was:
                found[name] = text
    return found


def with_check_digits(texts: Mapping[str, bytes], direction: str) -> dict[str, bytes]:
    """Texts of new numbers, in which the last three of 15 decimals of joints [rad] say that they are corrected."""
    found = dict(texts)
    for name, text in texts.items():
        if _JOINT.fullmatch(name):
            kept = f"{float(text):.12f}"
            found[name] = f"{kept}{_check(kept, direction)}".encode("ascii")
    return found


def direction_of_check_digits(targets: Iterable[Target]) -> str | None:
    """The direction in which the joints of a target were corrected; None where no check digits say so."""
    for target in targets:
        joints = [one for name, one in target.numbers.items() if len(one.text) >= _LONG and _JOINT.fullmatch(name)]
        texts = [f"{one.value:.15f}" for one in joints]
        for direction in ("command", "feedback"):
            if sum(text[-3:] == _check(text[:-3], direction) for text in texts) >= _ENOUGH:
                return direction
    return None


def _check(text: str, direction: str) -> str:
    """Three digits, never 000: those of typed numbers."""
    return f"{crc32(f'{direction} {text}'.encode()) % 999 + 1:03d}"


@cache
def _by_kind(names: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Names of numbers by position, orientation and joints."""
    groups: defaultdict[str, list[str]] = defaultdict(list)
    for name in names:
        groups[_kind_of(name)].append(name)
    return tuple(map(tuple, groups.values()))


def _kind_of(name: str) -> str:
    if name.rpartition(".")[2] in ("x", "y", "z", "X", "Y", "Z"):
        return name.rpartition(".")[0] + "position"
    return "joints" if _JOINT.fullmatch(name) else "orientation"


def _decimals(number: Number) -> int:
    """Digits after the point; those of a power of ten do not count."""
    return 0 if b"e" in number.text.lower() else len(number.text.rstrip().partition(b".")[2])
