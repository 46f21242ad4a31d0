"""
A term of your own
==================

An effect that truearm does not know, from a formula to a C file: say once what it is, and fit, model file and every
export follow.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

# Joint 4 of this UR10 carries a hose over joint 3, which pulls it back: by the square of the angle of joint 3.
arm = ta.load_arm("ur10")
random = np.random.default_rng(1)
angles = arm.working + random.uniform(-1.5, 1.5, (150, 6))
true = angles.copy()
true[:, 3] += 3e-4 * angles[:, 2] ** 2
points = arm.forward(true).tip_in_base + random.normal(0, 0.02, (150, 3))
session = ta.Session(angles, points)

# %%
# A term is a place (joint 4), a direction (rotation about z), a formula, a group and a prior standard deviation:

q3, about_z = ta.Expression.angle(3), (0, 0, 1, 0, 0, 0)
hose = ta.Term("J4 by the hose over J3", 4, about_z, q3**2, group="hose", prior_std=1e-4)

without = ta.fit(arm, session, model="kinematic")
model = ta.fit(arm, session, model="kinematic", terms=[hose]).model
for name, one in (("without", without.model), ("with", model)):
    error = np.linalg.norm(one.predict(session.angles) - session.points, axis=1)
    print(f"{name} the term: {error.mean():.3f} mm")

# %%
# The model file has the formula, and so has the C file, which needs nothing but libm:

folder = Path(tempfile.mkdtemp())
model.save(folder / "ur10.truearm")
print(ta.export(folder / "ur10.truearm", folder / "ur10.c"))
print(*(line.strip() for line in (folder / "ur10.c").read_text(encoding="utf-8").splitlines() if "pow(in->q" in line))

# %%
# The lesson in a figure: the error that the angle of joint 3 explains, and what is left with the term.

for label, one in (("without", without.model), ("with the term", model)):
    error = np.linalg.norm(one.predict(session.angles) - session.points, axis=1)
    plt.plot(np.rad2deg(angles[:, 2]), error, ".", label=label)
plt.xlabel("angle of joint 3 [deg]")
plt.ylabel("error [mm]")
plt.legend()
