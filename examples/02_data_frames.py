"""
DataFrames in and out
=====================

Columns carry their units in their names, as in a session file. Units are never guessed.
"""

import numpy as np
import pandas as pd

import truearm as ta

rng = np.random.default_rng(0)
frame = pd.DataFrame(rng.uniform(-60, 60, (5, 6)), columns=[f"q{i}_deg" for i in range(1, 7)])
frame["temperature_degC"] = 21.5
session = ta.Session.from_frame(frame)
session

# %%
# Inside, angles are in rad and lengths in mm:

session.angles.round(3)

# %%
# A column without a unit is refused, with what to do:

try:
    ta.Session.from_frame(frame.rename(columns={"q1_deg": "q1"}))
except ta.InputError as error:
    print(error)

# %%
# Results go out as DataFrames too, with a standard uncertainty for every coordinate:

arm = ta.load_arm("gao2017")
readings = ta.simulate(arm, poses=60, seed=3).session
model = ta.KinematicModel(arm).fit(readings.angles, readings.points)
results = ta.predict(model, session).to_frame()
results.round(4)

# %%
# pandas draws them. Each pose has its own uncertainty:

axes = results.plot.bar(y=["sx_mm", "sy_mm", "sz_mm"], rot=0)
axes.set(xlabel="reading", ylabel="standard uncertainty [mm]")
