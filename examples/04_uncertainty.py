"""
How far to trust a point
========================

A predicted point comes with its covariance: what the training readings leave undetermined, and what the model leaves
unexplained. Readings outside the trained range are flagged, and the uncertainty of the physical model grows there.
"""

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

arm = ta.load_arm("gao2017")
session = ta.simulate(arm, poses=400, strategy="uniform", seed=1).session
near = session.angles[:, 0] < 0  # train with joint 1 on one side only
model = ta.fit(arm, session.rows(np.flatnonzero(near)), model="physical").model

other = ta.simulate(arm, poses=400, strategy="uniform", seed=2).session

# %%
# The record of a prediction flags what is outside the trained range:

prediction = ta.predict(model, other)
print(prediction)
prediction.to_frame()[["x_mm", "sx_mm", "outside_training"]].head()

# %%
# Errors of new readings, and what was stated for each:

points, covariance = model.predict(other.angles, return_cov=True)
u_mm = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
error_mm = np.linalg.norm(points - other.points, axis=1)

plt.scatter(np.rad2deg(other.angles[:, 0]), error_mm, s=8, label="error of a point")
order = np.argsort(other.angles[:, 0])
plt.plot(np.rad2deg(other.angles[order, 0]), u_mm[order], "k.", ms=3, label="stated standard uncertainty")
plt.axvspan(0, np.rad2deg(other.angles[:, 0].max()), alpha=0.1)
plt.xlabel("joint 1 [deg]; no training readings in the shaded part")
plt.ylabel("mm")
plt.legend()
