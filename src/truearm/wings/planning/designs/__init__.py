"""Which readings to take next: observability, selection of poses and of places for seats and bars."""

from typing import Literal

ArtefactKind = Literal["seat", "bar", "tracker"]
Strategy = Literal["i-optimal", "d-optimal", "technician", "random"]
Terms = Literal["physical", "constants"]
