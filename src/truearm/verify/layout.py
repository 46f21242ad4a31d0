"""Where artefacts stand in the measuring volume, and where they are touched from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from truearm.verify.artefacts import Artefacts
from truearm.verify.orthogonal import FloatArray
from truearm.verify.test_plan import Plan


@dataclass(frozen=True, eq=False)
class Placement:
    """One group of points to take: in one go, on one thing that stands in one place.

    Attributes
    ----------
    test : str
        Of the plan: ``probing``, ``uni``, ..
    artefact : str
        Its name in the file of artefacts.
    keys : dict of str to str
        What tells the group from the others of its test, by column of the points file.
    points : (k, 3) array
        Nominal points of contact: on the ball's surface, or the middle of the seat [mm], in the arm's base frame.
    normals : (k, 3) array
        Unit vectors from which the probe comes to them: outward.
    at : (3,) array
        The middle of the artefact, or of this end of it [mm].
    """

    test: str
    artefact: str
    keys: Mapping[str, str]
    points: FloatArray
    normals: FloatArray
    at: FloatArray


def layout_of(
    plan: Plan, artefacts: Artefacts, measuring_range_mm: float, *, shoulder_mm: float | None = None
) -> tuple[Placement, ...]:
    """Lay out the tests that a plan requires, in the order in which an operator measures them."""
    raise NotImplementedError
