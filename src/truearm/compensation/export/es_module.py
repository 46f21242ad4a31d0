"""A model as an ES module for browsers and Node.js: the functions of the C file in the same order."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.compensation.export.source_code import source_of
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.targets.manifest import MAX_BYTES, Manifest, read_manifest
from truearm.errors import InputError, MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.typing import FloatArray

FORMAT = "js"
MAX_SECONDS = 300
# The module as a data URL: its file's name need not end in .mjs.
_RUNNER = """
import { readFileSync } from "node:fs";
const { source, call, rows } = JSON.parse(readFileSync(0, "utf8"));
const arm = await import("data:text/javascript;base64," + Buffer.from(source).toString("base64"));
function result(row) {
  try {
    return arm[call](...row);
  } catch (error) {
    return { error: String(error) };
  }
}
process.stdout.write(JSON.stringify(rows.map(result)));
"""


def write(model: Compensator, manifest: Manifest, path: str | Path) -> None:
    """Write a model as an ES module, which imports nothing.

    Parameters
    ----------
    model : Compensator
        Fitted: a nominal, kinematic or physical model.
    manifest : Manifest
        Goes into the first comment; its check poses are in the function ``check``.
    path : path
        Written whole or not at all.

    Raises
    ------
    InputError
        If the model is a network, or has terms of a basis of its user's own.
    """
    text = source_of(model, manifest, "model.mjs.j2", "[]")
    with atomic_file(path) as beside:
        beside.write_text(text, encoding="ascii")


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """Tips of an exported module, evaluated by Node.js.

    This runs the file's code: check only files that you would run.

    Parameters
    ----------
    path : path
    joints : (n, n_joints) array
        [rad, or mm].

    Returns
    -------
    (n, 3) array
        [mm].

    Raises
    ------
    MissingTool
        If Node.js is not installed.
    InputError
        If the module does not run, was not exported by truearm, or refuses joints.
    """
    joints = np.asarray(joints, dtype=float)
    n_joints = len(read_manifest(path).provenance.joint_names)
    if joints.ndim != 2 or joints.shape[1] != n_joints:
        raise InputError(f"expected joints of shape (n, {n_joints}), got {joints.shape}", file=path)
    results = run_module(path, "predictPoint", [[row] for row in joints.tolist()])
    for number, result in enumerate(results, 1):
        if isinstance(result, dict):
            raise InputError(f"the module refuses the joints ({result['error']})", file=path, row=f"pose {number}")
    return np.array(results, dtype=float).reshape(-1, 3)


def run_module(path: str | Path, call: str, rows: list[list[Any]]) -> list[Any]:
    """Results of a function of a module, a call for each row of arguments; ``{"error": ...}`` where it throws.

    Raises
    ------
    MissingTool
        If Node.js is not installed.
    InputError
        If the module does not run.
    """
    node = shutil.which("node")
    if node is None:
        raise MissingTool("an ES module is checked with Node.js, which is not installed", hint="apt install nodejs")
    source = read_limited(path, limit_bytes=MAX_BYTES).decode(errors="replace")
    job = json.dumps({"source": source, "call": call, "rows": rows})
    command = [node, "--input-type=module", "--eval", _RUNNER]
    try:
        done = subprocess.run(  # noqa: S603
            command, input=job, capture_output=True, text=True, timeout=MAX_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"the module did not finish in {MAX_SECONDS} s", file=path) from None
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "Error" in line), done.stderr[:200])
        raise InputError(f"Node.js cannot run the module: {first}", file=path)
    try:
        results: list[Any] = json.loads(done.stdout)
    except ValueError:
        raise InputError(
            "the module prints something of its own, so that its answer is unreadable", file=path
        ) from None
    return results
