"""Sources by what people type: ``KIND:ADDRESS``, such as ``rtde:192.168.0.7`` or ``lines:arm.toml@tcp:HOST:PORT``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from truearm.arm import Arm, load_arm
from truearm.errors import InputError
from truearm.wings.bench.sources.datagrams import abb_egm, kuka_rsi
from truearm.wings.bench.sources.dynamixel import dynamixel
from truearm.wings.bench.sources.feetech import feetech
from truearm.wings.bench.sources.line_pattern import text_lines
from truearm.wings.bench.sources.microscribe import microscribe, microscribe_arm
from truearm.wings.bench.sources.mqtt import mqtt
from truearm.wings.bench.sources.opcua import opcua
from truearm.wings.bench.sources.replay import replay
from truearm.wings.bench.sources.ros2 import ros2
from truearm.wings.bench.sources.sample import Source
from truearm.wings.bench.sources.ur_rtde import ur_rtde
from truearm.wings.bench.sources.virtual_arm import virtual_arm


@dataclass(frozen=True)
class SourceKind:
    """A kind of source.

    Attributes
    ----------
    form : str
        How it is typed: its name, and what the address after the colon and the rest after ``@`` are.
    title : str
        What it is.
    make : callable
        Makes the source from the address, a path where it is a FILE, and from what follows ``@``, if the form has it.
    needs : tuple of str, optional
        Module and extra without which it cannot be opened.
    read_arm : callable, optional
        Reads the arm that its maker identified, where the device states it.
    """

    form: str
    title: str
    make: Callable[..., Source]
    needs: tuple[str, str] | None = None
    read_arm: Callable[[str], Arm] | None = None

    @property
    def name(self) -> str:
        """What it is called."""
        return self.form.partition(":")[0]

    @property
    def has_serial_port(self) -> bool:
        """Whether it may be on a serial port, which needs pyserial."""
        return "CONNECTION" in self.form

    def open(self, address: str, rest: str) -> Source:
        """The source at an address, with what follows ``@``."""
        place = Path(address) if "FILE" in self.form else address
        return self.make(place, rest) if "@" in self.form else self.make(place)


def _speed(text: str) -> float:
    try:
        return float("inf") if text == "max" else float(text or 1)
    except ValueError:
        raise InputError(f"expected a speed, got {text!r:.40}", hint="@10, or @max") from None


KINDS = (
    SourceKind("lines:FILE.toml[@CONNECTION]", "text lines from a serial port, TCP, UDP or standard input", text_lines),
    SourceKind("rtde:HOST[:PORT][@HZ]", "a Universal Robots controller (RTDE)", ur_rtde),
    SourceKind("microscribe:CONNECTION", "a MicroScribe arm", microscribe, read_arm=microscribe_arm),
    SourceKind("feetech:FILE.toml[@CONNECTION]", "an arm of Feetech bus servos (SO-100, SO-101)", feetech),
    SourceKind("dynamixel:FILE.toml[@CONNECTION]", "an arm of Dynamixel X servos (ViperX)", dynamixel),
    SourceKind("ros2:FILE.toml", "joint states on a topic of ROS 2", ros2, ("cyclonedds", "ros2")),
    SourceKind("mqtt:FILE.toml", "messages in JSON of an MQTT broker", mqtt, ("paho", "mqtt")),
    SourceKind(
        "opcua:HOST[:PORT][@DEVICE]", "a robot by OPC UA for Robotics (OPC 40010-1)", opcua, ("asyncua", "opcua")
    ),
    SourceKind("egm:[HOST:]PORT", "an ABB robot that sends EGM to this computer", abb_egm),
    SourceKind("rsi:[HOST:]PORT", "a KUKA robot that sends RSI to this computer", kuka_rsi),
    SourceKind(
        "replay:SESSION[@SPEED]",
        "a session file, reading by reading",
        lambda address, rest: replay(Path(address), _speed(rest)),
    ),
    SourceKind(
        "virtual:ARM[@SPEED]",
        "an arm without errors that moves by itself",
        lambda address, rest: virtual_arm(load_arm(address), speed=_speed(rest)),
    ),
)


def open_source(name: str) -> Source:
    """The source of a name.

    Parameters
    ----------
    name : str
        ``KIND:ADDRESS``; `truearm sources` lists the kinds.

    Raises
    ------
    InputError
        If there is no such kind, its file breaks a rule of its format, or a package is missing.

    Examples
    --------
    >>> import truearm as ta
    >>> samples = ta.open_source("virtual:ur10@max").samples()
    >>> len(next(samples).joint_angles_rad)
    6
    """
    kind, address = _parsed(name)
    first, _, rest = address.partition("@")
    return kind.open(first, rest)


def read_source_arm(name: str) -> Arm:
    """The arm as its maker identified it, read from the device.

    Parameters
    ----------
    name : str
        As of `open_source`.

    Raises
    ------
    InputError
        If such a device states no constants.
    TruearmError
        If the device is not there.
    """
    kind, address = _parsed(name)
    if kind.read_arm is None:
        raise InputError(f"{kind.title} states no constants of its arm", hint="truearm arms, or your own arm file")
    return kind.read_arm(address.partition("@")[0])


def _parsed(name: str) -> tuple[SourceKind, str]:
    word, colon, address = name.partition(":")
    kind = next((one for one in KINDS if one.name == word), None)
    if kind is None or not colon or not address:
        raise InputError(f"expected a source, got {name!r:.80}", hint=", ".join(one.form for one in KINDS))
    return kind, address
