"""The peer's side of `pybotics_task.py`: runs in a Python with pybotics, reads the task, prints its answer as JSON."""

import json
import sys
import time
from importlib.metadata import version

import numpy as np
from pybotics.optimization import OptimizationHandler, compute_absolute_errors, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares


def main() -> None:
    """Fit the six joint offsets, test them."""
    task = np.load(sys.argv[1])
    n_train, angles, positions = int(task["n_train"]), task["angles"], task["positions"]
    robot = Robot.from_parameters(task["table"])
    sought = np.zeros(task["table"].shape, dtype=bool)
    sought[:, 2] = True  # theta
    handler = OptimizationHandler(robot, kinematic_chain_mask=sought.ravel())
    start = handler.generate_optimization_vector()
    begun = time.perf_counter()
    result = least_squares(optimize_accuracy, start, args=(handler, angles[:n_train], positions[:n_train]))
    seconds = time.perf_counter() - begun
    handler.apply_optimization_vector(result.x)
    errors = compute_absolute_errors(angles[n_train:], positions[n_train:], handler.robot)
    answer = {
        "version": version("pybotics"),
        "seconds": seconds,
        "evaluations": int(result.nfev),
        "jacobians": int(result.njev),
        "offsets_rad": (result.x - start).tolist(),
        "test_mean_mm": float(errors.mean()),
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
