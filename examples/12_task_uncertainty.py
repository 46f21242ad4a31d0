"""
Is the arm good enough for this tolerance?
==========================================

Virtual arms that could be the one in question measure a feature of a part; their errors give its uncertainty, which is
compared with the tolerance.
"""

import truearm as ta

session = ta.simulate("measuring7", poses=200, strategy="measuring", preset="shop", seed=1).session
model = ta.fit("measuring7", session, model="kinematic").model
print(ta.task(model, "length", 400.0, tolerance_mm=0.1, n_arms=300))

# %%
# The same for a sphere of 25 mm:

ta.task(model, "sphere", 25.0, tolerance_mm=0.1, n_arms=300)
