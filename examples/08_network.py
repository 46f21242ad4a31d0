"""
The network of the founding paper, inside and outside its box
=============================================================

A network learns coordinates from angles, without kinematics. It needs thousands of readings and is valid only in the
range it was trained on; the kinematic model is valid outside as well.
"""

import matplotlib.pyplot as plt

import truearm as ta

arm = ta.load_arm("gao2017")
train = ta.simulate(arm, poses=2500, strategy="box", seed=1).session
inside = ta.simulate(arm, poses=200, strategy="box", seed=2).session
outside = ta.simulate(arm, poses=200, strategy="measuring", seed=3).session

network = ta.NetworkModel(arm, hidden=(20, 20), trainer="varpro", epochs=60, seed=0).fit(train.angles, train.points)
kinematic = ta.KinematicModel(arm).fit(train.angles, train.points)

errors = {}
for name, model in (("network", network), ("kinematic", kinematic)):
    for where, session in (("inside the box", inside), ("everyday work", outside)):
        found = errors[f"{name},\n{where}"] = ta.evaluate(model, session).errors["model"]
        print(f"{name:10s} {where:15s} {found['mean_mm']:10.4f} mm")

# %%
# Mean and maximum. Outside its box the network is no longer a measuring instrument:

means, largest = ([one[key] for one in errors.values()] for key in ("mean_mm", "max_mm"))
plt.barh(list(errors), largest, color="#d7dce2", label="maximum")
plt.barh(list(errors), means, color=["C1", "C1", "C0", "C0"], label="mean")
plt.gca().invert_yaxis()
plt.xscale("log")
plt.xlabel("error [mm]")
