"""Terms: the small motions by which a real arm differs from its nominal model, and their basis functions.

Virtual arms draw the coefficients of terms from their priors; identification estimates them. The catalogue
(`truearm.identification.terms.catalogue`) has the terms of the known causes.
"""

from truearm.arm.arm import LinkMasses
from truearm.identification.terms.basis import (
    Basis,
    Column,
    Constant,
    Direction,
    Formula,
    GravityTorque,
    Harmonics,
    InSession,
    OfTip,
    PayloadTorque,
    Temperature,
    basis_from_data,
    check_parts,
    directions,
    harmonics,
    register_basis,
)
from truearm.identification.terms.catalogue import (
    FREE_BASE,
    FREE_TIP,
    HIGHEST_ORDER_OFFERED,
    base_terms,
    candidate_terms,
    constants,
    place_name,
)
from truearm.identification.terms.expression import HIGHEST_ORDER, Expression
from truearm.identification.terms.kernel import InducedProcess
from truearm.identification.terms.links import (
    GravityLoads,
    gravity_loads,
    gravity_torques,
    growth_motions,
    link_vectors,
    uniform_links,
)
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import SkippedTerm, Term

__all__ = [
    "FREE_BASE",
    "FREE_TIP",
    "HIGHEST_ORDER",
    "HIGHEST_ORDER_OFFERED",
    "ArmState",
    "Basis",
    "Column",
    "Constant",
    "Direction",
    "Expression",
    "Formula",
    "GravityLoads",
    "GravityTorque",
    "Harmonics",
    "InSession",
    "InducedProcess",
    "LinkMasses",
    "OfTip",
    "PayloadTorque",
    "SkippedTerm",
    "Temperature",
    "Term",
    "base_terms",
    "basis_from_data",
    "candidate_terms",
    "check_parts",
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
