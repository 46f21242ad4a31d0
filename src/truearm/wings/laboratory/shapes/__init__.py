"""Shapes of a part drawing, fitted to points by orthogonal distances; minimum zones, and relations of two shapes."""

from truearm.wings.laboratory.shapes.circle import Circle, fit_circle
from truearm.wings.laboratory.shapes.cone import Cone, fit_cone
from truearm.wings.laboratory.shapes.cylinder import Cylinder, fit_cylinder
from truearm.wings.laboratory.shapes.line import Line, fit_line
from truearm.wings.laboratory.shapes.minimum_zone import (
    CircumscribedSphere,
    MinimumZone,
    circumscribed_sphere,
    minimum_zone,
)
from truearm.wings.laboratory.shapes.plane import Plane, fit_plane
from truearm.wings.laboratory.shapes.relations import (
    Relation,
    angle,
    concentricity,
    distance,
    parallelism,
    perpendicularity,
)
from truearm.wings.laboratory.shapes.sphere import Sphere, fit_sphere
from truearm.wings.laboratory.shapes.torus import Torus, fit_torus

__all__ = [
    "Circle",
    "CircumscribedSphere",
    "Cone",
    "Cylinder",
    "Line",
    "MinimumZone",
    "Plane",
    "Relation",
    "Sphere",
    "Torus",
    "angle",
    "circumscribed_sphere",
    "concentricity",
    "distance",
    "fit_circle",
    "fit_cone",
    "fit_cylinder",
    "fit_line",
    "fit_plane",
    "fit_sphere",
    "fit_torus",
    "minimum_zone",
    "parallelism",
    "perpendicularity",
]
