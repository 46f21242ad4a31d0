"""The words that parameters of the verbs and options of the commands take, each list once.

Those of a wing are in the `__init__` of its room. The file imports nothing: the commands list these words in their
help, which comes without NumPy and its like.
"""

from typing import Literal

ModelKind = Literal["nominal", "kinematic", "physical", "network", "hybrid"]
ModelName = Literal["auto", ModelKind]
Trainer = Literal["varpro", "trainlm", "trainbr", "traingd", "traingdx"]
Limits = Literal["skip", "ignore"]  # of readings beyond a joint limit
Conditions = Literal["reproducibility", "repeatability"]  # of an uncertainty (JCGM 200:2012, 2.24 and 2.20)

Convention = Literal["dh", "mdh"]
