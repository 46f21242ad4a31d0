"""OPC UA for Robotics: our client against a server in process, with the nodes that OPC 40010-1 names."""

import asyncio
import socket
import threading
from contextlib import contextmanager

import numpy as np
import pytest
from devices import samples_of, tcp_device

from refusals import refuses
from truearm.wings.bench.sources import connections, opcua, open_source

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed")

DEG, RAD, MM, INCH = 17476, 4405297, 5066068, 4804168  # UNECE codes DD, C81, MMT, INH as numbers
ARM = {"Axis_10": (1.5, RAD), "Axis_1": (90.0, DEG), "Axis_2": (250.0, MM)}


async def _add_device(devices, index, name, axes):
    device = await devices.add_object(index, name)
    folder = await device.add_object(index, "Axes")
    variables = []
    for axis, (value, unit) in axes.items():
        parameters = await (await folder.add_object(index, axis)).add_object(index, "ParameterSet")
        position = await parameters.add_variable(index, "ActualPosition", value)
        stated = asyncua.ua.EUInformation(UnitId=unit) if isinstance(unit, int) else unit
        await position.add_property(index, "EngineeringUnits", stated)
        variables.append(position)
    return variables


@contextmanager
def server(**devices):
    """A server with motion devices; its port, and what writes a value into the first axis of the first device."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    loop, ready = asyncio.new_event_loop(), threading.Event()
    ends = asyncio.Event()
    first = []

    async def serve():
        one = asyncua.Server()
        await one.init()
        one.set_endpoint(f"opc.tcp://127.0.0.1:{port}/")
        one.set_security_policy([asyncua.ua.SecurityPolicyType.NoSecurity])
        index = await one.register_namespace("http://opcfoundation.org/UA/Robotics/")
        system = await (await one.nodes.objects.add_object(index, "DeviceSet")).add_object(index, "System")
        folder = await system.add_object(index, "MotionDevices")
        for name, axes in devices.items():
            first.extend(await _add_device(folder, index, name, axes))
        async with one:
            ready.set()
            await ends.wait()

    def write(value):
        asyncio.run_coroutine_threadsafe(first[0].write_value(value), loop).result(30)

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    assert ready.wait(60)
    try:
        yield port, write
    finally:
        loop.call_soon_threadsafe(ends.set)
        thread.join()
        loop.close()


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(connections, "RETRY_S", 0.01)


@pytest.fixture(scope="module")
def arm():
    """A server with one device, which takes seconds to start."""
    with server(Arm=ARM) as (port, write):
        yield f"opcua:127.0.0.1:{port}", write


def notice_of(source, text, most=6):
    stream = source.samples()
    said = [next(stream).text for _ in range(most)]
    assert any(text in one for one in said), said


def test_the_axes_in_order_and_by_their_units(arm):
    address, write = arm
    write(1.5)
    samples, notices = samples_of(open_source(address), 3)
    write(float("nan"))
    notice_of(open_source(address), "positions that are no numbers")
    for sample in samples:
        assert sample.joint_angles_rad == pytest.approx([np.pi / 2, 250.0, 1.5])
    assert notices == [f"connected to {address.replace('opcua:', 'opc.tcp://')}"]


def test_a_position_that_the_server_calls_stale_is_no_sample(arm):
    address, write = arm
    last = asyncua.ua.StatusCode(asyncua.ua.StatusCodes.UncertainLastUsableValue)
    write(asyncua.ua.DataValue(asyncua.ua.Variant(90.0), last))
    notice_of(open_source(address), "a position is not good: UncertainLastUsableValue")


def test_of_several_devices_one_is_named_and_its_units_are_asked():
    with server(Left=ARM, Right={"A1": (1.0, INCH)}, Text={"A1": (1.0, "deg")}) as (port, _):
        notice_of(
            open_source(f"opcua:127.0.0.1:{port}"), "expected one motion device, the server has Left, Right, Text"
        )
        samples, _ = samples_of(open_source(f"opcua:127.0.0.1:{port}@Left"), 1)
        notice_of(open_source(f"opcua:127.0.0.1:{port}@Right"), "axis A1 has an unknown unit, 4804168")
        notice_of(open_source(f"opcua:127.0.0.1:{port}@Text"), "no connection to opc.tcp://", most=1)
    assert len(samples[0].joint_angles_rad) == 3


def test_a_server_that_ends_is_said():
    with server(Arm=ARM) as (port, _):
        stream = open_source(f"opcua:127.0.0.1:{port}").samples()
        assert "connected" in next(stream).text
        assert len(next(stream).joint_angles_rad) == 3
    for one in stream:
        if getattr(one, "text", "").startswith("no connection to"):
            break


@pytest.mark.parametrize(
    "garbage", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"ACKF\x1c\0\0\0" + b"\xff" * 20, b"ERRF\x08\0\0\0"]
)
def test_what_is_no_opc_ua_is_said(garbage, monkeypatch):
    monkeypatch.setattr(opcua, "CONNECT_S", 0.5)
    with tcp_device(lambda connection: connection.sendall(garbage)) as port:
        notice_of(open_source(f"opcua:127.0.0.1:{port}"), "no connection to opc.tcp://", most=1)


@pytest.mark.parametrize("address", ["host:port", "host:65536", "host:4840 x", "http://host", "ho st"])
def test_what_is_no_server_is_refused(address):
    refuses("expected an OPC UA server", open_source, f"opcua:{address}")
