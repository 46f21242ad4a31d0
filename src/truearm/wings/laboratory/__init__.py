"""Verify: tests of an arm against its specification, and what its errors do to a measured feature."""

from typing import Literal

DecisionRule = Literal["iso14253-1:2017", "iso14253-1:2013", "simple"]
TemplateKind = Literal["artefacts", "mpe"]
FeatureKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone", "angle", "distance"]
MeasuredKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone"]
