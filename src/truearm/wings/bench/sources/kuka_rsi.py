"""KUKA's robot sensor interface (RSI): datagrams in XML with the joints that the robot reads; it is not answered.

Source: KUKA, "RobotSensorInterface": the element AIPos of the robot's message has the actual axes A1 to A6 in degrees,
IPOC its time.
The configuration on the robot needs ONLYSEND: otherwise RSI stops a robot that is not answered.
"""

from __future__ import annotations

from itertools import count, takewhile
from xml.etree import ElementTree

from truearm.wings.bench.sources.datagrams import datagram_source
from truearm.wings.bench.sources.sample import Source

MOST_BYTES = 8192


def kuka_rsi(address: str) -> Source:
    """Samples of a KUKA robot whose RSI sends to this computer.

    Parameters
    ----------
    address : str
        ``PORT`` or ``HOST:PORT`` of this computer; see `truearm.wings.bench.sources.datagrams.datagram_source`.
    """
    return datagram_source("rsi", address, decode_rsi, "datagrams have no element AIPos with the axes A1 ..")


def decode_rsi(datagram: bytes) -> tuple[list[float], tuple[str]]:
    """The angles in a message of the robot [deg], and its time as it is written.

    Raises
    ------
    ValueError
        If it is none.
    """
    # No entities, which could grow without bound, and no encoding in which they are not seen.
    if len(datagram) > MOST_BYTES or not datagram.isascii() or b"\0" in datagram or b"<!" in datagram:
        raise ValueError("no message of RSI")
    try:
        message = ElementTree.fromstring(datagram)  # noqa: S314, it has no entities
    except (ElementTree.ParseError, LookupError) as error:  # or an encoding that Python does not know
        raise ValueError("no XML") from error
    element = message.find("AIPos")
    axes = {} if element is None else element.attrib
    names = takewhile(axes.__contains__, (f"A{axis}" for axis in count(1)))
    return [float(axes[name]) for name in names], (message.findtext("IPOC", ""),)
