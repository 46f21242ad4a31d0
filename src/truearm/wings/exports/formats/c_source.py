"""A model as one C99 file, with the covariance of its points and both directions of inverse compensation.

Speed: the harmonics of a joint are computed once, by addition theorems; small rotations by their series.
"""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.models import Compensator
from truearm.typing import FloatArray
from truearm.wings.exports.formats.source_code import Language, joints_of_file, run_tool, write_source
from truearm.wings.exports.targets.manifest import Manifest

FORMAT = "c"
FLAGS = ("-std=c99", "-O2")
C99 = Language("model.c.j2", "{}", "in->q[{}]", "")


def write(model: Compensator, manifest: Manifest, path: str | Path) -> None:
    """Write a model as one C99 file, which needs nothing but libm; see `write_source`."""
    write_source(model, manifest, path, C99)


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
    joints = joints_of_file(path, joints)
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
    """Compile a C file to a shared library in a folder; errors as of `run_tool`."""
    library = Path(folder) / "model.so"
    arguments = [*FLAGS, *flags, "-shared", "-fPIC", "-o", str(library), str(Path(path).resolve()), "-lm"]
    run_tool("cc", "the C compiler", "gcc", arguments, path)
    return library


def _pointer(array: FloatArray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
