"""
What truearm refuses
====================

Mistakes of units, arms and files are refused in Python with the same words as on the command line. A message says what
happened, where, and what to do.
"""

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
