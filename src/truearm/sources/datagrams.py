"""Robots that send datagrams to this computer and are not answered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from truearm.sources.connections import Connection, connected, datagram_connector
from truearm.sources.decoded_messages import SILENT_S, samples_in
from truearm.sources.joint_scale import MOST_JOINTS
from truearm.sources.sample import Sample, Source, Stream

LARGEST_DEG = 7200.0

# The joint angles in a datagram [deg]; ValueError if it is none of the protocol.
JointsDeg = Callable[[bytes], list[float]]


def datagram_source(kind: str, address: str, joints_deg: JointsDeg, misfit: str) -> Source:
    """Samples of the datagrams that come to a port.

    Parameters
    ----------
    kind : str
        Of the source.
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer, as of `truearm.sources.connections.datagram_connector`.
    joints_deg : callable
    misfit : str
        What is wrong with datagrams that have none, in the plural.

    Raises
    ------
    InputError
        If it is no such address.
    """

    def sample(datagram: bytes, arrived_s: float) -> Sample | None:
        try:
            angles = joints_deg(datagram)
        except ValueError:
            return None
        is_pose = 0 < len(angles) <= MOST_JOINTS and all(abs(angle) <= LARGEST_DEG for angle in angles)
        return Sample(arrived_s, np.radians(angles)) if is_pose else None

    def talk(link: Connection) -> Stream:
        return samples_in(_datagrams(link), sample, misfit)

    return Source(f"{kind}:{address}", partial(connected, datagram_connector(address), f"udp:{address}", talk))


def _datagrams(link: Connection) -> Iterator[bytes | None]:
    while True:
        yield link.receive(SILENT_S) or None
