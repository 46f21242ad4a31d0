"""
Ten lines: simulate, split, fit, evaluate
=========================================

The whole chain on a virtual arm, whose errors are known. With your own readings, ``ta.read_session("readings.csv")``
takes the place of the simulation.
"""

import truearm as ta

arm = ta.load_arm("gao2017")
session = ta.simulate(arm, poses=300, strategy="measuring", seed=1).session
train, test = session.split(by="row", hold_out=0.3, seed=1)
fit = ta.fit(arm, train)
fit

# %%
# The test is on readings that the model has not seen. ``print`` gives the text alone; a notebook shows the figure too,
# and ``save_figure("errors.pdf")`` writes it for a text or a talk.

ta.evaluate(fit.model, test)
