"""
Which readings to take
======================

A plan chooses the poses that determine the arm best, and says how well the arm will be known before anything is
measured.
"""

import truearm as ta

plan = ta.plan("measuring7", "bar", poses=20, length_mm=500, terms="constants", seed=1)
plan

# %%
# The plan is a session to fill in: seats, positions, and the joint angles near which to take each reading.

print(plan)
