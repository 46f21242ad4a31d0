"""``truearm measure``: a length or a shape from joint angles, with its uncertainty."""

from __future__ import annotations

from typing import Any

from truearm.verbs import options
from truearm.verbs.console import print_record, progress


@options.of_verb("truearm.wings.laboratory.verbs.measure:measure")
def measure(
    verb: Any, model: options.ModelFile, session: options.SessionFile, as_json: options.Json = False, **given: Any
) -> None:
    """Measure a length, sphere, plane, circle, cylinder or cone.

    It is fitted to the compensated points of the readings. Each name in the column seat is a feature of its own, of
    lengths an end; without names all readings are of one feature. Of each two spheres or circles the distance of their
    centres is measured too, of planes, cylinders and cones distance and angle. The uncertainty is that of the arm, by
    the simulation of `truearm task` at the measured poses, together with the scatter of the points.
    """
    with progress(f"measuring a {given['feature']}", total=given["n_arms"]) as tell:
        result = verb(model, session, **given, progress=tell)
    print_record(result, as_json=as_json)
