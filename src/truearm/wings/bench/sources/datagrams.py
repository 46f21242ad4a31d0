"""Robots that send datagrams to this computer and are not answered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from truearm.wings.bench.sources.connections import Connection, connected, datagram_connector
from truearm.wings.bench.sources.decoded_messages import REPEATED, SILENT_S, Repeats, samples_in
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS
from truearm.wings.bench.sources.sample import Notice, Sample, Source, Stream

LARGEST_DEG = 7200.0

# The joint angles in a datagram [deg], and what counts and dates it; ValueError if it is none of the protocol.
Decode = Callable[[bytes], tuple[list[float], tuple[object, ...]]]


def datagram_source(kind: str, address: str, decode: Decode, misfit: str) -> Source:
    """Samples of the datagrams that come to a port.

    Parameters
    ----------
    kind : str
        Of the source.
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer, as of `truearm.wings.bench.sources.connections.datagram_connector`.
    decode : callable
    misfit : str
        What is wrong with datagrams that have none, in the plural.

    Raises
    ------
    InputError
        If it is no such address.
    """

    def sample(repeats: Repeats, datagram: bytes, arrived_s: float) -> Sample | Notice | None:
        try:
            angles, stamps = decode(datagram)
        except ValueError:
            return None
        if not (0 < len(angles) <= MOST_JOINTS and all(abs(angle) <= LARGEST_DEG for angle in angles)):
            return None
        if repeats(angles, *stamps):
            return REPEATED
        return Sample(arrived_s, np.radians(angles))

    def talk(link: Connection) -> Stream:
        return samples_in(_datagrams(link), partial(sample, Repeats()), misfit)

    return Source(f"{kind}:{address}", partial(connected, datagram_connector(address), f"udp:{address}", talk))


def _datagrams(link: Connection) -> Iterator[bytes | None]:
    while True:
        yield link.receive(SILENT_S) or None
