"""Threads: truearm runs its own over samples, each with one BLAS thread."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep the BLAS to one thread while the block runs.

    Idle BLAS threads spin: they occupy a core between products, and on a busy machine a product waits for all of them.
    An epoch of training 6-30-30-3 on two cores then takes 1.5 to 3 times as long. Fitting 11911 readings with several
    BLAS threads took 2.9 s in some runs on a shared machine, 0.7 s in others.
    """
    context: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return context


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _libraries() -> ThreadpoolController:
    """The loaded BLAS libraries; the search takes milliseconds."""
    return ThreadpoolController()
