"""Mistakes that people make, how many are believed; right sessions near them, how many are questioned.

A module of this folder holds cases of one kind; what a case is: `benchmarks.cases`. Those of certificates are a
benchmark of their own, `benchmarks.certificates`.
"""

from __future__ import annotations

from benchmarks.cases import Cases
from benchmarks.cases import seen as seen
from benchmarks.rows import RowResult, Rows

ROWS = Rows()
CASES = Cases()
mistake, right = CASES.mistake, CASES.right


@ROWS.row("believed", "mistakes that pass without the word they need", quick={"only": "keyboard"})
def believed(only: str = "", every: bool = False) -> RowResult:
    """Do what people do wrong. `only`: a part of the names; `every`: also those that are not believed."""
    return CASES.judged("mistakes", is_mistake=True, what="mistakes believed", only=only, every=every)


@ROWS.row("questioned", "right sessions that are refused or doubted", quick={"only": "as they were measured"})
def questioned(only: str = "", every: bool = False) -> RowResult:
    """Do what is right, near the edge. `only`: a part of the names; `every`: also those that are not questioned."""
    return CASES.judged("mistakes", is_mistake=False, what="right sessions questioned", only=only, every=every)
