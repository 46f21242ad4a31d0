"""Threads: ours over samples, one of the BLAS's for each."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep the BLAS to one thread while the block runs.

    Its idle threads wait by spinning: they take a core from ours between products, and on a busy machine a product
    waits for all of them. Training 6-30-30-3 on two cores, an epoch then takes 1.5 to 3 times as long.
    Fitting 11911 readings with threads of the BLAS' own took 2.9 s in some runs on a shared machine, 0.7 s in others.
    """
    context: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return context


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries at hand; looking for them takes milliseconds."""
    return ThreadpoolController()
