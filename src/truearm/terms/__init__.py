"""Basis functions of an arm's state: what shapes the small motions that make a real arm differ from its drawing.

Functions of arrays only. The virtual arm draws errors from them, identification fits them.
"""

from truearm.terms.gravity import GravityLoads, LinkMasses, gravity_loads, gravity_torques, uniform_links
from truearm.terms.joint import harmonics
from truearm.terms.thermal import REFERENCE_TEMPERATURE_DEGC, growth_motions, link_vectors

__all__ = [
    "REFERENCE_TEMPERATURE_DEGC",
    "GravityLoads",
    "LinkMasses",
    "gravity_loads",
    "gravity_torques",
    "growth_motions",
    "harmonics",
    "link_vectors",
    "uniform_links",
]
