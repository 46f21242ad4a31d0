"""Sampling strategies for poses: each is a function of an arm, a number of poses and a seed."""

from collections.abc import Callable, Mapping
from functools import partial

from truearm.wings.planning.designs.planned_readings import HALF_WIDTH_RAD, Poses, box, uniform
from truearm.wings.planning.designs.sampling.measuring import measuring_poses, seat
from truearm.wings.planning.designs.sampling.workspace import Sector

STRATEGIES: Mapping[str, Callable[..., Poses]] = {
    "box": box,
    "uniform": uniform,
    "sobol-box": partial(box, sobol=True),
    "sobol": partial(uniform, sobol=True),
    "measuring": measuring_poses,
    "seat": seat,
}
"""Strategies by the names of the command line: ``STRATEGIES[name](arm, n, seed=seed)``."""

__all__ = ["HALF_WIDTH_RAD", "STRATEGIES", "Poses", "Sector", "box", "measuring_poses", "seat", "uniform"]
