"""Names in readings that one thing may have in two spellings, and seats that occur once."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator

from truearm.findings import Finding
from truearm.readings.lengths import Lengths
from truearm.readings.readings import NAMED
from truearm.readings.session import Session

# Blanks between two digits separate numbers: 1 1 is no 11.
_BLANKS = re.compile(r"(?<!\d)[\s_]+|[\s_]+(?!\d)")
_MOST = 5  # names in a sentence


def doubtful_names(session: Session, lengths: Lengths | None) -> Iterator[Finding]:
    """`similar_names` and `single_seats`."""
    yield from similar_names(session)
    yield from single_seats(session, lengths)


def similar_names(session: Session) -> Iterator[Finding]:
    """A finding for each name that differs from a more frequent one of its column in case or blanks only."""
    for kind in NAMED:
        if (names := getattr(session, kind)) is None:
            continue
        spelled = defaultdict(list)
        for name, n in Counter(names[names != ""].tolist()).most_common():
            spelled[_BLANKS.sub("", name).casefold()].append(f"{name!r} ({n} reading{'s' * (n != 1)})")
        for usual, *others in spelled.values():
            for other in others:
                what = f"{kind.replace('_', ' ').capitalize()} {other} may be {usual}"
                said = f"{what}: the names differ in case or blanks only. Give one thing one name."
                yield Finding("similar names", said)


def single_seats(session: Session, lengths: Lengths | None) -> Iterator[Finding]:
    """A finding of seats with one reading that are not at the end of a known length: they tie no two poses."""
    if session.seat is None:
        return
    ends = [""] if lengths is None else ["", *lengths.seat_a.tolist(), *lengths.seat_b.tolist()]
    once = [repr(name) for name, n in Counter(session.seat.tolist()).items() if n == 1 and name not in ends]
    shown = ", ".join(once[:_MOST]) + f" and {len(once) - _MOST} more" * (len(once) > _MOST)
    if once:
        said = f"Seats {shown} have a single reading each" if len(once) > 1 else f"Seat {shown} has a single reading"
        yield Finding("single seats", f"{said}, which ties no two poses: ignored as a seat.", {"n": len(once)})
