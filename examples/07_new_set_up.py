"""
A tracker in another place: refit
=================================

The identified arm stays; base and tip are re-identified from 20 readings of the new set-up.
"""

import truearm as ta

arm = ta.load_arm("gao2017")
first = ta.simulate(arm, poses=200, strategy="measuring", seed=1).session
model = ta.fit(arm, first, model="physical").model

# The tracker was moved: the same arm, its points in another frame.
second = ta.simulate(arm, poses=150, strategy="measuring", seed=2).session
moved = ta.Session(second.angles, second.points @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [1500.0, -300.0, 80.0])
print(ta.evaluate(model, moved).summary())

# %%
refit = ta.refit(model, moved, n_readings=20)
print(refit)

# %%
# The model remembers the readings of the refit, and evaluate skips them:

ta.evaluate(refit.model, moved)
