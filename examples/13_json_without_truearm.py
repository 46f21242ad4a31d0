"""
A model for other programs: JSON
================================

The whole model as one JSON document: arm, chain, terms with their coefficients and uncertainties, training conditions.
`json_reader.py`, at the end of this page, is a reader that needs NumPy only: copy it into your program.
"""

import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
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
# Every coefficient comes with its standard uncertainty. The best determined rotations:

found = [
    (1e3 * size, 1e3 * u, term["name"].partition(" by ")[0])
    for term in document["identified"]["terms"]
    if any(term["direction"][:3])
    for size, u in zip(term["coefficients"][:1], term["standard_uncertainties"][:1], strict=True)
]
values, u, names = zip(*sorted(found, key=lambda one: -abs(one[0]) / one[1])[:8], strict=True)
plt.errorbar(values, names, xerr=2 * np.array(u), fmt="o", capsize=3)
plt.gca().invert_yaxis()
plt.axvline(0, color="black", lw=0.8)
plt.xlabel("coefficient, with twice its standard uncertainty [mrad]")

# %%
# The reader:
#
# .. literalinclude:: ../../examples/json_reader.py
#    :lines: 9-
