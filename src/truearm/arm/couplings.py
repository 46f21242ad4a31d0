"""Couplings: joints whose angles are sums of several encoders' angles, as a matrix.

A parallelogram holds the next link to the base, a belt or a differential turns two joints with one motor, a Fanuc
shows J3 counted from the horizontal: the angle of a joint is then no single encoder's. ``joint = matrix @ encoder`` in
rad, or mm for sliding joints. The chain and its small motions see the joints; readings and targets are the encoders'.
"""

from __future__ import annotations

import re

import numpy as np

from truearm.errors import InputError
from truearm.typing import FloatArray

_RULE = re.compile(r"J(\d+)(=|\+=|-=)(.+)", re.IGNORECASE)
_SUMMAND = re.compile(r"([+-]?)(?:(\d+(?:\.\d*)?|\.\d+)\*?)?J(\d+)", re.IGNORECASE)
_HINT = "'J3+=J2', or 'J3=J3-0.5*J2; J5=J5+J4': each joint by the encoders J1, J2, ... of the table"


def parse_coupling(text: str, n_joints: int) -> FloatArray:
    """The matrix of a coupling that is written as sums.

    Parameters
    ----------
    text : str
        ``"J3+=J2"``: the table's J3 lacks that of J2, or ``"J3 = J3 - 0.5*J2"``; several with commas or semicolons.
        On the right of each stand the columns of the table, as they were read.
    n_joints : int

    Returns
    -------
    (n_joints, n_joints) array
        Joint angles are ``angles @ matrix.T`` for angles (n, n_joints) as they were read.

    Raises
    ------
    InputError
        If it is no such text, names a joint that the arm lacks, or joints cannot be distinguished.

    Examples
    --------
    >>> parse_coupling("J3 += J2", 3)
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 1., 1.]])
    """
    matrix, done = np.eye(n_joints), set()
    for rule in filter(None, re.split("[,;]", re.sub(r"\s", "", text))):
        found = _RULE.fullmatch(rule)
        summands = [] if found is None else list(_SUMMAND.finditer(found[3]))
        if found is None or "".join(one[0] for one in summands) != found[3]:
            raise InputError(f"expected a coupling of joints, got {rule!r:.60}", hint=_HINT)
        numbers = [int(found[1]), *(int(one[3]) for one in summands)]
        if not all(1 <= number <= n_joints for number in numbers) or numbers[0] in done:
            twice = numbers[0] in done
            problem = f"J{numbers[0]} is coupled twice" if twice else f"the arm has the joints J1 .. J{n_joints}"
            raise InputError(f"{problem}, got {rule!r:.60}", hint=_HINT)
        done.add(numbers[0])
        row = np.zeros(n_joints)
        for (sign, factor), number in zip((one.group(1, 2) for one in summands), numbers[1:], strict=True):
            row[number - 1] += (-1 if sign == "-" else 1) * float(factor or 1)
        change = {"=": row, "+=": np.eye(n_joints)[numbers[0] - 1] + row, "-=": np.eye(n_joints)[numbers[0] - 1] - row}
        matrix[numbers[0] - 1] = change[found[2]]
    if not done or abs(np.linalg.det(matrix)) < 1e-9:
        raise InputError(f"expected a coupling that keeps the joints apart, got {text!r:.60}", hint=_HINT)
    return matrix


def coupling_text(matrix: FloatArray) -> str:
    """A coupling as sums, as `parse_coupling` takes them; of joints that are their own encoder nothing."""
    rules = []
    for i, row in enumerate(matrix):
        if np.array_equal(row, np.eye(len(matrix))[i]):
            continue
        summands = ""
        for j in np.flatnonzero(row):
            sign = "-" if row[j] < 0 else "+"
            factor = "" if abs(row[j]) == 1 else f"{abs(row[j]):.6g}*"
            summands += f" {sign} {factor}J{j + 1}"
        rules.append(f"J{i + 1} = {summands.removeprefix(' + ').strip() or '0'}")
    return "; ".join(rules)
