"""Tasks for other processes, apart from the tests: what a process imports to run one is most of its start."""

import os
import signal
import time
from pathlib import Path


def square(x: float) -> float:
    return x * x


def killed_once(task: tuple[int, str]) -> int:
    """Ends its process the first time, as the system does that runs out of memory."""
    number, mark = task
    if mark and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def killed_always(number: int) -> int:
    if number == 2:
        time.sleep(0.4)  # as a fit would take; a worker that dies while it starts is another matter
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def slow(number: int) -> int:
    time.sleep(0.2)
    return number


def touched(path: str) -> None:
    """Leaves a trace."""
    Path(path).touch()


def process_of(_: object) -> int:
    return os.getpid()


def begun_before(task: tuple[int, str]) -> int:
    """The first task lasts until the others stop beginning; how many have is in the folder."""
    number, folder = task
    Path(folder, str(number)).touch()
    seen = -1
    for _ in range(0 if number else 120):  # a minute, as a loaded machine may begin nothing else in half a second
        now = len(list(Path(folder).iterdir()))
        if now == seen > 1:
            break
        seen = now
        time.sleep(0.5)
    return number or seen
