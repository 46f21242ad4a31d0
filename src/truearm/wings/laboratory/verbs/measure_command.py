"""``truearm measure``: a length or a shape from joint angles, with its uncertainty."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from truearm.verbs.console import print_record, progress
from truearm.verbs.options import AcceptOption, Json, ModelFile, Seed, SessionFile
from truearm.wings.laboratory import MeasuredKind
from truearm.wings.laboratory.verbs.task_command import DrawnArms, millimetres


def measure(
    model: ModelFile,
    session: SessionFile,
    feature: Annotated[MeasuredKind, Option(help="What the points lie on.")] = "sphere",
    tip: Annotated[
        float,
        Option(
            "--tip-diameter",
            parser=millimetres,
            help="Diameter of the stylus tip [mm], which enlarges a sphere and narrows a circle or cylinder (bore).",
        ),
    ] = 0.0,
    repeatability: Annotated[
        float | None,
        Option(
            parser=millimetres,
            help="Measured standard deviation of a coordinate when a point is measured again in the same pose [mm]. "
            "Without it the uncertainty of means is overestimated.",
        ),
    ] = None,
    arms: DrawnArms = 1000,
    seed: Seed = 0,
    accept: AcceptOption = None,
    as_json: Json = False,
) -> None:
    """Measure a length, sphere, plane, circle, cylinder or cone.

    It is fitted to the compensated points of the readings. Each name in the column seat is a feature of its own, of
    lengths an end; without names all readings are of one feature. Of each two spheres or circles the distance of their
    centres is measured too, of planes, cylinders and cones distance and angle. The uncertainty is that of the arm, by
    the simulation of `truearm task` at the measured poses, together with the scatter of the points.
    """
    from truearm.wings.laboratory.verbs.measure import measure as measured

    with progress(f"measuring a {feature}", total=arms) as tell:
        result = measured(
            model,
            session,
            feature,
            tip_diameter_mm=tip,
            repeatability_mm=repeatability,
            n_arms=arms,
            seed=seed,
            accept=accept,
            progress=tell,
        )
    print_record(result, as_json=as_json)
