"""Virtual arms: nominal arms with drawn errors, whose true tip positions are known."""

from truearm.wings.planning.virtual.arm import Measurement, VirtualArm
from truearm.wings.planning.virtual.presets import PRESETS, Preset, load_preset, magnitudes

__all__ = ["PRESETS", "Measurement", "Preset", "VirtualArm", "load_preset", "magnitudes"]
