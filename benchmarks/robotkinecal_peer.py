"""The peer's side of `robotkinecal_task.py`: runs in a Python with robotkinecal, prints its answer as JSON."""

import json
import re
import sys
import time
from contextlib import redirect_stdout
from importlib.metadata import version
from io import StringIO

import numpy as np
import roboticstoolbox as rtb
from robotkinecal import SerialRobotKineCal
from spatialmath import SE3


def main() -> None:
    """Identify the screws and the flange, predict the test poses."""
    np.random.seed(0)  # noqa: NPY002 - the bases of its parameters are drawn by the global generator
    task = np.load(sys.argv[1])
    peer = SerialRobotKineCal(rtb.models.Panda(), "panda_link8")
    seen = list(task["points"])
    if task["full"]:
        seen = [SE3.Rt(R, point, check=False) for R, point in zip(task["R"], task["points"], strict=True)]
    peer.set_observations(list(task["angles"]), seen)
    said = StringIO()
    begun, begun_cpu = time.perf_counter(), time.process_time()
    with redirect_stdout(said):
        result = peer.solve()
    seconds, cpu_seconds = time.perf_counter() - begun, time.process_time() - begun_cpu
    told = re.search(r"rank of regressor is (\d+)/(\d+)", said.getvalue())
    answer = {
        "version": version("robotkinecal"),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "iterations": result.nb_iterations_executed,
        "rank": int(told[1]) if told else peer.N_PARAMS,
        "of": peer.N_PARAMS,
        "test_points": [peer.forward_kinematics(8, q).t.tolist() for q in task["test"]],
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
