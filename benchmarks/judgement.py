"""What is refused, what is said and what is fitted: honest but poor readings, and readings that are contradicted.

Rows of sets without a mistake: none may be refused, the error must be near that with the truth stated, and 93 to 97 %
of the true tips must lie in the stated 95 % ellipsoids. Rows of sets with a mistake: none may be accepted in silence.
"""

from __future__ import annotations

from benchmarks.rows import Rows

ROWS = Rows()

# Noise, zeros, lengths of links, plastic: unusual, not contradicted ---------------------------------------------------

# What moved during the session, and models that would learn its clock -------------------------------------------------

# Repeats of a pose, rounded angles ------------------------------------------------------------------------------------

# Few readings, several tips and sessions: never worse than the drawing ------------------------------------------------

# Other temperatures, outside the trained range ------------------------------------------------------------------------

# All of them together -------------------------------------------------------------------------------------------------
