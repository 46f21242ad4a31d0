"""
What truearm refuses
====================

Mistakes of units, arms and files are refused in Python with the same words as on the command line. A message says what
happened, where, and what to do.
"""

import matplotlib.pyplot as plt
import numpy as np

import truearm as ta

arm = ta.load_arm("ur10")
session = ta.simulate(arm, poses=60, seed=2).session


def refused(function, *arguments):
    """Print the message of a refusal."""
    try:
        function(*arguments)
    except ta.InputError as error:
        print(error)


# %%
# Degrees given as radians:

refused(ta.fit, arm, ta.Session(np.rad2deg(session.angles), session.points))

# %%
# Metres given as millimetres:

refused(ta.fit, arm, ta.Session(session.angles, session.points / 1000))

# %%
# Readings of another arm:

refused(ta.fit, "gen3lite", ta.Session(session.angles, session.points))

# %%
# A temperature in kelvin:

frame = session.to_frame()
frame["temperature_degC"] = 294.5
refused(ta.Session.from_frame, frame)

# %%
# Why it can tell: an arm has a reach. Points in metres lie within millimetres of its base, points in inches within
# a few hands; those of a longer arm lie where it cannot be.

units = {"millimetres": 1.0, "metres": 1e-3, "inches": 1 / 25.4}
for row, factor in enumerate(units.values()):
    plt.plot(np.linalg.norm(session.points * factor, axis=1), np.full(len(session), row), "|", ms=18)
plt.axvline(arm.chain.reach, color="black", lw=1)
plt.text(arm.chain.reach, 2.45, "reach of the arm", ha="right", va="top")
plt.yticks(range(len(units)), list(units))
plt.xscale("log")
plt.ylim(-0.5, 2.5)
plt.xlabel("distance of the points from the base, as numbers of mm")
