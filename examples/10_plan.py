"""
Which readings to take
======================

A plan chooses the poses that determine the arm best, and says how well the arm will be known before anything is
measured.
"""

import truearm as ta

plan = ta.plan("measuring7", "bar", poses=20, length_mm=500, terms="constants", seed=1)

# %%
# The plan is a session to fill in (``plan.save("plan.csv")``): seats, positions, and the joint angles near which to
# take each reading. The curve says when to stop: more poses than these would tell little more.

plan
