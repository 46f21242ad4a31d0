"""The readings of a session in space, coloured by error, with a plot against each joint and the arm at a reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from truearm.identification.references.tips import tip_names
from truearm.models import Compensator
from truearm.models.identified_model import to_identified
from truearm.pages.drawings.arm_scene import arm_mechanism, joint_columns
from truearm.pages.plotting import Figure
from truearm.pages.scene import Mechanism, PointCloud, PointColumn, Scene
from truearm.readings import Session
from truearm.typing import FloatArray


def arm_at_readings(models: Mapping[str, Compensator], readings: Session) -> Mechanism | None:
    """The arm that the first identified model found, which goes to the reading that a reader points at.

    None without such a model, for coupled joints, whose readings are not their angles, and for readings of several
    sessions or tips, which have frames of their own.
    """
    several = len(tip_names(readings)) > 1 or (readings.session is not None and len(set(readings.session)) > 1)
    found = [one for one in map(to_identified, models.values()) if one is not None]
    if several or not found or found[0].arm.chain.coupling is not None:
        return None
    arm = replace(found[0].arm, chain=found[0].fit_.chain)
    return arm_mechanism(arm, start=readings.angles[0], follows=[*range(arm.n_joints)], from_origin=False)


def readings_scene(
    points: FloatArray,
    errors: Mapping[str, FloatArray],
    angles: FloatArray,
    *,
    what: str,
    names: Sequence[str],
    joint_names: Sequence[str],
    sliding: Sequence[bool],
    still: Figure,
    shown: str,
    std_mm: FloatArray | None = None,
    mechanism: Mechanism | None = None,
    lines: Sequence[FloatArray] = (),
    marked: Mapping[int, str] | None = None,
) -> Scene:
    """The readings as an interactive scene.

    Parameters
    ----------
    points : (n, 3) array
        Where they are drawn [mm].
    errors : mapping of str to (n,) array
        Of each model [mm], not negative; a single model needs no name (empty).
    angles : (n, n_joints) array
        [rad], or [mm] for sliding joints.
    what : str
        What the errors are: "error" or "distance from the seat's mean point".
    names : sequence of str
        Of the readings.
    joint_names, sliding
        Of the joints.
    still : Figure
        The figure on paper.
    shown : str
        The model whose errors colour the readings at first.
    std_mm : (n,) array, optional
        Standard uncertainty of a coordinate of the model that is shown.
    mechanism : Mechanism, optional
        From `arm_at_readings`.
    lines : sequence of (m, 3) arrays
        Lines between the readings, such as bars [mm].
    marked : mapping of int to str, optional
        Labels of readings that have a ring.
    """
    cloud = PointCloud(
        points,
        names,
        [PointColumn(_of(what, name), "mm", values) for name, values in errors.items()],
        joint_columns(angles, sliding, joint_names),
        [] if std_mm is None else [PointColumn(_of("u of a coordinate", shown), "mm", std_mm)],
        noun="reading",
        shown=list(errors).index(shown),
        marked={} if marked is None else marked,
    )
    label = f"{len(points)} readings in space, coloured by {what}; the arm goes to the reading that is pointed at"
    label = label if mechanism else label.partition(";")[0]
    return Scene(label, "mm", still, cloud=cloud, mechanism=mechanism, lines=lines)


def _of(what: str, model: str) -> str:
    return f"{what}, {model}" if model else what
