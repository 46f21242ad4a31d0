"""
Model files
===========

A model is saved to one file: a JSON header and arrays in a zip, never a pickle. A file is checked before a number of it
is used.
"""

import tempfile
from pathlib import Path

import truearm as ta

arm = ta.load_arm("ur10")
session = ta.simulate(arm, poses=100, seed=1).session
model = ta.KinematicModel(arm).fit(session.angles, session.points)

folder = Path(tempfile.mkdtemp())
model.save(folder / "ur10.truearm")
again = ta.load_model(folder / "ur10.truearm")
print(abs(again.predict(session.angles) - model.predict(session.angles)).max(), "mm")

# %%
# A damaged file is refused:

damaged = folder / "damaged.truearm"
damaged.write_bytes((folder / "ur10.truearm").read_bytes()[:-100])
try:
    ta.load_model(damaged)
except ta.InputError as error:
    print(str(error).replace(str(folder), "..."))

# %%
# The loaded model knows its arm and the readings that it was trained on, so that any session can be tested with it:

ta.evaluate(again, ta.simulate(arm, poses=60, seed=1, strategy="uniform").session)
