"""A model as an ES module for browsers and Node.js: the functions of the C file in the same order."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.file_reading import read_limited
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.formats.source_code import Language, joints_of_file, run_tool, write_source
from truearm.wings.exports.targets.manifest import MAX_BYTES, Manifest

FORMAT = "js"
ES2015 = Language("model.mjs.j2", "[]", "inputs.q[{}]", "Math.")
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
    """Write a model as an ES module, which imports nothing; see `write_source`."""
    write_source(model, manifest, path, ES2015)


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
    joints = joints_of_file(path, joints)
    results = run_module(path, "predictPoint", [[row] for row in joints.tolist()])
    for number, result in enumerate(results, 1):
        if isinstance(result, dict):
            raise InputError(f"the module refuses the joints ({result['error']})", file=path, row=f"pose {number}")
    return np.array(results, dtype=float).reshape(-1, 3)


def run_module(path: str | Path, call: str, rows: list[list[Any]]) -> list[Any]:
    """Results of a function of a module, a call for each row of arguments; ``{"error": ...}`` where it throws.

    Errors are those of `run_tool`.
    """
    source = read_limited(path, limit_bytes=MAX_BYTES).decode(errors="replace")
    job = json.dumps({"source": source, "call": call, "rows": rows})
    printed = run_tool("node", "Node.js", "nodejs", ["--input-type=module", "--eval", _RUNNER], path, job)
    try:
        results: list[Any] = json.loads(printed)
    except ValueError:
        raise InputError(
            "the module prints something of its own, so that its answer is unreadable", file=path
        ) from None
    return results
