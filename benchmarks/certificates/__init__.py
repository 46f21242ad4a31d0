"""Certificates that state what is not so, how many pass; right campaigns near them, how many are questioned.

A module of this folder holds ways of one kind; what a case is: `benchmarks.cases`. A way passes if the program says no
word of it: it may refuse, or state on the certificate what is so.
"""

from __future__ import annotations

from benchmarks.cases import Cases
from benchmarks.cases import seen as seen
from benchmarks.rows import RowResult, Rows

ROWS = Rows()
CASES = Cases()
mistake, right = CASES.mistake, CASES.right


@ROWS.row("stated", "ways to a certificate that states what is not so, which pass", quick={"only": "in the future"})
def stated(only: str = "", every: bool = False) -> RowResult:
    """Do what makes a false certificate. `only`: a part of the names; `every`: also the ways that do not pass."""
    return CASES.judged("certificates", is_mistake=True, what="ways that pass", only=only, every=every)


@ROWS.row("questioned", "right campaigns that are refused or doubted", quick={"only": "as the plan asks"})
def questioned(only: str = "", every: bool = False) -> RowResult:
    """Do what is right, near the edge. `only`: a part of the names; `every`: also those that are not questioned."""
    return CASES.judged("certificates", is_mistake=False, what="right campaigns questioned", only=only, every=every)
