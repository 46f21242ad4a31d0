"""Large sessions: fit, predict and evaluate part by part, against reading alone; workers; bytes that are sent.

Readings are those of a moving UR10: a smooth path, points with autocorrelated noise. CPU seconds count all threads and
processes; a size is a process of its own, so that its peak memory is its own.
"""

from __future__ import annotations

import importlib
import os
import pickle  # of what is sent to workers, to count it; nothing is read from a file
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np

import truearm as ta
from benchmarks.cost import exponent
from benchmarks.rows import RowResult, Rows, Target, own_process, peak_bytes, scratch
from truearm.identification.from_sums import Iterate
from truearm.readings import Session
from truearm.readings.columns import session_columns
from truearm.readings.files import table_writer
from truearm.readings.large_sessions import LargeSession, sums_of_part
from truearm.solve.executors import Executor, Processes, Serial
from truearm.verbs.fit_sums import sent_model, sums_of_readings

ROWS = Rows()
fit_module = importlib.import_module("truearm.verbs.fit")  # ta.fit is the function
# Readings that are made, and written as a row group, at once.
CHUNK = 2**17
# Correlation of a reading's noise, and of its pose, with those of the one before.
NOISE_CORRELATION, PATH_CORRELATION = 0.95, 0.999
FORMS = ("csv", "parquet")


def cpu_seconds() -> float:
    """Of this process and of those it has waited for."""
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def made_session(n: int, form: str) -> str:
    """A folder with one file of n readings, made once; and beside it a model of the arm that moved."""
    from scipy.signal import lfilter

    folder = scratch() / f"{form}-{n}"
    if folder.exists():
        return str(folder)
    folder.mkdir()
    truth = ta.fit("ur10", ta.simulate("ur10", poses=400, seed=1).session, model="kinematic").model
    truth.save(scratch() / "arm.truearm")
    rng, path, noise = np.random.default_rng(1), np.zeros((1, 6)), np.zeros((1, 3))

    def continued(last: np.ndarray, steps: np.ndarray, correlation: float) -> tuple[np.ndarray, np.ndarray]:
        scaled = np.sqrt(1 - correlation**2) * steps
        found = lfilter([1.0], [1.0, -correlation], scaled, axis=0, zi=correlation * last)[0]
        return found, found[-1:]

    with table_writer(folder / f"readings.{form}") as append:
        for start in range(0, n, CHUNK):
            m = min(CHUNK, n - start)
            angles, path = continued(path, rng.normal(size=(m, 6)), PATH_CORRELATION)
            errors, noise = continued(noise, rng.normal(size=(m, 3)), NOISE_CORRELATION)
            session = Session(0.9 * angles)
            points = truth.predict_readings(session) + 0.03 * errors
            append(session_columns(Session(session.angles, points)))
    return str(folder)


@contextmanager
def executor_of(workers: int) -> Iterator[Executor]:
    """So many processes, which end with the block, or this one."""
    if workers == 1:
        yield Serial()
        return
    with closing(Processes(workers)) as executor:
        yield executor


def fitted(kind: str, folder: str, workers: int) -> dict[str, float]:
    """CPU and elapsed seconds of a fit, and the peak memory of its largest process."""
    begun, elapsed = cpu_seconds(), time.perf_counter()
    with executor_of(workers) as executor:
        found = ta.fit("ur10", folder, model=kind, executor=executor)
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    return {
        "readings": found.n_readings,
        "workers": workers,
        "passes": found.all_readings.n_passes,
        "CPU [s]": cpu_seconds() - begun,
        "elapsed [s]": time.perf_counter() - elapsed,
        "peak [MB]": max(peak_bytes(), children) / 1e6,
        "effective": found.all_readings.n_effective or 0.0,
        "held out [mm]": found.held_out_mm[0] if found.held_out_mm else 0.0,
    }


@ROWS.row("fit", quick={"readings": (30_000, 60_000)})
def fits(readings: tuple[int, ...] = (100_000, 1_000_000), kind: str = "kinematic", workers: int = 1) -> RowResult:
    """A fit by sums: seconds, peak memory, and their growth with the readings."""
    table = [own_process(fitted, kind, made_session(n, "parquet"), workers) for n in readings]
    growth = exponent(table, "readings", "CPU [s]")
    largest = table[-1]
    return RowResult(
        table,
        [
            Target("growth with the readings, exponent", growth, 1.02),
            Target(f"{largest['readings']} readings, elapsed [min]", largest["elapsed [s]"] / 60, 15),
            Target(f"{largest['readings']} readings, peak memory [MB]", largest["peak [MB]"], 2000),
        ],
    )


def fitted_in_memory(n: int) -> dict[str, float]:
    """CPU seconds of a physical fit of n readings of a virtual arm in one session, and the peak memory."""
    session = ta.simulate("gao2017", poses=n, seed=1).session
    made, begun = peak_bytes(), cpu_seconds()
    found = ta.fit("gao2017", session, model="physical")
    assert found.n_readings == n
    return {
        "readings": n,
        "CPU [s]": cpu_seconds() - begun,
        "peak [MB]": peak_bytes() / 1e6,
        "of it readings [MB]": made / 1e6,
    }


@ROWS.row("in-memory", threads="one", quick={"readings": (300, 600)})
def in_memory(readings: tuple[int, ...] = (150_000, 1_000_000)) -> RowResult:
    """A physical fit of all readings of a session in memory."""
    table = [own_process(fitted_in_memory, n) for n in readings]
    largest = table[-1]
    return RowResult(
        table,
        [
            Target("growth of a physical fit, exponent", exponent(table, "readings", "CPU [s]"), 1.1),
            Target(f"physical fit of {largest['readings']} readings [CPU s]", largest["CPU [s]"], 200),
            Target(f"physical fit of {largest['readings']} readings, peak memory [MB]", largest["peak [MB]"], 2000),
        ],
    )


@ROWS.row("by-sums", threads="one", quick={"readings": (600,), "at_once": 500})
def by_sums(readings: tuple[int, ...] = (60_000,), at_once: int = 50_000) -> Iterator[dict[str, float | str]]:
    """Fits by sums against those of all readings at once: CPU seconds, points, and their uncertainty."""
    training, test = (ta.simulate("ur10", poses=n, seed=n).session for n in (readings[-1], 2000))
    for kind in ("nominal", "kinematic", "physical"):
        found = {}
        for most in (at_once, readings[-1]):
            with patch.object(fit_module, "MOST_AT_ONCE", most):
                begun = cpu_seconds()
                model = ta.fit("ur10", training, model=kind).model
            covariance = model.fit_.tip_covariance(model.at(test).state)
            found[most] = cpu_seconds() - begun, model.predict_readings(test), np.trace(covariance, 0, 1, 2)
        (by_sums, there, u2), (whole, points, of_whole) = found.values()
        yield {
            "model": kind,
            "at once [CPU s]": whole,
            "by sums [CPU s]": by_sums,
            "points differ by [u]": float(np.sqrt((((there - points) ** 2).sum(axis=1) / of_whole).mean())),
            "u by sums over u": float(np.sqrt(u2 / of_whole).mean()),
        }


def read_and_used(folder: str, workers: int) -> dict[str, float]:
    """CPU seconds of reading alone, as checked sessions and by pandas, and of predict and evaluate."""
    import pandas

    model = ta.load_model(scratch() / "arm.truearm")
    out = Path(folder).with_suffix(".out.parquet")
    file = next(Path(folder).iterdir())
    seconds: dict[str, float] = {"readings": 0, "workers": workers}

    def of_all(verb: Callable[..., object], *options: object) -> object:
        with executor_of(workers) as executor:
            return verb(model, folder, *options, executor=executor)

    works: dict[str, Callable[[], object]] = {
        "pandas [s]": lambda: (pandas.read_csv if file.suffix == ".csv" else pandas.read_parquet)(file),
        "read [s]": lambda: sum(len(one) for part in LargeSession.open(folder).parts for one in part.sessions()),
        "predict [s]": lambda: of_all(ta.predict, out),
        "evaluate [s]": lambda: of_all(ta.evaluate),
    }
    for name, work in works.items():
        begun = cpu_seconds()
        found = work()
        seconds[name] = cpu_seconds() - begun
        if name == "read [s]":
            seconds["readings"] = float(found)
    return seconds | {"peak [MB]": peak_bytes() / 1e6}


@ROWS.row("read", quick={"readings": (20_000,)})
def reading(readings: tuple[int, ...] = (1_000_000,), workers: int = 1) -> RowResult:
    """Predict and evaluate against reading the file alone, CSV and Parquet."""
    table, targets = [], []
    for form in FORMS:
        for n in readings:
            one = own_process(read_and_used, made_session(n, form), workers)
            table.append({"form": form, **one})
            for verb in ("predict", "evaluate"):
                ratio = one[f"{verb} [s]"] / one["read [s]"]
                targets.append(Target(f"{verb}, {n} rows of {form}, by the time of reading them", ratio, 2.0))
    return RowResult(table, targets)


@ROWS.row("workers", quick={"readings": (60_000,)})
def shared(readings: tuple[int, ...] = (1_000_000,)) -> RowResult:
    """A kinematic fit by two processes against one: elapsed time. Two idle cores are needed."""
    folder = made_session(readings[-1], "parquet")
    one, two = (own_process(fitted, "kinematic", folder, workers) for workers in (1, 2))
    ratio = one["elapsed [s]"] / two["elapsed [s]"]
    return RowResult(
        [one, two], [Target("two processes, times as fast", ratio, 1.8, "above")], [f"load {os.getloadavg()[0]:.1f}"]
    )


@ROWS.row("sent", quick={"readings": (20_000,)})
def sent(readings: tuple[int, ...] = (100_000,)) -> RowResult:
    """Bytes of a task and of its sums, by the readings of a part, which are those of a row group."""
    folder = made_session(readings[-1], "parquet")
    part = LargeSession.open(folder).parts[0]
    model = ta.load_model(scratch() / "arm.truearm")
    at = Iterate(model.fit_.coefficients, model.fit_.references[0].noise_std ** 2)
    light, of_session = sent_model(model, model.fit_), {"limits": "skip", "accept": None, "n_session": part.n_readings}
    task = partial(sums_of_readings, model=light, at=at, without_part=at.x, gross_limit=10.0, **of_session)
    sums = sums_of_part((task, part))
    table = [
        {
            "readings of a part": part.n_readings,
            "coefficients": len(at.x),
            "task [kB]": len(pickle.dumps((task, part))) / 1e3,
            "sums [kB]": len(pickle.dumps(sums)) / 1e3,
            "file [kB]": next(Path(folder).iterdir()).stat().st_size / 1e3 * part.n_readings / readings[-1],
        }
    ]
    return RowResult(table)
