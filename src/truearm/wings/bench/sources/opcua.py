"""OPC UA: actual positions of the axes of a motion device, by the companion specification Robotics; read only.

Source: OPC 40010-1 v1.02, OPC UA for Robotics, 7.3: MotionDevices / device / Axes / axis / ParameterSet /
ActualPosition, an AnalogUnitType whose EngineeringUnits are codes of UNECE Recommendation 20 (OPC 10000-8, 5.6.3).
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from math import isfinite, pi
from typing import Any, TypeVar

import numpy as np

from truearm.errors import InputError
from truearm.wings.bench.sources.connections import CONNECT_S, connected, extra_package
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS
from truearm.wings.bench.sources.sample import Sample, Source, Stream

_Answer = TypeVar("_Answer")

PORT = 4840
RATE_HZ = 25.0
BROWSE_S, MOST_BROWSED = 30.0, 1000  # to find them: time, and nodes
LARGEST = 1e6  # of a position [rad, or mm]

# By the number of a unit: what takes a position to rad, or mm. A code is the number whose bytes are its letters.
_FACTORS = {
    int.from_bytes(code.encode(), "big"): factor
    for code, factor in {"DD": pi / 180, "C81": 1.0, "MMT": 1.0, "MTR": 1000.0}.items()
}


def opcua(address: str, device: str = "") -> Source:
    """Samples of a motion device of an OPC UA server.

    Parameters
    ----------
    address : str
        ``HOST``, ``HOST:PORT`` or ``HOST:PORT/PATH``; a session without a user.
    device : str
        Name of the device, where the server has several.

    Raises
    ------
    InputError
        If it is no such text, or the package asyncua is missing.
    """
    found = re.fullmatch(r"([\w.-]+|\[[\da-fA-F:]+\])(:\d{1,5})?(/[^\s@]*)?", address)
    if found is None or int((found[2] or "")[1:] or PORT) > 65535:
        raise InputError(f"expected an OPC UA server, got {address!r:.80}", hint="opcua:HOST:PORT")
    url = f"opc.tcp://{found[1]}{found[2] or f':{PORT}'}{found[3] or ''}"
    extra_package("asyncua", "opcua", "an OPC UA server")
    logging.getLogger("asyncua").addHandler(logging.NullHandler())  # what is lost is said as a notice
    name = f"opcua:{address}" + (f"@{device}" if device else "")
    return Source(name, partial(connected, partial(_Device, url, device), url, _samples))


class _Device:
    """A motion device of a server; OSError where the connection is lost.

    Its loop runs in a thread of its own, while something is asked for: that of who asks may run another.
    """

    def __init__(self, url: str, device: str) -> None:
        asyncua = extra_package("asyncua", "opcua", "an OPC UA server")
        self._runner, self._client = asyncio.Runner(), asyncua.Client(url, timeout=CONNECT_S)
        self._value = asyncua.ua.AttributeIds.Value
        self._thread = ThreadPoolExecutor(1, "truearm opcua")
        try:
            with self._failing():
                self._run(self._client.connect())
                self._positions, self._factors = self._run(asyncio.wait_for(self._axes(device), BROWSE_S))
        except OSError:
            self.close()
            raise

    @contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except ConnectionError:
            raise
        except Exception as error:  # whatever the library makes of what a server sends
            raise ConnectionError(f"{type(error).__name__}: {error}"[:200]) from None

    async def _axes(self, device: str) -> tuple[list[Any], list[float]]:
        """The variables of the axes, in the order of their names, and what takes them to rad, or mm."""
        devices = await self._motion_devices()
        names = ", ".join(devices)
        if (device and device not in devices) or (not device and len(devices) != 1):
            wanted = f"device {device!r:.60}" if device else "one motion device"
            raise ConnectionError(f"expected {wanted}, the server has {names or 'none':.200}")
        axes = await _children(await _child(devices[device or names], "Axes"))
        if not 0 < len(axes) <= MOST_JOINTS:
            raise ConnectionError(f"the device has {len(axes)} axes")
        positions, factors = [], []
        for name in sorted(axes, key=_natural):
            position = await _child(await _child(axes[name], "ParameterSet"), "ActualPosition")
            unit = await (await _child(position, "EngineeringUnits")).read_value()
            if unit.UnitId not in _FACTORS:
                raise ConnectionError(f"axis {name} has an unknown unit, {unit.UnitId}")
            positions.append(position)
            factors.append(_FACTORS[unit.UnitId])
        return positions, factors

    async def _motion_devices(self) -> dict[str, Any]:
        """Motion devices by their names, of all systems of the server."""
        found: dict[str, Any] = {}
        waiting = [await _child(self._client.nodes.objects, "DeviceSet")]
        for _ in range(MOST_BROWSED):
            if not waiting:
                break
            children = await _children(waiting.pop(0))
            if "MotionDevices" in children:
                found |= await _children(children["MotionDevices"])
            else:
                waiting += children.values()
        return found

    def position(self, due_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(n_axes,) positions at a time, all in one answer [rad, or mm]."""

        async def ask() -> list[Any]:
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            found = await self._client.read_attributes(self._positions, self._value)
            for one in found:
                if not one.StatusCode.is_good():  # the last value of a controller that has stopped
                    raise ConnectionError(f"the server says that a position is not good: {one.StatusCode.name}")
            return [None if one.Value is None else one.Value.Value for one in found]

        with self._failing():
            values = self._run(ask())
        if not all(isinstance(one, int | float) and isfinite(one) for one in values):
            raise ConnectionError("the server gives positions that are no numbers")
        positions = np.array(values, dtype=float) * self._factors
        if (np.abs(positions) > LARGEST).any():
            raise ConnectionError("the server gives numbers that are no positions")
        return positions

    def close(self) -> None:
        """Leave the server."""
        with self._thread:
            with suppress(Exception):
                self._run(asyncio.wait_for(self._client.disconnect(), CONNECT_S))
            self._thread.submit(self._runner.close)

    def _run(self, asked: Coroutine[Any, Any, _Answer]) -> _Answer:
        return self._thread.submit(self._runner.run, asked).result()


async def _children(node: Any) -> dict[str, Any]:
    """Objects and variables of a node by their names."""
    return {(await child.read_browse_name()).Name: child for child in await node.get_children()}


async def _child(node: Any, name: str) -> Any:
    children = await _children(node)
    if name not in children:
        raise ConnectionError(f"the server has no {name} where OPC 40010-1 puts it")
    return children[name]


def _natural(name: str) -> list[tuple[int, str]]:
    """What sorts Axis_2 before Axis_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _samples(device: _Device) -> Stream:
    due_s = time.monotonic()
    while True:
        positions = device.position(due_s)
        yield Sample(time.monotonic(), positions)
        due_s = max(due_s + 1 / RATE_HZ, time.monotonic() - 1 / RATE_HZ)
