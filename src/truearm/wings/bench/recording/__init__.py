"""Readings of a connected arm: taken, learned as they come, fitted meanwhile."""

from typing import Literal

TakeOn = Literal["still", "key"]  # when a reading of a connected arm is taken
