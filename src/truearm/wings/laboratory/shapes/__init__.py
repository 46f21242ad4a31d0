"""Shapes of a part drawing, fitted to points by orthogonal distances; minimum zones, and relations of two shapes."""

from truearm.wings.laboratory.shapes.least_squares_shapes import (
    Circle,
    Cone,
    Cylinder,
    Line,
    Plane,
    Sphere,
    Torus,
    fit_circle,
    fit_cone,
    fit_cylinder,
    fit_line,
    fit_plane,
    fit_sphere,
    fit_torus,
)
from truearm.wings.laboratory.shapes.minimum_zone import (
    CircumscribedSphere,
    MinimumZone,
    circumscribed_sphere,
    minimum_zone,
)
from truearm.wings.laboratory.shapes.relations import (
    Relation,
    angle,
    concentricity,
    distance,
    parallelism,
    perpendicularity,
)

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
