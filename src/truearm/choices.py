"""The words that parameters of the verbs and options of the commands take, each list once.

The file imports nothing: the commands list these words in their help, which comes without NumPy and its like.
"""

from typing import Literal

ModelKind = Literal["nominal", "kinematic", "physical", "network", "hybrid"]
ModelName = Literal["auto", ModelKind]
Trainer = Literal["varpro", "trainlm", "trainbr", "traingd", "traingdx"]
Limits = Literal["skip", "ignore"]  # of readings beyond a joint limit
Conditions = Literal["reproducibility", "repeatability"]  # of an uncertainty (JCGM 200:2012, 2.24 and 2.20)

TakeOn = Literal["still", "key"]  # when a reading of a connected arm is taken

ArtefactKind = Literal["seat", "bar", "tracker"]
Strategy = Literal["i-optimal", "d-optimal", "technician", "random"]
Terms = Literal["physical", "constants"]

Convention = Literal["dh", "mdh"]
ExportFormat = Literal["urdf", "constants", "deltas", "ur-kinematics", "joint-offsets", "c", "js", "onnx", "json"]
Frame = Literal["reference", "base"]  # of the reference instrument, or the arm's own base

RobotLanguage = Literal["urscript", "rapid", "krl", "fanuc"]
FanucJ3 = Literal["coupled", "independent"]  # J3 counted from the horizontal, so that it moves with J2, or from link 2
TargetDirection = Literal["command", "feedback"]
Untrained = Literal["refuse", "accept"]

DecisionRule = Literal["iso14253-1:2017", "iso14253-1:2013", "simple"]
TemplateKind = Literal["artefacts", "mpe"]
FeatureKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone", "angle", "distance"]
MeasuredKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone"]
ZoneKind = Literal["plane", "circle", "sphere", "cylinder"]

FigureFormat = Literal["svg", "pdf", "png"]
