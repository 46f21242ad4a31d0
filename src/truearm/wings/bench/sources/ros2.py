"""ROS 2: messages sensor_msgs/msg/JointState on a topic, by DDS and without an installation of ROS; read only.

ROS 2 puts ``rt`` before the name of a topic, and ``dds_`` into that of a type (design.ros2.org, "Topic and Service name
mapping to DDS").
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from truearm.errors import InputError
from truearm.files.toml_documents import read_document
from truearm.wings.bench.sources.connections import connected, extra_package
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS, Each, JointScale, Unit
from truearm.wings.bench.sources.line_pattern import LARGEST
from truearm.wings.bench.sources.sample import REPEATED, SILENT_S, Notice, Repeats, Sample, Source, Stream, samples_in

MOST_WAITING = 64  # messages
MM_PER_M = 1000.0

Name = Annotated[str, Field(min_length=1, max_length=200)]


class Ros2Document(JointScale):
    """The file of an arm that ROS 2 knows.

    Attributes
    ----------
    joints : list of str
        Names of the joints in the messages, base to tip: their order there is another one.
    topic : str
    domain : int
        The ROS_DOMAIN_ID.
    """

    joints: Annotated[tuple[Name, ...], Field(min_length=1, max_length=MOST_JOINTS)]
    topic: Name = "/joint_states"
    domain: Annotated[int, Field(strict=True, ge=0, le=232)] = 0
    unit: Each[Unit] = ("rad",)


def ros2(file: Path) -> Source:
    """Samples of an arm whose joint states are on a topic of ROS 2.

    Parameters
    ----------
    file : Path
        Of a `Ros2Document`. Joints with the unit mm slide: ROS states metres.

    Raises
    ------
    InputError
        If the file breaks a rule of its format, or the package cyclonedds is missing.
    """
    document = read_document(file, Ros2Document)
    _dds("core")
    if len(set(document.joints)) != len(document.joints):
        raise InputError("a name is twice in joints", file=file)
    n = len(document.joints)
    with InputError.of_file(file):
        decode = document.decoder(n)
    factors = np.where(np.isin(np.arange(1, n + 1), document.prismatic(n)), MM_PER_M, 1.0)

    def sample(repeats: Repeats, message: Any, arrived_s: float) -> Sample | Notice | None:
        positions = dict(zip(message.name, message.position, strict=False))
        numbers = np.array([positions.get(joint, np.nan) for joint in document.joints]) * factors
        if not (np.abs(numbers) <= LARGEST).all():
            return None
        stamp = message.header.stamp
        is_repeated = repeats(numbers.tolist(), stamp.sec + 1e-9 * stamp.nanosec)
        return REPEATED if is_repeated else Sample(arrived_s, decode(numbers.tolist()))

    def talk(reader: _Reader) -> Stream:
        lack = f"messages lack a joint of {', '.join(document.joints)}"
        return samples_in(reader.messages(), partial(sample, Repeats()), lack)

    name = f"topic {document.topic} of ROS 2"
    opened = partial(connected, partial(_Reader, document.topic, document.domain), name, talk)
    return Source(f"ros2:{file}", opened, document.prismatic(n))


class _Reader:
    """A reader of a topic; OSError where DDS fails."""

    def __init__(self, topic: str, domain: int) -> None:
        core, sub, policies = map(_dds, ("core", "sub", "qos"))
        kept = policies.Qos(policies.Policy.History.KeepLast(MOST_WAITING))
        self._error = core.DDSException
        with self._failing():
            participant = _dds("domain").DomainParticipant(domain)
            kind = _dds("topic").Topic
            self._reader: Any = sub.DataReader(participant, kind(participant, f"rt{topic}", joint_state()), qos=kept)

    @contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except self._error as error:
            raise ConnectionError(f"DDS: {error}") from None

    def messages(self) -> Iterator[Any]:
        """Messages as they arrive; None once a second while nothing does."""
        silent = _dds("util").duration(seconds=SILENT_S)
        with self._failing():
            while True:
                yield from self._reader.take_iter(timeout=silent)
                yield None

    def close(self) -> None:
        """DDS closes a reader that nobody refers to."""
        del self._reader


def _dds(part: str) -> Any:
    return extra_package(f"cyclonedds.{part}", "ros2", "a topic of ROS 2")


@cache
def joint_state() -> Any:
    """The type sensor_msgs/msg/JointState, as ROS 2 names it in DDS."""
    idl, types = _dds("idl"), _dds("idl.types")

    def struct(package: str, kind: str, /, **fields: Any) -> Any:
        return idl.make_idl_struct(kind, f"{package}::msg::dds_::{kind}_", fields)

    time = struct("builtin_interfaces", "Time", sec=types.int32, nanosec=types.uint32)
    header = struct("std_msgs", "Header", stamp=time, frame_id=str)
    numbers = types.sequence[types.float64]
    names = types.sequence[str]
    return struct(
        "sensor_msgs", "JointState", header=header, name=names, position=numbers, velocity=numbers, effort=numbers
    )
