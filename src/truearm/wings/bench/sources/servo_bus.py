"""Arms of bus servos (Feetech STS and SCS, Dynamixel X): what both protocols share; read only."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from truearm.errors import InputError
from truearm.files.toml_documents import Positive, read_document
from truearm.typing import FloatArray
from truearm.wings.bench.sources.connections import Connection, connected, connector
from truearm.wings.bench.sources.joint_scale import MOST_JOINTS, Each, JointScale, Unit
from truearm.wings.bench.sources.sample import Notice, Sample, Source, Stream

RATE_HZ = 50.0
ANSWER_S = 0.1
MOST_ERRORS = 20  # in a row
MOST_BYTES = 4096
COUNTS_PER_TURN = 4096.0

# Position [counts] and temperature [degC] of each servo that answered, by its number on the bus.
States = Mapping[int, tuple[int, int]]
# The request for the states of servos, and what finds whole answers in bytes, wherever they begin.
Request = Callable[[tuple[int, ...]], bytes]
Answers = Callable[[bytes], States]


class ServoDocument(JointScale):
    """The file of an arm of bus servos.

    Attributes
    ----------
    connection : str
        As of `truearm.wings.bench.sources.connections.connector`; another one may be given on the command line.
    ids : list of int
        Numbers of the servos on the bus, base to tip.
    """

    connection: str = ""
    ids: Annotated[
        tuple[Annotated[int, Field(strict=True, ge=0, le=252)], ...], Field(min_length=1, max_length=MOST_JOINTS)
    ]
    unit: Each[Unit] = ("counts",)
    counts_per_turn: Each[Positive] = (COUNTS_PER_TURN,)


def servo_bus(kind: str, file: Path, connection: str, request: Request, answers: Answers) -> Source:
    """Samples of an arm of bus servos.

    Raises
    ------
    InputError
        If the file breaks a rule of its format, or no connection is given.
    """
    document = read_document(file, ServoDocument)
    connection = connection or document.connection
    if not connection or len(set(document.ids)) != len(document.ids):
        missing = "the key connection is missing" if not connection else "an id is twice in ids"
        raise InputError(missing, file=file, hint="serial:/dev/ttyACM0:1000000" if not connection else None)
    with InputError.of_file(file):
        decode = document.decoder(len(document.ids))
        talk = partial(_samples, document.ids, decode, request, answers)
        opened = partial(connected, connector(connection), connection, talk)
    return Source(f"{kind}:{file}@{connection}", opened, document.prismatic(len(document.ids)))


def _samples(
    ids: tuple[int, ...],
    decode: Callable[[Sequence[float]], FloatArray],
    request: Request,
    answers: Answers,
    link: Connection,
) -> Stream:
    errors, said, due_s = 0, "", time.monotonic()
    while errors < MOST_ERRORS:
        states = _states(ids, request, answers, link)
        if missing := [number for number in ids if number not in states]:
            errors += 1
            if (text := f"no answer from servo {', '.join(map(str, missing))}") != said:
                yield Notice(text)
            said = text
        else:
            errors, said = 0, ""
            temperature = sum(states[number][1] for number in ids) / len(ids)
            angles = decode([float(states[number][0]) for number in ids])
            yield Sample(time.monotonic(), angles, temperature_degC=temperature)
        due_s = max(due_s + 1 / RATE_HZ, time.monotonic() - 1 / RATE_HZ)
        time.sleep(max(0.0, due_s - time.monotonic()))
    raise ConnectionError(said)


def _states(ids: tuple[int, ...], request: Request, answers: Answers, link: Connection) -> States:
    link.send(request(ids))
    data, until_s = b"", time.monotonic() + ANSWER_S
    states: States = {}
    while not set(ids) <= set(states) and (left_s := until_s - time.monotonic()) > 0:
        data = (data + link.receive(left_s))[-MOST_BYTES:]
        states = answers(data)
    return states
