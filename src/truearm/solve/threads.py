"""Threads: truearm runs its own over samples, each with one BLAS thread.

The rule: every public function and method that calculates (the verbs of `truearm.verbs`, fit and prediction of a
model, `load_model`) runs in `one_blas_thread`, as a decorator. What it calls does not need to. The setting of the
caller is back when the call returns; of calls in several threads, when the last returns.
"""

from __future__ import annotations

import os
import sys
from contextlib import ContextDecorator
from functools import cache
from threading import RLock, local
from typing import Any

from threadpoolctl import OpenBLASController, ThreadpoolController


class _Blocks:
    """Blocks that run with one thread in some of the BLAS libraries."""

    def __init__(self, *, of_each_thread: bool) -> None:
        self._of_each_thread = of_each_thread
        self._depth = 0
        self._limits: list[Any] = []
        self._seen: tuple[bool, ...] = ()

    def begin(self, loaded: tuple[bool, ...]) -> None:
        if self._depth == 0 or loaded != self._seen:  # a library loaded within a block starts with all threads
            self._seen = loaded
            libraries = _libraries(loaded)[self._of_each_thread]
            if any(library.get_num_threads() != 1 for library in libraries.lib_controllers):
                _let_this_thread_set()
                self._limits.append(libraries.limit(limits=1))
        self._depth += 1

    def end(self) -> None:
        self._depth -= 1
        while self._depth == 0 and self._limits:
            _let_this_thread_set()
            self._limits.pop().restore_original_limits()
            _let_this_thread_set()  # and the caller's threads after it


class _BlocksOfThread(_Blocks, local):
    """The same, counted in each thread."""


class OneBlasThread(ContextDecorator):
    """One BLAS thread until the outermost of nested blocks ends.

    Most libraries have one number of threads for the process. Blocks of several threads may overlap: the last that ends
    restores it. With OpenMP each thread has its own number.
    """

    def __init__(self) -> None:
        self._lock = RLock()
        self._of_process = _Blocks(of_each_thread=False)
        self._of_thread = _BlocksOfThread(of_each_thread=True)

    def __enter__(self) -> None:
        with self._lock:
            loaded = _loaded()
            self._of_process.begin(loaded)
            self._of_thread.begin(loaded)

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._of_thread.end()
            self._of_process.end()


_ONE = OneBlasThread()


def one_blas_thread() -> OneBlasThread:
    """Keep the BLAS to one thread while a block or, as a decorator, a function runs; blocks may be nested.

    Idle BLAS threads spin: they occupy a core between products, and on a busy machine a product waits for all of them.
    An epoch of training 6-30-30-3 on two cores then takes 1.5 to 3 times as long. Planning 50 poses took 67 s with two
    BLAS threads on a shared machine, 4 s with one.
    """
    return _ONE


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _loaded() -> tuple[bool, ...]:
    """Which of the packages with a BLAS of their own are loaded."""
    modules = sys.modules
    return "numpy.linalg" in modules, "scipy.linalg" in modules, "torch" in modules


@cache
def _libraries(loaded: tuple[bool, ...]) -> tuple[ThreadpoolController, ThreadpoolController]:
    """The BLAS libraries of the packages that are loaded: with one number of threads, and with one of each thread.

    The search takes milliseconds.
    """
    del loaded
    found = ThreadpoolController().select(user_api="blas")
    of_thread = [one.filepath for one in found.lib_controllers if getattr(one, "threading_layer", "") == "openmp"]
    of_process = [one.filepath for one in found.lib_controllers if one.filepath not in of_thread]
    return found.select(filepath=of_process), found.select(filepath=of_thread)


def _let_this_thread_set() -> None:
    """From version 3.8 on `threadpoolctl` ignores all threads but the first that set a number."""
    clear = getattr(OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
