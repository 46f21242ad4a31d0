"""A model as one C99 file, with the covariance of its points and both directions of inverse compensation.

Speed: the harmonics of a joint are computed once, by addition theorems; small rotations by their series.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.compensation.export.source_code import source_of
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.targets.manifest import Manifest, read_manifest
from truearm.errors import InputError, MissingTool
from truearm.files.atomic_write import atomic_file
from truearm.typing import FloatArray

FORMAT = "c"
FLAGS = ("-std=c99", "-O2")
# A compiler needs seconds for a file of 2 MB.
MAX_SECONDS = 300


def write(model: Compensator, manifest: Manifest, path: str | Path) -> None:
    """Write a model as one C99 file, which needs nothing but libm.

    Parameters
    ----------
    model : Compensator
        Fitted: a nominal, kinematic or physical model.
    manifest : Manifest
        Goes into the first comment; its check poses are in the function ``truearm_check``.
    path : path
        Written whole or not at all.

    Raises
    ------
    InputError
        If the model is a network, or has terms of a basis of its user's own.
    """
    text = source_of(model, manifest, "model.c.j2", "{}")
    with atomic_file(path) as beside:
        beside.write_text(text, encoding="ascii")


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """Tips of an exported file, compiled with the system's C compiler.

    This runs the file's code: check only files that you would compile.

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
        If there is no C compiler.
    InputError
        If the file does not compile, was not exported by truearm, or refuses joints.
    """
    joints = np.ascontiguousarray(joints, dtype=float)
    n_joints = len(read_manifest(path).provenance.joint_names)
    if joints.ndim != 2 or joints.shape[1] != n_joints:
        raise InputError(f"expected joints of shape (n, {n_joints}), got {joints.shape}", file=path)
    out = np.full((len(joints), 3), np.nan)
    with tempfile.TemporaryDirectory() as folder:
        library = ctypes.CDLL(str(compile_library(path, folder)))
        if not hasattr(library, "truearm_predict"):
            raise InputError("the file has no function truearm_predict", file=path)
        for row, q in enumerate(joints):
            code = library.truearm_predict(_pointer(q), None, _pointer(out[row]), None)
            if code < 0:
                raise InputError(f"the file refuses the joints with code {code}", file=path, row=f"pose {row + 1}")
    return out


def compile_library(path: str | Path, folder: str | Path, *flags: str) -> Path:
    """Compile a C file to a shared library in a folder.

    Raises
    ------
    MissingTool
        If there is no C compiler.
    InputError
        If the file does not compile.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise MissingTool("a C file is checked with a C compiler, and none is installed", hint="apt install gcc")
    library = Path(folder) / "model.so"
    command = [compiler, *FLAGS, *flags, "-shared", "-fPIC", "-o", str(library), str(Path(path).resolve()), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=MAX_SECONDS, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        raise InputError(f"the C compiler did not finish the file in {MAX_SECONDS} s", file=path) from None
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200])
        raise InputError(f"the C compiler refuses the file: {first}", file=path)
    return library


def _pointer(array: FloatArray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
