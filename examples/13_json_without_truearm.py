"""
A model for other programs: JSON
================================

The whole model as one JSON document: arm, chain, terms with their coefficients and uncertainties, training conditions.
`json_reader.py`, beside this example, is a reader that needs NumPy only.
"""

import json
import tempfile
from pathlib import Path

import numpy as np

import json_reader
import truearm as ta

session = ta.simulate("ur10", poses=80, seed=1).session
model = ta.fit("ur10", session, model="physical").model
file = Path(tempfile.mkdtemp()) / "ur10.json"
ta.export(model, file)

# %%
# The reader gives the points of the model, to rounding:

points = json_reader.tips(file, session.angles[:20])
print(f"{np.abs(points - model.predict(session.angles[:20])).max():.0e} mm")

# %%
# The document states what it comes from, and five poses by which a program tests itself:

document = json.loads(file.read_text())
origin = document["truearm-export"]
for pose in origin["check_poses"]:
    print(np.round(pose["joints"], 3), "rad:", np.round(pose["tip_mm"], 3), "mm")

# %%
# The terms with the largest coefficients:

for term in sorted(document["identified"]["terms"], key=lambda term: -max(map(abs, term["coefficients"])))[:5]:
    print(f"{term['name']:40} {term['coefficients'][0]:9.2e} +- {term['standard_uncertainties'][0]:.1e}")
