"""Virtual arms: nominal arms with drawn errors, whose truth is known."""

from truearm.virtual.arm import Measurement, VirtualArm
from truearm.virtual.presets import PRESETS, Preset, load_preset, magnitudes
from truearm.virtual.state import VirtualArmState

__all__ = ["PRESETS", "Measurement", "Preset", "VirtualArmState", "VirtualArm", "load_preset", "magnitudes"]
