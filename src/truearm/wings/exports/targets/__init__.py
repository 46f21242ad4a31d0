"""Corrected joint targets: what to send to a controller so that the arm goes where it should."""

from typing import Literal

Frame = Literal["reference", "base"]  # of the reference instrument, or the arm's own base
RobotLanguage = Literal["urscript", "rapid", "krl", "fanuc"]
FanucJ3 = Literal["coupled", "independent"]  # J3 counted from the horizontal, so that it moves with J2, or from link 2
TargetDirection = Literal["command", "feedback"]
Untrained = Literal["refuse", "accept"]
