"""
Corrected joint targets
=======================

What to send to a robot so that it goes where its program says, and what its encoders mean.
"""

import tempfile
from pathlib import Path

import numpy as np

import truearm as ta

simulated = ta.simulate("ur10", poses=200, preset="research", seed=1)
model = ta.fit("ur10", simulated.session, model="physical").model

# A program: joints as the nominal arm has them.
low, high = model.angle_ranges_.T
planned = low + (high - low) * np.random.default_rng(0).uniform(0.1, 0.9, (20, 6))
corrected = ta.correct(model, planned)
print(corrected)

# %%
# The virtual arm tells the truth: where its tip goes without and with the correction.

wanted = model.predict_nominal(planned)
good = ~corrected.refused
for what, joints in (("as planned", planned), ("corrected", corrected.joints)):
    distance = np.linalg.norm(simulated.virtual.true_tip(joints[good]) - wanted[good], axis=1)
    print(f"{what}: {distance.mean():.4f} mm from the target")

# %%
# Feedback is the way back: the encoders read the joints that were sent, and mean those that were planned.

meant = ta.correct(model, corrected.joints[good], direction="feedback")
print(np.abs(meant.joints - planned[good]).max(), "rad")

# %%
# A target that cannot be corrected is refused with its reason, the others are not affected.

planned[3, 0] += 3.0
print(ta.correct(model, planned).to_frame()[["status", "residual_mm", "u_mm"]].head())

# %%
# `save` writes the table, or the literals of a robot language; both say their direction and carry check poses.

file = Path(tempfile.mkdtemp()) / "corrected.script"
corrected.save(file, language="urscript")
print(file.read_text(encoding="utf-8").splitlines()[-2])
