"""Terms: the small motions that make a real arm differ from its drawing, and the functions that shape them.

The virtual arm draws errors from the functions, identification fits the terms' coefficients. Single causes of errors
are in `truearm.terms.catalogue`.
"""

from truearm.arm.masses import LinkMasses
from truearm.terms.basis import (
    Basis,
    Column,
    Constant,
    Direction,
    GravityTorque,
    Harmonics,
    Session,
    Temperature,
    basis_from_data,
    register_basis,
)
from truearm.terms.catalogue import (
    FREE_BASE,
    FREE_TIP,
    SkippedTerm,
    base_terms,
    candidate_terms,
    constants,
    place_name,
)
from truearm.terms.gravity import GravityLoads, gravity_loads, gravity_torques, uniform_links
from truearm.terms.joint import directions, harmonics
from truearm.terms.state import ArmState
from truearm.terms.term import Term
from truearm.terms.thermal import growth_motions, link_vectors

__all__ = [
    "FREE_BASE",
    "FREE_TIP",
    "ArmState",
    "Basis",
    "Column",
    "Constant",
    "Direction",
    "GravityLoads",
    "GravityTorque",
    "Harmonics",
    "SkippedTerm",
    "LinkMasses",
    "Session",
    "Temperature",
    "Term",
    "base_terms",
    "basis_from_data",
    "candidate_terms",
    "constants",
    "directions",
    "gravity_loads",
    "gravity_torques",
    "growth_motions",
    "harmonics",
    "link_vectors",
    "place_name",
    "register_basis",
    "uniform_links",
]
