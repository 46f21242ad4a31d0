"""
Corrected joint targets
=======================

What to send to a robot so that it goes where its program says, and what its encoders mean.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

simulated = ta.simulate("ur10", poses=200, preset="research", seed=1)
model = ta.fit("ur10", simulated.session, model="physical").model

# A program: joints as the nominal arm has them.
low, high = model.angle_ranges_.T
planned = low + (high - low) * np.random.default_rng(0).uniform(0.1, 0.9, (20, 6))
corrected = ta.correct(model, planned)
print(corrected)

wanted, good = model.predict_nominal(planned), ~corrected.refused

# %%
# Feedback is the way back: the encoders read the joints that were sent, and mean those that were planned.

meant = ta.correct(model, corrected.joints[good], direction="feedback")
print(np.abs(meant.joints - planned[good]).max(), "rad")

# %%
# A target that cannot be corrected is refused with its reason, the others are not affected.

beyond = planned.copy()
beyond[3, 0] += 3.0
print(ta.correct(model, beyond).to_frame()[["status", "residual_mm", "u_mm"]].head())

# %%
# `save` writes the table, or the literals of a robot language; both say their direction and carry check poses.

file = Path(tempfile.mkdtemp()) / "corrected.script"
corrected.save(file, language="urscript")
print(file.read_text(encoding="utf-8").splitlines()[-2])

# %%
# The virtual arm tells the truth: where its tip goes without and with the correction.

numbers = np.flatnonzero(good) + 1
for what, joints in (("as planned", planned), ("corrected", corrected.joints)):
    distance = np.linalg.norm(simulated.virtual.true_tip(joints[good]) - wanted[good], axis=1)
    print(f"{what}: {distance.mean():.4f} mm from the target")
    plt.plot(numbers, distance, "o-", label=what)
plt.yscale("log")
plt.xticks(numbers)
plt.xlabel("target of the program")
plt.ylabel("distance of the tip from its target [mm]")
plt.legend()
