"""Literal numbers of a program."""

from __future__ import annotations

from typing import NamedTuple

NOT_THERE = 8.9e9  # 9E9 of RAPID: no such axis


class Number(NamedTuple):
    """A literal number: its bytes in the program, and its value in the unit of the language."""

    start: int
    end: int
    text: bytes

    @property
    def value(self) -> float:
        """What the bytes state."""
        try:
            return float(self.text)
        except ValueError:  # a blank behind its sign
            return float(self.text.translate(None, b" \t"))
