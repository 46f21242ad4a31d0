"""
Without an instrument: seats and a bar
======================================

A ball on the stylus, some cone seats and a bar of certified length identify an arm. Readings in one seat say that the
tip was at one point; the bar gives the scale.
"""

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

arm = ta.load_arm("measuring7")
options = {"strategy": "seat", "reference": False, "seats": 3, "bars": 4, "bar_mm": 500.0}
taken = ta.simulate(arm, poses=165, **options)
taken.lengths.to_frame()

# %%
# Ten readings of the session; no reference point, but the name of a seat:

taken.session.to_frame().head(10).round(2)

# %%
fit = ta.fit(arm, taken.session, lengths=taken.lengths, model="physical")
print(fit)

# %%
# On another day, in seats elsewhere. The bar tests the scale:

other = ta.simulate(arm, poses=77, seed=1, **options)
print(ta.evaluate(fit.model, other.session, lengths=other.lengths))

# %%
# The virtual arm tells the truth, which no seat knows: the points of the other day, before and after.

truth = other.virtual.true_tip(other.session.angles)


def distances(points):
    """From the true points, once they lie as well on them as a turn and a shift can bring them [mm]."""
    centred, wanted = points - points.mean(axis=0), truth - truth.mean(axis=0)
    U, _, Vt = np.linalg.svd(centred.T @ wanted)
    return np.linalg.norm(centred @ U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt - wanted, axis=1)


before, after = arm.forward(other.session.angles).tip_in_base, fit.model.predict_readings(other.session)
plt.hist([distances(before), distances(after)], np.geomspace(3e-3, 3, 40), label=["nominal arm", "identified arm"])
plt.xscale("log")
plt.xlabel("distance from the true point [mm]")
plt.ylabel("readings")
plt.legend()
