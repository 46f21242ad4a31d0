"""Several tips on one flange: each has an offset of its own, all of them one arm.

The readings name their tip in the column `tip`. The tip named first takes the place of the arm file's tip; the others
have three more constants each, their offset from the first along the axes of the flange, with the prior of a free tip.
A model of several tips predicts for a named tip; `with_tip` makes it the model of one of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truearm.arm.chain import Chain
from truearm.identification.terms import OfTip, Term, constants
from truearm.readings.session import Session

GROUP = "further tips"
# Names in a sentence.
MOST_LISTED = 6


def tip_names(readings: Session) -> tuple[str, ...]:
    """Names of the tips of a session in the order of its readings; empty if none is named."""
    return () if readings.tip is None else tuple(dict.fromkeys(readings.tip.tolist()))


def further_tip_terms(chain: Chain, tips: tuple[str, ...]) -> list[Term]:
    """Offsets of every tip but the first from the first, with the prior of a free tip."""
    place = chain.n_places - 1
    free = [term for term in constants(chain, free=("tip",), angle_std=0.0, length_std=0.0) if term.place == place]
    return [
        replace(term, name=f"{term.name}, tip {name}", basis=OfTip(name), group=GROUP)
        for name in tips[1:]
        for term in free
    ]


def free_tips(readings: Session, free: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the tips of a session, of which several must be unknown.

    Raises
    ------
    InputError
        If the tip is known: that of the arm file is only one.
    """
    tips = tip_names(readings)
    if len(tips) > 1 and "tip" not in free:
        raise readings.error(
            f"the readings have {len(tips)} tips, and a fit with a known tip has one",
            column="tip",
            hint="let the tip be free (--free base,tip), or fit the readings of one tip",
        )
    return tips


def check_tips(tips: tuple[str, ...], readings: Session) -> None:
    """Check that a model of these tips can predict the readings of a session.

    Raises
    ------
    InputError
        If the model has several and the session names none, or a name is unknown.
    """
    if readings.tip is None:
        if len(tips) > 1:
            raise readings.error(
                f"the model has {len(tips)} tips ({listed_tips(tips)}), and the readings name none",
                column="tip",
                hint=f"add the column tip; or choose one of them: model.with_tip({tips[0]!r}) in Python",
            )
        return
    known = tips or tip_names(readings)[:1]  # a model without a name has one tip
    unknown = ~np.isin(readings.tip, known)
    problem, beside = "expected a tip of the model ({1}), got {0!r}", listed_tips(tips)
    if not tips:
        problem, beside = "expected one tip, as the model has, got {0!r} beside {1!r}", known[0]
    hint = "correct the name; for a new tip fit again, or refit the model of one tip with --free tip"
    readings.refuse(unknown, problem, readings.tip, np.broadcast_to(beside, len(unknown)), column="tip", hint=hint)


def listed_tips(tips: tuple[str, ...]) -> str:
    """Names of tips in a sentence, the first of them."""
    return ", ".join(tips[:MOST_LISTED]) + (f" and {len(tips) - MOST_LISTED} more" if len(tips) > MOST_LISTED else "")
