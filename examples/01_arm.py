"""
An arm from its file
====================

truearm knows some arms by name; your own arm comes from an arm file or a URDF.
"""

import numpy as np

import truearm as ta

arm = ta.load_arm("ur10")
arm

# %%
# Where the drawing says that the tip is, with all joints at zero [mm]:

arm.chain.tip_in_base(np.zeros((1, arm.n_joints)))
