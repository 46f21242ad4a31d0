"""Virtual arms: nominal arms with drawn errors, whose truth is known."""

from truearm.identification.virtual.arm import Measurement, VirtualArm
from truearm.identification.virtual.presets import PRESETS, Preset, load_preset, magnitudes
from truearm.identification.virtual.state import VirtualArmState

__all__ = ["PRESETS", "Measurement", "Preset", "VirtualArm", "VirtualArmState", "load_preset", "magnitudes"]
