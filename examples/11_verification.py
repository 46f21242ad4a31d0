"""
Would an arm pass the standard's test?
======================================

The tests of ISO 10360-12, carried out by virtual arms of a preset: the share of arms that conforms. The points of a
simulated test can be verified like measured ones.
"""

import truearm as ta

simulated = ta.simulate_verification("shop", n_arms=20, seed=1)
print(simulated)

# %%
# One of these tests, evaluated in full: test values with their uncertainties, limits and the decision.

ta.verify(simulated.points(0), artefacts=simulated.artefacts, specification=simulated.specification)
