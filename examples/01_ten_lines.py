"""
Ten lines: simulate, split, fit, evaluate, plot
===============================================

The whole chain on a virtual arm, whose errors are known. With your own readings, ``ta.read_session("readings.csv")``
takes the place of the simulation.
"""

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

arm = ta.load_arm("gao2017")
session = ta.simulate(arm, poses=300, strategy="measuring", seed=1).session
train, test = session.split(by="row", hold_out=0.3, seed=1)
fit = ta.fit(arm, train)
fit

# %%
# The test is on readings that the model has not seen:

evaluation = ta.evaluate(fit.model, test)
print(evaluation)

# %%
# Errors of the test readings, before and after:

nominal_mm = np.linalg.norm(fit.model.predict_nominal_readings(test) - test.points, axis=1)
model_mm = np.linalg.norm(fit.model.predict_readings(test) - test.points, axis=1)
bins = np.geomspace(1e-3, 2, 50)
plt.hist(
    [nominal_mm, model_mm],
    bins,
    label=["nominal arm", f"{fit.model.__class__.__name__}"],
    histtype="stepfilled",
    alpha=0.7,
)
plt.xscale("log")
plt.xlabel("error [mm]")
plt.ylabel("readings")
plt.legend()
plt.show()
