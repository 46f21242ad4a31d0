"""
The network of the founding paper, inside and outside its box
=============================================================

A network learns coordinates from angles, without kinematics. It needs thousands of readings and is valid only in the
range it was trained on; the kinematic model is valid outside as well.
"""

import truearm as ta

arm = ta.load_arm("gao2017")
train = ta.simulate(arm, poses=2500, strategy="box", seed=1).session
inside = ta.simulate(arm, poses=200, strategy="box", seed=2).session
outside = ta.simulate(arm, poses=200, strategy="measuring", seed=3).session

network = ta.NetworkModel(arm, hidden=(20, 20), trainer="varpro", epochs=60, seed=0).fit(train.angles, train.points)
kinematic = ta.KinematicModel(arm).fit(train.angles, train.points)

for name, model in (("network", network), ("kinematic", kinematic)):
    for where, session in (("inside the box", inside), ("everyday work", outside)):
        mean_mm = ta.evaluate(model, session).errors["model"]["mean_mm"]
        print(f"{name:10s} {where:15s} {mean_mm:10.4f} mm")
